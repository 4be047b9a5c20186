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
from dolfinx_joints.loads.load import Load, load_names
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
    """Result of a trial: a static increment from the last equilibrium to a factor.

    Attributes:
        factor: F.
        outcome: ``equilibrium``, ``jump`` to a distant equilibrium, or ``no equilibrium``.
        displacement: Largest change of a displacement component since the first state [m].
        released: Energy that the increment releases [J], see (31b).
        sliding: Share of the joint points that slide or are open.
        iterations: Iterations of the solver, 0 if no solution was found.
    """

    factor: float
    outcome: str
    displacement: float = float("nan")
    released: float = 0.0
    sliding: float = float("nan")
    iterations: int = 0

    @property
    def stable(self) -> bool:
        """True if the increment ends at an equilibrium without a jump."""
        return self.outcome == "equilibrium"


class _AtFactor(Equilibrium):
    """Equilibrium under loads of which the ``multiplied`` ones have a factor."""

    multiplied: Sequence[str] = ()
    factor = 1.0

    def _loads(self, increment: Increment) -> dict[str, PETSc.Vec]:
        """Return the loads by name at the factor [N] (collective)."""
        loads = super()._loads(increment)
        for name in self.multiplied:
            loads[name].scale(self.factor)
        return loads


class FailureTrials:
    """Trials at increasing factors; each stable trial is the start of the next ones.

    Args:
        model: The model.
        before: State from which the first trial starts.
        acting: Loads that act.
        time: Time at which the loads are evaluated [s].
        joints: Names of the joints whose strength is divided, empty for multiplied loads.
        multiplied: Loads that are multiplied.
        options: Tolerances and limits of Newton's method.
        kind: Solver, see `make_solver`.

    Attributes:
        rows: All trials so far.
        factor: Factor of the last equilibrium, None before the first one.
    """

    def __init__(
        self,
        model: Model,
        before: StaticState,
        acting: Sequence[Load],
        *,
        time: float,
        joints: Sequence[str],
        multiplied: Sequence[Load],
        options: SolverOptions,
        kind: SolverKind,
    ) -> None:
        """Prepare the system and its solver; the joints get a copy of their laws (collective)."""
        assert model.contact is not None
        self._laws, self._joints = model.contact.laws, joints
        self._contact = contact = model.contact.with_laws(self._laws)
        system = model.system(only=acting, static=True)
        bulk = None if system.bulk is None else system.bulk.with_joints(contact)
        self._system = system = replace(system, contact=contact, bulk=bulk)
        start = start_of_stage(system, before)
        solver = make_solver(system, options, kind, static_steps=1)
        carried = carried_loads(system, before, start)
        self._last = _AtFactor(system, solver, before, start, carried, constant=False)
        named = zip(load_names(model.loads), model.loads, strict=True)
        of_loads = {name: load for name, load in named}
        self._last.multiplied = [n for n, load in of_loads.items() if _contains(multiplied, load)]
        self._missing = tuple(n for n, load in of_loads.items() if not _contains(acting, load))
        self._last.ledger.at_place = self._divide_on_path
        self._solver, self._start = solver, before.displacement
        self._increment = Increment(
            time=time, share=1.0, whole=True, shortest=True, step=1, start=0.0
        )
        self._strengths = 1.0, 1.0
        self.rows: list[Trial] = []
        self.factor: float | None = None

    @property
    def state(self) -> StaticState:
        """Last equilibrium."""
        return self._last.state({"missing": self._missing})

    def run(self, factor: float, *, all_solvers: bool) -> bool:
        """Solve for the equilibrium at a factor; return True and accept it if it is stable.

        Args:
            factor: F.
            all_solvers: True if other starts, other solvers and pseudo-time are tried as well.

        Raises:
            ConvergenceError: A law returned NaN or infinity.
            JointsError: The iteration on water in joints does not converge.
        """
        last = self._last
        free_petsc_garbage(self._contact.operator.comm)
        self._set(factor)
        increment = replace(self._increment, shortest=all_solvers)
        try:
            solved = last.solve(increment)
        except ConvergenceError as failure:
            if failure.law is not None:
                raise
            self.rows.append(Trial(factor=factor, outcome="no equilibrium"))
            return False
        energy = last.ledger.after(solved)
        released = energy.released - last.ledger.energy.released
        change = last.displacement - self._start
        change.axpy(1.0, solved.change)
        assert solved.after is not None
        counts = self._contact.counts(solved.after.status)
        self.rows.append(
            Trial(
                factor=factor,
                outcome="jump" if released > 0.0 else "equilibrium",
                displacement=float(change.norm(PETSc.NormType.INFINITY)),
                released=released,
                sliding=(counts.slip + counts.open) / max(counts.total, 1),
                iterations=solved.report.iterations,
            )
        )
        if released > 0.0:
            return False
        last.ledger.energy, self.factor = energy, factor
        last.accept(solved, increment)
        return True

    def acceleration(self, factor: float) -> PETSc.Vec | None:
        """Return the acceleration at the start of a motion at a factor [m/s^2] (collective).

        The motion starts from rest at the last equilibrium and takes one implicit step of one of
        the `MOTION_TIMES`. The result is None if the body has no mass or no step converges.
        """
        self._set(factor)
        for time in MOTION_TIMES if self._system.mass.norm() else ():
            inertia = MatrixCoefficients(mass=1.0 / time**2, damping=0.0, stiffness=1.0)
            try:
                moved = self._last.move(self._increment, inertia)
            except JointsError:
                continue
            moved.scale(1.0 / time**2)
            return moved
        return None

    def _set(self, factor: float) -> None:
        """Set strengths or loads of the next increment."""
        if self._joints:
            self._strengths = 1.0 / (self.factor or factor), 1.0 / factor
            self._divide_on_path(1.0)
        self._last.factor = 1.0 if self._joints else factor

    def _divide_on_path(self, place: float) -> None:
        """Set the strength at a place of the increment, from 0 to 1; it varies linearly."""
        if self._joints:
            start, end = self._strengths
            factor = 1.0 / ((1.0 - place) * start + place * end)
            laws = {id(law): law for law in (self._laws[name] for name in self._joints)}
            made = {key: divided(law, factor) for key, law in laws.items()}
            changed = {name: made[id(self._laws[name])] for name in self._joints}
            self._contact.set_laws({**self._laws, **changed})


def _contains(loads: Sequence[Load], load: Load) -> bool:
    """Return True if a load is one of the given loads."""
    return any(load is one for one in loads)
