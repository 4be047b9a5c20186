# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stages of a run, static then dynamic, and the only time loop.

The loop itself writes no results: monitors write files, plots and progress bars.
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
from dolfinx_joints.motions.differing import DifferingMotion
from dolfinx_joints.simulation.checkpoint import CheckpointKeeper, Checkpoints, static_keeper
from dolfinx_joints.simulation.differing_ground import DifferingGround
from dolfinx_joints.simulation.dynamic_stage import DynamicRun, ground_motions
from dolfinx_joints.simulation.first_state import (
    InitialFields,
    check_settings,
    dynamic_loads,
    field_vectors,
    first_state,
    in_words,
)
from dolfinx_joints.simulation.monitor import Monitor, report_failures
from dolfinx_joints.simulation.outcome import Outcome, StaticState, closing_lines
from dolfinx_joints.simulation.record import StageRecord, grout_record, stage_name, stage_record
from dolfinx_joints.simulation.start_checks import check_complete, sudden_loads
from dolfinx_joints.simulation.statics.construction import grout_joints
from dolfinx_joints.simulation.statics.stage import check_acting, march
from dolfinx_joints.simulation.statics.stage_start import unloaded_state
from dolfinx_joints.simulation.statics.unfinished import check_grouted, unfinished_stage
from dolfinx_joints.solvers.batch import SharedBulk
from dolfinx_joints.solvers.choice import SolverKind, make_solver
from dolfinx_joints.solvers.step_solver import SolverOptions
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepControl, Stepper, ends_of_steps, locate

# Steps between two calls of PETSc's garbage collection on several ranks.
GARBAGE_INTERVAL = 10


@dataclass(eq=False, repr=False)
@checked
class Simulation:
    """Runs the static and dynamic stages of a model.

    Args:
        model: The model.
        monitors: Observers of the run.
        options: Tolerances and limits of Newton's method.
        solver: ``auto``, ``condensed``, ``monolithic`` or ``forms``; see `make_solver`.

    Attributes:
        static: Result of the last static stage, None before the first stage.
        stages: Static stages so far, for monitors of dynamic stages and `save_static`. Clear the
            list if it takes too much memory, for example after many small steps in time.
        seconds: Wall time by phase [s].

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> run = dj.Simulation(model)
        >>> state = run.statics()
        >>> end = run.dynamics(dt=0.01, steps=10, motion=lambda t: (1.0, 0.0, 0.0)).state
        >>> round(end.displacement.min()[1], 5)  # the upper block slides, -0.5 * 1 * 0.1^2 [m]
        -0.005
    """

    model: Model
    _: KW_ONLY
    monitors: Sequence[Monitor] = ()
    options: SolverOptions | None = None
    solver: SolverKind = "auto"

    def __post_init__(self) -> None:
        """Check the arguments; nothing is solved yet."""
        check_kind_of("model", self.model, isinstance(self.model, Model), "a Model")
        self.monitors = list(self.monitors)
        for monitor in self.monitors:
            check_kind_of("A monitor", monitor, isinstance(monitor, Monitor), "a Monitor")
            monitor.check(self.model)
        self.static: StaticState | None = None
        self.stages: list[StageRecord] = []
        self.seconds: dict[str, float] = {}
        self.shared: SharedBulk | None = None  # Shared with other simulations of the model.
        valid = isinstance(self.options, SolverOptions | None)
        check_kind_of("options", self.options, valid, "a SolverOptions")
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
        """Apply loads up to their values at time zero in equal steps (collective).

        The stage starts from the last static stage, or from the unloaded body. Loads of the last
        stage are removed unless ``loads`` contains them. Friction depends on the load path, so the
        number of steps matters if joints slide.

        Args:
            steps: Number of load steps.
            loads: Loads of the model that act at the end; all by default.
            joints: Names of the active joints, ``active`` for all or ``inactive`` for none. The
                other joints have no tractions until `grout`, and each block must be supported
                without them. A joint with tractions cannot become inactive.
            absent: Cell groups of blocks that are not built yet. These blocks have no weight, and
                joints next to them have no tractions. In its first stage, a block is cast free of
                stress, in the position of the mesh, against the existing blocks.
            name: Unique name of the stage in results; "statics 1" and so on by default.
            allow_jumps: If True, jumps are listed in ``StaticState.jumps``; else `JumpError`.

        Raises:
            JointsError: A joint cannot be inactive or must be grouted first, a block is not
                supported, or the iteration on water in joints does not converge.
            JumpError: The structure jumps to a distant equilibrium.
            ConvergenceError: A load step did not converge.
        """
        acting = self.model.loads if loads is None else loads
        check_acting(self.model, acting)
        before = self.static or unloaded_state(self.model)
        stage = unfinished_stage(self.model, before, joints, absent, acting)
        name = stage_name(name, "statics", self.stages)
        path = [(None, step / steps) for step in range(1, steps + 1)]
        self.static = self._march(name, path, acting, stage=stage, allow_jumps=allow_jumps)
        self.add_stage(stage_record(self.model, name, 0.0, self.static, acting))
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
        """Close joints in their present position after a static stage (collective).

        At points without traction, inactive or open, gap and slip are reset to zero; shear keys in
        contact across an opening keep their shear. Points in contact do not change. Inactive joints
        that are not named become active with their present opening. They stay inactive if their
        law gives a traction at this opening.

        Grout under pressure first pushes the faces of these points apart, with constant loads and
        fixed supports. Then the grout sets, and the pressure remains as joint traction.

        Args:
            joints: Names of the joints to grout; by default the inactive joints, or all joints if
                none is inactive.
            gap: Opening that remains after grouting [m].
            pressure: Pressure of the grout [Pa].
            name: Name of the stage in results, "grouting 1" and so on by default.

        Raises:
            JointsError: There is no static state, or the law of a joint excludes the pressure or
                the gap.
            ConvergenceError: No equilibrium under the pressure was found, or only after a jump.
        """
        if self.static is None:
            raise JointsError("grout() needs a static stage: run statics(joints=[...]) first.")
        name = stage_name(name, "grouting", self.stages)
        press = partial(self._march, name, [(None, 1.0)], ())
        self.static = grout_joints(
            self.model, self.static, joints, gap=gap, pressure=pressure, press=press
        )
        self.add_stage(grout_record(self.model, name, self.static, self.stages))
        return self.static

    @checked
    def quasi_statics(
        self,
        times: Annotated[Sequence[float], at.MinLen(1), at.Unit("s")],
        *,
        name: str | None = None,
        allow_jumps: bool = False,
    ) -> StaticState:
        """Compute the equilibrium at each time of a sequence (collective).

        Loads and prescribed displacements follow their functions of time; inertia and damping are
        neglected. The stage starts from the last static stage, or from the unloaded body.

        Args:
            times: Times [s] of the load steps.
            name: Name in results, "quasi-statics 1" and so on by default. If there are several
                times, each is recorded as a separate stage, "NAME, t = 2 s".
            allow_jumps: As in `statics`.

        Raises:
            JumpError: The structure jumps to a distant equilibrium.
            ConvergenceError: A load step did not converge.
        """
        name = stage_name(name, "quasi-statics", self.stages)

        def add_step(time: float, state: StaticState) -> None:
            label = name if len(times) == 1 else f"{name}, t = {time:g} s"
            self.static = state
            self.add_stage(stage_record(self.model, label, time, state, self.model.loads))

        check_grouted(self.static)
        path = [(float(t), 1.0) for t in times]
        options = {"reached": add_step, "allow_jumps": allow_jumps}
        self.static = self._march(name, path, self.model.loads, **options)
        return self.static

    def add_stage(self, stage: StageRecord) -> None:
        """Add a static stage and pass it to the monitors (collective)."""
        self.stages.append(stage)
        for monitor in self.monitors:
            monitor.static_stage(self.model, self.stages)

    def _march(
        self,
        name: str,
        path: Sequence[tuple[float | None, float]],
        acting: Sequence[Load],
        **arguments: Any,
    ) -> StaticState:
        """Run `march` from the last static state with the simulation's solver (collective)."""
        with self.phase("static"), report_failures(name, self.model, self.monitors, self.stages):
            start = self.model, self.static or unloaded_state(self.model), path, acting
            arguments |= {"options": self._options, "kind": self.solver, "watch": self._watch}
            state = march(*start, **arguments, accepted=[m.increment for m in self.monitors])
        free_petsc_garbage(self.model.jointed.mesh.comm)  # Matrices of the stage's solver.
        return state

    def save_static(self, path: str | Path) -> None:
        """Write the static stages so far to a file, replacing an existing one (collective)."""
        if self.static is None:
            raise JointsError("save_static() needs a static stage: run statics() first.")
        static_keeper(path, self.model).save_static(self.static, self.stages)

    def load_static(self, path: str | Path) -> StaticState:
        """Load the static stages that `save_static` wrote, to continue from the last (collective).

        The number of ranks may differ.
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
        """Integrate the motion from the static state, or from rest, under loads (collective).

        Args:
            dt: Time step [s].
            steps: Number of steps.
            motion: Ground acceleration (3,) [m/s^2] as a function of time [s], or a
                `DifferingMotion`, as returned by `Motion.for_steps`; for axes in 2-D see
                `BaseMotion`. Other functions are not resampled: use `Motion.scaled` instead of
                ``lambda t: 2 * m(t)``.
            loads: Loads of this stage in addition to the loads of the model.
            scheme: Time scheme, `EnergyConsistent` by default.
            control: Step-size control; by default, steps are halved if their solve fails.
            start: `InitialFields` in addition to the static state; or, instead of the static state,
                a dynamic state, such as ``state`` of an earlier outcome. At rest by default.
            checkpoint: File for checkpoints; no checkpoints by default. To restart from the file,
                pass the arguments and monitors of the run that wrote it. Then the states are read
                from the file, and only the time of ``start`` is used.

        Raises:
            CheckpointError: A checkpoint cannot be written, is missing, damaged or of another run.
            ConvergenceError: A shortest substep failed; the monitors have all previous steps.
        """
        scheme, control = check_settings(scheme, control, start, checkpoint)
        fields = field_vectors(self.model, start)
        resume = checkpoint is not None and checkpoint.resume
        (motion, *loads), resampling = for_steps([motion, *loads], dt, self.model.jointed.mesh.comm)
        acting, stage = dynamic_loads(motion, loads), dict[str, Any]({"ground motion": motion})
        differing = None
        if isinstance(motion, DifferingMotion):
            differing = DifferingGround(self.model, motion)
        ground = ground_motions(self.model, motion, loads, differing)
        motion = ground["motion"]
        state = start if isinstance(start, DynamicState) else None
        if begins := not resume and state is None:
            check_complete(self.static)
        if checkpoint is not None:
            checkpoint.check(self.model.jointed.mesh.comm)
        with self.phase("set-up of the dynamic stage"), released(checkpoint, at_end=False):
            reactions = [SupportForces(self.model)] if self.model.absorbing else []
            added: list[Load] = [*moved_by(motion, dt), *reactions, *loads]
            system = self.model.system(added, waves=dt, shared=self.shared)
            system = differing.moving(system) if differing else system
            solver = make_solver(system, self._options, self.solver)
            times = ends_of_steps(state.time if state else 0.0, dt, steps)
            facts = {"time step": dt, "number of steps": steps, "time scheme": scheme}
            facts |= {"start at": float(times[0]), "step control": control}
            facts |= {"solver": self.solver, "Newton": self._options}
            facts |= {f"initial {name}": vector for name, vector in fields.items()}
            keeper = None
            if checkpoint is not None:
                stage |= facts
                keeper = CheckpointKeeper(checkpoint, self.model, system, stage, loads, times)
            saved = keeper.load(self.monitors) if keeper and resume else None
            self.static = self.static if saved is None else saved.static
            if reactions and self.static is not None:
                reactions[0].set_reactions(self.static.reaction, system.constrained)
            state = saved.state if saved else first_state(solver, dt, self.static, state, fields)
            before = self.static, self.stages
            sudden = sudden_loads(self.model, system, state, *before, added) if begins else []
            run = DynamicRun(
                self.model,
                Stepper(scheme, solver, EnergyLedger(system), control),
                state,
                steps,
                ground=ground,
                monitors=self.monitors,
                watch=self._watch,
                warnings=[*self.model.doubts, *resampling, *sudden],
            )
        with released(checkpoint, at_end=True), run.finishing_monitors(self.seconds):
            if saved is None:
                settings = {name: in_words(fact) for name, fact in facts.items()} | acting
                run.start(settings=settings, stages=tuple(self.stages))
                self._save(keeper, run)
            else:
                run.resume(saved.state_dict, saved.origin)
            while run.step < steps:
                self._step(run, dt, float(times[run.step + 1]))
                self._save(keeper, run)
        return run.outcome()

    def _step(self, run: DynamicRun, dt: float, end: float) -> None:
        """Compute a step and pass it to the monitors (collective)."""
        with self.phase("time steps"):
            try:
                report = run.advance(dt, end)
            except ConvergenceError as failure:
                run.warn_of_slip()
                raise locate(failure, stage="dynamic", step=run.step + 1) from None
        with self.phase("monitors"):
            run.show(report)
        if run.step % GARBAGE_INTERVAL == 0:
            free_petsc_garbage(self.model.jointed.mesh.comm)
            run.warn_of_slip()

    def _save(self, keeper: CheckpointKeeper | None, run: DynamicRun) -> None:
        """Write a checkpoint if one is due (collective)."""
        if keeper is not None:
            with self.phase("checkpoints"):
                keeper.save_if_due(run, self.static)

    def report(self, outcome: Outcome) -> str:
        """Return a summary: energy error, accuracy, iterations and wall time by phase."""
        return closing_lines(outcome, self.model, self.seconds)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Measure the wall time of a ``with`` block and add it to a phase."""
        start = clock.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + clock.perf_counter() - start
