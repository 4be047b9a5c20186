# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The run that `kills.py` kills: a script with checkpoints, as a user would write it, that traces.

What it does at each moment is kept in a small file mapped into memory, which the system keeps when
the process is killed.

    python3 -m benchmarks._killed_job FOLDER STEPS
    python3 -m benchmarks._killed_job serve

The second loads everything once and forks a run for each line ``FOLDER STEPS`` of its input.
"""

from __future__ import annotations

import functools
import mmap
import os
import struct
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dolfinx_joints.simulation.monitor import Monitor

# In the order in which a run comes to them; the last four take turns.
PHASES = (
    "importing",
    "model",
    "statics",
    "set-up",
    "results begun",
    "results copied",
    "step",
    "records",
    "results written",
    "checkpoint written",
    "end",
)
EVERY, STATES = 2, 2  # steps between two checkpoints, and between two states of the results file
_LAYOUT = struct.Struct("<4i")


class Trace:
    """Where a run is, as others can read it, also after its death.

    Args:
        path: The file; made if it is not there.
    """

    def __init__(self, path: Path) -> None:
        """A new file tells of an import that has begun."""
        if not path.exists():
            path.write_bytes(_LAYOUT.pack(0, -1, -1, -1))
        with path.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), _LAYOUT.size)

    def _read(self) -> tuple[int, ...]:
        return _LAYOUT.unpack(self._memory[:])

    def _set(self, place: int, value: int) -> None:
        struct.pack_into("<i", self._memory, 4 * place, value)

    @property
    def phase(self) -> str:
        """What the run is doing."""
        return PHASES[self._read()[0]]

    @phase.setter
    def phase(self, name: str) -> None:
        self._set(0, PHASES.index(name))

    @property
    def step(self) -> int:
        """Last step taken, -1 before the stage."""
        return self._read()[1]

    @step.setter
    def step(self, value: int) -> None:
        self._set(1, value)

    @property
    def first(self) -> int:
        """Step that the run went on from, 0 if it began anew, -1 before it is known."""
        return self._read()[2]

    @first.setter
    def first(self, value: int) -> None:
        self._set(2, value)

    def during(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """A function that tells that it is at work."""

        @functools.wraps(call)
        def told(*arguments: Any, **named: Any) -> Any:
            before, self.phase = self.phase, name
            answer = call(*arguments, **named)
            self.phase = before
            return answer

        return told


class _StepTold(Monitor):
    """A monitor that traces the steps; it comes last, when the others have their record."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    def start(self, model: Any, stage: str, steps: int, first: Any) -> None:
        """A new run."""
        self._trace.first = self._trace.step = first.step

    def record(self, record: Any) -> None:
        """A step."""
        self._trace.step = record.step

    def resume(self, model: Any, stage: str, steps: int, last: Any, memory: Any) -> None:
        """A run that goes on."""
        self._trace.first = self._trace.step = last.step


def _watch(trace: Trace) -> None:
    """Let the package's writers tell when they are at work."""
    from dolfinx_joints.results.writer import ResultsWriter
    from dolfinx_joints.simulation import checkpoint
    from dolfinx_joints.simulation.dynamic_stage import DynamicRun

    for owner, name, phase in (
        (checkpoint, "write_checkpoint", "checkpoint written"),
        (ResultsWriter, "to_disk", "results written"),
        (ResultsWriter, "_flush_streams", "results written"),
        (ResultsWriter, "_copied", "results copied"),
        (DynamicRun, "start", "results begun"),
        (DynamicRun, "take", "step"),
        (DynamicRun, "show", "records"),
    ):
        call = owner.__dict__[name]
        if isinstance(call, classmethod):
            setattr(owner, name, classmethod(trace.during(phase, call.__func__)))
        else:
            setattr(owner, name, trace.during(phase, call))


def main(folder: Path, steps: int) -> None:
    """Run, or go on with what an earlier process has left (collective)."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    trace = Trace(folder / ("trace" if comm.rank == 0 else f"trace{comm.rank}"))
    import dolfinx_joints as dj
    from benchmarks._scenes import TIME_STEP, dam

    dj.abort_on_error(comm)
    _watch(trace)
    trace.phase = "model"
    scene, mesh = dam("dam tiny"), folder.parent / "mesh.msh"
    if not mesh.exists():
        scene.write(mesh)
    model = scene.model(scene.read(mesh), scene.law())
    results = dj.ResultsMonitor(
        folder / "run.h5",
        points={"crest": scene.crest},
        every=STATES,
        overwrite=True,
        envelopes=True,
    )
    kept = dj.Checkpoints(folder / "run.ckpt", every=EVERY)
    resume = comm.bcast(kept.found)
    simulation = dj.Simulation(model, monitors=[results, _StepTold(trace)])
    if not resume:
        trace.phase = "statics"
        simulation.statics(steps=scene.load_steps)
    trace.phase = "set-up"
    motion = scene.strong_shaking(steps * TIME_STEP)
    simulation.dynamics(dt=TIME_STEP, steps=steps, motion=motion, checkpoint=kept, resume=resume)
    trace.phase = "end"


def serve() -> None:
    """Fork a run for each line of the input; print its number, and how it ended."""
    import gmsh  # noqa: F401
    import mpi4py.MPI  # noqa: F401

    import benchmarks._scenes  # noqa: F401
    import dolfinx_joints as dj

    for name in dj.__all__:
        getattr(dj, name)
    for line in sys.stdin:
        folder, steps = line.rsplit(maxsplit=1)
        child = os.fork()
        if child == 0:
            os._exit(_forked(Path(folder), int(steps)))
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _forked(folder: Path, steps: int) -> int:
    """A run in a process that was forked; its exit status."""
    said = os.open(folder / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    try:
        main(folder, steps)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    if sys.argv[1:] == ["serve"]:
        serve()
    else:
        main(Path(sys.argv[1]), int(sys.argv[2]))
