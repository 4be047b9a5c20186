# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stages of a run, static then dynamic, and the only time loop.

The loop knows no files, plots or progress bars: monitors do.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import annotated_types as at

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JointsError, refuses_removed
from dolfinx_joints.common.files import released
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.loads.free_field import SupportForces
from dolfinx_joints.loads.ground_motion import for_steps, moved_by
from dolfinx_joints.loads.load import Load
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.checkpoint import CheckpointKeeper, Checkpoints, static_keeper
from dolfinx_joints.simulation.differing_ground import differing_ground, on_ground
from dolfinx_joints.simulation.dynamic_stage import DynamicRun, ground_motions
from dolfinx_joints.simulation.first_state import (
    InitialFields,
    checked_settings,
    first_state,
    given_fields,
    in_words,
    shaken_by,
)
from dolfinx_joints.simulation.monitor import Monitor, failures_shown
from dolfinx_joints.simulation.outcome import Outcome, StaticState, closing_lines
from dolfinx_joints.simulation.record import StageRecord, grout_record, stage_name, stage_record
from dolfinx_joints.simulation.start_checks import check_complete, sudden_loads
from dolfinx_joints.simulation.statics.construction import grouted
from dolfinx_joints.simulation.statics.stage import check_acting, march
from dolfinx_joints.simulation.statics.unfinished import (
    check_grouted,
    unfinished_stage,
)
from dolfinx_joints.solvers.batch import SharedBulk
from dolfinx_joints.solvers.choice import SolverKind, make_solver
from dolfinx_joints.solvers.step_solver import SolverOptions
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepControl, Stepper, ends_of_steps, located

# Steps between two collections of what petsc4py keeps on several ranks.
GARBAGE_INTERVAL = 10


@dataclass(eq=False, repr=False)
@checked
class Simulation:
    """Runs a model through its stages.

    Args:
        model: The model.
        monitors: Observers of the run.
        options: Tolerances and limits of Newton's method.
        solver: ``auto``, ``condensed``, ``monolithic`` or ``forms``; see `make_solver`.

    Attributes:
        model: The model.
        static: Result of the last static stage, None before it.
        stages: Static stages so far. Dynamic stages show them to monitors and `save_static` writes
            them; where they are too many to keep, such as small steps in time, clear the list.
        seconds: Wall time by phase [s].
    """

    model: Model
    _: KW_ONLY
    monitors: Sequence[Monitor] = ()
    options: SolverOptions | None = None
    solver: SolverKind = "auto"

    def __post_init__(self) -> None:
        """Check the model; nothing is solved yet."""
        check_kind_of("model", self.model, isinstance(self.model, Model), "a Model")
        self.monitors = list(self.monitors)
        for monitor in self.monitors:
            check_kind_of("A monitor", monitor, isinstance(monitor, Monitor), "a Monitor")
            monitor.check(self.model)
        self.static: StaticState | None = None
        self.stages: list[StageRecord] = []
        self.seconds: dict[str, float] = {}
        self.shared: SharedBulk | None = None  # with other simulations of the model
        known = isinstance(self.options, SolverOptions | None)
        check_kind_of("options", self.options, known, "a SolverOptions")
        self._options = self.options or SolverOptions()
        self._watch = SmallDisplacements(self.model.contact)

    @checked
    def statics(
        self,
        *,
        steps: Annotated[int, at.Ge(1)] = 1,
        loads: Sequence[Load] | None = None,
        joints: Literal["active", "inactive"] | Sequence[str] = "active",
        absent: Sequence[str] = (),
        name: str | None = None,
        allow_jumps: bool = False,
    ) -> StaticState:
        """Bring loads to their values at time zero in equal steps (collective).

        Goes on from the last static stage, from zero without one: loads that acted at its end stay
        if they are named again, and go if they are not. Friction depends on the path, so the number
        of steps matters where joints slide.

        Args:
            steps: Number of load steps.
            loads: Those of the model's loads that act at the end; all of them unless given.
            joints: Names of those that act, ``active`` for all or ``inactive`` for none. The
                others carry nothing, in this stage and until `grout`, and the blocks between them
                stand alone; none of them may carry anything yet.
            absent: Cell groups of blocks that are not there yet. They have no weight and joints
                beside them carry nothing; the stage that has them casts them, free of stress and
                where the mesh has them, against what is there.
            name: Name of the stage in results, unlike those before; "statics 1" and so on unless
                given.
            allow_jumps: True lists jumps in the state's ``jumps``, False raises `JumpError`.

        Raises:
            JointsError: Joints are in the wrong state, a block does not stand without them, or
                water in joints and their openings do not come to agree.
            JumpError: The structure jumps to a distant equilibrium.
            ConvergenceError: A load step did not converge.
        """
        acting = self.model.loads if loads is None else loads
        check_acting(self.model, acting)
        stage = unfinished_stage(self.model, self.static, joints, absent, acting)
        name = stage_name(name, "statics", self.stages)
        path = [(None, step / steps) for step in range(1, steps + 1)]
        self.static = self._march(name, path, acting, stage=stage, allow_jumps=allow_jumps)
        self._ended(stage_record(self.model, name, 0.0, self.static, acting))
        return self.static

    @checked
    def grout(
        self,
        joints: Sequence[str] | None = None,
        *,
        gap: Annotated[float, at.Ge(0), at.Unit("m")] = 0.0,
        pressure: Annotated[float, at.Ge(0), at.Unit("Pa")] = 0.0,
        name: str | None = None,
    ) -> StaticState:
        """Close joints where they stand after a static stage (collective).

        Where a joint carries nothing, inactive or open, its gap and slip count anew from here, and
        keys across an opening keep their shear; points in contact stay as they are. Joints that
        were inactive and are not named stay open by what their blocks have moved apart, and act
        from now on unless the next stage leaves them inactive; those whose laws pull across that
        gap stay inactive.

        Grout under pressure first pushes the faces of these points apart, loads and supports
        staying as they are, then sets: the pressure remains as their traction.

        Args:
            joints: Names of the joints to be grouted; unless given those that are inactive, all of
                them if none is.
            gap: Opening that the grout leaves [m].
            pressure: Of the grout [Pa].
            name: Name of the stage in results, "grouting 1" and so on unless given.

        Raises:
            JointsError: There is no static state yet, or a law bears no such pressure or gap.
            ConvergenceError: No equilibrium under the pressure was found, or only after a jump.
        """
        if self.static is None:
            raise JointsError("There is nothing to grout yet: run statics(joints=[...]) before.")
        name = stage_name(name, "grouting", self.stages)
        pressed = partial(self._march, name, [(None, 1.0)], ())
        self.static = grouted(
            self.model, self.static, joints, gap=gap, pressure=pressure, pressed=pressed
        )
        self._ended(grout_record(self.model, name, self.static, self.stages))
        return self.static

    @checked
    def quasi_statics(
        self,
        times: Annotated[Sequence[float], at.MinLen(1), at.Unit("s")],
        *,
        name: str | None = None,
        allow_jumps: bool = False,
    ) -> StaticState:
        """Equilibrium at each of a sequence of times, in order (collective).

        Loads and prescribed displacements follow their functions of time; inertia and damping are
        left out. Continues from the last static stage if there was one.

        Args:
            times: Times [s] of the load steps.
            name: Name in results, "quasi-statics 1" and so on unless given. Of several times each
                is a stage of its own: "NAME, t = 2 s".
            allow_jumps: As in `statics`.

        Raises:
            JumpError: The structure jumps to a distant equilibrium.
            ConvergenceError: A load step did not converge.
        """
        name = stage_name(name, "quasi-statics", self.stages)

        def reached(time: float, state: StaticState) -> None:
            one = name if len(times) == 1 else f"{name}, t = {time:g} s"
            self.static = state
            self._ended(stage_record(self.model, one, time, state, self.model.loads))

        check_grouted(self.static)
        path = [(float(t), 1.0) for t in times]
        more = {"reached": reached, "allow_jumps": allow_jumps}
        self.static = self._march(name, path, self.model.loads, **more)
        return self.static

    def _ended(self, stage: StageRecord) -> None:
        """Show a static stage to the monitors (collective)."""
        self.stages.append(stage)
        for monitor in self.monitors:
            monitor.static_stage(self.model, self.stages)

    def _march(
        self,
        name: str,
        path: Sequence[tuple[float | None, float]],
        acting: Sequence[Load],
        **more: Any,
    ) -> StaticState:
        """`march` from the last static state with the simulation's solver (collective)."""
        with self._phase("static"), failures_shown(name, self.model, self.monitors, self.stages):
            start = self.model, self.static, path, acting
            more |= {"options": self._options, "kind": self.solver, "watch": self._watch}
            found = march(*start, **more)
        free_petsc_garbage(self.model.jointed.mesh.comm)  # matrices of the stage's solver
        return found

    def save_static(self, path: str | Path) -> None:
        """Keep the static stages so far in a file, to go on from the last later (collective).

        Args:
            path: The file; one that is there already is replaced at once.
        """
        if self.static is None:
            raise JointsError("There is no static state to save yet: run statics() before.")
        static_keeper(path, self.model).save_static(self.static, self.stages)

    def load_static(self, path: str | Path) -> StaticState:
        """Go on from a static state of the same model that was saved (collective).

        Args:
            path: The file that `save_static` wrote, on any number of ranks.
        """
        self.static, self.stages = static_keeper(path, self.model).load_static()
        return self.static

    @checked
    @refuses_removed
    def dynamics(
        self,
        *,
        dt: Annotated[float, at.Gt(0), at.Unit("s")],
        steps: Annotated[int, at.Ge(1)],
        motion: Callable[[float], Any] | None = None,
        loads: Sequence[Load] = (),
        scheme: Scheme | None = None,
        control: StepControl | None = None,
        start: DynamicState | InitialFields | None = None,
        checkpoint: Checkpoints | None = None,
    ) -> Outcome:
        """March from the static state (or from zero) with the model's loads kept (collective).

        Args:
            dt: Time step [s].
            steps: Number of steps.
            motion: Ground acceleration (3,) [m/s^2] at a time [s], or a `DifferingMotion`, as
                `Motion.for_steps` returns them; axes in 2-D are those of `BaseMotion`. Other
                functions are read as they are: use `Motion.scaled`, not ``lambda t: 2 * m(t)``.
            loads: Loads of this stage besides the model's own.
            scheme: Time scheme, `EnergyConsistent` unless given.
            control: When steps are cut; where their solve fails unless given.
            start: `InitialFields` on top of the static state, or a state to go on from instead,
                such as ``state`` of an earlier outcome; at rest unless given.
            checkpoint: Where the run is kept on the disk as it goes, and whether it goes on from
                there, with the arguments and monitors of the run that wrote the file. The states
                of the file are taken then, of ``start`` the time alone. Nowhere unless given.

        Raises:
            CheckpointError: A checkpoint cannot be written, is missing, damaged or another run's.
            ConvergenceError: A step did not converge however often halved; monitors have the rest.
        """
        scheme, control = checked_settings(scheme, control, start, checkpoint)
        given = given_fields(self.model, start)
        resume = checkpoint is not None and checkpoint.resume
        (motion, *loads), lost = for_steps([motion, *loads], dt, self.model.jointed.mesh.comm)
        acting, differing = shaken_by(motion, loads), differing_ground(self.model, motion)
        stage: dict[str, Any] = {"ground motion": motion}
        ground = ground_motions(self.model, motion, loads, differing)
        motion = ground.motion
        state = start if isinstance(start, DynamicState) else None
        if begins := not resume and state is None:
            check_complete(self.static)
        if checkpoint is not None:
            checkpoint.check(self.model.jointed.mesh.comm)
        with self._phase("set-up of the dynamic stage"), released(checkpoint, at_end=False):
            kept = [SupportForces(self.model)] if self.model.absorbing else []
            shaking: list[Load] = [*moved_by(motion, dt), *kept, *loads]
            system = on_ground(differing, self.model.system(shaking, waves=dt, shared=self.shared))
            solver = make_solver(system, self._options, self.solver)
            times = ends_of_steps(state.time if state else 0.0, dt, steps)
            facts = {"time step": dt, "number of steps": steps, "time scheme": scheme}
            facts |= {"start at": float(times[0]), "step control": control}
            facts |= {"solver": self.solver, "Newton": self._options}
            facts |= {f"initial {name}": vector for name, vector in given.items()}
            keeper = None
            if checkpoint is not None:
                stage |= facts
                keeper = CheckpointKeeper(checkpoint, self.model, system, stage, loads, times)
            saved = keeper.load(self.monitors) if keeper and resume else None
            self.static = self.static if saved is None else saved.static
            if kept and self.static is not None:
                kept[0].take(self.static.reaction, system.constrained)
            state = saved.state if saved else first_state(solver, dt, self.static, state, given)
            before = self.static, self.stages
            doubts = sudden_loads(self.model, system, state, *before, shaking) if begins else []
            run = DynamicRun(
                self.model,
                Stepper(scheme, solver, EnergyLedger(system), control),
                state,
                steps,
                ground=ground,
                monitors=self.monitors,
                watch=self._watch,
                warnings=[*self.model.doubts, *lost, *doubts],
            )
        with released(checkpoint, at_end=True), run.watched(self.seconds):
            if saved is None:
                settings = {name: in_words(each) for name, each in facts.items()} | acting
                run.start(settings, tuple(self.stages))
                self._save(keeper, run)
            else:
                run.resume(saved.state_dict, saved.origin)
            while run.step < steps:
                self._step(run, dt, float(times[run.step + 1]))
                self._save(keeper, run)
        return run.outcome()

    def _step(self, run: DynamicRun, dt: float, end: float) -> None:
        """One step, recorded by the monitors (collective)."""
        with self._phase("time steps"):
            try:
                report = run.take(dt, end)
            except ConvergenceError as failure:
                run.warn_of_slip()
                raise located(failure, stage="dynamic", step=run.step + 1) from None
        with self._phase("monitors"):
            run.show(report)
        if run.step % GARBAGE_INTERVAL == 0:
            free_petsc_garbage(self.model.jointed.mesh.comm)
            run.warn_of_slip()

    def _save(self, keeper: CheckpointKeeper | None, run: DynamicRun) -> None:
        """Write a checkpoint where one is due (collective)."""
        if keeper is not None:
            with self._phase("checkpoints"):
                keeper.save_if_due(run, self.static)

    def report(self, outcome: Outcome) -> str:
        """Closing lines of a run: energy error, accuracy, iterations and seconds by phase."""
        return closing_lines(outcome, self.model, self.seconds)

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        """Add the wall time of a block to a phase."""
        began = clock.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + clock.perf_counter() - began
