# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Faults of the machine: one sentence each, what was written stays whole, no rank waits."""

import errno
import fcntl
import os
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest

from dolfinx_joints import ConvergenceError, FrictionNoTension, JointsError, Results, ResultsError
from dolfinx_joints.cli import main
from dolfinx_joints.common import files
from dolfinx_joints.common.errors import CheckpointError
from dolfinx_joints.common.files import FileLock
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.simulation.monitor import Monitor

WRITER = """
import sys, time
from dolfinx_joints.results.writer import ResultsWriter
writer = ResultsWriter(sys.argv[1], {})
writer.series("run", "u", (), "m", "displacement")
writer.start()
writer.append("run", 0.0, {"u": 1.0})
writer.flush()
print("written", flush=True)
time.sleep(100)
"""


def environment():
    """The variables of this process but those by which MPI knows it."""
    own = ("PMIX_", "OMPI_COMM_", "OMPI_UNIVERSE_", "PRTE_LAUNCHED")
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(own) or name.startswith("PMIX_MCA_")
    }


@pytest.fixture
def other_run(tmp_path):
    """A process that writes run.h5, and the file."""
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment()) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"written\n"
        yield process, path
        process.kill()


def test_a_results_file_has_one_writer(other_run):
    process, path = other_run
    sentence = rf"run\.h5 is being written by process {process.pid} on \S+; wait until it ends"
    with pytest.raises(ResultsError, match=sentence):
        ResultsWriter(path, {}, overwrite=True)
    with pytest.raises(ResultsError, match=sentence):
        ResultsWriter.resume(path, {"run": 1})
    with Results(path) as results:  # readers are welcome, and nothing was harmed
        assert results.series("run", "u").tolist() == [1.0]
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert path.with_name("run.h5.lock").exists()  # the dead one's
    with ResultsWriter.resume(path, {"run": 1}) as writer:
        writer.append("run", 1.0, {"u": 2.0})
    with Results(path) as results:
        assert results.series("run", "u").tolist() == [1.0, 2.0]
    assert sorted(p.name for p in path.parent.iterdir()) == ["run.h5"]


def test_a_file_system_without_locks_is_reported(tmp_path, monkeypatch):
    def none(file, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.warns(UserWarning, match=r"run\.h5 is on a file system without locks \(No locks"):
        FileLock(tmp_path / "run.h5", ResultsError).release()


def test_a_folder_that_cannot_be_written_is_named():
    # The kernel refuses files in /proc to everybody, root included.
    with pytest.raises(ResultsError, match=r"^/proc/run\.h5 cannot be created: .*\.$"):
        ResultsWriter("/proc/run.h5", {})


FULL = """
import resource, sys
import numpy as np
from dolfinx_joints import ResultsError
from dolfinx_joints.results.writer import ResultsWriter
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    with ResultsWriter(sys.argv[1], {}, flush_interval=0.0) as writer:
        writer.series("run", "u", (1000,), "m", "displacement")
        writer.start()
        for row in range(10_000):
            writer.append("run", float(row), {"u": np.full(1000, float(row))})
except ResultsError as error:
    print(error)
"""


@pytest.mark.parametrize("limit", [2_000_000, 2_100_007, 3_000_001])
def test_what_was_written_before_the_disk_was_full_is_read(tmp_path, limit):
    # A limit of file sizes fails as a full disk does, by an error of the system's write.
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", FULL, str(path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    assert (done.returncode, done.stderr) == (0, "")  # HDF5 has nothing to say when it closes
    assert "run.h5 cannot grow by" in done.stdout
    assert "File too large. The records written so far are complete." in done.stdout
    with Results(path) as results:
        rows = results.rows("run")
        assert results.status == "failed"
        assert "cannot grow" in results.summary["error"]
        assert results.series("run", "u")[:, 0].tolist() == list(range(rows))
        # 8 kB a row, less the 1 MiB that is kept for HDF5 itself and a chunk of 64 KiB.
        assert rows >= (limit - 2**20) / 8000 - 40
    assert path.stat().st_size <= limit
    with ResultsWriter.resume(path, {"run": rows}) as writer:
        writer.append("run", 1e9, {"u": np.zeros(1000)})


def test_no_room_for_a_new_file_leaves_none(tmp_path):
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", FULL, str(path), "100000"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "run.h5 cannot grow by" in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def wall(wall_file, read):
    """``wall(laws)``: a jointed wall with joint laws by name."""
    pytest.importorskip("dolfinx")
    from shaken_wall import wall

    jointed = read(wall_file())
    return lambda laws=None: wall(jointed, laws or FrictionNoTension(**STIFF))


STIFF = {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 30.0}
POINTS = {"corner": (0.0, 0.0, 20.0)}


def shaking(time):
    """A ground acceleration strong enough to open the joints, [m/s^2]."""
    return 12.0 * np.sin(2 * np.pi * np.array([2.3, 2.9, 3.1]) * time + [0.0, 0.7, 1.9])


def spoilt_law(field, after, *, forms=("", "condensed_")):
    """A law whose ``field`` holds NaN at its last point after some answers of its methods."""

    class Spoilt(FrictionNoTension):
        answers = 0

        def _spoil(self, response):
            Spoilt.answers += 1
            if Spoilt.answers > after:
                getattr(response, field)[-1:] = np.nan
            return response

    for name in ("backward_euler", "discrete_gradient"):
        for method in (form + name for form in forms):
            given = getattr(FrictionNoTension, method)
            spoilt = lambda self, *args, given=given: self._spoil(given(self, *args))  # noqa: E731
            setattr(Spoilt, method, spoilt)
    return Spoilt(**STIFF)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["condensed", "monolithic"])
@pytest.mark.parametrize("field", ["traction", "tangent"])
@pytest.mark.parametrize("after", [0, 5, 60])  # statics, a later iteration of it, dynamics
def test_nan_of_a_law_names_law_and_joint(wall, solver, field, after):
    from dolfinx_joints import Simulation

    laws = dict.fromkeys(("joint_1", "joint_2"), FrictionNoTension(**STIFF))
    run = Simulation(wall(laws | {"joint_3": spoilt_law(field, after)}), solver=solver)

    def all_of_it():
        run.statics()
        run.dynamics(dt=4e-3, steps=40, motion=shaking)

    with pytest.raises(
        ConvergenceError, match="the law Spoilt of joint 'joint_3' returned NaN"
    ) as got:
        all_of_it()
    assert (got.value.law, got.value.joint) == ("Spoilt", "joint_3")


@pytest.mark.mpi
@pytest.mark.parametrize("field", ["traction", "tangent"])
def test_nan_of_a_law_without_a_form_on_a_compliance_names_it(wall, field):
    from dolfinx_joints import Simulation

    run = Simulation(wall(spoilt_law(field, 5, forms=[""])), solver="condensed")
    with pytest.raises(ConvergenceError, match="the law Spoilt of joint 'joint_.' returned NaN"):
        run.statics()


def diagonal(comm, values):
    from petsc4py import PETSc

    matrix = PETSc.Mat().createAIJ((len(values), len(values)), nnz=1, comm=comm)
    for row in range(*matrix.getOwnershipRange()):
        matrix[row, row] = values[row]
    matrix.assemble()
    return matrix


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("values", "symmetric", "sentence"),
    [
        # MUMPS stops at its zero pivot: INFOG(1) = -10.
        ([1.0, 2.0, 0.0, 3.0], False, r"numerically singular; INFOG\(1\) = -10"),
        ([1.0, 2.0, 0.0, 3.0], True, "singular"),
        ([1.0, 2.0, np.nan, 3.0], False, "^The matrix contains values that are not finite"),
        ([1.0, 2.0, np.nan, 3.0], True, "^The matrix contains values that are not finite"),
    ],
)
def test_a_factorization_that_fails_says_why(comm, values, symmetric, sentence):
    from dolfinx_joints.solvers.direct import DirectSolver

    matrix = diagonal(comm, values)
    b, x = matrix.createVecLeft(), matrix.createVecRight()
    b.set(1.0)
    solver = DirectSolver(matrix, symmetric=symmetric)
    with pytest.raises(JointsError, match=sentence) as got:
        solver.solve(b, x)
    assert "\n" not in str(got.value)
    solver.destroy()


def test_who_deletes_a_lock_that_was_waited_for_does_not_make_two_owners(tmp_path, monkeypatch):
    # Between opening and locking, its last owner deletes the file: what is locked then is no lock.
    place, flock, calls = tmp_path / "r.h5.lock", files.fcntl.flock, []

    def slow(file, how):
        if not calls:
            place.unlink()
        elif len(calls) == 1:
            place.rename(tmp_path / "older.lock")
            place.touch()
        calls.append(how)
        flock(file, how)

    monkeypatch.setattr(files.fcntl, "flock", slow)
    with FileLock(tmp_path / "r.h5", ResultsError) as lock:
        assert len(calls) == 3
        with pytest.raises(ResultsError, match=r"r\.h5 is being written by process \d+ on"):
            FileLock(tmp_path / "r.h5", ResultsError)
    assert not place.exists()
    lock.release()  # again is nothing


def test_a_lock_that_cannot_be_written_is_reported(tmp_path):
    (tmp_path / "r.h5.lock").symlink_to("/dev/full")
    with pytest.raises(
        ResultsError, match=r"r\.h5 cannot be created: [\w ]+ \(r\.h5\.lock next to it\)\.$"
    ):
        FileLock(tmp_path / "r.h5", ResultsError)


def test_packages_without_metadata_are_unknown_to_the_manifest(monkeypatch):
    from dolfinx_joints.monitors import manifest

    def nothing(package):
        raise manifest.PackageNotFoundError(package)

    known = manifest.versions()
    monkeypatch.setattr(manifest, "version", nothing)
    monkeypatch.delitem(sys.modules, "gmsh", raising=False)
    found = manifest.versions()
    assert "gmsh" not in found
    assert {found[package] for package in manifest._PACKAGES} == {"unknown"}
    assert found["petsc"] == known["petsc"]


RANK = """
import sys
from mpi4py import MPI
import dolfinx_joints as dj
dj.abort_on_error(MPI.COMM_WORLD)
if MPI.COMM_WORLD.rank == 1:
    raise ValueError("the second rank has had enough")
MPI.COMM_WORLD.barrier()
print("never reached")
"""


def on_two_ranks(tmp_path, text):
    script = tmp_path / "analysis.py"
    script.write_text(text)
    command = ["mpirun", "-n", "2", sys.executable, str(script)]
    return subprocess.run(
        command, capture_output=True, text=True, env=environment(), check=False, timeout=120
    )


def test_a_rank_that_raises_ends_the_others_that_wait(tmp_path):
    pytest.importorskip("mpi4py")
    done = on_two_ranks(tmp_path, RANK)
    assert done.returncode != 0
    assert "ValueError: the second rank has had enough" in done.stderr
    assert "never reached" not in done.stdout


WRITTEN_BY_ALL = """
import sys
from mpi4py import MPI
from dolfinx_joints import plots
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.two_blocks import two_blocks
from matplotlib.figure import Figure
two_blocks(sys.argv[0] + ".msh", duplicated=True)
for k in range(20):
    plots.save(Figure(), sys.argv[0] + ".png", dpi=10)
on_root(MPI.COMM_WORLD, lambda: two_blocks(sys.argv[0] + ".msh", duplicated=True))
"""


def test_all_ranks_write_the_same_mesh_and_figure(tmp_path):
    # As the first demo does on several ranks. DOLFINx's import starts PETSc on all ranks together.
    pytest.importorskip("mpi4py")
    done = on_two_ranks(tmp_path, WRITTEN_BY_ALL)
    assert (done.returncode, done.stderr) == (0, "")


FAULTY_MONITOR = """
import numpy as np
from dolfinx.mesh import create_unit_cube, locate_entities_boundary
from mpi4py import MPI
import dolfinx_joints as dj
from dolfinx_joints.common import mpi
from dolfinx_joints.simulation.monitor import Monitor
comm, mpi.APART = MPI.COMM_WORLD, 1.0
dj.abort_on_error(comm)
mesh = create_unit_cube(comm, 2, 2, 2)
base = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0.0))
body = dj.split_mesh(mesh, joints={}, groups={"base": base})
material = dj.Elastic(young=1e9, poisson=0.2, density=2400.0)
class Faulty(Monitor):
    def start(self, model, stage, steps, first): pass
    def finish(self, status, summary): pass
    def record(self, record):
        if comm.rank == 1:
            raise OSError("the disk of the second rank is full")
model = dj.Model(body, material=material, supports=[dj.Fixed(group="base")])
dj.Simulation(model, monitors=[Faulty()]).dynamics(dt=0.01, steps=3)
print("never reached")
"""


@pytest.mark.parametrize("error", ["OSError", "SystemExit"])
def test_an_error_of_one_rank_in_a_run_ends_all(tmp_path, error):
    """The rank that fails must not wait for others, which are in the next step, to finish files.

    Python calls no `sys.excepthook` of a SystemExit.
    """
    done = on_two_ranks(tmp_path, FAULTY_MONITOR.replace("OSError", error))
    assert done.returncode != 0
    assert f"{error}: the disk of the second rank is full" in done.stderr
    assert "never reached" not in done.stdout


def marched(model, folder, *, steps=6, monitors=None, resume=False):
    """A short run with results and checkpoints."""
    from dolfinx_joints import Checkpoints, ResultsMonitor, Simulation

    if monitors is None:
        monitors = [ResultsMonitor(folder / "run.h5", points=POINTS, every=1, overwrite=True)]
    kept = Checkpoints(folder / "run.ckpt", every=2, resume=resume)
    run = Simulation(model, monitors=monitors)
    if not resume:
        run.statics()
    return run.dynamics(dt=4e-3, steps=steps, motion=shaking, checkpoint=kept)


class Then(Monitor):
    """A monitor that does something in a step."""

    def __init__(self, step, work):
        self.step, self.work = step, work

    def record(self, record):
        if record.step == self.step:
            self.work()


@pytest.mark.mpi
def test_a_live_run_is_not_continued_by_another(wall, comm, new_path):
    folder = new_path("live")
    if comm.rank == 0:
        folder.mkdir()
    comm.barrier()
    sentences = []

    def another():
        for resume in (True, False):
            with pytest.raises(CheckpointError) as got:
                marched(wall(), folder, monitors=[Then(0, int)], resume=resume)
            sentences.append(str(got.value))

    marched(wall(), folder, monitors=[Then(3, another)])
    assert f"run.ckpt is being written by process {comm.bcast(os.getpid())} on" in sentences[0]
    assert "exists; pass resume=True" in sentences[1]
    comm.barrier()
    marched(wall(), folder, monitors=[Then(0, int)], resume=True)  # it has ended


def test_a_disk_that_fills_up_in_a_run(wall, tmp_path):
    # From step 4 on no file may become larger than the results file is; some 60 states fit into
    # what it has already.
    path, old = tmp_path / "run.h5", resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill():
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size, old[1]))

    def monitors(step):
        from dolfinx_joints import ResultsMonitor

        writes = ResultsMonitor(path, points=POINTS, every=1, overwrite=True)
        return [writes, Then(step, fill)]

    try:
        with pytest.raises(ResultsError, match=r"run\.h5 cannot grow by .*too large.*complete\.$"):
            marched(wall(), tmp_path, steps=100, monitors=monitors(4))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    with Results(path) as results:
        assert results.status == "failed"
        assert 3 <= results.rows("histories") < 101
        assert "cannot grow" in results.summary["error"]
    marched(wall(), tmp_path, steps=100, monitors=monitors(-1), resume=True)
    with Results(path) as results:
        assert results.status == "complete"
        assert results.rows("histories") == 101


@pytest.mark.mpi
def test_a_file_of_fields_has_one_writer(wall, comm, new_path):
    from dolfinx_joints import FieldMonitor, Simulation

    path = new_path("run.vtkhdf")

    def shake(*others):
        run = Simulation(wall(), monitors=[FieldMonitor(path, every=1, overwrite=True), *others])
        run.statics()
        run.dynamics(dt=4e-3, steps=2, motion=shaking)

    def another():
        sentence = (
            rf"run\.vtkhdf is being written by process {comm.bcast(os.getpid())} on \S+; wait"
        )
        with pytest.raises(ResultsError, match=sentence):
            shake()

    def fail():
        raise RuntimeError("enough")

    shake(Then(1, another))
    with pytest.raises(RuntimeError, match="enough"):
        shake(Then(1, fail))
    shake()  # whatever ended the runs before, the file is free
    comm.barrier()
    assert path.is_file()
    assert not path.with_name("run.vtkhdf.lock").exists()


@pytest.mark.mpi
def test_the_manifest_of_a_run(wall, comm, new_path, capsys):
    from dolfinx_joints import ResultsMonitor, Simulation, __version__, synthetic_motion

    path = new_path("run.h5")
    run = Simulation(wall(), monitors=[ResultsMonitor(path, points=POINTS)])
    run.statics(joints=["joint_2", "joint_3"], name="weight")
    run.grout(name="grout")
    run.dynamics(dt=4e-3, steps=2, motion=synthetic_motion(seed=5))
    comm.barrier()
    with Results(path) as results:
        made = results.metadata["manifest"]
    assert made["versions"]["dolfinx_joints"] == __version__
    assert made["versions"]["numpy"] == np.__version__
    assert {"dolfinx", "petsc", "h5py", "gmsh", "numba"} <= set(made["versions"])
    assert made["settings"]["time step"] == 4e-3
    assert made["settings"]["number of steps"] == 2
    assert "relative_tolerance" in made["settings"]["Newton"]
    assert made["material"]["all"].startswith("Elastic(young=24000000000.0")
    assert set(made["joint_laws"]) == {"joint_1", "joint_2", "joint_3"}
    assert "base" in made["supports"][0]
    assert made["static_stages"] == {"weight": "Gravity; inactive: joint_1", "grout": "Gravity"}
    assert made["settings"]["ground motion"] == "synthetic motion 5"
    # Ten steps of 4 ms to a period; shear waves of 10 GPa over 2400 kg/m^3, 2041 m/s, in cells of
    # 20/3 m; k_s / (pi rho c_s).
    speed = np.sqrt(1e10 / 2400.0)
    limits = {"step": 25.0, "mesh": 0.015 * speed, "joints": 4e10 / (np.pi * 2400.0 * speed)}
    assert made["resolved_hz"] == pytest.approx(limits)
    assert len(made["mesh_sha256"]) == 64
    assert made["mesh_sha256"] in (comm.bcast(made["mesh_sha256"]),)
    assert main(["info", "--all", str(path)]) == 0
    printed = capsys.readouterr().out
    assert f"      dolfinx_joints: {__version__}\n" in printed
    assert "      time step: 0.004\n" in printed


def test_the_manifest_names_fields_and_formulae():
    from mpi4py import MPI

    import ufl
    from dolfinx import fem
    from dolfinx.mesh import create_unit_square

    from dolfinx_joints import Temperature
    from dolfinx_joints.monitors.manifest import as_json

    mesh = create_unit_square(MPI.COMM_SELF, 1, 1)
    field = fem.Function(fem.functionspace(mesh, ("P", 1)), name="winter")
    for value, text in ((field, "winter"), (2 * ufl.SpatialCoordinate(mesh)[0], "2 * x[0]")):
        shown = as_json(Temperature(value=value, reference=7.0, expansion=1e-5))
        assert shown.startswith(f"Temperature(value={text!r}, reference=7.0, expansion=1e-05")
        assert "factor=constant" in shown


def test_the_hash_of_a_mesh_knows_its_nodes_and_facets():
    from mpi4py import MPI

    from dolfinx_joints.monitors.manifest import mesh_hash

    def hashed(nodes, facets):
        return mesh_hash(MPI.COMM_SELF, nodes, np.array(facets))

    nodes, facets = np.arange(12.0).reshape(4, 3), [[0, 1, 2], [2, 1, 3]]
    one = hashed(nodes, facets)
    # The order of facets and of their vertices differs between numbers of ranks.
    assert hashed(nodes, [[1, 3, 2], [0, 1, 2]]) == one
    assert hashed(nodes, [[1, 3, 0], [0, 1, 2]]) != one
    assert hashed(nodes * (1 + 4e-16), facets) != one


def test_warnings_of_a_run_are_kept(wall, tmp_path):
    from dolfinx_joints import ResultsMonitor, Simulation

    # Steps as long as half the periods of the shaking: each errs by more than 5 %.
    run = Simulation(wall(), monitors=[ResultsMonitor(tmp_path / "run.h5", points=POINTS)])
    run.statics()
    with pytest.warns(UserWarning, match="error of a single step") as said:
        run.dynamics(dt=0.15, steps=3, motion=shaking)
    assert said.list[-1].filename == __file__  # the line that asks for the run
    with Results(tmp_path / "run.h5") as results:
        assert any("error of a single step" in text for text in results.summary["warnings"])


def test_a_monitor_that_fails_at_the_end_leaves_the_others_theirs(wall):
    from dolfinx_joints import Monitor, Simulation

    finished = []

    class Full(Monitor):
        def finish(self, status, summary):
            raise OSError("no room")

    class Noting(Monitor):
        def finish(self, status, summary):
            finished.append(status)

    run = Simulation(wall(), monitors=[Full(), Noting()])
    run.statics()
    with pytest.raises(OSError, match="no room"):
        run.dynamics(dt=0.01, steps=1, motion=shaking)
    assert finished == ["complete"]


def test_parameters_are_told_without_addresses_and_numpy():
    from functools import partial

    from dolfinx_joints.monitors.manifest import as_json

    assert as_json(np.int64(200)) == 200
    assert as_json(np.float32(0.5)) == 0.5
    text = as_json(partial(shaking, group="crest"))
    assert "0x" not in text
    assert "function shaking" in text
    assert "group='crest'" in text
