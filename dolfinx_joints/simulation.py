# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stages of a run, static then dynamic, and the only time loop.

The loop knows no files, plots or progress bars: monitors do.
"""

from __future__ import annotations

import time as clock
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.checks import check_count, check_kind_of, check_number
from dolfinx_joints.energy import EnergyLedger, EnergyRow
from dolfinx_joints.errors import ConvergenceError
from dolfinx_joints.linear import STATIC
from dolfinx_joints.loads import BaseMotion, Load
from dolfinx_joints.memory_use import peak_mb
from dolfinx_joints.model import Model
from dolfinx_joints.parallel import free_petsc_garbage
from dolfinx_joints.results import LARGE_ENERGY_ERROR, LARGE_LOCAL_ERROR
from dolfinx_joints.schemes import EnergyConsistent
from dolfinx_joints.small_displacements import SmallDisplacements
from dolfinx_joints.solver import NewtonOptions, SolveReport, StepSolver
from dolfinx_joints.solver_choice import check_kind, make_solver
from dolfinx_joints.stages import Monitor, Outcome, Record, StaticState
from dolfinx_joints.states import DynamicState, Products, Scheme, StepReport, initial_state
from dolfinx_joints.stepping import StepControl, Stepper, check_step, located
from dolfinx_joints.system import MatrixSystem

# Steps between two collections of what petsc4py keeps on several ranks.
GARBAGE_INTERVAL = 10


class Simulation:
    """Runs a model through its stages.

    Args:
        model: The model.
        monitors: What watches the run.
        newton: Tolerances and limits of Newton's method.
        solver: ``auto``, ``condensed`` or ``monolithic``; see `make_solver`.

    Attributes:
        model: The model.
        static: Result of the last static stage, None before it.
        seconds: Wall time by phase [s].
    """

    def __init__(
        self,
        model: Model,
        *,
        monitors: Sequence[Monitor] = (),
        newton: NewtonOptions | None = None,
        solver: str = "auto",
    ) -> None:
        """Nothing is solved yet."""
        good = isinstance(monitors, list | tuple) and all(hasattr(m, "record") for m in monitors)
        check_kind_of("monitors", monitors, good, "a list of monitors")
        options = isinstance(newton, NewtonOptions | None)
        check_kind_of("newton", newton, options, "a NewtonOptions")
        self.model, self.monitors = model, list(monitors)
        self.static: StaticState | None = None
        self.seconds: dict[str, float] = {}
        self._newton, self._kind = newton or NewtonOptions(), solver
        self._watch = SmallDisplacements(model.contact)
        check_kind(solver)

    def statics(self, *, steps: int = 1) -> StaticState:
        """Apply the model's loads in equal steps from zero, joints active (collective).

        Friction depends on the path, so the number of steps matters where joints slide. Loads
        with a time factor and prescribed displacements are taken at time zero. The body is loaded
        as it stands, joints closed and stress-free: self weight then presses vertical joints by
        arch and Poisson action only, and no construction sequence is followed.

        Args:
            steps: Number of load steps.

        Raises:
            ValueError: ``steps`` is not positive.
            ConvergenceError: A load step did not converge.
        """
        check_count("steps", steps, 1, "at least one load step is needed")
        factors = np.arange(1, steps + 1) / steps
        return self._statics([(None, float(f)) for f in factors])

    def quasi_statics(self, times: Sequence[float]) -> StaticState:
        """Equilibrium at each of a sequence of times, in order (collective).

        Loads and prescribed displacements follow their functions of time; inertia and damping are
        left out. Continues from the last static stage if there was one.

        Args:
            times: Times [s] of the load steps.

        Raises:
            ValueError: There is no time, or one is not finite.
            ConvergenceError: A load step did not converge.
        """
        path = list(times)
        check_count("The number of times", len(path), 1, "at least one is needed")
        for time in path:
            check_number("A time", time, lambda _: True, "finite", unit="s")
        return self._statics([(float(t), 1.0) for t in path], resume=True)

    def _statics(
        self, path: list[tuple[float | None, float]], *, resume: bool = False
    ) -> StaticState:
        """March through (time, load factor), time None for a ramp at time zero."""
        with self._phase("static"):
            system = self.model.system()
            solver = make_solver(system, self._newton, self._kind, static_steps=len(path))
            u = system.stiffness.createVecRight()
            u.set(0.0)
            joints = system.contact.at_rest(u) if system.contact else None
            if resume and self.static is not None:
                self.static.displacement.copy(u)
                joints = self.static.joints.state if self.static.joints else None
            held, reports = system.constrained, []
            elastic_force, load, b, x = (u.duplicate() for _ in range(4))
            system.stiffness.mult(u, elastic_force)
            for step, (time, scale) in enumerate(path, start=1):
                system.load(time or 0.0, load, scale=scale)
                b.waxpy(-1.0, elastic_force, load)
                x.set(0.0)
                at_supports = system.prescribed(time or 0.0, scale=scale)
                x.getArray()[held] = at_supports - u.array[held]
                try:
                    response, report = solver.solve(STATIC, b, x, joints)
                    products = Products(solver, STATIC, b, x, response)
                except ConvergenceError as failure:
                    self._watch.warn("in a static stage")
                    raise located(failure, stage="static", step=step, time=time) from None
                u.axpy(1.0, x)
                elastic_force.axpy(1.0, products.stiffness)
                if response:
                    joints = response.state
                    self._watch.see(joints.gap)
                reports.append(report)
            self._watch.warn("in a static stage")
            self.static = StaticState(
                displacement=u, joints=response, reaction=products.reaction, reports=reports
            )
            free_petsc_garbage(self.model.jointed.mesh.comm)
        return self.static

    def dynamics(
        self,
        *,
        dt: float,
        steps: int,
        motion: Callable[[float], Any] | None = None,
        loads: Sequence[Load] = (),
        scheme: Scheme | None = None,
        control: StepControl | None = None,
        velocity: PETSc.Vec | None = None,
        start: DynamicState | None = None,
    ) -> Outcome:
        """March from the static state (or from zero) with the model's loads kept (collective).

        Args:
            dt: Time step [s].
            steps: Number of steps.
            motion: Ground acceleration (3,) [m/s^2] at a time [s]; none unless given.
            loads: Loads of this stage besides the model's own.
            scheme: Time scheme, `EnergyConsistent` unless given.
            control: When steps are cut; where their solve fails unless given.
            velocity: Initial velocity [m/s], zero unless given.
            start: State to go on from instead, such as ``state`` of an earlier outcome.

        Raises:
            ValueError: ``dt`` or ``steps`` is not positive, or both ``velocity`` and ``start`` are
                given.
            ConvergenceError: A step did not converge however often it was halved; what had been
                computed is with the monitors.
        """
        check_step(dt)
        check_count("steps", steps, 1, "at least one time step is needed")
        if velocity is not None and start is not None:
            raise ValueError("velocity and start are both given; start holds a velocity already.")
        scheme, control = scheme or EnergyConsistent(), control or StepControl()
        check_kind_of("scheme", scheme, hasattr(scheme, "advance"), "a time scheme")
        check_kind_of("control", control, isinstance(control, StepControl), "a StepControl")
        if motion is not None:
            _check_motion(motion, self.model.gdim)
        shaking = [BaseMotion(acceleration=motion)] if motion is not None else []
        with self._phase("set-up of the dynamic stage"):
            system = self.model.system([*shaking, *loads])
            solver = make_solver(system, self._newton, self._kind, scheme.rule)
            state = self._first_state(solver, velocity, start)
            run = _Run(self, scheme, solver, control, state, steps, motion)
        with run.watched():
            run.start()
            for step in range(1, steps + 1):
                with self._phase("time steps"):
                    try:
                        report = run.take(dt)
                    except ConvergenceError as failure:
                        self._watch.warn(f"by t = {run.state.time:.4g} s")
                        raise located(failure, stage="dynamic", step=step) from None
                with self._phase("monitors"):
                    run.show(step, report)
                if step % GARBAGE_INTERVAL == 0:
                    free_petsc_garbage(self.model.jointed.mesh.comm)
                    self._watch.warn(f"by t = {run.state.time:.4g} s")
        self._watch.warn(f"by t = {run.state.time:.4g} s")
        outcome = run.outcome()
        if self.model.jointed.mesh.comm.rank == 0:
            _warn_of(outcome)
        return outcome

    def _first_state(
        self, solver: StepSolver, velocity: PETSc.Vec | None, start: DynamicState | None
    ) -> DynamicState:
        """The state a dynamic stage begins with, its acceleration in balance with its loads."""
        origin = start or self.static
        if origin is None:
            return initial_state(solver, velocity=velocity)
        if start is None:
            self._check_prescribed(solver.system, origin.displacement)
        # The joints' tractions are taken as they are: a point that slid sits on the friction limit,
        # and asked again, round-off would decide.
        return initial_state(
            solver,
            time=start.time if start else 0.0,
            displacement=origin.displacement,
            velocity=start.velocity if start else velocity,
            joints=origin.joints,
        )

    def _check_prescribed(self, system: MatrixSystem, u: PETSc.Vec) -> None:
        """Refuse prescribed displacements that jump from the static state to time zero."""
        at_zero = system.prescribed(0.0)
        held = u.getArray(readonly=True)[system.constrained]
        jump = float(np.abs(at_zero - held).max(initial=0.0))
        if max(self.model.jointed.mesh.comm.allgather(jump)) > 1e-9 * max(u.norm(), 1e-12):
            raise ValueError(
                "The displacements prescribed at t = 0 differ from those of the static state that "
                "the dynamic stage starts from; let their functions agree there."
            )

    def report(self, outcome: Outcome) -> str:
        """Closing lines of a run: energy error, accuracy, iterations and seconds by phase."""
        phases = ", ".join(f"{name} {value:.1f} s" for name, value in self.seconds.items())
        counts = outcome.counts
        mean = outcome.iterations / max(counts.accepted, 1)
        balance = "" if outcome.imbalance is None else f", of all lines {outcome.imbalance:.1e}"
        tried = f", {counts.rejected} more were tried and cut" if counts.rejected else ""
        return (
            f"energy error {100 * outcome.energy_error:.3g} % of the largest energy{balance}; "
            f"largest local displacement error {100 * outcome.local_error:.3g} % of the largest "
            f"displacement\n{outcome.steps} steps in {counts.accepted} pieces{tried}; "
            f"{mean:.2f} Newton iterations per piece, {self._solver(outcome)}\n{phases}"
        )

    def _solver(self, outcome: Outcome) -> str:
        """The solver of a run, and which laws left no choice."""
        contact = self.model.contact
        missing = () if contact is None else contact.without_local("end_point")
        text = f"{outcome.solver} solver"
        if outcome.solver == "monolithic" and missing:
            text += f" (no local solution in {', '.join(missing)})"
        if outcome.end_point_laws:
            text += f", end-point law in {', '.join(outcome.end_point_laws)}"
        return text

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        """Add the wall time of a block to a phase."""
        began = clock.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + clock.perf_counter() - began


def _warn_of(outcome: Outcome) -> None:
    """Say what makes a run doubtful."""
    if outcome.energy_error > LARGE_ENERGY_ERROR:
        warnings.warn(
            f"The energy error is {100 * outcome.energy_error:.3g} % of the largest energy: joints "
            "open and close too fast for this scheme and time step; take EnergyConsistent, or a "
            "smaller step.",
            stacklevel=3,
        )
    if outcome.local_error > LARGE_LOCAL_ERROR:
        warnings.warn(
            f"A single step errs by an estimated {100 * outcome.local_error:.3g} % of the largest "
            "displacement; take a smaller one.",
            stacklevel=3,
        )


def _check_motion(motion: Any, gdim: int) -> None:
    """Refuse a ground motion that gives no acceleration vector."""
    wanted = f"a function of time that gives at least {gdim} numbers"
    check_kind_of("motion", motion, callable(motion), wanted)
    first = np.asarray(motion(0.0))
    good = first.ndim == 1 and len(first) >= gdim and first.dtype.kind in "if"
    check_kind_of("motion(0)", first.tolist(), good, f"at least {gdim} numbers")


class _Run:
    """Bookkeeping of a dynamic stage."""

    def __init__(
        self,
        simulation: Simulation,
        scheme: Scheme,
        solver: StepSolver,
        control: StepControl,
        state: DynamicState,
        steps: int,
        motion: Callable[[float], Any] | None,
    ) -> None:
        self.simulation, self.state, self.steps = simulation, state, steps
        self._motion = motion
        self.solver, self._conserves = solver.name, scheme.conserves(solver.system)
        self.ledger = EnergyLedger(solver.system)
        self.ledger.start(state)
        self.stepper = Stepper(scheme, solver, self.ledger, control)
        contact = solver.system.contact
        whole = scheme.rule == "step" and contact is not None
        self._end_point_laws = contact.without_step if whole and contact else ()
        self.iterations = 0
        self._local_error = self._largest = 0.0
        self._origin = state.displacement.copy()
        self._work = state.displacement.duplicate()
        self._started: list[Monitor] = []

    def start(self) -> None:
        """Start the monitors."""
        first = self._record(0, None, self.ledger.row, 0)
        for monitor in self.simulation.monitors:
            monitor.start(self.simulation.model, "dynamic", self.steps, first)
            self._started.append(monitor)

    def take(self, dt: float) -> StepReport:
        """Take a step and account for every piece of it."""
        self._pieces = 0
        for after, report, row in self.stepper.advance(self.state, dt):
            self.ledger.record(row)
            self.state = after
            if after.joints is not None:
                self.simulation._watch.see(after.joints.state.gap)
            self._pieces += 1
            self.iterations += report.solve.iterations
            self._local_error = max(self._local_error, report.local_error)
            self._work.waxpy(-1.0, self._origin, after.displacement)
            self._largest = max(self._largest, float(self._work.norm()))
        return report

    def show(self, step: int, report: StepReport) -> None:
        """Hand a step to the monitors."""
        record = self._record(step, report.solve, self.ledger.row, self._pieces - 1)
        for monitor in self.simulation.monitors:
            monitor.record(record)

    def _record(
        self, step: int, solve: SolveReport | None, row: EnergyRow, halvings: int
    ) -> Record:
        return Record(
            stage="dynamic",
            step=step,
            time=self.state.time,
            displacement=self.state.displacement,
            velocity=self.state.velocity,
            reaction=self.state.reaction,
            joints=self.state.joints,
            motion=self._motion,
            solve=solve,
            energy=row,
            halvings=halvings,
        )

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Tell the monitors how the stage ended, whatever ended it."""
        try:
            yield
        except BaseException as error:
            status = "failed" if isinstance(error, Exception) else "stopped"
            self._finish(status, {"error": f"{type(error).__name__}: {error}"})
            raise
        peak = self.simulation.model.jointed.mesh.comm.allreduce(peak_mb())
        self._finish("complete", {"peak_mb": peak})

    def _finish(self, status: str, extra: dict[str, Any]) -> None:
        outcome = self.outcome()
        summary = {
            "steps": outcome.steps,
            **asdict(outcome.counts),
            "iterations": outcome.iterations,
            "solver": outcome.solver,
            "energy_error": outcome.energy_error,
            "imbalance": outcome.imbalance,
            "local_error": outcome.local_error,
            "seconds": dict(self.simulation.seconds),
            **extra,
        }
        for monitor in self._started:
            monitor.finish(status, summary)

    def outcome(self) -> Outcome:
        """Where the run stands."""
        return Outcome(
            state=self.state,
            energy=self.ledger.row,
            energy_error=self.ledger.relative_error,
            imbalance=self.ledger.relative_imbalance if self._conserves else None,
            local_error=self._local_error / self._largest if self._largest else 0.0,
            steps=self.steps,
            counts=self.stepper.counts,
            iterations=self.iterations,
            solver=self.solver,
            end_point_laws=self._end_point_laws,
        )
