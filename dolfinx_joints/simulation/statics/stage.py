# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One static stage: from the last static state through load steps, and what may follow it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.loads.load import Load, always, load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.statics.construction import with_inactive
from dolfinx_joints.simulation.statics.joint_water_iteration import JointWaterIteration
from dolfinx_joints.simulation.statics.jumps import Jumps
from dolfinx_joints.simulation.statics.ledger import SolvedIncrement, StaticLedger
from dolfinx_joints.simulation.statics.load_increments import Increment, LoadIncrements
from dolfinx_joints.simulation.statics.stage_start import carried_loads, start_of_stage
from dolfinx_joints.simulation.statics.unfinished import Unfinished
from dolfinx_joints.solvers.choice import SolverKind, make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC
from dolfinx_joints.solvers.first_that_works import BondReleaseSolver, StaticSolver
from dolfinx_joints.solvers.step_solver import SolveReport, SolverOptions, StepSolver
from dolfinx_joints.time_integration.products import Products


def march(
    model: Model,
    before: StaticState,
    path: Sequence[tuple[float | None, float]],
    acting: Sequence[Load],
    *,
    options: SolverOptions,
    kind: SolverKind,
    watch: SmallDisplacements,
    stage: Unfinished | None = None,
    apart: Floats | None = None,
    allow_jumps: bool = False,
    reached: Callable[[float, StaticState], None] | None = None,
) -> StaticState:
    """Return the equilibrium at the end of a path of load steps (collective).

    An increment is cut in halves if its solve does not converge, or if it releases energy (31b).
    Each step of the path has a time [s], None for a ramp at time zero, and its share of the way
    from the loads and prescribed displacements of ``before`` to those at this time. ``acting`` are
    those of the model's loads that act; without a ``stage`` all joints and blocks do. Tractions on
    the faces of joints ``apart``, shape (n, 3), [Pa], are added to the loads of ``before``, and no
    other load changes then. ``reached`` is called with time [s] and state after each step.

    Raises:
        JumpError: No equilibrium without a jump was found and ``allow_jumps`` is false.
        ConvergenceError: No equilibrium was found.
    """
    system, contact = model.system(only=acting, static=True), model.contact
    start = start_of_stage(system, before)
    carried = carried_loads(system, before, start)
    named = zip(load_names(model.loads), model.loads, strict=True)
    missing = tuple(n for n, one in named if not any(one is other for other in acting))
    facts: dict[str, Any] = {"missing": missing}
    if apart is not None and contact is not None:
        facts["loads"] = before.loads
        system = _under(system, before, contact.operator, apart)
    if stage is not None:
        facts |= {"inactive": stage.inactive, "absent": stage.absent}
        idle = None if contact is None else contact.without(stage.idle)
        system = _holding(replace(system, contact=idle), before, stage.dofs)
    solver = make_solver(system, options, kind, static_steps=len(path))
    at = _Equilibrium(system, solver, before, start, carried, stays=apart is not None)
    increments, jumps = LoadIncrements(path), Jumps(at.ledger, model, allow_jumps)
    progress = Progress("static stage", len(path), "steps", model.jointed.mesh.comm.rank)
    for increment in _accepted(at, increments, jumps, kind, watch):
        free_petsc_garbage(model.jointed.mesh.comm)
        progress.advance(int(increment.whole))
        if reached is not None and increment.whole:
            facts |= {"cuts": increments.cuts, "jumps": jumps.of_step(increment.step)}
            reached(increment.time or 0.0, at.state(facts))
    progress.finish()
    watch.warn("in a static stage")
    at.ledger.warn()
    if stage is not None:
        # Blocks that are absent have no loads and no supports.
        for force in (at.reaction, *at.loads.values()):
            force.getArray()[stage.dofs] = 0.0
        if contact is not None:
            at.response = with_inactive(contact, at.response, before, at.displacement, stage)
    return at.state(facts | {"cuts": increments.cuts, "jumps": jumps.found})


def _accepted(
    at: _Equilibrium,
    increments: LoadIncrements,
    jumps: Jumps,
    kind: SolverKind,
    watch: SmallDisplacements,
) -> Iterator[Increment]:
    """Solve the increments, cut where they fail; yield those that are accepted (collective)."""
    for increment in increments:
        try:
            solved = at.solve(increment)
        except ConvergenceError as failure:
            watch.warn("in a static stage")
            if increment.shortest:
                remedy = _remedy(failure, kind, at.solver.name, increment.start)
                raise increment.located(failure, remedy) from None
            increments.cut()
            continue
        energy = at.ledger.after(solved)
        if increment.shortest:
            jumps.take(energy, increment)
        elif energy.released > at.ledger.energy.released:
            increments.cut()
            continue
        at.ledger.energy = energy
        at.accept(solved, increment)
        if at.joints is not None:
            watch.record(at.joints.gap)
        yield increment


class _Equilibrium:
    """The last accepted equilibrium of a stage, and the solution of the next increment.

    Attributes are those of a `StaticState`; ``joints`` is the state of the joints, None without
    any, and ``response`` their response. The solver includes the iteration on water in joints.
    """

    def __init__(
        self,
        system: MatrixSystem,
        solver: StepSolver,
        before: StaticState,
        start: Response | None,
        carried: Mapping[str, PETSc.Vec],
        *,
        stays: bool,
    ) -> None:
        """Start from a static state with a response and loads [N] (collective).

        If ``stays`` is true, these loads keep their value while those of the system are added.
        """
        self._system, self._stays, self._unloaded = system, stays, before.unloaded
        self._without_water = self.solver = solver
        self.displacement, self.reaction = before.displacement.copy(), before.reaction.copy()
        self._start = None if system.internal_forces is None else start
        self.response: Response | None = None
        self.joints = None if self._start is None else self._start.state
        if system.water is not None and self.joints is not None:
            self.solver = JointWaterIteration(system.water, solver)
        self.reports: list[SolveReport] = []
        self._elastic_force = system.stiffness * self.displacement
        self._b, self._x = system.vector(), system.vector()
        self.loads = self._step_loads = carried
        self._supported = self.displacement.getArray()[system.constrained]
        self.ledger = StaticLedger(system, before.energy, self._start)

    def state(self, facts: Mapping[str, Any]) -> StaticState:
        """Return the equilibrium as a state of the stage, with further facts."""
        return StaticState(
            displacement=self.displacement.copy(),
            joints=self.response,
            reaction=self.reaction,
            reports=list(self.reports),
            energy=self.ledger.energy,
            **{"loads": self.loads, **facts},
        )

    def solve(self, increment: Increment) -> SolvedIncrement:
        """Return the solution of an increment; the last accepted one does not change (collective).

        Raises:
            ConvergenceError: No solution was found.
        """
        system, x, water = self._system, self._x, self._system.water
        self._set_up(increment)
        # From the unloaded body without gaps the equations scale with the load: a shorter increment
        # fails as well.
        unloaded = self._unloaded and increment.whole and not self.reports
        _prepare(self._without_water, increment.shortest or unloaded, self._start)
        response, report = self.solver.solve(STATIC, self._b, x, self.joints)
        products = Products(system, STATIC, self._b, x, response)
        moved = water is not None and bool(water.toggled(water.codes, water.entered).any())
        return SolvedIncrement(
            displacement=self.displacement,
            elastic_force=self._elastic_force,
            change=x,
            products=products,
            reaction=self.reaction,
            loads=(self.loads, self._loads(increment)),
            before=self._start,
            after=response,
            water_moved=moved,
            report=report,
        )

    def accept(self, solved: SolvedIncrement, increment: Increment) -> None:
        """Continue from the solution of an increment (collective)."""
        self.displacement.axpy(1.0, solved.change)
        self._elastic_force.axpy(1.0, solved.products.stiffness)
        self.reaction, self.loads = solved.products.reaction, solved.loads[1]
        self.response = solved.after
        if solved.after is not None:
            self._start, self.joints = solved.after, solved.after.state
        self.reports.append(solved.report)
        if increment.time is not None and increment.whole:
            # The next step in time starts from these loads and supports.
            self._step_loads = self.loads
            self._supported = self.displacement.getArray()[self._system.constrained]

    def _set_up(self, increment: Increment) -> None:
        """Set the right-hand side b, and in x the displacement of the supports."""
        system, b, x = self._system, self._b, self._x
        share, fixed = increment.share, system.constrained
        if system.water is not None and self.joints is not None:
            system.water.enter(self.joints.gap)
        self._elastic_force.copy(b)
        b.scale(-1.0)
        for load in self._loads(increment).values():
            b.axpy(1.0, load)
        supported = system.prescribed(increment.time or 0.0, scale=share)
        supported = supported + (1.0 - share) * self._supported
        x.set(0.0)
        x.getArray()[fixed] = supported - self.displacement.array[fixed]

    def _loads(self, increment: Increment) -> dict[str, PETSc.Vec]:
        """Return the loads by name at the end of an increment [N] (collective)."""
        share = increment.share
        found = self._system.loads_by_name(increment.time or 0.0, share)
        remains = 1.0 if self._stays else 1.0 - share
        for name, load in self._step_loads.items() if remains else ():
            if name in found:
                found[name].axpy(remains, load)
            else:
                found[name] = remains * load
        return found


def _prepare(solver: StepSolver, last_resort: bool, start: Response | None) -> None:
    """Let a static solver continue from a response, and try other solvers as a last resort."""
    chosen = solver.inner if isinstance(solver, BondReleaseSolver) else solver
    if isinstance(chosen, StaticSolver):
        chosen.last_resort = last_resort
        chosen.continue_from(start)


def _under(
    system: MatrixSystem, before: StaticState, operator: GapOperator, apart: Floats
) -> MatrixSystem:
    """Return the system under constant tractions of the grout, with its supports at rest."""
    push = operator.force(-apart, before.displacement.duplicate())
    there = before.displacement.getArray()[system.constrained]
    patterns, names = [(push, always)], ["grout"]
    return replace(system, patterns=patterns, load_names=names, values=lambda _: there)


def _holding(system: MatrixSystem, before: StaticState, dofs: NDArray[np.int64]) -> MatrixSystem:
    """Return the system with further dofs constrained at their present displacement."""
    every = np.union1d(system.constrained, dofs)
    there = before.displacement.getArray()[every]
    supported, held = np.searchsorted(every, system.constrained), np.isin(every, dofs)

    def values(time: float) -> Floats:
        found = there.copy()
        found[supported] = system.prescribed(time)
        return np.where(held, there, found)

    return replace(system, constrained=every, values=values)


def _remedy(failure: ConvergenceError, kind: str, solver: str, reached: float) -> str | None:
    """Return a remedy for a failure at the shortest increment, None if there is none."""
    if failure.law is not None:
        return None
    limit = "The joints or the bulk may carry no more: more strength or supports, or less load."
    if reached == 0.0 and not failure.yielding:
        limit = "Is each block restrained by supports, springs, or joints under enough pressure?"
    if kind != "auto":
        return f'solver="auto" also tries the other solver and pseudo-time. {limit}'
    if solver != "condensed":
        softer = "" if failure.yielding else " or softer joints"
        return f"SolverOptions(max_iterations=100){softer} may go further. {limit}"
    return limit


def check_acting(model: Model, loads: Any) -> None:
    """Check that the loads of a static stage are the model's own."""
    for load in loads:
        if not any(load is one for one in model.loads):
            raise ValueError(
                f"A {type(load).__name__} was given to a static stage that is not among the "
                "model's loads; give it to Model(loads=...) as well."
            )
