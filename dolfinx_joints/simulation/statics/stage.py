# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One static stage: from the last static state through load steps, and what may follow it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.loads.load import Load, always, load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import StageRecord
from dolfinx_joints.simulation.statics.construction import with_inactive
from dolfinx_joints.simulation.statics.joint_water_iteration import JointWaterIteration
from dolfinx_joints.simulation.statics.load_increments import Increment, LoadIncrements
from dolfinx_joints.simulation.statics.unfinished import Unfinished
from dolfinx_joints.solvers.choice import SolverKind, make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC
from dolfinx_joints.solvers.first_that_works import HoldingBonds, StaticSolver
from dolfinx_joints.solvers.step_solver import SolveReport, SolverOptions, StepSolver
from dolfinx_joints.time_integration.products import Products


def march(
    model: Model,
    before: StaticState | None,
    path: Sequence[tuple[float | None, float]],
    acting: Sequence[Load],
    *,
    stage: Unfinished | None,
    apart: Floats | None,
    options: SolverOptions,
    kind: SolverKind,
    watch: SmallDisplacements,
    reached: Callable[[float, StaticState], None] | None,
) -> StaticState:
    """Equilibrium at each step of a path (collective).

    Args:
        model: The model.
        before: State to go on from; zero, joints at rest, without one.
        path: Time [s] of each step, None for a ramp at time zero, and its share of the way from
            the loads and prescribed displacements of ``before`` to those at this time.
        acting: Those of the model's loads that act.
        stage: What does not act yet; None where everything acts.
        apart: Tractions, shape (n, 3), [Pa], on the faces of joints that are added to what
            ``before`` carries, which then is all that acts; None without.
        options: Tolerances and limits of Newton's method.
        kind: Of the solver; see `make_solver`.
        watch: Observer of slip and opening.
        reached: Called with time [s] and state after each step, if given.
    """
    system, contact = model.system(only=acting, static=True), model.contact
    carried = _carried(system, before)
    if apart is not None and before is not None and contact is not None:
        push = contact.operator.force(apart, before.displacement.duplicate())
        system = _under(system, before, carried - push)
    if stage is not None:
        idle = None if contact is None else contact.without(stage.idle)
        system = _holding(replace(system, contact=idle), before, stage.dofs)
    solver = make_solver(system, options, kind, static_steps=len(path))
    at, increments = _Equilibrium(system, solver, before, carried), LoadIncrements(path)
    missing = tuple(
        name
        for name, one in zip(load_names(model.loads), model.loads, strict=True)
        if not any(one is other for other in acting)
    )

    def state() -> StaticState:
        return StaticState(
            displacement=at.displacement.copy(),
            joints=at.response,
            reaction=at.products.reaction,
            reports=list(at.reports),
            inactive=stage.inactive if stage else (),
            absent=stage.absent if stage else (),
            missing=missing,
            cuts=increments.cuts,
        )

    progress = Progress("static stage", len(path), "steps", model.jointed.mesh.comm.rank)
    for increment in increments:
        try:
            at.advance(increment)
        except ConvergenceError as failure:
            watch.warn("in a static stage")
            increments.cut(failure, _remedy(failure, kind, at.solver.name, increments.reached))
            continue
        free_petsc_garbage(model.jointed.mesh.comm)
        if at.joints is not None:
            watch.see(at.joints.gap)
        progress.advance(int(increment.whole))
        if reached is not None and increment.whole:
            reached(increment.time or 0.0, state())
    progress.finish()
    watch.warn("in a static stage")
    if stage is not None:
        # Nothing acts there, nothing is supported.
        at.products.reaction.getArray()[stage.dofs] = 0.0
        if contact is not None:
            at.response = with_inactive(contact, at.response, before, at.displacement, stage)
    return state()


class _Equilibrium:
    """The last one reached in a stage, and the way to the next.

    Attributes:
        solver: With water in joints the iteration around it.
        displacement: Displacement vector.
        joints: State of the joints, None without any.
        response: Response of the joints, likewise.
        products: What follows from the equation solved, the forces of the supports among it.
        reports: Of the solver, one for each increment.
    """

    def __init__(
        self,
        system: MatrixSystem,
        solver: StepSolver,
        before: StaticState | None,
        carried: PETSc.Vec | None,
    ) -> None:
        """Start from a static state and the loads that it carries, or from rest (collective)."""
        self._system = system
        self._chosen = solver.inner if isinstance(solver, HoldingBonds) else solver
        self.solver: StepSolver | JointWaterIteration = solver
        self.displacement = u = system.stiffness.createVecRight()
        u.set(0.0)
        self.joints = system.internal_forces.at_rest(u) if system.internal_forces else None
        if before is not None:
            before.displacement.copy(u)
            if self.joints is not None and before.joints:
                self.joints = before.joints.state
        if system.water is not None and self.joints is not None:
            self.solver = JointWaterIteration(system.water, solver)
        self.response: Response | None = None
        self.products: Products
        self.reports: list[SolveReport] = []
        self._elastic_force, self._load, self._b, self._x = (u.duplicate() for _ in range(4))
        system.stiffness.mult(u, self._elastic_force)
        # Where loads and supports of a step go from.
        self._carried, self._supported = carried, u.getArray()[system.constrained]

    def advance(self, increment: Increment) -> None:
        """Equilibrium at the end of an increment (collective).

        Raises:
            ConvergenceError: None was found; all is as before.
        """
        b, x, u = self._b, self._x, self.displacement
        self._set_up(increment)
        if isinstance(self._chosen, StaticSolver):
            self._chosen.last_resort = increment.last_resort
        response, report = self.solver.solve(STATIC, b, x, self.joints)
        products = Products(self._system, STATIC, b, x, response)
        fixed = self._system.constrained
        if increment.time is not None and increment.whole:
            # The next step in time starts from these loads.
            self._carried = b + self._elastic_force
            self._supported = u.getArray()[fixed] + x.getArray()[fixed]
        u.axpy(1.0, x)
        self._elastic_force.axpy(1.0, products.stiffness)
        self.response, self.products = response, products
        if response:
            self.joints = response.state
        self.reports.append(report)

    def _set_up(self, increment: Increment) -> None:
        """Right-hand side b, and in x the way of the supports."""
        system, b, x, load = self._system, self._b, self._x, self._load
        time, share, fixed = increment.time or 0.0, increment.share, system.constrained
        if system.water is not None and self.joints is not None:
            system.water.enter(self.joints.gap)
        system.load(time, load, scale=share)
        supported = system.prescribed(time, scale=share)
        if self._carried is not None and share < 1.0:
            load.axpy(1.0 - share, self._carried)
            supported = supported + (1.0 - share) * self._supported
        b.waxpy(-1.0, self._elastic_force, load)
        x.set(0.0)
        x.getArray()[fixed] = supported - self.displacement.array[fixed]


def _under(system: MatrixSystem, before: StaticState, load: PETSc.Vec) -> MatrixSystem:
    """The system under a load that does not change, supports staying where they are."""
    there = before.displacement.getArray()[system.constrained]
    return replace(system, patterns=[(load, always)], load_names=(), values=lambda _: there)


def _holding(
    system: MatrixSystem, before: StaticState | None, dofs: NDArray[np.int64]
) -> MatrixSystem:
    """The system with further dofs held where they are."""
    every = np.union1d(system.constrained, dofs)
    there = before.displacement.getArray()[every] if before else np.zeros(len(every))
    supported, held = np.searchsorted(every, system.constrained), np.isin(every, dofs)

    def values(time: float) -> Floats:
        found = there.copy()
        found[supported] = system.prescribed(time)
        return np.where(held, there, found)

    return replace(system, constrained=every, values=values)


def _remedy(failure: ConvergenceError, kind: str, solver: str, reached: float) -> str | None:
    """What helps against a failure at the shortest increment, by the solver and load factor."""
    if failure.law is not None:
        return None
    limit = "The joints or the bulk may carry no more: more strength or supports, or less load."
    if reached == 0.0 and not failure.yielding:
        limit = "Is each block held by supports, springs or joints pressed enough not to slide?"
    if kind != "auto":
        return f'solver="auto" tries more, and finds most equilibria. {limit}'
    if solver != "condensed":
        softer = "" if failure.yielding else " or softer joints"
        return f"SolverOptions(max_iterations=100){softer} may go further. {limit}"
    return limit


def _carried(system: MatrixSystem, before: StaticState | None) -> PETSc.Vec | None:
    """Loads that a static state carries, from its balance [N]; None without one (collective)."""
    if before is None:
        return None
    force, internal_forces = system.stiffness * before.displacement, system.internal_forces
    if internal_forces is not None and before.joints is not None:
        force.axpy(1.0, internal_forces.force(before.joints, force.duplicate()))
    force.axpy(-1.0, before.reaction)
    return force


def check_acting(model: Model, loads: Any) -> None:
    """Check that the loads of a static stage are the model's own."""
    for load in loads:
        if not any(load is one for one in model.loads):
            raise ValueError(
                f"A {type(load).__name__} was given to a static stage that is not among the "
                "model's loads; give it to Model(loads=...) as well."
            )


def check_complete(model: Model, static: StaticState | None, stages: Sequence[StageRecord]) -> None:
    """Check that nothing is missing in a static state, nor its water from before the grout.

    Warns of loads that jump, those of the last static stage being of another time (collective).
    """
    if static is not None and static.absent:
        raise JointsError(
            f"{', '.join(static.absent)} is absent in the static state, which would act at once; "
            "run statics() with all blocks before."
        )
    if static is not None and static.missing:
        raise JointsError(
            f"The static state lacks {', '.join(static.missing)} as the dynamic stage has it, "
            "which would act at once; run statics() with all loads before."
        )
    if static is not None and stages and stages[-1].time:
        _warn_of_jumps(model, stages[-1])


def _warn_of_jumps(model: Model, last: StageRecord) -> None:
    """Warn of loads that differ between a static stage's time and zero (collective)."""
    system = model.system()
    norms = np.array([vector.norm() for vector, _ in system.patterns])
    at = [norms * np.abs(system.mean_factors(time, time)) for time in (0.0, last.time)]
    changes = norms * np.abs(system.load_change(last.time, 0.0))
    off = np.array(system.load_names)[changes > 1e-9 * np.max(at, initial=0.0)]
    if len(off) and model.jointed.mesh.comm.rank == 0:
        warnings.warn(
            f"The static stage {last.name!r} ended with the loads of t = {last.time:g} s, a "
            f"dynamic stage begins with those of t = 0: {', '.join(dict.fromkeys(off))} changes at "
            "once. For a start at rest let quasi_statics end at 0, from times before it.",
            stacklevel=5,
        )
