# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files of 0.2.0 open, and give the numbers that 0.2.0 gave.

``files_of_0.2.0.tar.xz`` contains files that 0.2.0 wrote, the script ``write.py`` that it ran,
and the tables of its command ``dolfinx-joints csv``. These tables are the expected numbers.

- ``space``: a 3-D run with two static stages, a bond that breaks, water in the joint, resultants
  and envelopes;
- ``plane_continued``: a 2-D run that continues another one. Its first record differs from its
  static state, and slips count from the first record;
- ``plane_stages``: a 2-D run of two static stages.
"""

from __future__ import annotations

import csv
import tarfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from vtk_files import read_vtk

from dolfinx_joints import ResultsError, compare, export, report
from dolfinx_joints.export.tables import write_csv
from dolfinx_joints.postprocessing.measures import joint_history, joint_measures
from dolfinx_joints.results.quantities import row_of
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

# The warning states the frequencies that the short runs resolve.
pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")

DYNAMIC = ["space", "plane_continued"]
RUNS = [*DYNAMIC, "plane_stages"]
# Names of columns and rows contain these words now, in addition to the words of 0.2.0.
ADDED_WORDS = (" from the unloaded body", " from the first record")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("files_of_0.2.0")
    with tarfile.open(Path(__file__).with_name("files_of_0.2.0.tar.xz")) as archive:
        archive.extractall(path, filter="data")
    return path


def columns(path: Path, removed: tuple[str, ...] = ()) -> dict[str, list[str]]:
    text = path.read_text()
    for words in removed:
        text = text.replace(words, "")
    head, *rows = csv.reader(text.splitlines())
    return dict(zip(head, map(list, zip(*rows, strict=True)), strict=True))


@pytest.mark.parametrize("run", RUNS)
def test_tables_have_the_numbers_of_the_version_that_wrote_the_file(folder, tmp_path, run):
    with Results(folder / f"{run}.h5") as results:
        write_csv(results, tmp_path)
    tables = sorted(path.name for path in (folder / run).iterdir())
    assert len(tables) == {"space": 10, "plane_continued": 9, "plane_stages": 2}[run]
    for name in tables:
        expected, table = columns(folder / run / name), columns(tmp_path / name, ADDED_WORDS)
        for heading, values in expected.items():
            if name != "histories.csv" or not heading.startswith("displacement of "):
                assert table[heading] == values, (name, heading)


@pytest.mark.parametrize("run", DYNAMIC)
def test_displacements_count_from_the_static_state_now(folder, tmp_path, run):
    # In 0.2.0 they counted from the unloaded body, also those of stages.
    with Results(folder / f"{run}.h5") as results:
        paths = {path.name: path for path in write_csv(results, tmp_path)}
    table = columns(paths["histories.csv"])
    old, stages = (columns(folder / run / name) for name in ("histories.csv", "stages.csv"))
    for axis in "xyz":
        static = float(stages[f"displacement of top {axis} [m]"][-1])
        expected = np.array(old[f"displacement of top {axis} [m]"], dtype=float) - static
        values = np.array(table[f"displacement of top from the static state {axis} [m]"], float)
        np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("run", RUNS)
def test_arrays_and_series_are_those_of_the_file(folder, run):
    path = folder / f"{run}.h5"
    with h5py.File(path, "r") as file, Results(path) as results:
        assert (results.layout, results.status) == (1, "complete")
        assert results.metadata["manifest"]["versions"]["dolfinx_joints"] == "0.2.0"
        for name in results.statics:
            np.testing.assert_array_equal(results.static(name), file["static"][name])
        dynamic = (
            {"energy", "histories", "joints", "resultants", "states"} if run in DYNAMIC else ()
        )
        assert {"statics", *dynamic} <= set(results.streams)
        for stream, names in results.streams.items():
            for name in names:
                rows = file["streams"][stream][name][: results.rows(stream)]
                np.testing.assert_array_equal(results.series(stream, name), rows)
                # A renamed quantity would have no row, and needs a new version of the layout.
                row, _ = row_of(stream, name)
                assert row.unit == results.unit(stream, name)


@pytest.mark.parametrize("run", RUNS)
def test_paraview_shows_the_states_of_the_file(folder, tmp_path, run):
    names = {"states": run, "statics": f"{run}_stages"}
    with Results(folder / f"{run}.h5") as results:
        export.write_vtk(results, tmp_path / run)
        for stream in names.keys() & results.streams.keys():
            steps = read_vtk(tmp_path / f"{names[stream]}.vtkhdf")
            fields = [grid.point_data["displacement [m]"] for _, grid in steps]
            np.testing.assert_array_equal(fields, results.series(stream, "displacement"))


@pytest.mark.parametrize("run", RUNS)
def test_the_report_has_the_meanings_of_that_version(folder, tmp_path, run):
    # A node of two supports was counted in both, and slips counted from the first record.
    path = report.write([folder / f"{run}.h5"], tmp_path / "report.html", with_3d=False)
    page = path.read_text()
    assert "A node of several supports counts in each of them" in page
    assert ("Slips count from the first record" in page) == (run in DYNAMIC)
    assert "slip from the static state" not in page


def test_largest_and_residual_slips_have_the_same_zero(folder):
    # The largest slips are recorded at every step, residual slips follow from states.
    with Results(folder / "plane_continued.h5") as results:
        static = results.series("statics", "joints/joint_1/gap", -1)
        first = results.series("states", "joints/joint_1/gap", 0)
        assert np.abs(first - static).max() > 1e-3  # the run that was continued has slid
        _, _, slip = joint_history(results, "joint_1")
        assert slip[0].max() == 0.0
        recorded = results.series("joints", "joint_1/slip")
        largest = joint_measures(results)["joint_1"]["slip_max"]
    assert slip[-1].max() == pytest.approx(recorded[-1], rel=1e-12)
    assert largest == recorded.max()


def test_a_run_does_not_continue_a_file_with_other_meanings(folder):
    path = folder / "space.h5"
    with Results(path) as results:
        rows = {stream: results.rows(stream) for stream in results.streams}
    message = r"space\.h5 cannot be continued: it has version 1 of the layout"
    with pytest.raises(ResultsError, match=message):
        ResultsWriter.resume(path, rows)
    assert Results(path).layout == 1


def test_a_comparison_with_a_file_of_another_layout_has_a_note(folder, tmp_path):
    newer = tmp_path / "newer.h5"
    newer.write_bytes((folder / "plane_continued.h5").read_bytes())
    with h5py.File(newer, "r+") as file:
        file.attrs["version"] = 2
    comparison = compare(folder / "plane_continued.h5", newer)
    assert comparison.notes == [
        "Layouts 1 and 2: slips of continued runs and reactions have other meanings "
        "(docs/results_file.md)."
    ]
    (changed,) = (row.quantity for row in comparison.rows if row.difference)
    assert changed == "measures/slip_residual"
