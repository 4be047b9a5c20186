# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""`accuracy`: its runs, resuming, refusals, the table; the example of the guide.

Expected: errors of values that are powers of step and cell size.
"""

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from declared import declare_histories
from written_runs import CUBE, FACES

import dolfinx_joints as dj
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.results.layout import Cells, declare_body
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.study import read_table

GUIDE = Path(__file__).resolve().parents[2] / "docs/guide/studies.md"
SLIP = "joint_1: slip [m]"
LEVELS = {"size": 0.5, "dt": 0.1}


def powers(folder, *, size, dt):
    """Displacement 3 - 2 dt^2 - 0.4 size, a singular stress, and a value without order."""
    return {
        "displacement [m]": 3.0 - 2.0 * dt**2 - 0.4 * size,
        "peak [Pa]": 8.0 * size**-0.455,
        "erratic [m]": 1.0 + 0.01 * np.sin(80.0 * dt),
        "lost [m]": np.nan if dt > 0.3 else 1.0,
    }


def failing(folder, *, size, dt):
    if size > 0.7 and not (folder.parents[1] / "cured").exists():
        raise ValueError("the cells are too large.")
    return {"u [m]": dt + 0.1 * size}


def without_step(folder, *, size, dt):
    """Return a value that does not depend on the step."""
    return {"u [m]": size}


def process_of(folder, *, size, dt):
    """Return the number of the process."""
    return {"u [m]": size + dt, "process": float(os.getpid())}


def same_file(folder, *, size, dt):
    """Return a file whatever size and step are."""
    return folder.parents[2] / "run.h5"


def test_errors_of_values_that_are_powers(tmp_path):
    result = dj.accuracy(tmp_path / "a", powers, **LEVELS, progress=False)
    table = result.table
    assert table["value"].tolist() == ["displacement [m]", "peak [Pa]", "erratic [m]"]
    assert table["step_kind"].tolist() == ["order", "constant", "no order"]
    assert table["cell_kind"].tolist() == ["order", "growth", "constant"]
    assert table["step_order"][0] == pytest.approx(2.0, rel=1e-4)
    assert table["cell_order"][0] == pytest.approx(1.0, rel=1e-4)
    assert table["step_error"][0] == pytest.approx(0.02, rel=1e-3)
    assert table["cell_error"][0] == pytest.approx(0.2, rel=1e-3)
    assert table["error"][:2] == pytest.approx([0.22, np.inf], rel=1e-3)
    name, value = "displacement [m]", powers(None, **LEVELS)["displacement [m]"]
    assert result.bars[name] == pytest.approx((value, 0.22), rel=1e-3)
    # At the predicted run the error is 1 % of the value.
    dt, size = table["dt [s]"][0], table["size [m]"][0]
    assert 2.0 * dt**2 + 0.4 * size == pytest.approx(0.01 * value, rel=2e-2)
    assert np.isnan(table["dt [s]"][1])
    shown = str(result)
    lines = {line.split("  ")[0]: line for line in shown.splitlines()}
    assert re.search(r" 7\.9 %  +0\.72 %, order 2\.0  +7\.2 %, order 1\.0 ", lines[name])
    assert re.search(r" no limit  +constant  +growth  +out of reach$", lines["peak [Pa]"])
    assert re.search(r"< [\d.]+ %  +< [\d.]+ %, no order  +constant ", lines["erratic [m]"])
    assert "growth: peak [Pa]. These peaks grow as cells shrink" in shown
    assert result.lacking == ["lost [m]"]
    assert "Not in all runs, so without an error: lost [m].\n" in shown
    written = (tmp_path / "a" / "accuracy.csv").read_text().splitlines()
    assert written[0].startswith("value,given,error,step_error,step_kind,step_order,cell_error,")
    assert len(written) == 4


def test_each_run_starts_an_interpreter(tmp_path):
    """The processor time of each run contains the start-up, so that times are comparable."""
    result = dj.accuracy(tmp_path / "a", process_of, **LEVELS, workers=1, progress=False)
    assert len({*result.runs["process"]}) == 5


def test_a_second_call_makes_only_missing_runs(tmp_path):
    path = tmp_path / "a"
    first = dj.accuracy(path, powers, **LEVELS, cells=(), progress=False)
    assert first.runs["case"].tolist() == ["given", "step_x2", "step_x4"]
    assert set(first.table["cell_kind"]) == {"not varied"}
    finer = (0.5, 0.25)
    second = dj.accuracy(path, powers, **LEVELS, steps=finer, cells=(), progress=False)
    runs = read_table(path)  # those of the first call stay
    assert set(runs["case"]) == {"given", "step_x2", "step_x4", "step_x0.5", "step_x0.25"}
    assert runs["wall_s"][0] == first.runs["wall_s"][0]
    assert second.table["step_error"][0] == pytest.approx(0.02, rel=1e-3)


def test_a_folder_of_another_study_is_refused(tmp_path):
    path = tmp_path / "a"
    dj.accuracy(path, powers, **LEVELS, cells=(), progress=False)
    before = (path / "table.json").read_bytes()
    for run, size in ((powers, 0.6), (failing, 0.5)):
        with pytest.raises(StudyError, match="contains another study: its case 'given' has"):
            dj.accuracy(path, run, size=size, dt=0.1, cells=(), progress=False)
    assert (path / "table.json").read_bytes() == before


def test_a_failed_run_is_made_again(tmp_path):
    path = tmp_path / "a"
    message = "needs all runs of .*: 4 cases run, .* 1 failed\n  cell_x1.6: ValueError: the cells"
    with pytest.raises(StudyError, match=message):
        dj.accuracy(path, failing, **LEVELS, progress=False)
    (path / "cured").touch()
    result = dj.accuracy(path, failing, **LEVELS, progress=False)
    assert result.table["step_order"] == pytest.approx([1.0], rel=1e-4)


def test_a_function_that_does_not_use_the_step_is_refused(tmp_path):
    with pytest.raises(StudyError, match="No value changes with the step: the function does not"):
        dj.accuracy(tmp_path / "a", without_step, **LEVELS, progress=False)
    with pytest.raises(ValueError, match="steps and cells are both empty"):
        dj.accuracy(tmp_path / "b", powers, size=0.5, dt=0.1, steps=(), cells=(), progress=False)


def test_runs_on_equal_cells_are_refused(tmp_path):
    with ResultsWriter(tmp_path / "run.h5", {}) as writer:
        cells = Cells(12, np.arange(8).reshape(1, 8), {})
        declare_body(writer, CUBE, FACES, {}, cells)
        declare_histories(writer, [CUBE[-1]])
        writer.start()
        writer.finish("complete", {})
    with pytest.raises(StudyError, match="'cell_x1.26' has as many cells as another one"):
        dj.accuracy(tmp_path / "a", same_file, **LEVELS, progress=False)


@pytest.mark.parametrize(
    ("run", "changes", "message"),
    [
        (powers, {"steps": (2.0,)}, r"steps is \(2.0,\); it must be two or more positive factors"),
        (powers, {"cells": (1.0, 2.0)}, r"cells is \(1.0, 2.0\); it must be two or more"),
        (powers, {"cells": (-1.0, 2.0)}, r"cells is \(-1.0, 2.0\); it must be two or more"),
        (lambda size, dt: {}, {}, r"run must accept \(folder, size=..., dt=...\)"),
        (lambda folder, size, dt: {}, {}, "must be at the top level of a module"),
    ],
)
def test_arguments_that_are_refused(tmp_path, run, changes, message):
    with pytest.raises(ValueError, match=message):
        dj.accuracy(tmp_path / "a", run, **LEVELS, **changes)
    assert not (tmp_path / "a").exists()


@pytest.mark.mpi
def test_several_ranks_are_refused_on_each(tmp_path, monkeypatch):
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    with pytest.raises(StudyError, match="accuracy starts .* without mpirun"):
        dj.accuracy(tmp_path / "a", powers, **LEVELS)
    assert not (tmp_path / "a").exists()


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Folder and printed text of the guide's example, started twice: the second call only reads."""
    pytest.importorskip("dolfinx")
    pytest.importorskip("gmsh")
    (code,) = (
        t for t in re.findall("```python\n(.*?)```", GUIDE.read_text(), re.S) if "dj.acc" in t
    )
    folder = tmp_path_factory.mktemp("example")
    (folder / "blocks.py").write_text(code)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command, printed = [sys.executable, "blocks.py"], []
    for _ in range(2):
        made = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert made.returncode == 0, made.stderr
        printed.append(made.stdout)
    assert printed[0] == printed[1]
    return folder, printed[0]


def written_errors(folder):
    """Rows of the CSV file by the name of the value."""
    with (folder / "accuracy/accuracy.csv").open() as file:
        return {row["value"]: row for row in csv.DictReader(file)}


def test_the_example_of_the_guide(example):
    """Expected: the upper block rests while the ground moves by 30 t^3 / 6, 0.04 m at 0.2 s."""
    row = written_errors(example[0])[SLIP]
    assert row["step_kind"] == "order"
    assert float(row["step_order"]) == pytest.approx(2.0, abs=0.05)
    assert 0.5 < float(row["error"]) / abs(float(row["given"]) - 0.04) < 2.0
    assert len(read_table(example[0] / "accuracy")["case"]) == 5


def test_printed_errors_are_those_of_the_files(example):
    """The second call reads its rows, and prints the same text as the first one."""
    folder, printed = example
    rows, runs = written_errors(folder), read_table(folder / "accuracy")
    lines = [re.split("  +", line) for line in printed.splitlines()]
    shown = {line[0]: line[1:] for line in lines if line[0] in rows}
    assert shown.keys() == rows.keys()
    for name, (value, *errors, run) in shown.items():
        row = rows[name]
        given, kinds = float(row["given"]), [row["step_kind"], row["cell_kind"]]
        assert value == f"{given:.4g}"
        assert runs[name][0] == given
        columns = [(row["error"], kinds)]
        columns += [(row[f"{name}_error"], row[f"{name}_kind"]) for name in ("step", "cell")]
        for text, (error, kind) in zip(errors, columns, strict=True):
            number = re.match(r"(< )?([\d.e-]+) %", text)
            assert (text == "constant") == (kind == "constant")
            assert ("no order" in kind) == text.startswith("< ")
            expected = 100.0 * float(error) / given if given else 0.0
            assert number is None or float(number[2]) == pytest.approx(expected, rel=0.06)
        predicted = "{:.2g} s, {:.2g} m: {:.2g} s".format(*map(float, [*row.values()][-3:]))
        assert run == (predicted if row["dt [s]"] != "nan" else "out of reach")
    for case, seconds in zip(runs["case"], runs["processor_s"], strict=True):
        assert f"{case} {seconds:.2g} s" in printed


def test_bars_of_the_report_are_those_of_the_files(example):
    rows, texts = written_errors(example[0]), (example[0] / "report.html").read_text()
    shown = re.findall(r">([^<>]{1,12}) <span class=.where.>± ([^<,]{1,12}),", texts)
    expected = []
    for name in ("crest displacement [m]", "crest acceleration below 25 Hz [m/s^2]", SLIP):
        factor = 1e3 if name.endswith("[m]") else 1.0
        value, error = (factor * float(rows[name][key]) for key in ("given", "error"))
        expected.append((f"{value:#.4g}", f"{error:.4g}"))
    signs = str.maketrans("\N{MINUS SIGN}", "-")
    assert [(v.translate(signs).strip("-"), e.translate(signs)) for v, e in shown] == expected
