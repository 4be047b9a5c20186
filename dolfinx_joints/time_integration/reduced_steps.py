# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint steps of a large body in few shapes of it, checked by the residual of the whole body."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.laws.law import Rule
from dolfinx_joints.model.modes import too_few, whole_groups
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.first_that_works import HoldingBonds
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.dissipation import midpoint_coefficients
from dolfinx_joints.time_integration.midpoint import EnergyConsistent, ImplicitContact, exact_square
from dolfinx_joints.time_integration.reduced_values import BodyValues, Expanded
from dolfinx_joints.time_integration.scheme import Scheme, StepReport
from dolfinx_joints.time_integration.states import DynamicState


@dataclass(frozen=True, kw_only=True)
@checked
class ReducedBulk:
    """Steps in which the body moves in few shapes, where that misses little of the whole body.

    The shapes are the body's responses to a force at every joint unknown, so that joints feel the
    compliance that they feel of the whole body, the lowest modes of the body cut at its joints, and
    its responses to the loads. A step whose error is larger than the tolerance is taken by the
    whole body instead, and what it moved by becomes one more shape.

    Attributes:
        modes: Number of lowest modes.
        tolerance: Largest error of a step, the root of its energy over that of the largest energy
            of motion so far; both kinetic and strain energy, of the part from the start.
    """

    modes: Annotated[int, at.Ge(1)] = 100
    tolerance: Annotated[float, at.Gt(0), at.Lt(1)] = 1e-3


@dataclass(kw_only=True)
class ReducedCounts:
    """What became of the steps of a reduced run, rejected attempts apart.

    Attributes:
        shapes: Of the basis, at the end.
        dofs: Of the whole body.
        reduced: Steps taken in the basis.
        whole: Steps taken by the whole body.
        largest_error: Of the steps taken in the basis, see `ReducedBulk.tolerance`.
    """

    shapes: int = 0
    dofs: int = 0
    reduced: int = 0
    whole: int = 0
    largest_error: float = 0.0


class ReducedSteps:
    """A midpoint scheme that steps in a basis where it can.

    Its states are coordinates, `whole` and `Expanded` give those of the body. After a step of the
    whole body both ends are in the basis: u1 = u0 + x and v1 = 2 x / dt - v0. Nothing is projected
    away, so the energies of both kinds of steps are those of one ledger.

    Args:
        options: Basis and tolerance.
        scheme: Of the steps.
        solver: Of the whole body.
        state: Of the whole body at the start.
        dt: Length of most steps [s].

    Attributes:
        counts: Steps of both kinds; the last attempt is taken for one until the next.
        start: The state at the start.

    Raises:
        JointsError: The system or the scheme has what a basis cannot take.
    """

    def __init__(
        self,
        options: ReducedBulk,
        scheme: Scheme,
        solver: StepSolver,
        state: DynamicState,
        dt: float,
    ) -> None:
        """Make the basis (collective)."""
        from dolfinx_joints.solvers.interface.solver import InterfaceSolver
        from dolfinx_joints.solvers.reduced.basis import ReducedBasis
        from dolfinx_joints.solvers.reduced.whole_body import WholeBody, as_columns

        system = solver.system
        _check(system, scheme, solver)
        assert isinstance(solver, InterfaceSolver)
        self._options, self._scheme, self._solver = options, scheme, solver
        self.rule: Rule = scheme.rule
        self.forces_over_steps = scheme.forces_over_steps
        self._effective = _coefficients(dt)
        separate = replace(system, contact=None)
        shapes = whole_groups(separate, options.modes).shapes
        if not shapes:
            raise too_few("modes", separate, options.modes)
        factors = system.coefficients(
            self._effective.mass, self._effective.damping, self._effective.stiffness
        )
        self._condensed = solver.condensed(self._effective, self.rule)
        patterns = as_columns((v for v, _ in system.patterns), like=shapes[0])
        body = WholeBody(system, self._condensed)
        self.basis = ReducedBasis(body, factors, patterns, as_columns(shapes, like=shapes[0]))
        for vector in (state.displacement, state.velocity, state.acceleration):
            self.basis.add(vector)
        self._factors = factors
        self._reduced: InterfaceSolver | None = None
        self.counts = ReducedCounts(shapes=self.basis.size, dofs=system.mass.getSize()[0])
        self._largest, self._go_on_whole = 0.0, False
        self._tried: tuple[PETSc.Vec | None, float, ReducedCounts] = None, 0.0, self.counts
        self.start = self._in_coordinates(state)
        self._known = self.start, state
        self._before = self.start
        self._rest: NDArray[np.float64] = np.zeros(0)
        self._values = BodyValues(self.basis, system, factors)

    def conserves(self, system: MatrixSystem) -> bool:
        """Whether the balance is exact."""
        return self._scheme.conserves(system)

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """One step of a state of coordinates; see `Scheme.advance` (collective).

        Responses to joint forces are those of steps of one length: the whole body takes all others.
        """
        if state.displacement is self._tried[0]:  # the last attempt was rejected
            _, self._largest, counts = self._tried
            self.counts = replace(counts, shapes=self.basis.size)
        self._tried = state.displacement, self._largest, replace(self.counts)
        if self._go_on_whole or _coefficients(dt) != self._effective:
            return self._by_whole_body(state, dt, end)
        state = self._renewed(state)
        if self._reduced is None:
            from dolfinx_joints.solvers.interface.solver import InterfaceSolver
            from dolfinx_joints.solvers.reduced.system import reduced_system

            self._reduced = InterfaceSolver(
                reduced_system(self._solver.system, self._condensed, self.basis),
                self._solver.options,
            )
        try:
            after, report = self._scheme.advance(self._reduced, state, dt, end)
        except ConvergenceError:
            return self._by_whole_body(state, dt, end)
        error = self._relative(self._missed(state, after), after)
        if error > self._options.tolerance:
            return self._by_whole_body(state, dt, end)
        self.counts.reduced += 1
        self.counts.largest_error = max(self.counts.largest_error, error)
        self._before = state
        return after, report

    def _by_whole_body(
        self, state: DynamicState, dt: float, end: float | None
    ) -> tuple[DynamicState, StepReport]:
        """The step of the whole body; the basis grows by what it moved by (collective)."""
        whole = self.whole(state)
        after, report = self._scheme.advance(self._solver, whole, dt, end)
        x = after.displacement.copy()
        x.axpy(-1.0, whole.displacement)
        missed, size = self.basis.missed(x), self.basis.size
        self.basis.add(x)
        if self.basis.size > size:
            self._reduced = None
        reduced = self._in_coordinates(after)
        self._known = reduced, after
        self._go_on_whole = self._relative(missed, reduced) > self._options.tolerance
        self.counts.whole += 1
        self.counts.shapes = self.basis.size
        change = self.basis.whole(reduced.acceleration) - self.basis.whole(state.acceleration)
        error = float(np.linalg.norm(change)) * dt**2 / 12.0
        return reduced, replace(report, local_error=error)

    def _missed(self, before: DynamicState, after: DynamicState) -> float:
        """Energy of the error of a step in the basis [J] (collective)."""
        of_mass, of_stiffness = self._factors
        inertia = after.rate * self.basis.whole(before.velocity)
        inertia += of_mass / of_stiffness * self.basis.whole(before.displacement)
        loads = self._solver.system.mean_factors(before.time, after.time)
        return self.basis.error(inertia, loads)

    def _relative(self, energy: float, after: DynamicState) -> float:
        """Root of an energy over that of the largest of motion, ``after`` included."""
        whole = self.basis.whole
        if len(self._rest) < self.basis.size:
            self._rest = self.basis.stiffness @ whole(self.start.displacement)
        moved = whole(after.displacement) - whole(self.start.displacement)
        stretch = 0.5 * moved @ (whole(after.elastic_force) - self._rest)
        self._largest = largest = max(self._largest, after.kinetic_energy + float(stretch))
        return math.sqrt(energy / largest) if largest > 0.0 else 0.0

    # ------------------------------------------------------------ states

    def whole(self, state: DynamicState) -> DynamicState:
        """State of the whole body, from one of coordinates (collective)."""
        reduced, known = self._known
        if state.displacement is reduced.displacement:
            return replace(known, time=state.time)
        system, shown = self._solver.system, self._shown(state)
        momentum, elastic_force = (shown.displacement.duplicate() for _ in range(2))
        system.mass.mult(shown.velocity, momentum)
        system.stiffness.mult(shown.displacement, elastic_force)
        return replace(
            state,
            displacement=shown.displacement,
            velocity=shown.velocity,
            acceleration=shown.acceleration,
            load=system.load(state.time, momentum.duplicate()),
            reaction=shown.reaction,
            momentum=momentum,
            elastic_force=elastic_force,
            remainder=None,
        )

    def distance(self, state: DynamicState) -> float:
        """Norm of the coordinates of the displacement from the start (collective)."""
        moved = self.basis.whole(state.displacement) - self.basis.whole(self.start.displacement)
        return float(np.linalg.norm(moved))

    def shown(self, state: DynamicState) -> DynamicState | Expanded:
        """Vectors of the body, made when they are asked for."""
        known = state.displacement is self._known[0].displacement
        return self.whole(state) if known else self._shown(state)

    def _shown(self, state: DynamicState) -> Expanded:
        return Expanded(self._values, self._before, state)

    def _renewed(self, state: DynamicState) -> DynamicState:
        """The state in the basis as it is: forces of a smaller one lack rows (collective)."""
        if state.displacement.getSize() == self.basis.size:
            return state
        return self._in_coordinates(self.whole(state))

    def _in_coordinates(self, state: DynamicState) -> DynamicState:
        """State of coordinates, from one of the body that is in the basis (collective)."""
        basis, vector, system = self.basis, self.basis.coordinate_vector, self._solver.system
        u, v, a = (
            basis.coordinates(each)
            for each in (state.displacement, state.velocity, state.acceleration)
        )
        return replace(
            state,
            displacement=vector(u),
            velocity=vector(v),
            acceleration=vector(a),
            load=vector(basis.loads @ system.mean_factors(state.time, state.time)),
            reaction=vector(np.zeros(basis.size)),
            momentum=vector(basis.mass @ v),
            elastic_force=vector(basis.stiffness @ u),
            remainder=None,
        )


def _coefficients(dt: float) -> MatrixCoefficients:
    """Those of a midpoint step of length dt [s]."""
    return midpoint_coefficients(exact_square(2.0 / dt), 1.0, 0)


def _check(system: MatrixSystem, scheme: Scheme, solver: StepSolver) -> None:
    """Check that steps of the system can be taken in a basis (collective)."""
    from dolfinx_joints.solvers.interface.solver import InterfaceSolver

    plain = isinstance(scheme, EnergyConsistent | ImplicitContact) and (
        not scheme.exact_modes and scheme.spectral_radius == 1.0
    )
    comm = system.mass.comm.tompi4py()
    wrong = {
        "a scheme other than EnergyConsistent() and ImplicitContact()": not plain,
        "bonds or keys that break": isinstance(solver, HoldingBonds),
        "a solver other than the condensed one": not isinstance(solver, InterfaceSolver),
        "moving supports": system.values is not None,
        "waves in a reservoir": system.coupled is not None,
        "dashpots": system.dashpots is not None or system.absorption is not None,
        "damping ratios of modes": system.damped_modes is not None,
        "unsymmetric matrices": not system.symmetric,
        "water that follows the joints": system.water is not None,
        "dofs without mass": sum(comm.allgather(len(system.massless))) > 0,
    }
    for what, there in wrong.items():
        if there:
            raise JointsError(f"reduced is given, but the run has {what}, which it cannot take.")
