# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of a scene with their cost: wall and processor time, PETSc's times, peak memory."""

from __future__ import annotations

import ctypes
import gc
import statistics
import sys
import time as clock
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from petsc4py import PETSc

import dolfinx_joints as dj
from benchmarks.shared.scenes import TIME_STEP, Scene
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.laws.law import Law
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import Record
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.interface.solver import InterfaceSolver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state

FACTOR = ("MatCholFctrSym", "MatCholFctrNum", "MatLUFactorSym", "MatLUFactorNum")
SINGLE = ("MatSolve", "MatForwardSolve", "MatBackwardSolve")
ITERATION = "JointIteration"
InterfaceSolver._iterate = PETSc.Log.EventDecorator(ITERATION)(  # type: ignore[method-assign]
    InterfaceSolver._iterate
)


def petsc_seconds(names: Sequence[str]) -> float:
    """Return PETSc's logged time of these events on this rank [s]; switch the log on if needed."""
    return sum(info["time"] for info in _logged(names))


def back_substitution(since: tuple[float, int] = (0.0, 0)) -> tuple[float, int]:
    """Return the time of back-substitutions on this rank [s] and their number, minus ``since``."""
    whole, forward, backward = _logged(SINGLE)
    spent = sum(info["time"] for info in (whole, forward, backward))
    return spent - since[0], whole["count"] + backward["count"] - since[1]


def _logged(names: Sequence[str]) -> list[dict[str, Any]]:
    if not PETSc.Log.isActive():
        PETSc.Log.begin()
    return [PETSc.Log.Event(name).getPerfInfo() for name in names]


@contextmanager
def supernodal_factors_alone() -> Iterator[None]:
    """Make steps use CHOLMOD's factor even if the factor in blocks of a node is faster."""
    before, limits.NODE_BLOCK_ROWS = limits.NODE_BLOCK_ROWS, 0
    try:
        yield
    finally:
        limits.NODE_BLOCK_ROWS = before


# Ratio of wall to processor time of a step above which wall times are not reliable.
DISTURBED = 1.1


def print_disturbance(rows: Iterable[dict[str, Any]]) -> None:
    """Warn if other processes used the processors; on one rank only, as ranks wait actively."""
    busy = max(row["wall_over_cpu"] for row in rows)
    if MPI.COMM_WORLD.size == 1 and busy > DISTURBED:
        print(
            f"\nOther processes ran: wall times are up to {busy:.2f} times the processor times."
            "\nUse the processor times, or measure again."
        )


def progress(text: str) -> None:
    """Print the progress on rank 0 to standard error."""
    if MPI.COMM_WORLD.rank == 0:
        print(text, file=sys.stderr, flush=True)


def free_memory() -> None:
    """Free the memory of earlier runs, so that it does not count for the next (collective)."""
    gc.collect()
    free_petsc_garbage(MPI.COMM_WORLD)
    ctypes.CDLL(None).malloc_trim(0)


def reset_peak() -> None:
    """Reset the kernel's largest resident size of this process."""
    Path("/proc/self/clear_refs").write_text("5")


def peak_mb() -> float:
    """Return the largest resident size since `reset_peak`, summed over ranks [MiB] (collective)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    mine = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return MPI.COMM_WORLD.allreduce(mine) / 1024.0


def slowest(value: float) -> float:
    """Return the largest value of all ranks (collective)."""
    return MPI.COMM_WORLD.allreduce(value, op=MPI.MAX)


def bandwidth() -> float:
    """Measure the memory bandwidth of all ranks in a triad, w = y + s x [B/s] (collective)."""
    vectors = [PETSc.Vec().createSeq(10_000_000) for _ in range(3)]
    for vector in vectors:
        vector.set(1.0)
    seconds = []
    for _ in range(7):
        MPI.COMM_WORLD.barrier()
        began = clock.perf_counter()
        vectors[0].waxpy(0.5, *vectors[1:])
        seconds.append(slowest(clock.perf_counter() - began))
    moved = sum(8.0 * vector.getSize() for vector in vectors)
    for vector in vectors:
        vector.destroy()
    return MPI.COMM_WORLD.size * moved / min(seconds)


@dataclass(kw_only=True)
class Phases:
    """Wall time and peak memory by phase.

    Attributes:
        seconds: Wall time of the slowest rank [s].
        peaks_mb: Peak memory in the phase, memory of earlier phases included [MiB].
    """

    seconds: dict[str, float] = field(default_factory=dict)
    peaks_mb: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Measure a block as a phase (collective)."""
        reset_peak()
        began = clock.perf_counter()
        yield
        self.seconds[name] = slowest(clock.perf_counter() - began)
        self.peaks_mb[name] = peak_mb()


class StepWatch(Monitor):
    """Monitor that records the cost of each step and the crest's displacement.

    The clock runs from the end of one call to the beginning of the next. It measures the whole loop
    except this monitor.

    Attributes:
        wall: Wall time of each step [ms].
        cpu: Processor time of each step [ms].
        iterations: Newton iterations of each step's last substep.
        shares: Fractions of joint points open, sticking and sliding after each step.
        crest: Displacement of the crest from the start at the end of each step, (3,) each [m].
        factor: Time of PETSc's factorization in the first step [s].
        solves: Mean wall time of a back-substitution in each step [ms].
        iterating: Wall time of the compiled iteration on the joints in each step [ms].
    """

    def __init__(self, scene: Scene) -> None:
        """Create empty records."""
        self._scene = scene
        self.wall: list[float] = []
        self.cpu: list[float] = []
        self.iterations: list[int] = []
        self.shares: list[tuple[float, float, float]] = []
        self.crest: list[np.ndarray] = []
        self.factor = 0.0
        self.solves: list[float] = []
        self.iterating: list[float] = []

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Find the crest and start the clock."""
        from dolfinx_joints.mesh.node_numbering import NodeNumbering
        from dolfinx_joints.monitors.probes import PointProbe

        self._probe = PointProbe(model, [self._scene.crest], NodeNumbering(model.V))
        self._static = self._probe.read(first.displacement)[0]
        self._factored = petsc_seconds(FACTOR)
        self._solved = back_substitution()
        self._iterated = petsc_seconds([ITERATION])
        self._last = clock.perf_counter(), clock.process_time()

    def record(self, record: Record) -> None:
        """Stop and restart the clock."""
        now = clock.perf_counter(), clock.process_time()
        self.wall.append(1e3 * (now[0] - self._last[0]))
        self.cpu.append(1e3 * (now[1] - self._last[1]))
        spent, solves = back_substitution(since=self._solved)
        self.solves.append(1e3 * spent / max(solves, 1))
        self._solved = back_substitution()
        iterated = petsc_seconds([ITERATION])
        self.iterating.append(1e3 * (iterated - self._iterated))
        self._iterated = iterated
        assert record.solve is not None
        self.iterations.append(record.solve.iterations)
        counts = record.solve.counts
        if counts is not None:
            shares = (counts.open, counts.stick, counts.slip)
            self.shares.append(tuple(n / counts.total for n in shares))
        if len(self.wall) == 1:
            self.factor = petsc_seconds(FACTOR) - self._factored
        self.crest.append(self._probe.read(record.displacement)[0] - self._static)
        self._last = clock.perf_counter(), clock.process_time()

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Release the model."""
        del self._probe


def march(
    scene: Scene,
    mesh: Path,
    steps: int,
    *,
    law: Law | None,
    solver: str = "auto",
    options: dj.SolverOptions | None = None,
    watch: StepWatch | None = None,
    dt: float = TIME_STEP,
) -> dict[str, Any]:
    """Run statics, then the motion, with a law for the joints or without joints (collective).

    Returns:
        Only numbers, so that no memory is kept for the next run. Times are those of the slowest
        rank; times of steps leave out the first step.

        - ``dofs``, constrained ones included, and ``joint_points``;
        - ``ms``, ``cpu_ms``: median wall and processor time of a step;
        - ``solve_ms``, ``iteration_ms``: median wall time of a back-substitution, and of the
          iteration on the joints in a step; ``over_solve``: step over back-substitution;
        - ``setup_s``: wall time by phase: ``mesh`` (read and split), ``assembly``, ``statics``,
          ``factor`` of the bulk, and ``compliance``, the additional time of the first step without
          factor; ``total_s``, ``total_cpu_s``: from reading the mesh to the last step;
        - ``peaks_mb``: peak memory of ``model`` (mesh and assembly), ``statics`` and ``steps``;
          ``peak_mb``: the largest;
        - ``peaks_mm``: largest displacement of the crest from the static state along each axis;
        - ``solver``, ``newton_mean``, ``newton_max``, ``accepted`` and ``cut`` steps, ``ledger``,
          ``energy_error``; with joints ``shares`` of the points open, sticking and sliding.

    Raises:
        ValueError: There are fewer than 2 steps.
    """
    if steps < 2:
        raise ValueError(f"steps is {steps}; the first is not measured, so give at least 2.")
    free_memory()
    phases, watch = Phases(), watch if watch is not None else StepWatch(scene)
    began = clock.perf_counter(), clock.process_time()
    with phases.phase("mesh"):
        jointed = scene.read(mesh, tied=law is None)
    with phases.phase("assembly"):
        model = scene.model(jointed, law)
        simulation = dj.Simulation(model, monitors=[watch], solver=solver, options=options)
    with phases.phase("statics"):
        simulation.statics(steps=scene.load_steps)
    with phases.phase("steps"):
        outcome = simulation.dynamics(dt=dt, steps=steps, motion=scene.shaking(steps * dt))
    kind = "with joints" if law else "linear"
    progress(f"{scene.name}, {kind}: {steps} steps in {phases.seconds['steps']:.1f} s")
    median = statistics.median(watch.wall[1:])
    once = max(watch.wall[0] - median, 0.0) / 1e3
    step, solve = slowest(median), slowest(statistics.median(watch.solves[1:]))
    peaks = phases.peaks_mb
    return {
        "dofs": model.num_dofs,
        "joint_points": model.operator.num_points if model.operator else 0,
        "ms": step,
        "cpu_ms": slowest(statistics.median(watch.cpu[1:])),
        "solve_ms": solve,
        "iteration_ms": slowest(statistics.median(watch.iterating[1:])),
        "over_solve": step / solve,
        "setup_s": {
            **{name: phases.seconds[name] for name in ("mesh", "assembly", "statics")},
            "factor": slowest(watch.factor),
            "compliance": slowest(max(once - watch.factor, 0.0)) if law else 0.0,
        },
        "total_s": slowest(clock.perf_counter() - began[0]),
        "total_cpu_s": slowest(clock.process_time() - began[1]),
        "peaks_mb": {
            "model": max(peaks["mesh"], peaks["assembly"]),
            "statics": peaks["statics"],
            "steps": peaks["steps"],
        },
        "peak_mb": max(peaks.values()),
        "peaks_mm": list(1e3 * np.abs(watch.crest).max(axis=0)),
        "solver": outcome.solver,
        "newton_mean": outcome.iterations / outcome.counts.accepted,
        "newton_max": max(watch.iterations),
        "accepted": outcome.counts.accepted,
        "cut": outcome.counts.rejected,
        "ledger": outcome.imbalance,
        "energy_error": outcome.energy_error,
        "shares": list(np.mean(watch.shares, axis=0)) if watch.shares else None,
    }


def median_of(runs: Sequence[dict[str, Any]], name: str) -> Any:
    """Return the median over runs of a number of `march`, or of each number by name."""
    values = [run[name] for run in runs]
    if isinstance(values[0], dict):
        return {key: statistics.median(value[key] for value in values) for key in values[0]}
    return statistics.median(values)


class Marching:
    """Run with timed steps that can alternate with the steps of other runs.

    Args:
        system: The system.
        dt: Time step [s].
        static: Initial state.
        scheme: The time scheme.

    Attributes:
        ms: Processor time of each step [ms].
        iterations: Newton iterations of all steps.
        ledger: The energy ledger.
    """

    def __init__(
        self, system: dj.MatrixSystem, dt: float, static: StaticState, scheme: dj.EnergyConsistent
    ) -> None:
        """Start from the static state."""
        self._solver, self._dt, self._scheme = make_solver(system), dt, scheme
        self._state = initial_state(
            self._solver, dt=dt, displacement=static.displacement, joints=static.joints
        )
        self.ledger = EnergyLedger(system)
        self.ledger.start(self._state)
        self.ms: list[float] = []
        self.iterations = 0

    def step(self) -> None:
        """Compute a step."""
        began = clock.process_time()
        self._state, report = self._scheme.advance(self._solver, self._state, self._dt)
        self.ms.append(1e3 * (clock.process_time() - began))
        self.ledger.record(self.ledger.after(self._state, report))
        self.iterations += report.solve.iterations
