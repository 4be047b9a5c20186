# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice of the solver for the steps of a system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from mpi4py import MPI

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import diagonal_compliance
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.effective_matrix import iterates
from dolfinx_joints.solvers.first_that_works import BondReleaseSolver, OtherStarts, StaticSolver
from dolfinx_joints.solvers.newton import NewtonSolver
from dolfinx_joints.solvers.step_solver import SolverOptions, StepSolver

if TYPE_CHECKING:
    from dolfinx_joints.solvers.interface.solver import InterfaceSolver

SolverKind = Literal["auto", "condensed", "monolithic", "forms"]


@checked
def make_solver(
    system: MatrixSystem,
    options: SolverOptions | None = None,
    kind: SolverKind = "auto",
    *,
    static_steps: int = 0,
) -> StepSolver:
    """Return a solver of the steps of a system (collective).

    Args:
        system: The system.
        options: Tolerances and limits.
        kind: ``condensed``, ``monolithic``, ``forms`` or ``auto``. ``auto`` selects the condensed
            solver. It selects the monolithic one for nonlinear cells, and for an iteratively solved
            bulk unless joints are much stiffer than its elements (`STIFF_AT_NODES`). The reference
            ``forms`` is the monolithic solver with joints assembled by interior-facet integrals. If
            the shortest static increment does not converge, other starts are tried; ``auto`` also
            tries other solvers and pseudo-time.
        static_steps: Number of static load steps to be solved; 0 in dynamics.
    """
    if static_steps and system.contact is not None and system.contact.softens:
        _check_softening(system, system.contact)
    solver = _solver_of(system, options, kind, static_steps)
    brittle = system.contact is not None and system.contact.brittle
    return BondReleaseSolver(solver) if brittle else solver


def _check_softening(system: MatrixSystem, contact: Contact) -> None:
    """Check that the elements at each joint point are stiffer than its bond softens (collective).

    Raises:
        JointsError: The equilibrium of a point on its elements is not unique.
    """
    operator, comm = contact.operator, contact.operator.comm
    compliance = diagonal_compliance(operator.matrix, system.stiffness.getDiagonal())
    elements = operator.areas[:, None] * compliance.reshape(-1, 3)
    softening = np.repeat(contact.steepest_softening(), (1, 2), axis=1)
    share = (elements * softening).max(axis=1, initial=0.0)
    ratio = comm.allreduce(float(share.max(initial=0.0)), MPI.MAX)
    if ratio < limits.SOFTENING_COMPLIANCE:
        return
    joint = contact.worst_joint(np.where(share == ratio, 1.0, 0.0))
    change = limits.SOFTENING_COMPLIANCE / ratio
    raise JointsError(
        f"Joint {joint!r}: the compliance of the cells at a joint point times the steepest "
        f"softening of its bond is {ratio:.3g}; it must be below {limits.SOFTENING_COMPLIANCE:g}, "
        f"as statics are not unique from 1 on. Use cells of at most {change:.2g} times their size, "
        f"strengths of at most {change**0.5:.2g} times, or fracture energies of at least "
        f"{1.0 / change:.2g} times the present ones."
    )


def _solver_of(
    system: MatrixSystem,
    options: SolverOptions | None,
    kind: SolverKind,
    static_steps: int,
) -> StepSolver:
    """Return a solver of steps without breaking bonds (collective)."""
    contact = system.contact
    first = _first_solver(system, options, kind, static_steps)
    if not static_steps or contact is None or system.bulk is not None:
        return first
    from dolfinx_joints.solvers.interface.solver import InterfaceSolver
    from dolfinx_joints.solvers.interface.whole import WholeSolver
    from dolfinx_joints.solvers.pseudo_time import PseudoTime

    others: list[Callable[[StepSolver], StepSolver]] = []
    if isinstance(first, InterfaceSolver) or not iterates(system, first.options.linear):
        others.append(lambda _: OtherStarts(first))
    if kind == "auto" and system.control is None:
        if isinstance(first, WholeSolver):
            condensed = InterfaceSolver(system, _for_steps(options, contact, static_steps))
            others += [lambda _: condensed, lambda _: OtherStarts(condensed)]
        elif isinstance(first, InterfaceSolver) and not contact.rigid:
            others.append(lambda _: NewtonSolver(system, options))
        alone = isinstance(first, NewtonSolver) and not isinstance(first, WholeSolver)
        others.append(lambda last: PseudoTime(first if alone else last))
    return StaticSolver(first, *others)


def _first_solver(
    system: MatrixSystem,
    options: SolverOptions | None,
    kind: SolverKind,
    static_steps: int,
) -> NewtonSolver | InterfaceSolver:
    """Return the solver that is tried first in each step (collective)."""
    contact = system.contact
    rigid = contact is not None and contact.rigid
    condenses = contact is not None and system.bulk is None and kind in ("auto", "condensed")
    if system.control is not None and not (condenses and system.symmetric):
        raise JointsError(
            "Controlled loads need the condensed solver: a model with joints, without nonlinear "
            'cells, with symmetric stiffness, and solver="auto" or "condensed".'
        )
    if system.bulk is not None and (kind == "condensed" or rigid):
        which = "" if kind == "condensed" else ", which rigid joints need,"
        raise JointsError(
            f"The condensed solver{which} supports linear bodies only. The body has nonlinear "
            f"cells ({', '.join(system.bulk.kinds)}), which need joint laws with finite "
            'stiffness and solver="auto" or "monolithic".'
        )
    if kind == "forms" and contact is not None:
        if system.coupled is not None:
            raise JointsError(
                'solver="forms" does not support a reservoir with waves: it integrates joints over '
                'the mesh of the body alone. Use solver="monolithic", which gives the same result, '
                "or an added mass instead of the reservoir."
            )
        return NewtonSolver(_by_forms(system, contact), options, name="forms")
    if system.bulk is not None or kind == "monolithic" or contact is None:
        return NewtonSolver(system, options)
    # Imported only if there are joints: a linear run loads no solver of joints.
    from dolfinx_joints.solvers.interface.solver import InterfaceSolver
    from dolfinx_joints.solvers.interface.whole import WholeSolver

    whole = kind == "auto" and system.control is None
    if whole and _suits_multigrid(system, contact, options or SolverOptions()):
        return WholeSolver(system, options)
    return InterfaceSolver(system, _for_steps(options, contact, static_steps))


def _suits_multigrid(system: MatrixSystem, contact: Contact, options: SolverOptions) -> bool:
    """Return True if multigrid solves body and joints in few iterations (collective)."""
    if contact.rigid or not iterates(system, options.linear):
        return False
    operator, diagonal = contact.operator, system.stiffness.getDiagonal()
    compliance = diagonal_compliance(operator.matrix, diagonal).reshape(-1, 3)
    closed = operator.areas[:, None] * np.repeat(contact.closed_stiffness(), (1, 2), axis=1)
    ratio = float((compliance * closed).max(initial=0.0))
    at_nodes = getattr(operator, "quadrature", None) in ("auto", "nodal")
    largest = limits.STIFF_AT_NODES if at_nodes else limits.STIFF_ELSEWHERE
    return bool(operator.comm.allreduce(ratio, MPI.MAX) <= largest)


def _by_forms(system: MatrixSystem, contact: Contact) -> MatrixSystem:
    """Return the system with joints by interior-facet integrals (collective)."""
    bulk = None if system.bulk is None else system.bulk.with_joints(contact.by_forms)
    return replace(system, contact=contact.by_forms, bulk=bulk)


def _for_steps(options: SolverOptions | None, contact: Contact, static_steps: int) -> SolverOptions:
    """Return the options, without a stored compliance if too few solves would use it."""
    options, unknowns = options or SolverOptions(), 3 * contact.operator.num_points
    few = unknowns > limits.LARGEST_WHOLE
    few = few and 0 < limits.STATIC_SOLVE_COLUMNS * static_steps < unknowns
    if few and options.compliance == "auto":
        return replace(options, compliance="matrix-free")
    return options
