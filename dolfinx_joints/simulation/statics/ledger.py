# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy ledger of static stages: works, stored energy, losses, and the energy that jumps release.

Loads and displacements of an increment lie on straight paths between its ends. The work of the
loads f and the supports r on the increment x is exact on these paths, and so is that of the bulk:

    (f0 + f1) . x / 2 + (r0 + r1) . x / 2
        = change of (u.K u / 2) + sum of w (t0 + t1) . dg / 2.                               (31a)

The work on the joints splits into stored energy, friction and numerical loss by the formulas (30)
of the laws. The released energy is the work of the out-of-balance forces along the path,

    sum of w [(t0 + t1) . dg / 2 - integral of t(g0 + s dg) . dg over s from 0 to 1].        (31b)

It tends to zero with the increment if equilibria follow each other continuously, and is negative in
joints that begin to slide. If the structure jumps, it is the energy that would set it in motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, JointState, Response
from dolfinx_joints.laws.losses import work
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.static_energy import StaticEnergy
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.products import Products

# Gauss's rule for each half of a path (cut where the joint opens or closes).
_GAUSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, kw_only=True)
class SolvedIncrement:
    """Solution of an increment with what acts at both of its ends.

    Attributes:
        displacement: u at the start [m].
        elastic_force: K u at the start [N].
        change: x [m].
        products: K x and the reactions at the end.
        reaction: Reactions at the start [N].
        loads: Loads by name at the start and at the end [N].
        before: Response of the joints at the start, None without joints.
        after: Response of the joints at the end, None if no joint acts.
        water_moved: Whether water entered or left joint points.
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
    """Add up works and energies of a static stage, increment by increment.

    Args:
        system: The system of the stage.
        names: Names of all joints of the model.
        before: Energies after the last stage, None for the unloaded body.
        start: Response of the joints and of plastic cells at the start, None without any.

    Attributes:
        energy: Energies after the last accepted increment.
    """

    def __init__(
        self,
        system: MatrixSystem,
        names: Sequence[str],
        before: StaticEnergy | None,
        start: Response | None,
    ) -> None:
        """Begin; stored energy that changed since the last stage is work of the construction."""
        self._system, self._names = system, names
        self.energy = energy = before or _nothing(len(names))
        elastic = self._elastic(start)
        added = float(np.sum(elastic - energy.joint_elastic))
        if added:
            works = _sum(energy.input_by_load, {"construction": added})
            self.energy = replace(energy, joint_elastic=elastic, input_by_load=works)

    def after(self, increment: SolvedIncrement) -> StaticEnergy:
        """Return the energies after an increment; the ledger stays as it is (collective)."""
        last, x = self.energy, increment.change
        friction, numerical, broken, released = self._of_joints(increment)
        released = released * bool(released.sum() > 0.0)
        moved = 0.5 * (increment.reaction.dot(x) + increment.products.reaction.dot(x))
        energy = replace(
            last,
            strain=self._strain(increment),
            joint_elastic=self._elastic(increment.after),
            input_by_load=_sum(last.input_by_load, _works(increment)),
            supports=last.supports + float(moved),
            joint_friction=last.joint_friction + friction,
            joint_numerical=last.joint_numerical + numerical,
            joint_bonds=last.joint_bonds + broken,
            plastic=last.plastic + self._plastic(increment.after),
            joint_released=last.joint_released + released * (not increment.water_moved),
            water_released=last.water_released + float(released.sum()) * increment.water_moved,
        )
        joints = energy.joint_friction + energy.joint_numerical + energy.joint_bonds
        lost = float(joints.sum()) + energy.plastic
        sizes = (last.scale, energy.stored, abs(energy.input), abs(lost))
        return replace(energy, error=energy.stored + lost - energy.input, scale=max(sizes))

    def turned_over(self, energy: StaticEnergy) -> float:
        """Return the work of the increment to these energies plus the energy then stored [J]."""
        return abs(energy.input - self.energy.input) + energy.stored

    def _of_joints(self, increment: SolvedIncrement) -> Floats:
        """Return what an increment loses in each joint, shape (4, number of joints), [J].

        The rows are friction, numerical loss, energy lost with bonds, and released energy; points
        whose bonds break count in the third row alone (collective).
        """
        contact, before, after = self._system.contact, increment.before, increment.after
        if contact is None or before is None or after is None:
            return np.zeros((4, len(self._names)))
        traction = 0.5 * (before.traction + after.traction)
        with raised_together(contact.operator.comm):
            lost = contact.losses(BACKWARD_EULER, before.state, after, traction)
        numerical = lost.numerical + lost.impact
        released = numerical
        if not contact.rigid:
            taken = work(traction, after.state.gap - before.state.gap)
            released = taken - path_work(contact, before.state, after.state.gap)
        broken = contact.broken(before.state, after.state)
        whole = [lost.friction, numerical, np.zeros_like(released), released]
        bonds = [np.zeros_like(released)] * 2 + [lost.friction + numerical, np.zeros_like(released)]
        return contact.integrals(np.where(broken, bonds, whole))

    def _strain(self, increment: SolvedIncrement) -> float:
        """Return the elastic energy of bulk and springs at the end of an increment (collective)."""
        u, x, force = increment.displacement, increment.change, increment.elastic_force
        stiffness, bulk, after = increment.products.stiffness, self._system.bulk, increment.after
        energy = 0.5 * float(u.dot(force)) + float(x.dot(force)) + 0.5 * float(x.dot(stiffness))
        if bulk is None or after is None:
            return energy
        return energy + bulk.elastic_correction(after.state)

    def _plastic(self, after: Response | None) -> float:
        """Return the plastic work of the increment that led to a response (collective)."""
        bulk = self._system.bulk
        return 0.0 if bulk is None or after is None else bulk.dissipation(after)

    def _elastic(self, joints: Response | None) -> Floats:
        """Return the elastic energy of each joint, shape (number of joints,), [J] (collective)."""
        contact = self._system.contact
        if contact is None or joints is None:
            return np.zeros(len(self._names))
        return contact.stored_energy(joints.state)


def _nothing(joints: int) -> StaticEnergy:
    """Return the energies of the unloaded body with a number of joints."""
    none = np.zeros(joints)
    return StaticEnergy(
        strain=0.0,
        joint_elastic=none,
        input_by_load={},
        supports=0.0,
        joint_friction=none,
        joint_numerical=none,
        joint_bonds=none,
        plastic=0.0,
        joint_released=none,
        water_released=0.0,
        error=0.0,
        scale=0.0,
    )


def _works(increment: SolvedIncrement) -> dict[str, float]:
    """Return the work of each load on an increment [J] (collective)."""
    x, (start, end) = increment.change, increment.loads
    names = dict.fromkeys([*start, *end])
    forces = {name: [each[name] for each in (start, end) if name in each] for name in names}
    return {name: 0.5 * sum(float(f.dot(x)) for f in each) for name, each in forces.items()}


def _sum(works: Mapping[str, float], more: Mapping[str, float]) -> dict[str, float]:
    """Return the sums of works by name [J]."""
    names = dict.fromkeys([*works, *more])
    return {name: works.get(name, 0.0) + more.get(name, 0.0) for name in names}


def path_work(contact: Contact, before: JointState, gap: Floats) -> Floats:
    """Return the work of the laws on the straight path from a state to a gap (collective).

    Each half of the path has a Gauss rule of its own; a path on which the joint opens or closes is
    cut there instead.

    Args:
        contact: The joints, of laws whose tractions follow from the gap.
        before: State at the start of the path.
        gap: Gap at its end, shape (n, 3), [m].

    Returns:
        Work per area of each local point, shape (n,), [J/m^2].
    """
    way, start, end = gap - before.gap, before.gap[:, 0], gap[:, 0]
    crosses = (start > 0.0) != (end > 0.0)
    middle = np.divide(start, start - end, out=np.full(len(gap), 0.5), where=crosses)
    total = np.zeros(len(gap))
    for first, length in ((np.zeros(len(gap)), middle), (middle, 1.0 - middle)):
        for node, weight in zip(*_GAUSS, strict=True):
            place = first + 0.5 * (1.0 + node) * length
            response = contact.at_gap(before.gap + place[:, None] * way, before)
            total += 0.5 * weight * length * work(response.traction, way)
    return total
