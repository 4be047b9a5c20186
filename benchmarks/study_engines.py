# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A study of 8 cases on different executors: the same table from each, also after a kill.

`make bench-studies` brings dask and submitit. Each executor runs the study once whole, and once
killed by signal 9 (with all its processes) when two cases have rows, and started again.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints import measures
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.study import Study, Table, read_table

CASES, WORKERS = 8, 2
ENGINES = ("processes", "pool", "mpi", "dask", "submitit")
NEEDS = {"mpi": "mpi4py", "dask": "distributed", "submitit": "submitit"}


def shaken_wall(folder: Path, *, angle: float) -> dict[str, float]:
    """A wall with three joints of a friction angle [degrees]: opening, slip, energy error."""
    from mpi4py import MPI

    msh = jointed_wall(folder / "wall.msh", divisions=(4, 1, 4))
    law = dj.FrictionNoTension(
        normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=angle
    )
    model = dj.Model(
        dj.read_msh(msh, MPI.COMM_WORLD),
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    monitor = dj.ResultsMonitor(folder / "run.h5", points={"crest": (0.0, 0.0, 20.0)})
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    outcome = simulation.dynamics(dt=4e-3, steps=50, motion=shaking)
    with dj.Results(folder / "run.h5") as results:
        peaks = measures.joint_measures(results)["joint_2"]
    return {
        "opening": peaks["opening_max"],
        "slip": peaks["slip_max"],
        "balanced": float(outcome.energy_error < 1e-9),
        "ranks": float(MPI.COMM_WORLD.size),
    }


def shaking(time: float) -> np.ndarray:
    """Acceleration of the ground [m/s^2]."""
    return 12.0 * np.sin(2 * np.pi * np.array([2.3, 2.9, 3.1]) * time)


class Jobs(Executor):
    """submitit's executor, whose jobs are no futures: a thread waits for each."""

    def __init__(self, executor: Any, jobs: int) -> None:
        """Take the executor, and how many jobs it may be given at once."""
        self._executor, self._threads = executor, ThreadPoolExecutor(jobs)

    def submit(self, function: Any, /, *args: Any, **options: Any) -> Future[Any]:
        """Hand a job on."""
        return self._threads.submit(
            lambda: self._executor.submit(function, *args, **options).result()
        )


@contextmanager
def executor(engine: str, path: Path) -> Iterator[Executor | None]:
    """The executor of a name."""
    if engine == "pool":
        with ProcessPoolExecutor(WORKERS) as pool:
            yield pool
    elif engine == "mpi":
        from mpi4py.futures import MPIPoolExecutor

        with MPIPoolExecutor() as ranks:
            yield ranks
    elif engine == "dask":
        from dask.distributed import Client

        with Client(n_workers=WORKERS, threads_per_worker=1, dashboard_address=None) as client:
            yield client.get_executor()
    elif engine == "submitit":
        import submitit

        jobs = submitit.AutoExecutor(folder=path.with_suffix(".jobs"), cluster="local")
        jobs.update_parameters(timeout_min=5)
        yield Jobs(jobs, WORKERS)
    else:
        yield None


def run(engine: str, path: Path) -> None:
    """Run the study here, or what is left of it."""
    cases = {f"{k}_degrees": {"angle": float(k)} for k in range(20, 20 + CASES)}
    with executor(engine, path) as chosen:
        Study(path, shaken_wall, cases).run(executor=chosen, workers=WORKERS, progress=False)


def start(engine: str, path: Path) -> subprocess.Popen[bytes]:
    """Run it in a process group of its own."""
    command = [sys.executable, "-m", "benchmarks.study_engines", "--run", engine, str(path)]
    if engine == "mpi":
        mpi = ["mpirun", "--oversubscribe", "-n", str(WORKERS + 1), sys.executable]
        command = [*mpi, "-m", "mpi4py.futures", *command[1:]]
    return subprocess.Popen(command, start_new_session=True)


def finished(path: Path) -> int:
    """Rows that there are."""
    try:
        return len(read_table(path)["case"])
    except dj.JointsError:
        return 0


def killed_and_resumed(engine: str, path: Path) -> int:
    """Kill it when two cases have rows, run the rest; cases whose rows it kept."""
    process = start(engine, path)
    while finished(path) < 2:
        if process.poll() is not None:
            raise RuntimeError(f"{engine} ended with code {process.returncode}")
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    kept = finished(path)
    time.sleep(2.0)  # processes in other groups see the end of the runner
    if start(engine, path).wait():
        raise RuntimeError(f"{engine} could not be continued")
    return kept


def values(table: Table) -> dict[str, list[Any]]:
    """The table without times and memory."""
    measured = ("wall_s", "peak_mb")
    return {name: column.tolist() for name, column in table.items() if name not in measured}


def main() -> int:
    """Print a line for each executor; 1 where a table differs."""
    parser = Parser(description=__doc__)
    parser.add_argument("--run", nargs=2, metavar=("ENGINE", "PATH"), help="run one here")
    parser.add_argument("--quick", action="store_true", help="processes and pool alone")
    options = parser.parse_args()
    if options.run:
        run(options.run[0], Path(options.run[1]))
        return 0
    expected: dict[str, list[Any]] = {}
    same = True
    with tempfile.TemporaryDirectory() as name:
        for engine in ENGINES[: 2 if options.quick else None]:
            if find_spec(NEEDS.get(engine, "numpy")) is None:
                print(f"{engine:10} left out: {NEEDS[engine]} is missing")
                continue
            whole, cut = Path(name) / engine, Path(name) / f"{engine}_killed"
            began = time.perf_counter()
            code = start(engine, whole).wait()
            seconds = time.perf_counter() - began
            kept = killed_and_resumed(engine, cut)
            tables = [values(read_table(path)) for path in (whole, cut)]
            expected = expected or tables[0]
            agree = code == 0 and all(table == expected for table in tables)
            print(f"{engine:10} {seconds:6.1f} s, killed with {kept} rows, tables equal: {agree}")
            same = same and agree
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
