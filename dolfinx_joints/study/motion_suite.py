# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One model under a suite of ground motions, side by side."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
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
from dolfinx_joints.loads.ground_motion import MOVING
from dolfinx_joints.monitors.results_monitor import ResultsMonitor
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.spectra import arias_intensity, response_spectrum
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

# Failures of a step, or of one run to go on: of one motion, whatever becomes of others.
OF_ONE = (ConvergenceError, JointsError, OtherRunError)

# Key of a results file's metadata.
DIGEST = "motion of the suite"


class MotionSuite(Summarised):
    """Runs of one model from one static state, each under a ground motion of its own.

    They share the bulk's factor and the compliance at the joints; linear systems are solved in
    blocks of all runs, which takes several times less than one by one. Joints iterate by
    themselves: a run gives what it gives alone, but for rounding. Each has a results file
    ``NAME.h5``, and while it lasts a checkpoint ``NAME.checkpoint``: killed at any moment, a suite
    goes on where it was.

    Args:
        path: Folder of the suite, made where missing.
        simulation: Its model, options and static state are taken.
        motions: Ground motions by name of the run.
        points: Monitor points, see `ResultsMonitor`.
        every: Steps between two states in the results files.

    Raises:
        ValueError: A name is no file name, or a motion is no `Motion`.
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
        """Check the motions; nothing is written yet."""
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
        **options: Any,
    ) -> Tally:
        """Run the motions that have no complete results yet, each to its end (collective).

        A change of the model, its static state or ``options`` goes unnoticed by complete runs.

        Args:
            dt: Time step [s].
            at_once: Runs side by side: each holds its own state, some 20 vectors.
            checkpoint_every: Steps between two checkpoints of a run.
            rerun_changed: Run again what was run under another motion or time step, an error
                otherwise, and begin runs anew that have not ended and had another model, points
                or ``options``; otherwise they fail.
            options: ``scheme``, ``control`` and ``loads`` of `Simulation.dynamics`.

        Returns:
            Runs done, failed with the reason, and skipped because they were there.

        Raises:
            StudyError: The motion of a run has changed.
            ResultsError: A results file cannot be written; other runs have come to their end.
        """
        states = on_root(self._comm, lambda: self._states(dt, rerun_changed))
        waiting = [name for name, state in states.items() if state != "there"]
        shared = SharedBulk()
        try:
            found = shared.scheduler.run(
                {
                    n: self._of(n, dt, states[n], shared, checkpoint_every, rerun_changed, options)
                    for n in waiting
                },
                at_once,
            )
        finally:
            shared.destroy()
        failed = {n: str(end) for n, end in found.items() if type(end) in OF_ONE}
        for end in found.values():
            if isinstance(end, Exception) and type(end) not in OF_ONE:
                raise end  # a wrong point, a full disk: of no use to go on with
        done = [name for name in waiting if name not in failed]
        skipped = [name for name in states if name not in waiting]
        return Tally(done=done, failed=failed, skipped=skipped, failed_before={}, remarks={})

    def results(self, name: str) -> Path:
        """Results file of a run."""
        return self.path / f"{name}.h5"

    @checked
    def table(self, *, period: Annotated[float, at.Gt(0), at.Unit("s")] | None = None) -> Table:
        """Intensities and responses of the complete runs, a row each, in the order of the motions.

        Of a motion: ``pga [m/s^2]`` and ``sa [m/s^2]``, the pseudo-acceleration at a ``period``
        with 5 % damping, the largest of its components; ``arias [m/s]``, the sum of theirs; in
        2-D of x and z, which move the model. Of the run, over all joints: ``opening [m]``, ``slip
        [m]`` and the smallest ``safety [-]`` against sliding, as in `joint_peaks`; ``displacement
        [m]``, the largest single component, x, y or z, of a monitor point at the crest, from the
        static state; ``imbalance [-]`` of the energy lines.
        """
        known = {name: self._known(self.results(name)) for name in self.motions}
        complete = [name for name, found in known.items() if found is not None and found[0]]
        rows = [self._row(name, period) for name in complete]
        values = {what: np.array([row[what] for row in rows]) for what in (rows or [{}])[0]}
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
            for what, unit, of in (("opening", "m", max), ("slip", "m", max), ("safety", "-", min)):
                known = [peaks[what].value for peaks in joints if not np.isnan(peaks[what].value)]
                row[f"{what} [{unit}]"] = of(known, default=math.nan)
            crest = displacement_peak(results, crest_points(results))
            row["displacement [m]"] = abs(crest.value)
            left = results.summary["imbalance"]
            row["imbalance [-]"] = math.nan if left is None else left
        return row

    def _states(self, dt: float, rerun_changed: bool) -> dict[str, State]:
        """Which runs are complete and which have begun."""
        self.path.mkdir(parents=True, exist_ok=True)
        states: dict[str, State] = {}
        for name, motion in self.motions.items():
            path = self.results(name)
            states[name] = "new"
            known = self._known(path)
            if known is None:
                continue
            complete, digest = known
            if digest != _digest(motion, dt):
                if not rerun_changed:
                    raise StudyError(
                        f"{path} is of another motion or time step than {name!r} now has; pass "
                        "rerun_changed=True to run it again, or take another folder."
                    )
            elif complete:
                states[name] = "there"
            elif self._checkpoint(name).exists():
                states[name] = "begun"
        return states

    def _known(self, path: Path) -> tuple[bool, Any] | None:
        """Whether a run is complete, and its digest; None without a run.

        A kill while it was set up leaves a file that is still open for writing and cannot be read.
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

    def _of(
        self,
        name: str,
        dt: float,
        state: State,
        shared: SharedBulk,
        every: int,
        rerun_changed: bool,
        options: Mapping[str, Any],
    ) -> Any:
        """The run of a motion, to be called."""
        given, motion = self._simulation, self.motions[name]
        # Of a sample beyond the last step there is nothing left but rounding.
        steps = max(math.ceil(motion.duration / dt * (1.0 - 1e-12)), 1)

        def run(*, resume: bool) -> Outcome:
            monitor = ResultsMonitor(
                self.results(name),
                points=self._points,
                every=self._every,
                overwrite=True,
                metadata={DIGEST: _digest(motion, dt)},
            )
            one = Simulation(
                given.model, monitors=[monitor], options=given.options, solver=given.solver
            )
            one.static, one.stages, one.shared = given.static, list(given.stages), shared
            path = self._checkpoint(name)
            kept = Checkpoints(path, every=every, overwrite=True, resume=resume)
            outcome = one.dynamics(dt=dt, steps=steps, motion=motion, checkpoint=kept, **options)
            on_root(self._comm, path.unlink)
            return outcome

        def begun() -> Outcome:
            try:
                return run(resume=True)
            except OtherRunError as error:
                if not rerun_changed:
                    raise OtherRunError(
                        f"{error} Pass rerun_changed=True to begin it anew."
                    ) from None
            return run(resume=False)

        return begun if state == "begun" else partial(run, resume=False)


def _digest(motion: Motion, dt: float) -> str:
    """What tells motions and time steps apart."""
    return hashlib.sha256(
        motion.acceleration.tobytes() + repr((motion.dt, dt)).encode()
    ).hexdigest()
