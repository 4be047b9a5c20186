# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy ledger of static stages: works, stored energy, losses.

Loads and displacements of an increment are on straight paths between its ends. The work of
loads f and supports r on the increment x, and the work of the bulk, are exact on these paths:

    (f0 + f1) . x / 2 + (r0 + r1) . x / 2
        = change of (u.K u / 2) + sum of w (t0 + t1) . dg / 2.                               (31a)
The joints have the areas w, tractions t and gap changes dg. Formulas (30) of the laws split their
work into stored energy, friction and numerical loss. `released` computes the energy of a jump.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.errors import warn
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, Response
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.static_energy import StaticEnergy
from dolfinx_joints.simulation.statics.released import released
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.products import Products

EPS = float(np.finfo(np.float64).eps)

# An increment is a jump if it releases more than this fraction of a reference energy: the work of
# the loads during the release plus the energy stored at the start (docs/decisions/two_solvers.md).
RELEASED_SHARE = 0.05

# Smallest loss of an increment that is checked for a jump, divided by the energy stored at its
# start. The loss is friction and numerical loss, of which the energy of a jump is a part.
LEAST_LOSS = 0.1 * RELEASED_SHARE

# Largest error of the energy balance without a warning, divided by the largest energy. Residuals of
# the solvers are at most 1e-6 of the forces.
LARGEST_ERROR = 1e-6


@dataclass(frozen=True, kw_only=True)
class SolvedIncrement:
    """Solution of an increment, with loads, reactions and responses at its start and end.

    Attributes:
        displacement: u at the start [m].
        elastic_force: K u at the start [N].
        change: Displacement increment x [m].
        products: K x and the reactions at the end.
        reaction: Reactions at the start [N].
        loads: Loads by name at the start and at the end [N].
        before: Response of the joints at the start, None without joints.
        after: Response of the joints at the end, None if no joint acts.
        water_moved: True if joint points became wet or dry.
        report: Report of the solver.
    """

    displacement: PETSc.Vec
    elastic_force: PETSc.Vec
    change: PETSc.Vec
    products: Products
    reaction: PETSc.Vec
    loads: tuple[Mapping[str, PETSc.Vec], Mapping[str, PETSc.Vec]]
    before: Response | None
    after: Response | None
    water_moved: bool
    report: SolveReport


class StaticLedger:
    """Adds up works and energies of a static stage, increment by increment.

    ``energy`` contains the energies after the last accepted increment. A stage starts with the
    energies of the last stage, but with the elastic joint energy of the response ``start``. The
    function ``at_place`` sets the strength of the joints at a position of the increment, 0 to 1.
    """

    def __init__(self, system: MatrixSystem, before: StaticEnergy, start: Response | None) -> None:
        """Start the ledger; changes of joint energy between stages are work of construction."""
        self._system = system
        self._zeros: Floats = np.zeros(len(before.joint_elastic))
        self._norm = float(system.stiffness.norm(PETSc.NormType.NORM_INFINITY))
        self._rounding = 0.0
        self.at_place: Callable[[float], None] | None = None
        self.energy = with_stored(before, self._joint_energy(start))

    def after(self, increment: SolvedIncrement) -> StaticEnergy:
        """Return the energies after an increment without adding it to the ledger (collective)."""
        last, x = self.energy, increment.change
        size = float(increment.displacement.norm()) + float(x.norm())
        self._rounding = EPS * self._norm * size**2
        friction, numerical, broken = self._joint_losses(increment)
        works = _works(increment)
        supports = [float(r.dot(x)) for r in (increment.reaction, increment.products.reaction)]
        forces = np.sum([*works.values(), supports], axis=0)
        _, dissipated, bulk_numerical = self._system.bulk_terms(increment.after)
        jump, losses = self._zeros, float(np.abs([friction, numerical]).sum())
        if losses > LEAST_LOSS * self.energy.stored:
            jump = self._released_energy(increment, *forces)
        energy = replace(
            last,
            strain=self._strain(increment),
            joint_elastic=self._joint_energy(increment.after),
            input_by_load=_sum(last.input_by_load, {n: 0.5 * sum(w) for n, w in works.items()}),
            supports=last.supports + 0.5 * sum(supports),
            joint_friction=last.joint_friction + friction,
            joint_numerical=last.joint_numerical + numerical,
            joint_bonds=last.joint_bonds + broken,
            plastic=last.plastic + dissipated,
            bulk_numerical=last.bulk_numerical + bulk_numerical,
            joint_released=last.joint_released + jump * (not increment.water_moved),
            water_released=last.water_released + float(jump.sum()) * increment.water_moved,
        )
        joints = energy.joint_friction + energy.joint_numerical + energy.joint_bonds
        losses = float(joints.sum()) + energy.plastic + energy.bulk_numerical
        sizes = (last.scale, energy.stored, abs(energy.input), abs(losses))
        return replace(energy, error=energy.stored + losses - energy.input, scale=max(sizes))

    def warn(self) -> None:
        """Warn on rank 0 if the energy balance does not close to rounding error (collective)."""
        error, comm = self.energy.relative_error, self._system.stiffness.comm
        is_open = abs(self.energy.error) > LARGEST_ERROR * self.energy.scale + self._rounding
        if is_open and comm.rank == 0:
            warn(
                f"The energy balance of the static stages does not close: {error:.2g} of the "
                "largest energy is missing. Possible causes: rounding errors, with stiff joints or "
                "large displacements, or a law with inconsistent tractions and stored energy."
            )

    def _joint_losses(self, increment: SolvedIncrement) -> Floats:
        """Return the losses of an increment in each joint, shape (3, number of joints), [J].

        The rows are friction, numerical loss, and energy of broken bonds. At points whose bonds
        break, the last row contains the whole loss (collective).
        """
        contact, before, after = self._system.contact, increment.before, increment.after
        if contact is None or before is None or after is None:
            return np.array([self._zeros] * 3)
        traction = 0.5 * (before.traction + after.traction)
        with raised_together(contact.operator.comm):
            lost = contact.losses(BACKWARD_EULER, before.state, after, traction)
        numerical, zero = lost.numerical + lost.impact, np.zeros(len(traction))
        broken = contact.broken(before.state, after.state)
        bonds = [zero, zero, lost.friction + numerical]
        return contact.integrals(np.where(broken, bonds, [lost.friction, numerical, zero]))

    def _released_energy(self, increment: SolvedIncrement, start: float, end: float) -> Floats:
        """Return the energy released in each joint [J], zero if there is no jump (collective).

        ``start`` and ``end`` are R0 and R1 (31b): loads and support forces times x [J].
        """
        contact, before, after = self._system.contact, increment.before, increment.after
        if contact is None or before is None or after is None:
            return self._zeros
        by_joint, meanwhile = released(contact, before, after, start, end, self.at_place)
        limit = RELEASED_SHARE * (meanwhile + self.energy.stored)
        jumps = by_joint.sum() > limit + EPS * self._norm * float(increment.change.norm()) ** 2
        return by_joint if jumps else self._zeros

    def _strain(self, increment: SolvedIncrement) -> float:
        """Return the elastic energy of bulk and springs at the end of an increment (collective)."""
        u, x, force = increment.displacement, increment.change, increment.elastic_force
        stiffness = increment.products.stiffness
        energy = 0.5 * float(u.dot(force)) + float(x.dot(force)) + 0.5 * float(x.dot(stiffness))
        return energy + self._system.bulk_terms(increment.after)[0]

    def _joint_energy(self, joints: Response | None) -> Floats:
        """Return the elastic energy of each joint, shape (number of joints,), [J] (collective)."""
        contact = self._system.contact
        if contact is None or joints is None:
            return self._zeros
        return contact.stored_energy(joints.state)


def with_stored(energy: StaticEnergy, elastic: Floats) -> StaticEnergy:
    """Return the energies with new elastic energies of the joints [J].

    The difference counts as work of construction: grout under pressure stores energy in joints
    without a displacement.
    """
    added = float(np.sum(elastic - energy.joint_elastic))
    if not added:
        return energy
    works = _sum(energy.input_by_load, {"construction": added})
    return replace(energy, joint_elastic=elastic, input_by_load=works)


def _works(increment: SolvedIncrement) -> dict[str, list[float]]:
    """Return each load at start and end of an increment, times x [J] (collective)."""
    x, ends = increment.change, increment.loads
    names = dict.fromkeys([*ends[0], *ends[1]])
    return {
        name: [float(loads[name].dot(x)) if name in loads else 0.0 for loads in ends]
        for name in names
    }


def _sum(works: Mapping[str, float], others: Mapping[str, float]) -> dict[str, float]:
    """Return the sums of works by name [J]."""
    names = dict.fromkeys([*works, *others])
    return {name: works.get(name, 0.0) + others.get(name, 0.0) for name in names}
