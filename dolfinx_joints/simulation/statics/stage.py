# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One static stage: load steps from the last static state, and preparation of the next stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, Response
from dolfinx_joints.loads.load import Load, always, load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.statics.construction import with_inactive
from dolfinx_joints.simulation.statics.jumps import Jumps
from dolfinx_joints.simulation.statics.ledger import SolvedIncrement, StaticLedger
from dolfinx_joints.simulation.statics.load_increments import Increment, LoadIncrements
from dolfinx_joints.simulation.statics.stage_start import carried_loads, start_of_stage
from dolfinx_joints.simulation.statics.unfinished import Unfinished
from dolfinx_joints.solvers.choice import SolverKind, make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC, MatrixCoefficients
from dolfinx_joints.solvers.first_that_works import BondReleaseSolver, StaticSolver
from dolfinx_joints.solvers.step_solver import (
    Solution,
    SolverAround,
    SolveReport,
    SolverOptions,
    StepEquation,
    StepSolver,
)
from dolfinx_joints.time_integration.products import Products

if TYPE_CHECKING:
    from dolfinx_joints.loads.water.pressures_in_joints import JointWaters

# Largest number of solves of a static load step until openings and pressures agree.
MOST_SOLVES = 100


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
    accepted: Sequence[Callable[..., None]] = (),
) -> StaticState:
    """Return the equilibrium at the end of a path of load steps (collective).

    An increment is halved if its solve does not converge, or if it releases energy (31b). Each step
    of the path has a time [s], None for a ramp at time zero, and a load factor. The factor applies
    to the change of loads and prescribed displacements since ``before``. Only the loads ``acting``
    of the model act. Without a ``stage`` all joints and blocks act. ``apart`` are additional
    tractions on joint faces, shape (n, 3), [Pa]; all other loads are then constant. The function
    ``reached`` is called with time [s] and state after each step, and the functions ``accepted``
    with equilibrium, solution and increment after each increment (`Monitor.increment`).

    Raises:
        JumpError: No equilibrium without a jump was found and ``allow_jumps`` is false.
        ConvergenceError: No equilibrium was found.
    """
    system, contact = model.system(only=acting, static=True), model.contact
    start = start_of_stage(system, before)
    carried = carried_loads(system, before, start)
    named = zip(load_names(model.loads), model.loads, strict=True)
    missing = tuple(n for n, load in named if not any(load is active for active in acting))
    facts: dict[str, Any] = {"missing": missing}
    if apart is not None and contact is not None:
        facts["loads"] = before.loads
        system = _under_grout(system, before, contact.operator, apart)
    if stage is not None:
        facts |= {"inactive": stage.inactive, "absent": stage.absent}
        idle = None if contact is None else contact.without(stage.idle)
        system = _constrained(replace(system, contact=idle), before, stage.dofs)
    solver = make_solver(system, options, kind, static_steps=len(path))
    last = Equilibrium(system, solver, before, start, carried, constant=apart is not None)
    increments = LoadIncrements(path, time=before.time)
    jumps = Jumps(last.ledger, model, allow_jumps)
    progress = Progress("static stage", len(path), "steps", model.jointed.mesh.comm.rank)
    for increment, solved in solve_increments(last, increments, jumps, kind, watch):
        free_petsc_garbage(model.jointed.mesh.comm)
        for process in accepted:
            process(last, solved, increment)
        progress.advance(int(increment.whole))
        if reached is not None and increment.whole:
            facts |= {"cuts": increments.cuts, "jumps": jumps.of_step(increment.step)}
            reached(increment.time or 0.0, last.state(facts))
    progress.finish()
    watch.warn("in a static stage")
    last.ledger.warn()
    if stage is not None:
        # Absent blocks have no loads and no support reactions.
        for force in (last.reaction, *last.loads.values()):
            force.getArray()[stage.dofs] = 0.0
        if contact is not None:
            last.response = with_inactive(contact, last.response, before, last.displacement, stage)
    return last.state(facts | {"cuts": increments.cuts, "jumps": jumps.recorded})


def solve_increments(
    last: Equilibrium,
    increments: LoadIncrements,
    jumps: Jumps,
    kind: SolverKind,
    watch: SmallDisplacements,
) -> Iterator[tuple[Increment, SolvedIncrement]]:
    """Solve increments, halve increments that fail, and yield accepted increments (collective)."""
    for increment in increments:
        try:
            solved = last.solve(increment)
        except ConvergenceError as failure:
            watch.warn("in a static stage")
            if increment.shortest:
                remedy = _remedy(failure, kind, last.solver.name, increment.start)
                raise increment.locate(failure, remedy) from None
            increments.cut()
            continue
        energy = last.ledger.after(solved)
        if increment.shortest:
            jumps.add(energy, increment)
        elif energy.released > last.ledger.energy.released:
            increments.cut()
            continue
        last.ledger.energy = energy
        last.accept(solved, increment)
        if last.joints is not None:
            watch.record(last.joints.gap)
        yield increment, solved


class Equilibrium:
    """Last accepted equilibrium of a stage, and the solution of the next increment.

    The attributes are as in `StaticState`, except that ``joints`` is the state of the joints, None
    without joints, and ``response`` is their response. The solver includes the iteration on water.
    """

    def __init__(
        self,
        system: MatrixSystem,
        solver: StepSolver,
        before: StaticState,
        start: Response | None,
        carried: Mapping[str, PETSc.Vec],
        *,
        constant: bool,
    ) -> None:
        """Start from a static state with a response and loads [N] (collective).

        If ``constant`` is true, the ``carried`` loads stay constant while the system's loads are
        added.
        """
        self._system, self._constant, self._unloaded = system, constant, before.unloaded
        self._without_water = self.solver = solver
        self.displacement, self.reaction = before.displacement.copy(), before.reaction.copy()
        self._start = None if system.internal_forces is None else start
        self.response: Response | None = None
        self.joints = None if self._start is None else self._start.state
        if system.water is not None and self.joints is not None:
            self.solver = JointWaterIteration(system.water, solver)
        self.reports: list[SolveReport] = []
        self._time = before.time
        self._elastic_force = system.stiffness * self.displacement
        self._b, self._x = system.vector(), system.vector()
        self.loads = self._step_loads = carried
        self._supported = self.displacement.getArray()[system.constrained]
        self.ledger = StaticLedger(system, before.energy, self._start)

    def state(self, facts: Mapping[str, Any]) -> StaticState:
        """Return the equilibrium as a `StaticState`; ``facts`` are its other attributes."""
        return StaticState(
            displacement=self.displacement.copy(),
            joints=self.response,
            reaction=self.reaction,
            reports=list(self.reports),
            energy=self.ledger.energy,
            time=self._time,
            **{"loads": self.loads, **facts},
        )

    def solve(self, increment: Increment) -> SolvedIncrement:
        """Return the solution of an increment, without accepting it (collective).

        Raises:
            ConvergenceError: No solution was found.
        """
        x, water = self._x, self._system.water
        self._set_up(increment)
        # From the unloaded body without gaps, the solution is proportional to the load, so a
        # shorter increment would fail as well.
        unloaded = self._unloaded and increment.whole and not self.reports
        prepare(self._without_water, increment.shortest or unloaded, self._start)
        rule = replace(BACKWARD_EULER, elapsed=increment.elapsed)
        response, report = self.solver.solve(STATIC, self._b, x, self.joints, rule)
        products = self._products(response)
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

    def _products(self, response: Response | None) -> Products:
        """Return the products of the solution with a response (collective)."""
        return Products(self._system, STATIC, self._b, self._x, response)

    def move(self, increment: Increment, inertia: MatrixCoefficients) -> PETSc.Vec:
        """Return the displacement [m] of an implicit step of motion from rest (collective).

        The motion starts at the accepted equilibrium, under the loads at the end of an increment.
        """
        self._set_up(increment)
        prepare(self._without_water, False, self._start)
        self._without_water.solve(inertia, self._b, self._x, self.joints)
        return self._x.copy()

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
            # The next step in time starts from these loads and support displacements.
            self._step_loads, self._time = self.loads, increment.time
            self._supported = self.displacement.getArray()[self._system.constrained]

    def _set_up(self, increment: Increment) -> None:
        """Set the right-hand side b, and in x the displacement increment of the supports."""
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
        loads = self._system.loads_by_name(increment.time or 0.0, share)
        factor = 1.0 if self._constant else 1.0 - share
        for name, load in self._step_loads.items() if factor else ():
            if name in loads:
                loads[name].axpy(factor, load)
            else:
                loads[name] = factor * load
        return loads


def prepare(solver: StepSolver, last_resort: bool, start: Response | None) -> None:
    """Let a static solver continue from a response; allow other solvers if ``last_resort``."""
    chosen = solver.inner if isinstance(solver, BondReleaseSolver) else solver
    if isinstance(chosen, StaticSolver):
        chosen.last_resort = last_resort
        chosen.continue_from(start)


def _under_grout(
    system: MatrixSystem, before: StaticState, operator: GapOperator, apart: Floats
) -> MatrixSystem:
    """Return the system under constant tractions of the grout, with fixed supports."""
    force = operator.force(-apart, before.displacement.duplicate())
    fixed = before.displacement.getArray()[system.constrained]
    patterns, names = [(force, always)], ["grout"]
    return replace(system, patterns=patterns, load_names=names, values=lambda _: fixed)


def _constrained(
    system: MatrixSystem, before: StaticState, dofs: NDArray[np.int64]
) -> MatrixSystem:
    """Return the system with further dofs constrained at their present displacement."""
    union = np.union1d(system.constrained, dofs)
    present = before.displacement.getArray()[union]
    supported, fixed = np.searchsorted(union, system.constrained), np.isin(union, dofs)

    def values(time: float) -> Floats:
        prescribed = present.copy()
        prescribed[supported] = system.prescribed(time)
        return np.where(fixed, present, prescribed)

    return replace(system, constrained=union, values=values)


def _remedy(failure: ConvergenceError, kind: str, solver: str, reached: float) -> str | None:
    """Return a remedy for the failure of a shortest increment, None if the law is the cause."""
    if failure.law is not None:
        return None
    limit = "The limit load may be reached: add strength or supports, or reduce the loads."
    if reached == 0.0 and not failure.yielding:
        limit = "Is each block restrained by supports, springs, or joints under enough pressure?"
    if kind != "auto":
        return f'solver="auto" also tries the other solver and pseudo-time. {limit}'
    if solver != "condensed":
        softer = "" if failure.yielding or failure.stick is None else " or softer joints"
        return f"SolverOptions(max_iterations=100){softer} may reach larger loads. {limit}"
    return limit


def check_acting(model: Model, loads: Any) -> None:
    """Check that the loads of a static stage belong to the model."""
    for load in loads:
        if not any(load is member for member in model.loads):
            raise ValueError(
                f"A {type(load).__name__} of this static stage is not a load of the model; add it "
                "to Model(loads=...), too."
            )


class JointWaterIteration(SolverAround):
    """Repeats a static load step until the water pressures agree with the resulting openings.

    The first solve uses the pressures of the last load step. If water opens joints and open joints
    admit water, openings only grow, and the iteration ends at the smallest openings that agree with
    their pressures. At the end the right-hand side includes the water forces.
    """

    def __init__(self, water: JointWaters, inner: StepSolver) -> None:
        super().__init__(inner)
        self._water = water

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve for the displacement and the water (collective)."""
        start, seen = equation.x.copy(), [self._water.codes]
        while True:
            response, report = self.inner.solve(*equation)
            assert response is not None
            codes = self._water.by_opening(response.state.gap)
            toggled = self._water.toggled(codes, seen[-1])
            if not toggled.any():
                return response, report
            repeats = any(not self._water.toggled(codes, old).any() for old in seen)
            if repeats or len(seen) == MOST_SOLVES:
                worst = int(np.argmax(toggled))
                raise JointsError(
                    f"The iteration on water in the joint {self._water.joints[worst]!r} does not "
                    f"converge in a static stage: after {len(seen)} iterations {toggled[worst]} "
                    "joint points still change between wet and dry. Use more load steps, a larger "
                    "aperture, or a given Uplift."
                )
            seen.append(codes)
            self._water.change(codes, equation.b)
            start.copy(equation.x)
