# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equilibria with divided strengths or multiplied loads, each from the previous equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.laws.strength import divided
from dolfinx_joints.loads.load import Load
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.statics.load_increments import Increment
from dolfinx_joints.simulation.statics.stage import Equilibrium
from dolfinx_joints.simulation.statics.stage_start import carried_loads, start_of_stage
from dolfinx_joints.solvers.choice import SolverKind, make_solver
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.step_solver import SolverOptions

# Durations of the motion from rest that shows the mechanism [s], tried in turn. In longer motions
# the mechanism exceeds the elastic displacements more, but rounding errors may prevent a solution.
MOTION_TIMES = 0.3, 0.1, 0.03, 0.01


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Static increment from the last equilibrium to a factor.

    Attributes:
        factor: F.
        outcome: ``equilibrium``, ``jump`` to a distant equilibrium, or ``no equilibrium``.
        displacement: Largest change of a displacement component since the first state [m].
    """

    factor: float
    outcome: str
    displacement: float = float("nan")


class FailureTrials(Equilibrium):
    """Trials at changing factors; each equilibrium is the start of the next trials.

    ``acting`` are the loads at a time [s]. The factor multiplies those with names ``multiplied``,
    and divides the strengths of ``joints``. The attribute ``trials`` lists all trials. Other
    arguments are those of `march`.
    """

    def __init__(
        self,
        model: Model,
        before: StaticState,
        acting: Sequence[Load],
        options: SolverOptions,
        kind: SolverKind,
        *,
        time: float,
        joints: Sequence[str],
        multiplied: Sequence[str],
    ) -> None:
        """Prepare the system and its solver; the joints get a copy of their laws (collective)."""
        assert model.contact is not None
        self._laws, self._joints, self._multiplied = model.contact.laws, joints, multiplied
        self._contact = contact = model.contact.with_own_laws()
        system = model.system(only=acting, static=True)
        bulk = None if system.bulk is None else system.bulk.with_joints(contact)
        system = replace(system, contact=contact, bulk=bulk)
        start = start_of_stage(system, before)
        solver = make_solver(system, options, kind, static_steps=1)
        super().__init__(
            system, solver, before, start, carried_loads(system, before, start), constant=False
        )
        self.ledger.at_place = self._divide_on_path if joints else None
        self._first, self._factors = before.displacement, (1.0, 1.0)
        ends = {"share": 1.0, "start": 0.0}
        self._increment = Increment(time=time, whole=True, shortest=True, step=1, **ends)
        self.trials: list[Trial] = []

    def run(self, factor: float, *, all_solvers: bool) -> bool:
        """Solve at a factor; return True and accept the equilibrium if there is no jump.

        With ``all_solvers`` other starts, other solvers and pseudo-time are tried as well.

        Raises:
            ConvergenceError: A law returned NaN or infinity.
            JointsError: The iteration on water in joints does not converge.
        """
        free_petsc_garbage(self._contact.operator.comm)
        self._set(factor)
        increment = replace(self._increment, shortest=all_solvers)
        try:
            solved = self.solve(increment)
        except ConvergenceError as failure:
            if failure.law is not None:
                raise
            self.trials.append(Trial(factor=factor, outcome="no equilibrium"))
            return False
        energy = self.ledger.after(solved)
        stable = energy.released <= self.ledger.energy.released
        change = self.displacement - self._first + solved.change
        outcome, size = "equilibrium" if stable else "jump", change.norm(PETSc.NormType.INFINITY)
        self.trials.append(Trial(factor=factor, outcome=outcome, displacement=float(size)))
        if stable:
            self.ledger.energy, self._factors = energy, (factor, factor)
            self.accept(solved, increment)
        return stable

    def acceleration(self, factor: float) -> PETSc.Vec | None:
        """Return the acceleration at a factor, from rest at the last equilibrium [m/s^2] (31d).

        It is the mean in an implicit step over one of the `MOTION_TIMES`. The result is None if the
        body has no mass or no step converges (collective).
        """
        self._set(factor)
        for time in MOTION_TIMES if self._system.mass.norm() else ():
            inertia = MatrixCoefficients(mass=1.0 / time**2, damping=0.0, stiffness=1.0)
            try:
                return self.move(self._increment, inertia) / time**2
            except JointsError:
                continue
        return None

    def _loads(self, increment: Increment) -> dict[str, PETSc.Vec]:
        """Return the loads by name at the factor [N] (collective)."""
        loads = super()._loads(increment)
        for name in self._multiplied:
            loads[name].scale(self._factors[1])
        return loads

    def _set(self, factor: float) -> None:
        """Set the factor at the end of the next increment."""
        self._factors = self._factors[0] if self.reports else factor, factor
        self._divide_on_path(1.0)

    def _divide_on_path(self, place: float) -> None:
        """Set the strength at a place of the increment, from 0 to 1; it varies linearly."""
        start, end = self._factors
        factor = 1.0 / ((1.0 - place) / start + place / end)
        users = {id(self._laws[name]): name for name in self._joints}
        made = {key: divided(self._laws[name], factor, name) for key, name in users.items()}
        self._contact.set_laws(
            self._laws | {name: made[id(self._laws[name])] for name in self._joints}
        )
