# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs interrupted and continued from checkpoints end as runs that were not."""

import errno
import hashlib
import os
import random
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from inspect import signature
from pathlib import Path

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import DT, LAW, POINTS, STEPS, Killed, Killer, shaking, valley, wall
from vtk_files import read_vtk

import dolfinx_joints as dj
from dolfinx_joints.simulation import checkpoint_file


def content(path):
    """Everything in a results file but times of day, seconds and the command line."""
    with dj.Results(path) as results:
        assert results.status == "complete"
        found = {name: results.static(name) for name in results.statics}
        for stream, names in results.streams.items():
            found[f"{stream}/time"] = results.time(stream)
            for name in names:
                found[f"{stream}/{name}"] = results.series(stream, name)
        summary = {k: v for k, v in results.summary.items() if k not in ("seconds", "peak_mb")}
        metadata = {k: v for k, v in results.metadata.items() if k != "ranks"}
        metadata["manifest"].pop("command")  # names other folders
        return found, summary, metadata


def interrupted(make, folder, kill_at, *, every=2, solver="auto", **options):
    """Outcomes and results files of a whole run, and of one killed in some steps and resumed."""

    def run(name, kill, checkpoint=None):
        monitors = [
            dj.ResultsMonitor(
                folder / name, points=POINTS, every=3, envelopes=True, resultants=True
            ),
            Killer(kill),
        ]
        simulation = dj.Simulation(make(), monitors=monitors, solver=solver)
        if checkpoint is None or not checkpoint.resume:
            simulation.statics(steps=2)
        return simulation, simulation.dynamics(
            dt=DT, steps=STEPS, motion=shaking, checkpoint=checkpoint, **options
        )

    whole = run("whole.h5", None)
    kept = dj.Checkpoints(folder / "run.ckpt", every=every)
    resume = False
    for step in kill_at:
        with pytest.raises(Killed):
            run("resumed.h5", step, replace(kept, resume=resume))
        resume = True
    return whole, run("resumed.h5", None, replace(kept, resume=True))


def identical(whole, resumed, folder):
    """Fail unless all arrays have the same bits."""
    one, other = content(folder / "whole.h5"), content(folder / "resumed.h5")
    assert one[0].keys() == other[0].keys()
    for name in one[0]:
        np.testing.assert_array_equal(one[0][name], other[0][name], err_msg=name)
    assert one[1:] == other[1:]
    (simulation, outcome), (again, after) = whole, resumed
    for name in ("displacement", "velocity", "acceleration", "momentum", "elastic_force"):
        expected, found = getattr(outcome.state, name), getattr(after.state, name)
        np.testing.assert_array_equal(found.array, expected.array, err_msg=name)
    joints, found = outcome.state.joints, after.state.joints
    for name in ("gap", "elastic_slip", "internal"):
        np.testing.assert_array_equal(getattr(found.state, name), getattr(joints.state, name))
    np.testing.assert_array_equal(found.traction, joints.traction)
    assert after.counts == outcome.counts
    assert after.energy.error == outcome.energy.error
    before, known = simulation.static, again.static
    np.testing.assert_array_equal(known.displacement.array, before.displacement.array)
    assert known.reports == before.reports


BOND = dj.MohrCoulombJoint(
    normal_stiffness=1e11,
    shear_stiffness=1e11,
    friction_angle_deg=30.0,
    cohesion=1e5,
    tensile_strength=5e4,
    dilatancy_angle_deg=5.0,
)
KEYS = dj.ShearKeyJoint(
    normal_stiffness=1e11,
    shear_stiffness=1e11,
    friction_angle_deg=30.0,
    depth=0.2,
    flank_angle_deg=60.0,
    spacing=1.0,
    tooth_cohesion=2e5,
)
WAVES = dj.ReservoirWaves(group="y_min", level=18.0, length=30.0, bottom_reflection=0.7)
CUT = dj.StepControl(max_halvings=3, tolerance=2e-3)
CASES = {
    "condensed": {"solver": "condensed"},
    "condensed, steps cut": {"solver": "condensed", "control": CUT},
    "monolithic": {"solver": "monolithic"},
    "monolithic, steps cut": {"solver": "monolithic", "control": CUT},
    "exact modes, steps cut": {"scheme": dj.EnergyConsistent(exact_modes=6), "control": CUT},
    "Newmark": {"scheme": dj.Newmark()},
    "rigid joints": {"joints": dj.RigidJoint(friction_angle_deg=30.0)},
    "internal variables": {"joints": BOND},
    "shear keys": {"joints": KEYS},
    "reservoir waves": {"water": WAVES},
    "gravity waves": {"water": replace(WAVES, gravity_waves=True)},
}


@pytest.mark.parametrize("case", CASES)
def test_continued_run_has_the_same_bits(case, wall_file, read, tmp_path):
    options = dict(CASES[case])
    law, water = options.pop("joints", LAW), options.pop("water", None)
    kills = (3, 7, 10) if case == "condensed" else (7,)
    whole, resumed = interrupted(
        lambda: wall(read(wall_file()), law, water=water), tmp_path, kills, **options
    )
    identical(whole, resumed, tmp_path)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("solver", "joints", "water"),
    [
        ("condensed", LAW, lambda: None),
        ("monolithic", LAW, lambda: None),
        ("condensed", LAW, lambda: replace(WAVES, gravity_waves=True)),
        ("condensed", LAW, valley),
        # Flanks of 60 degrees and friction of 30 lock: which of many forces is found is rounding.
        ("condensed", replace(KEYS, flank_angle_deg=45.0), lambda: None),
    ],
    ids=["condensed", "monolithic", "waves", "waves above a bed", "shear keys"],
)
@pytest.mark.parametrize("grows", [True, False])
def test_continued_on_another_number_of_ranks(
    comm, wall_file, read, new_path, solver, joints, water, grows
):
    """On one rank first and then on all, and the other way round."""
    path, file = new_path("ranks"), wall_file()
    if comm.rank == 0:
        path.mkdir()
    comm.barrier()
    first, then = (MPI.COMM_SELF, comm) if grows else (comm, MPI.COMM_SELF)

    def run(name, on, kill, checkpoint=None):
        if on.size < comm.size and comm.rank > 0:
            return
        results = dj.ResultsMonitor(path / name, points=POINTS, every=3, envelopes=True)
        monitors = [results, Killer(kill)]
        model = wall(read(file, on), joints, water=water())
        simulation = dj.Simulation(model, monitors=monitors, solver=solver)
        if checkpoint is None or not checkpoint.resume:
            simulation.statics()
        simulation.dynamics(dt=DT, steps=STEPS, motion=shaking, checkpoint=checkpoint)

    run("whole.h5", then, None)
    comm.barrier()
    kept = dj.Checkpoints(path / "run.ckpt", every=4)
    if first.size == comm.size or comm.rank == 0:
        with pytest.raises(Killed):
            run("resumed.h5", first, 7, kept)
    comm.barrier()
    run("resumed.h5", then, None, replace(kept, resume=True))
    comm.barrier()
    whole, found = content(path / "whole.h5")[0], content(path / "resumed.h5")[0]
    assert whole.keys() == found.keys()
    for name, expected in whole.items():
        # Sums over other ranks are rounded otherwise; what is small is a difference of large parts.
        scale = 1.0 if name.endswith("status") else np.nanmax(np.abs(expected))
        given = found[name]
        if "energy/" in name:
            stream = "statics/energy" if name.startswith("statics/") else "energy"
            scale = np.abs(whole[f"{stream}/strain"]).max()
        if name == "histories/iterations":
            # Corrections are in single precision on one rank; and points that slid in statics lie
            # on the friction cone but for the last bit, which decides whether the first tangent of
            # the first step lets them slide.
            assert np.abs(given[2:] - expected[2:]).max() <= 1
            continue
        np.testing.assert_allclose(given, expected, rtol=0, atol=1e-10 * scale, err_msg=name)


def short(
    jointed, folder, *, monitors=None, joints=LAW, water=None, run=None, resume=False, **options
):
    """A run of four steps with checkpoints; ``run`` has further arguments of `Simulation`."""
    watching = (
        [dj.ResultsMonitor(folder / "run.h5", points=POINTS)] if monitors is None else monitors
    )
    model = wall(jointed, joints, water=water)
    simulation = dj.Simulation(model, monitors=watching, **(run or {}))
    if not resume:
        simulation.statics()
    given = {"dt": DT, "steps": 4, "motion": shaking}
    given["checkpoint"] = dj.Checkpoints(folder / "run.ckpt", every=2, resume=resume)
    return simulation.dynamics(**{**given, **options})


def weaker(time):
    return 0.999 * shaking(time)


DIFFERENT = {
    "dt": ({"dt": 2e-3}, "time step: 0.004 in the checkpoint, 0.002 in this run"),
    "steps": ({"steps": 5}, "number of steps: 4 in the checkpoint, 5 in this run"),
    "motion": ({"motion": weaker}, "ground motion: different"),
    "loads": ({"loads": [dj.Gravity()]}, "load Gravity_1: missing in the checkpoint"),
    "scheme": (
        {"scheme": dj.Newmark()},
        "time scheme: EnergyConsistent in the checkpoint, Newmark",
    ),
    "control": ({"control": CUT}, "step control.max_halvings: 6 in the checkpoint, 3 in this run"),
    "start": (
        {"start": dj.InitialFields(velocity=(0.0, 0.0, 0.0))},
        "initial velocity: missing in the checkpoint",
    ),
    "solver": ({"run": {"solver": "monolithic"}}, "solver: 'auto' in the checkpoint, 'mono"),
    "options": ({"run": {"options": dj.SolverOptions(max_iterations=9)}}, "Newton.max_iterations"),
    "monitors": ({"monitors": [dj.ProgressMonitor()]}, "monitors: ['ResultsMonitor'] in"),
    "model": ({"joints": dj.RigidJoint(friction_angle_deg=30.0)}, "law of joint_1: Friction"),
}


def test_every_argument_of_a_run_is_changed():
    arguments = {
        *signature(dj.Simulation).parameters,
        *signature(dj.Simulation.dynamics).parameters,
    }
    assert DIFFERENT.keys() == arguments - {"self", "checkpoint"}


@pytest.mark.parametrize("case", DIFFERENT)
def test_another_run_is_refused(case, wall_file, read, tmp_path):
    options, sentence = DIFFERENT[case]
    short(read(wall_file()), tmp_path)
    with pytest.raises(dj.CheckpointError, match=re.escape(sentence)) as raised:
        short(read(wall_file()), tmp_path, resume=True, **options)
    assert str(raised.value).startswith(f"The checkpoint {tmp_path / 'run.ckpt'} belongs to a")


def test_what_cannot_be_compared_is_named(wall_file, read, tmp_path):
    class Stream:
        """A motion from a source that Python cannot look into."""

        def __init__(self):
            self.source = (n for n in range(9))

        def __call__(self, time):
            return np.zeros(3)

    jointed = read(wall_file())
    short(jointed, tmp_path, monitors=[], motion=Stream())
    sentence = r"detect changes of ground motion\.source \(generator\)\.$"
    with pytest.warns(UserWarning, match=sentence):
        short(jointed, tmp_path, monitors=[], motion=Stream(), resume=True)


def test_results_of_another_run_are_refused(wall_file, read, tmp_path):
    jointed, file = read(wall_file()), tmp_path / "run.h5"
    with pytest.raises(Killed):
        short(jointed, tmp_path, monitors=[dj.ResultsMonitor(file, points=POINTS), Killer(3)])

    def resumed(**options):
        monitor = dj.ResultsMonitor(file, **{"points": POINTS, **options})
        short(jointed, tmp_path, monitors=[monitor, Killer()], resume=True)

    with pytest.raises(
        dj.CheckpointError, match="recorded with every=10, but this run has every=5"
    ):
        resumed(every=5)
    with pytest.raises(dj.CheckpointError, match="the file was recorded with points="):
        resumed(points={"corner": POINTS["corner"]})
    with pytest.raises(dj.CheckpointError, match="recorded with single_precision=False, but"):
        resumed(single_precision=True)
    file.rename(tmp_path / "elsewhere.h5")
    with pytest.raises(dj.ResultsError, match="There is no results file"):
        resumed()
    short(
        jointed,
        tmp_path / "other",
        monitors=[dj.ResultsMonitor(file, points=POINTS)],
        steps=1,
        checkpoint=None,
    )
    with pytest.raises(
        dj.ResultsError, match="contains 2 records of 'energy', .* 3 records of 'energy'"
    ):
        resumed()
    assert content(file)  # refused, the file stays as it was


@pytest.mark.mpi
def test_checkpoint_files_that_are_refused(comm, wall_file, read, new_path, monkeypatch):
    folder, jointed = new_path("refused"), read(wall_file())
    path = folder / "run.ckpt"
    if comm.rank == 0:
        folder.mkdir()
    comm.barrier()

    def refused(sentence, **options):
        with pytest.raises(dj.CheckpointError, match=sentence):
            short(jointed, folder, **options)
        comm.barrier()

    def leave(change):
        if comm.rank == 0:
            change()
        comm.barrier()

    refused(r"^There is no checkpoint .*run.ckpt\.$", resume=True)
    short(jointed, folder)
    refused("exists; pass resume=True to Checkpoints to continue from it, or", monitors=[])
    whole = path.read_bytes()
    comm.barrier()
    for size in (0, 7, len(whole) // 2, len(whole) - 1):
        leave(lambda size=size: path.write_bytes(whole[:size]))
        refused("is not a checkpoint, or is damaged", resume=True)
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 1
    leave(lambda: path.write_bytes(damaged))
    refused("is not a checkpoint, or is damaged: its checksum", resume=True)

    def foreign():
        with h5py.File(path, "w") as file:
            file["x"] = 1.0

    leave(foreign)
    refused("is not a checkpoint, or is damaged", resume=True)

    def of_another_program():
        foreign()
        content = path.read_bytes()
        path.write_bytes(content + hashlib.sha256(content).digest())

    leave(of_another_program)
    refused("is HDF5 but not a file of 'dolfinx_joints checkpoint'", resume=True)

    def newer():
        monkeypatch.setattr(checkpoint_file, "VERSION", 7)
        checkpoint_file.write_checkpoint(path, {})
        monkeypatch.undo()

    leave(newer)
    refused("has the layout version 7; this program reads version 6", resume=True)
    leave(lambda: checkpoint_file.write_checkpoint(path, {"run": {}}))
    refused("is not a checkpoint, or is damaged: 'monitors'", resume=True)


@pytest.mark.parametrize("stop", ["killed", "disk full"])
def test_a_checkpoint_that_is_not_finished_leaves_the_old_one(
    stop, wall_file, read, tmp_path, monkeypatch
):
    jointed, path = read(wall_file()), tmp_path / "run.ckpt"
    seen = []
    to_disk = checkpoint_file._to_disk

    def third(place):
        seen.append(place)
        if len(seen) == 5:  # two calls for each checkpoint, those of steps 0 and 2 are whole
            if stop == "killed":
                raise Killed
            raise OSError(errno.ENOSPC, "No space left on device")
        to_disk(place)

    monkeypatch.setattr(checkpoint_file, "_to_disk", third)
    if stop == "killed":
        with pytest.raises(Killed):
            short(jointed, tmp_path)
    else:
        sentence = "run.ckpt cannot be written: .*No space left on device; the previous checkpoint"
        with pytest.raises(dj.CheckpointError, match=sentence):
            short(jointed, tmp_path)
    assert path.with_name("run.ckpt.part").exists() == (stop == "killed")
    monkeypatch.undo()
    assert checkpoint_file.read_checkpoint(path)["state_dict"]["step"] == 2
    short(jointed, tmp_path, resume=True)
    assert not path.with_name("run.ckpt.part").exists()
    assert content(tmp_path / "run.h5")[1]["steps"] == 4


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_a_stage_after_another_goes_on_at_its_time(wall_file, read, tmp_path):
    """Without ``start``, whose time counts, its steps would end at times from zero on."""
    model = wall(read(wall_file()))
    first = dj.Simulation(model).dynamics(dt=DT, steps=3, motion=shaking)

    def run(kill, start=first.state, *, resume=False):
        simulation = dj.Simulation(model, monitors=[Killer(kill)])
        kept = dj.Checkpoints(tmp_path / "run.ckpt", every=2, resume=resume)
        return simulation.dynamics(dt=DT, steps=4, motion=shaking, start=start, checkpoint=kept)

    with pytest.raises(Killed):
        run(3)
    with pytest.raises(
        dj.CheckpointError, match=r"start at: 0\.012 in the checkpoint, 0\.0 in this run"
    ):
        run(None, None, resume=True)
    assert run(None, resume=True).state.time == pytest.approx(7 * DT, rel=1e-14)


def test_first_checkpoint_saves_the_statics(wall_file, read, tmp_path):
    jointed = read(wall_file())
    with pytest.raises(Killed):
        short(jointed, tmp_path, monitors=[Killer(1)])
    kept = dj.Checkpoints(tmp_path / "run.ckpt")
    assert kept.found
    simulation = dj.Simulation(wall(jointed), monitors=[Killer()])
    simulation.dynamics(dt=DT, steps=4, motion=shaking, checkpoint=replace(kept, resume=True))
    expected = dj.Simulation(wall(jointed)).statics().displacement.array
    np.testing.assert_array_equal(simulation.static.displacement.array, expected)


def test_fields_and_progress_of_a_continued_run(wall_file, read, tmp_path, capsys):
    jointed = read(wall_file())

    def monitors(kill):
        fields = dj.FieldMonitor(tmp_path / "run", every=1)
        return [fields, dj.ProgressMonitor("again"), Killer(kill)]

    with pytest.raises(Killed):
        short(jointed, tmp_path, monitors=monitors(3), water=WAVES)
    capsys.readouterr()
    short(jointed, tmp_path, monitors=monitors(None), water=WAVES, resume=True)
    for name in ("run.vtkhdf", "run_joints.vtkhdf", "run_reservoir.vtkhdf"):
        times = [time for time, _ in read_vtk(tmp_path / name)]
        np.testing.assert_allclose(times, DT * np.arange(5), rtol=1e-12)
    assert "4/4" in capsys.readouterr().err


def test_a_damaged_file_of_fields_does_not_stop_a_continued_run(wall_file, read, tmp_path):
    jointed, fields = read(wall_file()), tmp_path / "run.vtkhdf"

    def monitors(kill):
        return [dj.FieldMonitor(fields, every=1), Killer(kill)]

    with pytest.raises(Killed):
        short(jointed, tmp_path, monitors=monitors(3))
    fields.write_bytes(fields.read_bytes()[:-100])
    with pytest.warns(UserWarning, match=r"cannot be continued: .*run\.vtkhdf\.damaged;"):
        short(jointed, tmp_path, monitors=monitors(None), resume=True)
    assert (tmp_path / "run.vtkhdf.damaged").is_file()
    assert read_vtk(fields)[-1][0] == pytest.approx(4 * DT)
    assert len(read_vtk(tmp_path / "run_joints.vtkhdf")) == 5


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_without_joints_and_without_a_static_state(wall_file, read, tmp_path):
    body = wall(read(wall_file(), joints=[]), None)

    def run(kill, **options):
        simulation = dj.Simulation(body, monitors=[Killer(kill)])
        return simulation, simulation.dynamics(dt=DT, steps=6, **options)

    kept = dj.Checkpoints(tmp_path / "run.ckpt", every=1)
    _, whole = run(None)
    with pytest.raises(Killed):
        run(4, checkpoint=kept)
    simulation, resumed = run(None, checkpoint=replace(kept, resume=True))
    assert simulation.static is None
    np.testing.assert_array_equal(resumed.state.displacement.array, whole.state.displacement.array)
    assert resumed.energy.stored == whole.energy.stored


SCRIPT = """
import os, sys
from pathlib import Path
sys.path.insert(0, str(Path(sys.argv[1])))
from mpi4py import MPI
from dolfinx_joints import Checkpoints, ResultsMonitor, Simulation, read_msh
from shaken_wall import DT, POINTS, Killer, shaking, wall

class Printer(Killer):
    def record(self, record):
        if comm.rank == 0:
            print(record.step, flush=True)

comm = MPI.COMM_WORLD
processes = comm.gather(os.getpid())
if comm.rank == 0:
    print(*processes, flush=True)
mesh, folder, name = sys.argv[2], Path(sys.argv[3]), sys.argv[4]
path = folder / f"{name}.ckpt"
kept = Checkpoints(path, every=1, resume=path.exists())
monitors = [ResultsMonitor(folder / f"{name}.h5", points=POINTS, overwrite=True), Printer()]
simulation = Simulation(wall(read_msh(mesh, comm)), monitors=monitors)
if not kept.resume:
    simulation.statics(steps=2)
simulation.dynamics(dt=DT, steps=60, motion=shaking, checkpoint=kept)
"""


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
def test_signal_9_at_random_moments(wall_file, tmp_path, ranks):
    """The same script started again after each kill ends as one left alone.

    Bit by bit on one rank; on two, sums are not rounded alike each time.
    """
    here = str(Path(__file__).parents[1])
    mpirun = [] if ranks == 1 else ["mpirun", "-n", str(ranks)]
    # What mpirun leaves when it is killed goes with the folder.
    environment = {**os.environ, "TMPDIR": str(tmp_path)}

    def start(name):
        script = [sys.executable, "-c", SCRIPT, here, str(wall_file()), str(tmp_path), name]
        pipe = subprocess.PIPE
        return subprocess.Popen([*mpirun, *script], stdout=pipe, text=True, env=environment)

    whole = start("whole")
    whole.communicate()
    assert whole.returncode == 0
    chance, reached = random.Random(7), 0
    for _ in range(4):
        run = start("killed")
        processes = [int(number) for number in run.stdout.readline().split()]
        assert len(processes) == ranks
        for number, line in enumerate(run.stdout):
            assert number or int(line) >= reached  # goes on, and does not begin anew
            if int(line) >= reached + 12:
                break
        time.sleep(0.03 * chance.random())  # anywhere in a step, a record or a checkpoint
        for process in {*processes, run.pid}:
            os.kill(process, signal.SIGKILL)
        run.communicate()
        assert run.returncode == -signal.SIGKILL
        reached = int(line)
    last = start("killed")
    last.communicate()
    assert last.returncode == 0
    one, other = content(tmp_path / "whole.h5"), content(tmp_path / "killed.h5")
    assert one[0].keys() == other[0].keys()
    for name, values in one[0].items():
        rounding = 0.0 if ranks == 1 else 1e-10 * np.abs(values).max(initial=0.0)
        np.testing.assert_allclose(other[0][name], values, rtol=0, atol=rounding, err_msg=name)
    assert ranks > 1 or one[1:] == other[1:]
