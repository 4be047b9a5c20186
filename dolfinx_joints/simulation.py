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
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.checks import check_count, check_kind_of, check_number
from dolfinx_joints.dynamic_run import DynamicRun
from dolfinx_joints.errors import ConvergenceError
from dolfinx_joints.linear import STATIC
from dolfinx_joints.loads import BaseMotion, Load
from dolfinx_joints.model import Model
from dolfinx_joints.parallel import free_petsc_garbage
from dolfinx_joints.results import LARGE_ENERGY_ERROR, LARGE_LOCAL_ERROR
from dolfinx_joints.schemes import EnergyConsistent
from dolfinx_joints.small_displacements import SmallDisplacements
from dolfinx_joints.solver import NewtonOptions, StepSolver
from dolfinx_joints.solver_choice import check_kind, make_solver
from dolfinx_joints.stages import Monitor, Outcome, StaticState
from dolfinx_joints.states import DynamicState, Products, Scheme, initial_state
from dolfinx_joints.stepping import StepControl, check_step, located
from dolfinx_joints.system import MatrixSystem

if TYPE_CHECKING:
    from dolfinx_joints.checkpoint import CheckpointKeeper, Checkpoints

# Steps between two collections of what petsc4py keeps on several ranks.
GARBAGE_INTERVAL = 10

# Times at which functions of time are compared with those of a checkpoint.
SAMPLES = 500


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
            JointsError: Water in a joint and its openings do not come to agree.
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
            joints = system.resistance.at_rest(u) if system.resistance else None
            if resume and self.static is not None:
                self.static.displacement.copy(u)
                joints = self.static.joints.state if self.static.joints else None
            if system.water is not None and joints is not None:
                system.water.enter(joints.gap)
                solver = system.water.settling(solver)
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
        checkpoint: Checkpoints | None = None,
        resume: bool = False,
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
            checkpoint: Where the run is kept on the disk as it goes; nowhere unless given.
            resume: Go on from that checkpoint, with the arguments and monitors of the run that
                wrote it. Its static state is taken as well; ``velocity`` and ``start`` are not
                looked at.

        Raises:
            ValueError: ``dt`` or ``steps`` is not positive, both ``velocity`` and ``start`` are
                given, or ``resume`` without ``checkpoint``.
            CheckpointError: A checkpoint cannot be written, or is not there, damaged or of
                another run.
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
        good = checkpoint is None or hasattr(checkpoint, "keeper")
        check_kind_of("checkpoint", checkpoint, good, "a Checkpoints")
        if resume and checkpoint is None:
            raise ValueError("resume is True, but no checkpoint is given to go on from.")
        if motion is not None:
            _check_motion(motion, self.model.gdim)
            if any(getattr(load, "absolute", False) for load in (*self.model.loads, *loads)):
                raise ValueError(
                    "motion is given beside a FreeField, which moves the ground already; give one."
                )
        shaking = [BaseMotion(acceleration=motion)] if motion is not None else []
        if checkpoint is not None:
            checkpoint.check(self.model.jointed.mesh.comm, self.monitors, resume=resume)
        with self._phase("set-up of the dynamic stage"):
            system = self.model.system([*shaking, *loads])
            solver = make_solver(system, self._newton, self._kind, scheme.rule)
            facts = {"time step": dt, "number of steps": steps, "time scheme": scheme}
            facts |= {"step control": control, "solver": self._kind, "Newton": self._newton}
            began = start.time if start else 0.0
            times = began + dt * steps * np.linspace(0.0, 1.0, SAMPLES)
            keeper = None
            if checkpoint is not None:
                keeper = checkpoint.keeper(self.model, system, facts, motion, times)
            saved = keeper.load(self.monitors) if keeper and resume else None
            if saved is not None:
                self.static = saved.static
            run = DynamicRun(
                model=self.model,
                monitors=self.monitors,
                watch=self._watch,
                seconds=self.seconds,
                scheme=scheme,
                solver=solver,
                control=control,
                state=saved.state if saved else self._first_state(solver, velocity, start),
                steps=steps,
                motion=motion,
            )
        with run.watched():
            if saved is None:
                run.start()
                self._save(keeper, run)
            else:
                run.resume(saved.memory, saved.origin)
            while run.step < steps:
                self._step(run, dt)
                self._save(keeper, run)
        self._watch.warn(f"by t = {run.state.time:.4g} s")
        outcome = run.outcome()
        if self.model.jointed.mesh.comm.rank == 0:
            _warn_of(outcome)
        return outcome

    def _step(self, run: DynamicRun, dt: float) -> None:
        """One step, told to the monitors (collective)."""
        with self._phase("time steps"):
            try:
                report = run.take(dt)
            except ConvergenceError as failure:
                self._watch.warn(f"by t = {run.state.time:.4g} s")
                raise located(failure, stage="dynamic", step=run.step + 1) from None
        with self._phase("monitors"):
            run.show(report)
        if run.step % GARBAGE_INTERVAL == 0:
            free_petsc_garbage(self.model.jointed.mesh.comm)
            self._watch.warn(f"by t = {run.state.time:.4g} s")

    def _save(self, keeper: CheckpointKeeper | None, run: DynamicRun) -> None:
        """Write a checkpoint where one is due (collective)."""
        if keeper is not None:
            with self._phase("checkpoints"):
                keeper.save_if_due(run, self.static)

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
            water=start.water if start else None,
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
        if self.model.bulk is not None:
            text += f" (plastic cells of {', '.join(self.model.bulk.kinds)})"
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
