# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies: rows that survive the end of the runner, failures, the table.

Expected: arithmetic of the functions below, and a run that nothing has disturbed.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.files import FileLock
from dolfinx_joints.study import Study, read_table, write_csv

TIMES = ("wall_s", "peak_mb")


def square(folder, *, x, wait=0.0, label="none"):
    """A case: a file, a number, a text."""
    (folder / "x.txt").write_text(str(x))
    time.sleep(wait)
    return {"square": x * x, "third": x / 3.0, "text": label}


def picky(folder, *, x):
    """Fails at 2, dies at 3, ends at 4, returns no row at 5."""
    if x == 2:
        raise ValueError("two is\nnot allowed.")
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if (folder.parents[1] / "cured").exists():
        return {"y": 10.0 * x}
    if x == 4:
        sys.exit("no more")
    return [1.0] if x == 5 else {"y": float(x)}


def clashing(folder, *, height, base=0.0):
    """Values with names of parameters, of the table, of another case's parameter, and an array."""
    values = {"crest": 5.0, "height": 2.0 * height, "status": "own", "vector": np.zeros(3)}
    return values if height == 1.0 else {"base": 7.0}


def without_times(table):
    return {name: column.tolist() for name, column in table.items() if name not in TIMES}


def squares(path, number=4, wait=0.0):
    return Study(path, square, {f"x={k}": {"x": k, "wait": wait} for k in range(number)})


def test_rows_are_in_the_order_of_the_cases(tmp_path):
    # The first case ends last.
    cases = {
        "slow": {"x": 1, "wait": 0.8},
        "fast": {"x": 2},
        "text": {"x": 3, "label": "p,q"},
    }
    tally = Study(tmp_path / "s", square, cases).run(workers=3, progress=False)
    assert tally.done == ["slow", "fast", "text"]
    assert (tally.failed, tally.skipped) == ({}, [])
    table = read_table(tmp_path / "s")
    assert table["case"].tolist() == ["slow", "fast", "text"]
    assert table["square"].tolist() == [1.0, 4.0, 9.0]
    assert table["third"].tolist() == [1 / 3, 2 / 3, 1.0]  # every digit
    assert table["text"].tolist() == ["none", "none", "p,q"]
    np.testing.assert_array_equal(table["wait"], [0.8, np.nan, np.nan])  # not given
    assert table["wall_s"][0] >= 0.8
    assert (table["peak_mb"] > 5.0).all()
    assert (tmp_path / "s" / "cases" / "fast" / "x.txt").read_text() == "2"
    lines = write_csv(table, tmp_path / "t.csv").read_text().splitlines()
    assert lines[0] == "case,status,reason,wall_s,peak_mb,x,wait,label,square,third,text"
    assert lines[1].endswith(f",1.0,0.8,,1.0,{1 / 3!r},none")
    assert lines[3].endswith(',1.0,"p,q"')


def test_only_some_and_finished_cases_are_skipped(tmp_path):
    some = squares(tmp_path / "s")
    assert some.run(only=["x=2", "x=1"], progress=False).done == ["x=1", "x=2"]
    before = some.table()["wall_s"].tolist()
    tally = squares(tmp_path / "s", 3).run(progress=False)
    assert (tally.done, tally.skipped) == (["x=0"], ["x=1", "x=2"])
    assert read_table(tmp_path / "s")["wall_s"].tolist()[1:] == before
    with pytest.raises(ValueError, match="There is no case 'x=9'; there are x=0, x=1, x=2, x=3."):
        some.run(only=["x=9"])


def reading(folder):
    """Read standard input, here and in a child process; return the numbers of characters."""
    child = subprocess.run(["cat"], stdout=subprocess.PIPE, timeout=20.0, check=True)
    return {"own": len(sys.stdin.read()), "of child": len(child.stdout)}


def test_standard_input_of_a_case_is_empty(tmp_path):
    study = Study(tmp_path / "s", reading, {"a": {}})
    assert study.run(progress=False).failed == {}
    assert [study.table()[name].tolist() for name in ("own", "of child")] == [[0.0], [0.0]]


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
    before = (path / "table.json").read_bytes()
    message = r"table\.json cannot be written: File too large\.$"
    with full_disk(100), pytest.raises(StudyError, match=message):
        squares(path, 3).run(progress=False)
    assert (path / "table.json").read_bytes() == before
    assert {item.name for item in path.iterdir()} <= {"table.json", "cases", "table.json.lock"}
    assert squares(path, 3).run(progress=False).done == ["x=2"]


# Shells have what they start in the background ignore interrupts.
RUNNER = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {tests!r})
from test_study import squares
if __name__ == "__main__":
    from concurrent.futures import ProcessPoolExecutor
    squares({path!r}, 6, wait={wait}).run(executor={executor}, workers=2, progress=False)
"""


def start_runner(path, wait, executor="None"):
    facts = {"path": str(path), "wait": wait, "executor": executor}
    code = RUNNER.format(tests=str(Path(__file__).parent), **facts)
    return subprocess.Popen([sys.executable, "-c", code])


def wait_for(runner, ready):
    while not ready():
        assert runner.poll() is None
        time.sleep(0.02)


@pytest.mark.parametrize("executor", ["None", "ProcessPoolExecutor(2)"])
def test_killed_half_way_and_resumed(tmp_path, executor):
    squares(tmp_path / "whole", 6, wait=0.5).run(workers=2, progress=False)
    path = tmp_path / "killed"
    runner = start_runner(path, 0.5, executor)
    wait_for(runner, lambda: path.exists() and (path / "table.json").exists())
    runner.kill()  # signal 9
    runner.wait()
    wait_for_lock(path)  # workers of a pool see the end of the runner and end
    tally = squares(path, 6, wait=0.5).run(workers=2, progress=False)
    assert tally.skipped
    assert len(tally.done) >= 2  # those that were under way
    assert len(tally.done) + len(tally.skipped) == 6
    assert without_times(read_table(path)) == without_times(read_table(tmp_path / "whole"))


def test_a_worker_that_dies_is_a_row(tmp_path):
    """Of a pool whose worker dies nothing comes back; the cases before keep their rows."""
    with ProcessPoolExecutor(1) as pool:
        pool.submit(int).result()
        cases = Study(tmp_path / "s", square, {"a": {"x": 1}, "b": {"x": 2, "wait": 600.0}})
        (worker,) = pool._processes

        def kill():
            wait_for_files(cases, "b")
            os.kill(worker, signal.SIGKILL)

        threading.Thread(target=kill).start()
        tally = cases.run(executor=pool, progress=False)
    assert tally.done == ["a"]
    assert tally.failed["b"].startswith("its worker was lost: BrokenProcessPool: ")
    retried = Study(tmp_path / "s", square, {"a": {"x": 1}, "b": {"x": 2}})
    assert retried.run(rerun_changed=True, progress=False).done == ["b"]
    assert read_table(tmp_path / "s")["square"].tolist() == [1.0, 4.0]


def wait_for_lock(path):
    for _ in range(500):
        try:
            return FileLock(path / "table.json", StudyError).release()
        except StudyError:
            time.sleep(0.02)
    raise AssertionError("the study is still locked")


def wait_for_files(study, name):
    while not (study.folder(name) / "x.txt").exists():
        time.sleep(0.02)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_cases_end_with_their_runner(tmp_path, end):
    path, alone = tmp_path / "s", 600.0  # a case takes that long by itself [s]
    runner = start_runner(path, alone)
    wait_for(runner, lambda: len(list(path.glob("cases/*/x.txt"))) == 2)
    ends = time.monotonic() + 0.5 * alone
    tasks = Path(f"/proc/{runner.pid}/task").glob("*/children")
    cases = [child for task in tasks for child in task.read_text().split()]
    assert len(cases) >= 2
    runner.send_signal(end)
    assert runner.wait(0.5 * alone) != 0
    while any(Path(f"/proc/{case}/fd/1").exists() for case in cases):  # a zombie has no files
        assert time.monotonic() < ends
        time.sleep(0.02)


def test_an_interrupt_before_the_first_row_begins_no_more_cases(tmp_path, monkeypatch):
    """All of four are handed out by then, two of them run and are ended."""
    cases = squares(tmp_path / "s", 4, wait=5.0)

    def interrupted(**_):
        for name in ("x=0", "x=1"):
            wait_for_files(cases, name)
        raise KeyboardInterrupt

    monkeypatch.setattr("tqdm.auto.tqdm", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cases.run(workers=2)
    assert len(list((tmp_path / "s").glob("cases/*/x.txt"))) == 2


def test_failures_are_recorded_and_the_rest_goes_on(tmp_path):
    cases = Study(tmp_path / "s", picky, {f"x={k}": {"x": k} for k in range(1, 7)})
    tally = cases.run(workers=2, progress=False)
    assert tally.done == ["x=1", "x=6"]
    log = tmp_path / "s" / "cases" / "x={}" / "log.txt"
    assert tally.failed == {
        "x=2": "ValueError: two is not allowed.",
        "x=3": f"ended by signal 9; see {str(log).format(3)}",
        "x=4": f"ended by exit code 1; see {str(log).format(4)}",
        "x=5": "StudyError: The function must return a mapping of values, not [1.0].",
    }
    assert "2 cases run, 0 already complete, 4 failed\n  x=2: ValueError: two" in str(tally)
    table = read_table(tmp_path / "s")
    assert table["status"].tolist() == ["complete", *["failed"] * 4, "complete"]
    np.testing.assert_array_equal(table["y"], [1.0, *[np.nan] * 4, 6.0])
    assert "Traceback" in Path(str(log).format(2)).read_text()
    assert "no more" in Path(str(log).format(4)).read_text()

    (tmp_path / "s" / "cured").touch()
    left = cases.run(progress=False)  # failed ones only if asked
    assert (left.done, left.failed_before) == ([], tally.failed)
    told = "0 cases run, 2 already complete, 0 failed, 4 failed before (retry with retry_failed"
    assert str(left).startswith(told)
    assert "\n  x=2: ValueError: two is not allowed." in str(left)
    again = cases.run(progress=False, retry_failed=True)
    assert again.done == ["x=4", "x=5"]
    np.testing.assert_array_equal(cases.table()["y"], [1.0, np.nan, np.nan, 40.0, 50.0, 6.0])


def test_a_finished_case_is_kept_whatever_its_values_are_called(tmp_path):
    cases = {"low": {"height": 1.0, "base": 3.0}, "high": {"height": 2.0}}
    tally = Study(tmp_path / "s", clashing, cases).run(progress=False)
    assert (tally.done, tally.failed) == (["low", "high"], {})
    table = read_table(tmp_path / "s")
    assert table["status"].tolist() == ["complete", "complete"]
    assert table["height"].tolist() == [1.0, 2.0]
    low = {name: column[0] for name, column in table.items()}
    assert (low["crest"], low["height (value)"], low["base"]) == (5.0, 2.0, 3.0)
    assert low["status (value)"] == "own"
    # Of the other case ``base`` is a value, and no parameter.
    np.testing.assert_array_equal(table["base"], [3.0, np.nan])
    np.testing.assert_array_equal(table["base (value)"], [np.nan, 7.0])
    for text in (tally.remarks["low"], low["reason"], str(tally)):
        assert "'height' is already used by another column; the value is in the column" in text
        assert "'vector' must be a number or a text, not array([0., 0., 0.])" in text
    assert tally.remarks["high"].endswith("the value is in the column 'base (value)'.")
    log = (tmp_path / "s" / "cases" / "low" / "log.txt").read_text()
    assert "'vector': array([0., 0., 0.])" in log


def test_changed_parameters_are_run_again_only_if_asked(tmp_path):
    Study(tmp_path / "s", square, {"a": {"x": 1}, "b": {"x": 2}}).run(progress=False)
    changed = Study(tmp_path / "s", square, {"a": {"x": 1}, "b": {"x": 3, "label": "new"}})
    with pytest.raises(StudyError, match=r"'b' .* with other parameters: {'x': 2}, now {'x': 3, "):
        changed.run(progress=False)
    tally = changed.run(progress=False, rerun_changed=True)
    assert (tally.done, tally.skipped) == (["b"], ["a"])
    assert read_table(tmp_path / "s")["square"].tolist() == [1.0, 9.0]


@pytest.mark.parametrize(
    ("function", "cases", "message"),
    [
        (square, {"a": {"x": 1, "z": 2}}, "'a' are wrong: got an unexpected keyword argument 'z'"),
        (square, {"a": {}}, "'a' are wrong: missing a required .*argument: 'x'"),
        (square, {"a": {"x": np.zeros(2)}}, "'a' are wrong: Object of type ndarray"),
        (square, [1, 2], "Study: cases is .1, 2.; it must be parameters by name of the case"),
        (square, {"a/b": {"x": 1}}, "The case 'a/b' must have a name of letters"),
        (square, {"a": {"case": 1}}, "The parameter 'case' has the name of a column"),
        (lambda folder: {}, {}, "must be at the top level of a module"),
    ],
)
def test_cases_that_cannot_be_run(tmp_path, function, cases, message):
    with pytest.raises(ValueError, match=message):
        Study(tmp_path, function, cases)


def test_places_and_processes_where_no_study_runs(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(StudyError, match="The study .*file cannot be written: "):
        squares(tmp_path / "file").run(progress=False)
    lock = FileLock(tmp_path / "table.json", StudyError)
    with lock, pytest.raises(StudyError, match="is being written by process"):
        squares(tmp_path).run(progress=False)
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    with pytest.raises(StudyError, match="run it without mpirun"):
        squares(tmp_path).run()


@pytest.mark.parametrize("content", ["{", '[{"case": "a"}]'])
def test_a_damaged_table_is_one_error(tmp_path, content):
    with pytest.raises(StudyError, match="There is no table .*; run the study first"):
        read_table(tmp_path)
    squares(tmp_path, 1).run(progress=False)
    assert json.loads((tmp_path / "table.json").read_text())[0]["values"]["square"] == 0
    (tmp_path / "table.json").write_text(content)
    with pytest.raises(StudyError, match=r"table\.json is damaged or not the table of a study: "):
        read_table(tmp_path)
