# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Concurrent runs of one model under a suite of ground motions."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import (
    ConvergenceError,
    JointsError,
    OtherRunError,
    ResultsError,
    StudyError,
)
from dolfinx_joints.common.hdf5 import check_superblock
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import check_kind_of, check_named
from dolfinx_joints.common.summary import Rows, Summarised, names
from dolfinx_joints.loads.ground_motion import MOVING, IncidentWave
from dolfinx_joints.loads.oblique_field import rising_waves
from dolfinx_joints.monitors.results_monitor import ResultsMonitor
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.spectra import arias_intensity, response_spectrum
from dolfinx_joints.postprocessing.frames import usual_reference
from dolfinx_joints.postprocessing.peaks import crest_points, displacement_peak, joint_peaks
from dolfinx_joints.results.reader import Results
from dolfinx_joints.simulation.checkpoint import Checkpoints
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.solvers.batch import SharedBulk
from dolfinx_joints.study.runner import Tally, check_name
from dolfinx_joints.study.table import Table

if TYPE_CHECKING:
    from dolfinx_joints.monitors.probes import Probe
    from dolfinx_joints.simulation.outcome import Outcome

State = Literal["there", "begun", "new"]
Waves = Mapping[str, Sequence[Any] | None]  # loads of the free field by name of the run

# Errors that end the run of one motion only; the other runs continue.
OF_ONE = (ConvergenceError, JointsError, OtherRunError)

# Metadata key in the results file.
DIGEST = "motion of the suite"


class MotionSuite(Summarised):
    """Runs of one model from one static state, each under a separate ground motion.

    The runs share the bulk's factor and the joint compliance. Linear systems of all runs are solved
    as blocks, which is several times faster than one solve per run. The joints of each run iterate
    independently, so its results equal those of a single run to rounding. Each run writes a results
    file ``NAME.h5`` and, until it ends, a checkpoint ``NAME.checkpoint``. A suite that was killed
    continues from the checkpoints.

    Args:
        path: Folder of the suite, created if missing.
        simulation: Simulation with the model, options and static state.
        motions: Ground motions by name of the run.
        points: Monitor points, see `ResultsMonitor`.
        every: Steps between two states in the results files.

    Raises:
        ValueError: A name is not a file name, or a motion is not a `Motion`.
    """

    def __init__(
        self,
        path: str | Path,
        simulation: Simulation,
        motions: Mapping[str, Motion],
        *,
        points: Mapping[str, Sequence[float] | Probe],
        every: int = 10,
    ) -> None:
        """Check the motions; write nothing yet."""
        check_kind_of("simulation", simulation, isinstance(simulation, Simulation), "a Simulation")
        check_named("motions", motions, "motions by name of the run")
        for name, motion in motions.items():
            check_name(f"The run {name!r}", name)
            check_kind_of(f"The motion {name!r}", motion, isinstance(motion, Motion), "a Motion")
        self.path, self.motions = Path(path), dict(motions)
        self._simulation, self._points, self._every = simulation, points, every
        self._comm = simulation.model.jointed.mesh.comm

    def _summary(self) -> Rows:
        yield "folder", self.path
        yield "motions", f"{len(self.motions)}: {names(self.motions)}"

    @checked
    def run(
        self,
        *,
        dt: Annotated[float, at.Gt(0), at.Unit("s")],
        at_once: Annotated[int, at.Ge(1)] = 16,
        checkpoint_every: Annotated[int, at.Ge(1)] = 200,
        rerun_changed: bool = False,
        free_field: Callable[[Motion], Sequence[Any]] | None = None,
        **options: Any,
    ) -> Tally:
        """Run all motions without complete results to their ends (collective).

        Complete runs are not repeated if the model, its static state or ``options`` change.

        Args:
            dt: Time step [s].
            at_once: Number of concurrent runs; each run stores about 20 vectors.
            checkpoint_every: Steps between two checkpoints of a run.
            rerun_changed: Repeat runs whose motion or time step has changed (otherwise an error),
                and restart incomplete runs whose model, points or ``options`` have changed
                (otherwise they fail).
            free_field: Function that returns a list with the `FreeField` or `ObliqueFreeField` of a
                motion, which then moves the model in place of the motion itself. A run lasts as
                long as the motion and the outcrops of `incident_wave` in the list.
            options: ``scheme``, ``control`` and ``loads`` of `Simulation.dynamics`.

        Returns:
            Completed runs, failed runs with reasons, and runs skipped as already complete.

        Raises:
            StudyError: The motion, the time step or the outcrop of a run has changed.
            ResultsError: A results file cannot be written; the other runs have been completed.
        """
        waves = {n: free_field(m) if free_field else None for n, m in self.motions.items()}
        for name, loads in waves.items() if free_field else ():
            good = isinstance(loads, Sequence) and bool(rising_waves(loads))
            check_kind_of(f"free_field of {name!r}", loads, good, "a list with a FreeField")
        states = on_root(self._comm, lambda: self._states(dt, waves, rerun_changed))
        waiting = [name for name, state in states.items() if state != "there"]
        shared = SharedBulk()
        try:
            outcomes = shared.scheduler.run(
                {
                    n: self._task(
                        n, dt, states[n], shared, checkpoint_every, rerun_changed, waves[n], options
                    )
                    for n in waiting
                },
                at_once,
            )
        finally:
            shared.destroy()
        failed = {n: str(end) for n, end in outcomes.items() if type(end) in OF_ONE}
        for end in outcomes.values():
            if isinstance(end, Exception) and type(end) not in OF_ONE:
                raise end  # an error that affects all runs, such as a wrong point or a full disk
        done = [name for name in waiting if name not in failed]
        skipped = [name for name in states if name not in waiting]
        return Tally(done=done, failed=failed, skipped=skipped, failed_before={}, remarks={})

    def results(self, name: str) -> Path:
        """Return the results file of a run."""
        return self.path / f"{name}.h5"

    @checked
    def table(self, *, period: Annotated[float, at.Gt(0), at.Unit("s")] | None = None) -> Table:
        """Return intensities and responses, one row per complete run, in the order of the motions.

        Columns of the motion (in 2-D of x and z, which move the model):

        - ``pga [m/s^2]`` and ``sa [m/s^2]``, the largest component of the acceleration and of the
          pseudo-acceleration at a ``period`` [s] with 5 % damping,
        - ``arias [m/s]``, the sum over the components.

        Columns of the run:

        - ``opening [m]``, ``slip [m]`` and the smallest ``safety [-]`` against sliding of all
          joints, as in `joint_peaks`,
        - ``displacement [m]``, the largest component of a crest point from the static state, under
          a free field relative to the level free surface,
        - ``imbalance [-]`` of the energy ledger.
        """
        stored = {name: self._stored(self.results(name)) for name in self.motions}
        complete = [name for name, run in stored.items() if run is not None and run[0]]
        rows = [self._row(name, period) for name in complete]
        values = {column: np.array([row[column] for row in rows]) for column in (rows or [{}])[0]}
        return {"case": np.array(complete, dtype=object), **values}

    def _row(self, name: str, period: float | None) -> dict[str, float]:
        motion = self.motions[name]
        acceleration = motion.acceleration[:, MOVING[self._simulation.model.gdim]]
        arias = arias_intensity(acceleration, motion.dt)[-1].sum()
        row = {"pga [m/s^2]": float(np.abs(acceleration).max()), "arias [m/s]": float(arias)}
        if period is not None:
            spectrum = response_spectrum(acceleration, motion.dt, [period], 0.05)
            row["sa [m/s^2]"] = float(spectrum.pseudo_acceleration.max())
        with Results(self.results(name)) as results:
            joints = [joint_peaks(results, joint) for joint in results.joints]
            for kind, unit, of in (("opening", "m", max), ("slip", "m", max), ("safety", "-", min)):
                values = [peaks[kind].value for peaks in joints if not np.isnan(peaks[kind].value)]
                row[f"{kind} [{unit}]"] = of(values, default=math.nan)
            crest = displacement_peak(results, crest_points(results), usual_reference(results))
            row["displacement [m]"] = abs(crest.value)
            imbalance = results.summary["imbalance"]
            row["imbalance [-]"] = math.nan if imbalance is None else imbalance
        return row

    def _states(self, dt: float, waves: Waves, rerun_changed: bool) -> dict[str, State]:
        """Return the state of each run: complete, begun or new."""
        self.path.mkdir(parents=True, exist_ok=True)
        states: dict[str, State] = {}
        for name, motion in self.motions.items():
            path = self.results(name)
            states[name] = "new"
            stored = self._stored(path)
            if stored is None:
                continue
            complete, digest = stored
            if digest != _digest(motion, dt, waves[name]):
                if not rerun_changed:
                    raise StudyError(
                        f"{path} was computed with another motion, free field, time step or "
                        f"version for {name!r}; pass rerun_changed=True to run it again, or use "
                        "another folder."
                    )
            elif complete:
                states[name] = "there"
            elif self._checkpoint(name).exists():
                states[name] = "begun"
        return states

    def _stored(self, path: Path) -> tuple[bool, Any] | None:
        """Return True if a run is complete, and its digest; None without a readable file.

        A run that was killed during its setup leaves a file that cannot be read.
        """
        if not path.exists():
            return None
        try:
            with Results(path) as results:
                return results.complete, results.metadata.get(DIGEST)
        except ResultsError:
            if path.stat().st_size and not check_superblock(path, ResultsError):
                raise
            return None

    def _checkpoint(self, name: str) -> Path:
        return self.path / f"{name}.checkpoint"

    def _task(
        self,
        name: str,
        dt: float,
        state: State,
        shared: SharedBulk,
        every: int,
        rerun_changed: bool,
        waves: Sequence[Any] | None,
        options: Mapping[str, Any],
    ) -> Any:
        """Return a function that runs the model under a motion."""
        given, motion = self._simulation, self.motions[name]
        loads = [*options.get("loads", ()), *(waves or ())]
        # Do not add a step if the duration exceeds the last step only by rounding.
        duration = max(moving.duration for moving in (motion, *_outcrops(waves)))
        steps = max(math.ceil(duration / dt * (1.0 - 1e-12)), 1)

        def run(*, resume: bool) -> Outcome:
            monitor = ResultsMonitor(
                self.results(name),
                points=self._points,
                every=self._every,
                overwrite=True,
                metadata={DIGEST: _digest(motion, dt, waves)},
            )
            one = Simulation(
                given.model, monitors=[monitor], options=given.options, solver=given.solver
            )
            one.static, one.stages, one.shared = given.static, list(given.stages), shared
            path = self._checkpoint(name)
            kept = Checkpoints(path, every=every, overwrite=True, resume=resume)
            ground = motion if waves is None else None
            outcome = one.dynamics(
                dt=dt, steps=steps, motion=ground, checkpoint=kept, **{**options, "loads": loads}
            )
            on_root(self._comm, path.unlink)
            return outcome

        def begun() -> Outcome:
            try:
                return run(resume=True)
            except OtherRunError as error:
                if not rerun_changed:
                    raise OtherRunError(f"{error} Pass rerun_changed=True to restart it.") from None
            return run(resume=False)

        return begun if state == "begun" else partial(run, resume=False)


def _outcrops(waves: Sequence[Any] | None) -> list[Motion]:
    """Return the motions of the rising waves that `incident_wave` made."""
    incidents = [wave.incident for wave in rising_waves(waves or ())]
    return [incident.outcrop for incident in incidents if isinstance(incident, IncidentWave)]


def _digest(motion: Motion, dt: float, waves: Sequence[Any] | None) -> str:
    """Return a hash of the motion, the time step, and the free field with its outcrops."""
    digest = hashlib.sha256()
    for moving in (motion, *_outcrops(waves)):
        digest.update(moving.acceleration.tobytes() + repr((moving.dt, dt)).encode())
    digest.update("".join(type(wave).__name__ for wave in waves or ()).encode())
    return digest.hexdigest()
