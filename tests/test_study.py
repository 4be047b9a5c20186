# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies: rows that survive what ends the runner, refusals, the table.

Expected: arithmetic of the functions below, and a run that nothing has disturbed.
"""

import errno
import fcntl
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

pytest.importorskip("h5py")

from dolfinx_joints import study_case
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.study import Study, read_table, write_csv
from dolfinx_joints.study import _address as study_address
from dolfinx_joints.study_table import (
    LONGEST_TEXT,
    OWN_COLUMNS,
    plain_values,
    read_row,
    write_row,
    write_table,
)

TIMES = ("wall_s", "peak_mb")


def square(folder, *, x, wait=0.0, label="none"):
    """A case: a file, a number, a text."""
    (folder / "x.txt").write_text(str(x))
    time.sleep(wait)
    return {"square": x * x, "third": x / 3.0, "said": label}


def picky(folder, *, x):
    """Fails at 2, dies at 3."""
    if x == 2:
        raise ValueError("two is\nnot allowed.")
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if (folder.parents[1] / "cured").exists():
        return {"y": 10.0 * x}
    if x == 4:
        sys.exit("no more")
    return {"y": float(x)}


def vector(folder, *, x):
    """Returns what a row cannot hold."""
    return {"y": np.zeros(3)}


def without_times(table):
    return {name: column.tolist() for name, column in table.items() if name not in TIMES}


def squares(path, number=4, wait=0.0):
    return Study(path, square, {f"x={k}": {"x": k, "wait": wait} for k in range(number)})


def test_rows_are_in_the_order_of_the_cases(tmp_path):
    # The first case ends last.
    cases = {"slow": {"x": 1, "wait": 0.8}, "fast": {"x": 2}, "text": {"x": 3, "label": "a b"}}
    tally = Study(tmp_path / "s", square, cases).run(workers=3, progress=False)
    assert tally.done == ["slow", "fast", "text"]
    assert (tally.failed, tally.skipped) == ({}, [])
    table = read_table(tmp_path / "s")
    assert table["case"].tolist() == ["slow", "fast", "text"]
    assert table["square"].tolist() == [1.0, 4.0, 9.0]
    assert table["third"].tolist() == [1 / 3, 2 / 3, 1.0]  # every digit
    assert table["said"].tolist() == ["none", "none", "a b"]
    np.testing.assert_array_equal(table["wait"], [0.8, np.nan, np.nan])  # not given
    assert table["wall_s"][0] >= 0.8
    assert (table["peak_mb"] > 5.0).all()
    assert (tmp_path / "s" / "cases" / "fast" / "x.txt").read_text() == "2"


def test_finished_cases_are_skipped(tmp_path):
    study = squares(tmp_path / "s", 2)
    study.run(progress=False)
    before = without_times(study.table()), study.table()["wall_s"].tolist()
    tally = squares(tmp_path / "s", 3).run(progress=False)
    assert (tally.done, tally.skipped) == (["x=2"], ["x=0", "x=1"])
    assert study.table()["wall_s"].tolist() == before[1]
    assert len(read_table(tmp_path / "s")["case"]) == 3


def test_only_some(tmp_path):
    study = squares(tmp_path / "s")
    assert study.run(only=["x=2", "x=1"], progress=False).done == ["x=1", "x=2"]
    assert read_table(tmp_path / "s")["x"].tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="There is no case 'x=9'; there are x=0, x=1, x=2, x=3."):
        study.run(only=["x=9"])


@contextmanager
def full_disk(limit):
    """No file may become larger than so many bytes, as on a full disk; nor may pytest's output."""
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, old[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)


def test_a_full_disk_leaves_the_table_before(tmp_path):
    path = tmp_path / "s"
    squares(path, 2).run(progress=False)
    csv_file = write_csv(read_table(path), path / "table.csv")
    before, files = csv_file.read_bytes(), sorted(path.iterdir())
    sentence = r"^\S*/{}: File too large; the one before it is kept\.$"
    table = read_table(path)
    with full_disk(100), pytest.raises(StudyError) as of_table:  # bytes: neither table fits
        squares(path, 3).run(progress=False)
    with full_disk(100), pytest.raises(StudyError) as of_csv:
        write_csv(table, csv_file)
    of_table.match(sentence.format(r"table\.h5 cannot be written"))
    of_csv.match(sentence.format(r"table\.csv cannot be written"))
    assert read_table(path)["square"].tolist() == [0.0, 1.0]
    assert csv_file.read_bytes() == before
    assert sorted(path.iterdir()) == files
    assert squares(path, 3).run(progress=False).done == ["x=2"]


def test_no_room_for_a_row_is_one_sentence(tmp_path, monkeypatch):
    # Neither the case nor, after it, the runner has a place for the row.
    path = tmp_path / "s"
    monkeypatch.setattr(Study, "_write_table", lambda self: None)
    with full_disk(0), pytest.raises(StudyError) as failure:
        squares(path, 1).run(progress=False)
    failure.match(r"rows/x=0\.json cannot be written: File too large\.$")
    assert list((path / "rows").iterdir()) == []


def test_no_room_for_a_case_is_one_sentence(tmp_path, monkeypatch):
    # The system's own answer where a disk has no room for another folder.
    def mkdir(path, *args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    (tmp_path / "s" / "rows").mkdir(parents=True)
    monkeypatch.setattr(Study, "_locked", lambda self: nullcontext(0))
    monkeypatch.setattr(Path, "mkdir", mkdir)
    with pytest.raises(StudyError, match="^The case 'x=0' cannot be started: .*No space left"):
        squares(tmp_path / "s", 1).run(progress=False)


RUNNER = """
import sys
sys.path.insert(0, {tests!r})
from test_study import squares
squares({path!r}, 6, wait=0.5).run(workers=2, progress=False)
"""


def living_cases(path):
    """Processes that hold the lock of a study."""
    descriptor = os.open(path / "lock", os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def test_killed_half_way_and_resumed(tmp_path):
    squares(tmp_path / "whole", 6, wait=0.5).run(workers=2, progress=False)
    path = tmp_path / "killed"
    code = RUNNER.format(tests=str(Path(__file__).parent), path=str(path))
    runner = subprocess.Popen([sys.executable, "-c", code])
    while len(list(path.glob("rows/*.json"))) < 2:
        assert runner.poll() is None
        time.sleep(0.02)
    runner.kill()  # signal 9
    runner.wait()
    study = squares(path, 6, wait=0.5)
    tally = study.run(workers=2, progress=False)
    assert not living_cases(path)
    assert len(tally.skipped) >= 2
    assert len(tally.done) >= 2  # two were under way
    assert len(tally.done) + len(tally.skipped) == 6
    assert without_times(read_table(path)) == without_times(read_table(tmp_path / "whole"))


def test_cases_end_with_their_runner(tmp_path):
    path = tmp_path / "s"
    code = RUNNER.format(tests=str(Path(__file__).parent), path=str(path)).replace("0.5", "600.0")
    runner = subprocess.Popen([sys.executable, "-c", code])
    while len(list(path.glob("cases/*/x.txt"))) < 2:
        assert runner.poll() is None
        time.sleep(0.02)
    runner.kill()
    runner.wait()
    squares(path, 1).run(progress=False)  # has to wait for the lock that the cases held
    assert read_table(path)["square"].tolist() == [0.0]


def test_failures_are_recorded_and_the_rest_goes_on(tmp_path):
    study = Study(tmp_path / "s", picky, {f"x={k}": {"x": k} for k in range(1, 6)})
    tally = study.run(workers=2, progress=False)
    assert tally.done == ["x=1", "x=5"]
    assert tally.failed == {
        "x=2": "ValueError: two is not allowed.",
        "x=3": "ended by signal 9 (SIGKILL)",
        "x=4": "ended by exit code 1: no more",
    }
    assert "2 cases run, 0 were there already, 3 failed\n  x=2: ValueError: two" in str(tally)
    table = read_table(tmp_path / "s")
    assert table["status"].tolist() == ["complete", "failed", "failed", "failed", "complete"]
    np.testing.assert_array_equal(table["y"], [1.0, np.nan, np.nan, np.nan, 5.0])
    assert "Traceback" in (tmp_path / "s" / "cases" / "x=2" / "log.txt").read_text()

    (tmp_path / "s" / "cured").touch()
    assert study.run(progress=False).done == []  # failed ones only if asked
    again = study.run(progress=False, retry_failed=True)
    assert again.done == ["x=4"]
    assert list(again.failed) == ["x=2", "x=3"]
    np.testing.assert_array_equal(study.table()["y"], [1.0, np.nan, np.nan, 40.0, 5.0])


def test_a_value_that_no_row_can_hold(tmp_path):
    tally = Study(tmp_path / "s", vector, {"a": {"x": 1}}).run(progress=False)
    assert "The value 'y' must be a number or a text, not array([0., 0., 0.])" in tally.failed["a"]


def awkward(folder, *, kind):
    """Returns or prints what HDF5 has no place for, or dies in an unusual way."""
    if kind == "text":
        return {"said": "a\0b\udcff"}
    if kind == "error":
        raise ValueError("a\0b" + 3_000_000 * "x")
    if kind == "printed":
        sys.stdout.write(3_000_000 * "x" + "the end\0")
        sys.stdout.flush()
        os._exit(4)
    if kind == "signal":
        os.kill(os.getpid(), 40)  # one without a name
    if kind == "log":
        (folder / "log.txt").unlink()
        os._exit(5)
    return {kind: 1.0}


def test_nothing_that_a_case_does_stops_the_study(tmp_path):
    # What is kept of a text: its ends, NUL and what is not Unicode written as Python does.
    kinds = {"t": "text", "e": "error", "p": "printed", "s": "signal", "l": "log"}
    names = {"n1": "", "n2": ".", "n3": "a|b", "n4": "a\nb"}
    cases = {name: {"kind": kind} for name, kind in {**kinds, **names}.items()}
    tally = Study(tmp_path / "s", awkward, cases).run(workers=3, progress=False)
    assert tally.done == ["t"]
    table = read_table(tmp_path / "s")
    assert table["said"][0] == r"a\0b\udcff"
    reasons = dict(zip(table["case"], table["reason"], strict=True))
    assert reasons["e"].startswith(r"ValueError: a\0bxx")
    assert reasons["p"].startswith("ended by exit code 4: xx")
    assert reasons["p"].endswith(r"xxthe end\0")
    assert max(map(len, reasons.values())) <= LONGEST_TEXT + len(" ... ")
    assert (reasons["s"], reasons["l"]) == ("ended by signal 40", "ended by exit code 5")
    assert all("A value may not be named" in reasons[name] for name in names)


def named_like_a_column(folder, *, case):
    """Takes a parameter whose column would replace the names of the cases."""
    return {"y": case}


def test_changed_parameters_are_refused_or_run_again(tmp_path):
    Study(tmp_path / "s", square, {"a": {"x": 1}, "b": {"x": 2}}).run(progress=False)
    changed = Study(tmp_path / "s", square, {"a": {"x": 1}, "b": {"x": 3, "label": "new"}})
    with pytest.raises(StudyError, match=r"'b' .* was run with other parameters \(x: 2, now 3; la"):
        changed.run(progress=False)
    tally = changed.run(progress=False, rerun_changed=True)
    assert (tally.done, tally.skipped) == (["b"], ["a"])
    assert read_table(tmp_path / "s")["square"].tolist() == [1.0, 9.0]


def test_two_runners_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("dolfinx_joints.study.LOCK_SECONDS", 0.1)
    study = squares(tmp_path / "s")
    with study._locked(), pytest.raises(StudyError, match="Another runner is at work in "):
        study.run(progress=False)
    assert len(study.run(progress=False).done) == 4


def test_refusals(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="'a' do not fit: got an unexpected keyword argument 'z'"):
        Study(tmp_path, square, {"a": {"x": 1, "z": 2}})
    with pytest.raises(ValueError, match="'a' do not fit: missing a required .*argument: 'x'"):
        Study(tmp_path, square, {"a": {}})
    with pytest.raises(ValueError, match="of the case 'a' cannot be kept: Object of type ndarray"):
        Study(tmp_path, square, {"a": {"x": np.zeros(2)}})
    with pytest.raises(ValueError, match="The case 'a/b' must have a name of letters"):
        Study(tmp_path, square, {"a/b": {"x": 1}})
    with pytest.raises(ValueError, match="The case 1 must have a name of letters"):
        Study(tmp_path, square, {1: {"x": 1}})
    with pytest.raises(ValueError, match="The parameter 'case' of the case 'a' has the name of a"):
        Study(tmp_path, named_like_a_column, {"a": {"case": 1}})
    (tmp_path / "file").touch()
    with pytest.raises(StudyError, match="The study .*file cannot be written: .*Not a directory"):
        squares(tmp_path / "file").run(progress=False)
    with pytest.raises(ValueError, match="must be at the top level of a module"):
        Study(tmp_path, lambda folder: {}, {})
    with pytest.raises(ValueError, match="workers is 0; one or more cases may run at once"):
        squares(tmp_path).run(workers=0)
    with pytest.raises(StudyError, match="There is no table .*: run|run the study first"):
        read_table(tmp_path / "nothing")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    with pytest.raises(StudyError, match="run it without mpirun"):
        squares(tmp_path).run()


def test_files_that_are_no_rows_or_tables_are_told(tmp_path):
    # Another program, or a full disk, has put something else in their places.
    row = tmp_path / "a.json"
    assert read_row(row) is None
    for content, message in (
        ("{", r"a\.json is not a row of a study: .*line 1"),
        ("[]", r"a\.json is not a row of a study\.$"),
        ('{"case": "a"}', r"a\.json is not a row of a study\.$"),
    ):
        row.write_text(content)
        with pytest.raises(StudyError, match=message):
            read_row(row)
    place = tmp_path / "other.h5"
    place.write_text("no table")
    with pytest.raises(StudyError, match=r"other\.h5 is not an HDF5 file\.$"):
        read_table(place)
    with h5py.File(place, "w") as file:
        file["x"] = 1.0
    with pytest.raises(
        StudyError, match=r"other\.h5 is no table of a study, or a damaged one: its checksum"
    ):
        read_table(place)


def test_cases_end_with_an_interrupted_run(tmp_path, monkeypatch):
    # Ctrl-C while the runner waits for a case that would take ten minutes.
    study = squares(tmp_path / "s", 1, wait=600.0)

    def interrupt(seconds):
        if list(tmp_path.glob("s/cases/*/x.txt")):
            raise KeyboardInterrupt
        time.sleep(seconds)

    world = SimpleNamespace(sleep=interrupt, monotonic=time.monotonic)
    monkeypatch.setattr("dolfinx_joints.study.clock", world)
    with pytest.raises(KeyboardInterrupt):
        study.run(progress=False)
    assert not living_cases(tmp_path / "s")


def test_a_case_ends_when_its_runner_is_gone(monkeypatch):
    # The standard input ends, and nothing else can be on it: exit code 1, after all of it is read.
    left, codes = [b"more", b""], []
    world = SimpleNamespace(read=lambda file, count: left.pop(0), _exit=codes.append)
    monkeypatch.setattr(study_case, "os", world)
    study_case._end_with_the_runner()
    assert (left, codes) == ([], [1])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0], r"The function must return a mapping of values, not \[1\.0\]"),
        ({"x": 1.0}, "The value 'x' has the name of a parameter or of the study"),
        ({"wall_s": 1.0}, "The value 'wall_s' has the name of a parameter or of the study"),
        ({"y": None}, "The value 'y' must be a number or a text, not None"),
    ],
)
def test_what_a_case_may_not_return(values, message):
    with pytest.raises(StudyError, match=message):
        plain_values(values, ["x"])


def test_a_function_of_the_running_script_is_known_by_its_module(tmp_path, monkeypatch):
    # As after python3 -m tests.test_study; a file that is run by its path cannot be imported.
    monkeypatch.setattr(square, "__module__", "__main__")
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", SimpleNamespace(name=__name__))
    assert study_address(square) == (__name__, "square")
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    with pytest.raises(ValueError, match="must be at the top level of a module"):
        Study(tmp_path, square, {})


def test_csv(tmp_path):
    study = Study(tmp_path / "s", square, {"a": {"x": 1, "label": "p,q"}, "b": {"x": 2}})
    study.run(progress=False)
    lines = write_csv(study.table(), tmp_path / "t.csv").read_text().splitlines()
    assert lines[0] == "case,status,reason,wall_s,peak_mb,x,label,square,third,said"
    assert lines[1].startswith("a,complete,,")
    assert lines[1].endswith(f',1.0,"p,q",1.0,{1 / 3!r},"p,q"')


@pytest.mark.parametrize(
    "change",
    [("1.5", "1" * 400), ('"values": {', '"values": [{"a": 1}], "more": {'), ("{", "[" * 5000)],
    ids=["a number without end", "no mapping", "deep"],
)
def test_a_row_that_fits_no_table_is_refused(tmp_path, change):
    path = tmp_path / "row.json"
    row = dict(zip(OWN_COLUMNS, ("a", "complete", "", 1.5, 20.0), strict=True))
    write_row(path, row | {"parameters": {"x": 1}, "values": {"y": 2.5}})
    assert read_row(path)["values"] == {"y": 2.5}
    path.write_text(path.read_text().replace(*change, 1))
    with pytest.raises(StudyError, match=r"row\.json is ") as failure:
        read_row(path)
    assert "\n" not in str(failure.value)


def test_a_table_that_has_changed_is_refused(tmp_path):
    # One bit of a number, which HDF5 itself would not notice.
    path = tmp_path / "table.h5"
    write_table(path, {"x": np.array([1.0, 2.0]), "said": np.array(["a", "é"], dtype=object)})
    assert read_table(path)["said"].tolist() == ["a", "é"]
    content = bytearray(path.read_bytes())
    content[content.index(np.float64(2.0).tobytes())] ^= 1
    path.write_bytes(content)
    with pytest.raises(StudyError, match="its checksum is not that of what it holds"):
        read_table(path)
