# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files: what is written is read, also from torn, growing and foreign files."""

import itertools
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from declared import declare_energy, declare_histories, declare_states

from dolfinx_joints.common.errors import ConvergenceError, JointsError, ResultsError
from dolfinx_joints.export.tables import tables_of
from dolfinx_joints.results.overview import describe
from dolfinx_joints.results.quantities import ENERGY_TERMS
from dolfinx_joints.results.reader import OLDEST, VERSION, Results
from dolfinx_joints.results.writer import ResultsWriter


def writer_of(path: Path, **options: Any) -> ResultsWriter:
    """Start a writer with the stream ``run`` of ``u`` (2, 3) and ``count``."""
    writer = ResultsWriter(path, {"title": "wall", "dt": 0.005}, **options)
    writer.static("mesh/nodes", np.arange(6.0).reshape(2, 3), "m", "nodes")
    writer.series("run", "u", (2, 3), "m", "displacement")
    writer.series("run", "count", (), "-", "iterations", dtype=np.int64)
    writer.start()
    return writer


def append_rows(writer: ResultsWriter, first: int, last: int) -> None:
    """Append records whose displacement equals their number everywhere."""
    for row in range(first, last):
        writer.append("run", 0.005 * row, {"u": np.full((2, 3), row), "count": row})


def run_into(error: BaseException, path: Path) -> None:
    """Let an exception end a run of three records."""
    with writer_of(path) as writer:
        append_rows(writer, 0, 3)
        raise error


def test_what_is_written_is_read(tmp_path: Path) -> None:
    with writer_of(tmp_path / "r.h5") as writer:
        append_rows(writer, 0, 200)
        writer.finish("complete", {"steps": np.int64(200), "seconds": np.array([1.5])})
    with Results(tmp_path / "r.h5") as results:
        assert results.metadata == {"title": "wall", "dt": 0.005}
        assert results.summary == {"steps": 200, "seconds": [1.5]}
        assert results.complete
        assert results.streams == {"run": ["count", "u"]}
        assert results.statics == ["mesh/nodes"]
        np.testing.assert_allclose(results.time("run"), 0.005 * np.arange(200))
        displacement = results.series("run", "u")
        assert displacement.shape == (200, 2, 3)
        np.testing.assert_array_equal(displacement[:, 1, 2], np.arange(200))
        assert results.series("run", "count").dtype == np.int64
        np.testing.assert_array_equal(results.static("mesh/nodes"), [[0, 1, 2], [3, 4, 5]])
        assert results.unit("mesh/nodes") == results.unit("run", "u") == "m"
        assert results.description("run", "u") == "displacement"


def test_records_are_chosen_by_number_slice_and_time(tmp_path: Path) -> None:
    with writer_of(tmp_path / "r.h5") as writer:
        append_rows(writer, 0, 10)
    with Results(tmp_path / "r.h5") as results:
        assert results.series("run", "count", 3) == 3
        assert results.series("run", "count", -1) == 9
        np.testing.assert_array_equal(results.series("run", "count", slice(1, 8, 3)), [1, 4, 7])
        assert results.series("run", "count", slice(8, 2)).size == 0
        assert results.nearest("run", 0.0212) == 4
        with pytest.raises(ResultsError, match="has 10 records, got number 10"):
            results.series("run", "count", 10)
        with pytest.raises(ResultsError, match="positive step"):
            results.series("run", "count", slice(None, None, -1))


def test_the_status_tells_a_finished_run_from_others(tmp_path: Path) -> None:
    with writer_of(tmp_path / "stopped.h5") as writer:
        append_rows(writer, 0, 3)
    for name, error in (
        ("failed", ZeroDivisionError("too bad")),
        ("interrupted", KeyboardInterrupt()),
    ):
        with pytest.raises(type(error)):
            run_into(error, tmp_path / f"{name}.h5")
    with Results(tmp_path / "stopped.h5") as results:
        assert (results.status, results.rows("run")) == ("stopped", 3)
    with Results(tmp_path / "failed.h5") as results:
        assert (results.status, results.rows("run")) == ("failed", 3)
        assert results.summary == {"error": "ZeroDivisionError: too bad"}
    with Results(tmp_path / "interrupted.h5") as results:
        assert results.status == "stopped"


def test_a_growing_file_can_be_read(tmp_path: Path) -> None:
    # The reader is a process of its own, as HDF5 shares an open file within a process.
    code = (
        "import sys; from dolfinx_joints.results.reader import Results\n"
        "results = Results(sys.argv[1])\n"
        "print(results.status, results.rows('run'), results.series('run', 'u').max())"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "r.h5")]
    with writer_of(tmp_path / "r.h5", flush_interval=0.0) as writer:
        append_rows(writer, 0, 7)
        seen = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert seen.split() == ["running", "7", "6.0"]
        append_rows(writer, 7, 100)
        seen = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert seen.split() == ["running", "100", "99.0"]


def test_a_killed_run_leaves_a_readable_file(tmp_path: Path) -> None:
    """Kill a process after two streams had their last flush at row 2000 of 4000.

    After it, a full buffer of 1024 rows of each stream was written, at different rows.
    """
    code = (
        "import os, signal, sys; import numpy as np\n"
        "from dolfinx_joints.results.writer import ResultsWriter\n"
        "writer = ResultsWriter(sys.argv[1], {}, flush_interval=1e9)\n"
        "for stream in ('states', 'histories'):\n"
        "    writer.series(stream, 'count', (), '-', 'number of the row')\n"
        "writer.start()\n"
        "for row in range(4000):\n"
        "    writer.append('states', row, {'count': row})\n"
        "    if row % 100 == 99:\n"
        "        block = np.arange(row - 99, row + 1)\n"
        "        writer.extend(list(block), {'histories': {'count': block}})\n"
        "    if row == 1999:\n"
        "        writer.flush()\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "r.h5")]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    with Results(tmp_path / "r.h5") as results:
        assert results.status == "running"
        assert not results.complete
        for stream in ("states", "histories"):
            np.testing.assert_array_equal(results.series(stream, "count"), np.arange(2000))
            np.testing.assert_array_equal(results.time(stream), np.arange(2000))


@pytest.mark.parametrize(("busy", "rows"), [(True, 0), (False, 600)])
def test_flushes_follow_the_work_and_not_the_clock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, busy: bool, rows: int
) -> None:
    """Count rows in the file if each call of the clock takes 2 s.

    On a busy machine these are seconds of other processes: no row is written before the end.
    Otherwise each row is older than 1 s and is written.
    """
    ticks = itertools.count(0, 2)
    processor = (lambda: 0.0) if busy else (lambda: float(next(ticks)))
    clock = SimpleNamespace(monotonic=lambda: float(next(ticks)), process_time=processor)
    monkeypatch.setattr("dolfinx_joints.results.writer.clock", clock)
    with writer_of(tmp_path / "r.h5") as writer:
        append_rows(writer, 0, 600)
        assert len(writer._file["streams/run/time"]) == rows
        assert writer.records == {"run": 600}


@pytest.mark.parametrize(
    ("rows", "chunk"), [(0, 1), (41, 41), (1024, 1024), (1100, 550), (None, 256)]
)
def test_chunks_fit_the_expected_rows(tmp_path: Path, rows: int | None, chunk: int) -> None:
    """Chunks are equal, with at most 1024 rows and 64 kB: 1100 rows are two chunks of 550."""
    expected = {} if rows is None else {"rows": {"run": rows}}
    with writer_of(tmp_path / "r.h5", **expected) as writer:
        append_rows(writer, 0, 2)
    for _ in range(2):  # as written, and as copied
        with h5py.File(tmp_path / "r.h5") as file:
            assert file["streams/run/count"].chunks == (chunk,)
            assert file["streams/run/time"].chunks == (chunk,)
        ResultsWriter.resume(tmp_path / "r.h5", {"run": 2}).close()
    with ResultsWriter(tmp_path / "s.h5", {}, rows={"run": 20}) as writer:
        writer.series("run", "u", (1024,), "m", "8 kB: three chunks of 7 rows, 57 kB")
        writer.start()
        assert writer._file["streams/run/u"].chunks == (7, 1024)


def test_memory_does_not_grow_with_the_rows(tmp_path: Path) -> None:
    # 3.2 MB of each of 8 series. HDF5's cache of chunks would keep the last MB of each.
    def resident() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    names = [f"x{i}" for i in range(8)]
    values = dict.fromkeys(names, np.ones(1024))
    with ResultsWriter(tmp_path / "r.h5", {}, flush_interval=0.0) as writer:
        for name in names:
            writer.series("run", name, (1024,), "m", "a number")
        writer.start()
        sizes = []
        for row in range(400):
            writer.append("run", float(row), values)
            sizes.append(resident())
    assert sizes[-1] - sizes[20] < 2e6


def test_a_run_killed_before_its_start_is_reported(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from dolfinx_joints.results.writer import ResultsWriter\n"
        "writer = ResultsWriter(sys.argv[1], {})\n"
        "writer._file.flush()\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "r.h5")], check=False)
    with pytest.raises(ResultsError, match="did not start, or ended before writing it"):
        Results(tmp_path / "r.h5")


def test_only_whole_records_are_read(tmp_path: Path) -> None:
    with writer_of(tmp_path / "r.h5") as writer:
        append_rows(writer, 0, 10)
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        file["streams/run/u"].resize(8, axis=0)
    with Results(tmp_path / "r.h5") as results:
        assert results.rows("run") == len(results.time("run")) == 8
        assert len(results.series("run", "count")) == 8
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        file["streams/run/time"][7:] = np.nan
    with Results(tmp_path / "r.h5") as results:
        assert results.rows("run") == 7


def test_values_are_copied_when_appended(tmp_path: Path) -> None:
    displacement = np.ones((2, 3))
    with writer_of(tmp_path / "r.h5") as writer:
        writer.append("run", 0.0, {"u": displacement, "count": 0})
        displacement[:] = 2.0
    with Results(tmp_path / "r.h5") as results:
        np.testing.assert_array_equal(results.series("run", "u", 0), 1.0)


def test_an_existing_file_is_kept_by_default(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    path.write_text("precious")
    with pytest.raises(ResultsError, match="exists; pass overwrite=True"):
        ResultsWriter(path, {})
    with pytest.raises(ResultsError, match="JSON cannot represent the metadata"):
        ResultsWriter(path, {"model": object()}, overwrite=True)
    assert path.read_text() == "precious"
    writer_of(path, overwrite=True).close()
    old = Results(path)
    with writer_of(path, overwrite=True) as writer:
        append_rows(writer, 0, 1)
    assert (old.rows("run"), Results(path).rows("run")) == (0, 1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"u": np.zeros((2, 3))}, "must contain u, count, got u"),
        ({"u": np.zeros((3, 2)), "count": 1}, r"declared with shape \(2, 3\), got \(3, 2\)"),
    ],
)
def test_a_wrong_record_is_an_error(tmp_path: Path, values: dict[str, Any], message: str) -> None:
    with writer_of(tmp_path / "r.h5") as writer:
        with pytest.raises(ResultsError, match=message):
            writer.append("run", 1.0, values)
        assert not writer._streams["run"].waiting


def test_names_times_and_summaries_are_checked(tmp_path: Path) -> None:
    row = {"u": np.zeros((2, 3)), "count": 0}
    with (
        ResultsWriter(tmp_path / "r.h5", {}) as writer,
        pytest.raises(ResultsError, match="Names must be visible"),
    ):
        writer.static("joint 1/../points", [0.0], "m", "points")
    with writer_of(tmp_path / "s.h5") as writer:
        writer.append("run", 1.0, row)
        for time in (1.0, np.nan):
            with pytest.raises(ResultsError, match="finite and increase"):
                writer.append("run", time, row)
        with pytest.raises(ResultsError, match="65536 bytes"):
            writer.finish("complete", {"text": "x" * 70000})
        writer.finish("complete", {})


@pytest.mark.parametrize(
    "read",
    [
        lambda r: r.streams,
        lambda r: r.statics,
        lambda r: r.metadata,
        lambda r: r.joints,
        lambda r: r.series("run", "u"),
        tables_of,
    ],
)
def test_a_closed_file_says_so(tmp_path: Path, read: Callable[[Results], Any]) -> None:
    with writer_of(tmp_path / "r.h5") as writer:
        append_rows(writer, 0, 1)
    results = Results(tmp_path / "r.h5")
    assert results.streams
    results.close()
    results.close()
    with pytest.raises(ResultsError, match=r"r\.h5 is closed\.$"):
        read(results)


def test_foreign_files_are_errors(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="There is no results file"):
        Results(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(ResultsError, match="not an HDF5 file"):
        Results(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w", libver="latest") as file:
        file["x"] = 1.0
    with pytest.raises(ResultsError, match="HDF5 but not a file of 'dolfinx_joints results'"):
        Results(tmp_path / "other.h5")
    writer_of(tmp_path / "newer.h5").close()
    with h5py.File(tmp_path / "newer.h5", "r+") as file:
        file.attrs["version"] = VERSION + 1
    with pytest.raises(
        ResultsError, match="has version 3 of the layout.*highest supported is 2. Update"
    ):
        Results(tmp_path / "newer.h5")
    for number, version in enumerate((OLDEST - 1, "1")):  # h5py writes texts of variable length
        writer_of(tmp_path / f"older{number}.h5").close()
        with h5py.File(tmp_path / f"older{number}.h5", "r+") as file:
            file.attrs["version"] = version
        with pytest.raises(ResultsError, match="is of an older version of this program .*run it"):
            Results(tmp_path / f"older{number}.h5")
    writer_of(tmp_path / "torn.h5").close()
    with h5py.File(tmp_path / "torn.h5", "r+") as file:
        del file["streams"]
    with pytest.raises(ResultsError, match=r"torn\.h5 was left incomplete before its run started"):
        Results(tmp_path / "torn.h5")


def test_missing_names_list_those_that_exist(tmp_path: Path) -> None:
    writer_of(tmp_path / "r.h5").close()
    with Results(tmp_path / "r.h5") as results:
        with pytest.raises(ResultsError, match="No array 'mesh/cells'.*it has mesh/nodes"):
            results.static("mesh/cells")
        with pytest.raises(ResultsError, match="No stream 'walk'.*it has run"):
            results.time("walk")
        with pytest.raises(ResultsError, match="No series 'v'.*it has count, u"):
            results.unit("run", "v")
        with pytest.raises(ResultsError, match="has no records"):
            results.nearest("run", 0.0)


def test_the_agreed_layout_and_its_description(tmp_path: Path) -> None:
    joint = {
        "points": np.zeros((4, 3)),
        "frames": np.tile(np.eye(3), (4, 1, 1)),
        "areas": np.ones(4),
        "facet": np.zeros(4, dtype=np.int64),
    }
    with ResultsWriter(tmp_path / "r.h5", {"point_names": ["crest", "base"]}) as writer:
        declare_histories(writer, np.zeros((2, 3)))
        declare_energy(writer)
        declare_states(writer, np.zeros((8, 3)), [[0, 1, 2, 3]], {"joint_1": joint})
        writer.start()
        writer.append("energy", 0.5, dict.fromkeys(ENERGY_TERMS, 1.0))
        writer.finish("complete", {"steps": 1})
    with Results(tmp_path / "r.h5") as results:
        assert results.joints == ["joint_1"]
        assert results.point_index("base") == results.point_index(1) == 1
        with pytest.raises(ResultsError, match="No monitor point 'toe'; the file has crest, base"):
            results.point_index("toe")
        assert sorted(results.streams["energy"]) == sorted(ENERGY_TERMS)
        assert results.series("states", "joints/joint_1/gap").shape == (0, 4, 3)
        assert results.unit("states", "joints/joint_1/traction") == "Pa"
    table = describe(tmp_path / "r.h5")
    assert "complete" in table.splitlines()[0]
    assert "stream energy: 1 record, 0.5 to 0.5 s" in table
    assert "joints/joint_1/traction" in table


def test_a_convergence_error_says_what_it_knows() -> None:
    error = ConvergenceError(
        stage="earthquake",
        step=12,
        time=0.0585,
        iteration=30,
        residual=1.25e-3,
        tolerance=1e-8,
        open=20,
        stick=5,
        slip=3,
        joint="joint_2",
    )
    assert str(error) == (
        "The earthquake stage, step 12, at t = 0.0585 s did not converge in 30 iterations: "
        "residual 0.00125, tolerance 1e-08; joint points 20 open, 5 stick, 3 slip; "
        "worst joint 'joint_2'."
    )
    error.add_note("a note of the caller's")
    copy = pickle.loads(pickle.dumps(error))
    assert (str(copy), copy.slip, copy.joint) == (str(error), 3, "joint_2")
    assert str(ConvergenceError()) == "The solve did not converge."
    assert str(ConvergenceError(iteration=1)) == "The solve did not converge in 1 iteration."
    assert isinstance(error, JointsError)
    assert isinstance(error, RuntimeError)


def test_texts_that_are_no_utf8_do_not_stop_a_run(tmp_path: Path) -> None:
    # What sys.argv gives for the byte 0xff.
    facts = {"command": ["\udcff.h5"], "mesh": Path("meshes") / "dam.msh"}
    with ResultsWriter(tmp_path / "r.h5", facts) as writer:
        writer.start()
        writer.finish("complete", {})
    with Results(tmp_path / "r.h5") as results:
        assert results.metadata == {"command": ["?.h5"], "mesh": "meshes/dam.msh"}


def test_a_file_that_cannot_be_closed_is_not_locked_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = writer_of(tmp_path / "r.h5")
    close = writer._file.close

    def fail() -> None:
        close()
        raise RuntimeError("no room")

    monkeypatch.setattr(writer._file, "close", fail)
    with pytest.raises(RuntimeError, match="no room"):
        writer.close()
    assert not (tmp_path / "r.h5.lock").exists()


def test_a_copy_that_fails_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with writer_of(tmp_path / "r.h5") as writer:
        append_rows(writer, 0, 3)

    def fail(*_: Any) -> None:
        raise OSError("no room")

    with monkeypatch.context() as patch:
        patch.setattr(ResultsWriter, "_copy", fail)
        with pytest.raises(ResultsError, match=r"r\.h5 cannot be copied: no room"):
            ResultsWriter.resume(tmp_path / "r.h5", {"run": 2})
    assert [path.name for path in tmp_path.iterdir()] == ["r.h5"]
    with ResultsWriter.resume(tmp_path / "r.h5", {"run": 2}) as writer:
        writer.finish("complete", {})
    with Results(tmp_path / "r.h5") as results:
        assert results.series("run", "count").tolist() == [0, 1]
