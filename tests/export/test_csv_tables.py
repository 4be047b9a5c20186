# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""CSV tables hold what the file holds, and the overview of a file fits a screen; no DOLFINx."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from declared import declare_energy, declare_envelopes, declare_histories, declare_states

from dolfinx_joints import Motion, RecordError, Results, ResultsError, cli
from dolfinx_joints.export.tables import write_csv
from dolfinx_joints.postprocessing.joints.resultants import block_resultants, joint_resultants
from dolfinx_joints.results.overview import overview
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.study.table import write_csv as write_table

STEPS, EVERY = 7, 3
RANDOM = np.random.default_rng(7)
AREAS = np.array([0.5, 1.5])
POINTS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
LEVEL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # rows n = z, s1 = x, s2 = y


def write_run(path: Path, joints: tuple[str, ...] = ("joint_1", "joint_2")) -> Path:
    """A file with random numbers in every place that a table reads."""
    joint = {
        "points": POINTS,
        "frames": np.stack([LEVEL, LEVEL]),
        "areas": AREAS,
        "facet": np.zeros(2, dtype=np.int64),
    }
    laws = {"kind": "FrictionNoTension", "friction_angle_deg": 45.0, "cohesion": 0.0}
    facts = {
        "point_names": ["crest", "left, top"],
        "stage": "dynamic",
        "steps": STEPS,
        "laws": dict.fromkeys(joints, laws),
    }
    with ResultsWriter(path, facts) as writer:
        declare_histories(writer, RANDOM.random((2, 3)), accelerations=True)
        writer.series("histories", "reaction/base", (3,), "N", "force")
        writer.series("histories", "velocity", (2, 3), "m/s", "a series of points that a run adds")
        declare_energy(writer, joints, ["Gravity"])
        nodes = RANDOM.random((4, 3))
        declare_states(writer, nodes, [[0, 1, 2, 3]], dict.fromkeys(joints, joint), status=True)
        declare_envelopes(writer, [1, 3], np.full((2, 3), np.nan), np.full((2, 3), np.nan))
        writer.start()
        for step in range(STEPS):
            time = 0.1 * step
            append(writer, "histories", time)
            append(writer, "energy", time)
            if step % EVERY == 0:
                append(writer, "states", time)
        append(writer, "envelopes", 0.6)
        writer.finish("complete", {"steps": STEPS, "accepted": STEPS, "energy_error": 1e-14})
    return path


def append(writer: ResultsWriter, stream: str, time: float) -> None:
    """A record of random numbers."""
    with_shapes = writer._streams[stream]._datasets
    writer.append(
        stream,
        time,
        {
            name: RANDOM.standard_normal(data.shape[1:]) * 1e6
            if data.dtype.kind == "f"
            else RANDOM.integers(0, 3, data.shape[1:])
            for name, data in with_shapes.items()
        },
    )


def read(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, rows


def column(path: Path, name: str) -> np.ndarray:
    """Numbers of a column."""
    header, rows = read(path)
    return np.array([float(row[header.index(name)]) for row in rows])


def test_tables_hold_the_numbers_of_the_file(tmp_path):
    # Series that only some runs have; `test_readback` has every other column.
    with Results(write_run(tmp_path / "r.h5")) as results:
        paths = write_csv(results, tmp_path / "new" / "tables")
        names = ["histories", "peaks", "energy", "joints", "joint_extremes", "resultants"]
        names.append("envelopes")
        assert [path.name for path in paths] == [f"{name}.csv" for name in names]
        history = paths[0]
        velocity = results.series("histories", "velocity")
        found = column(history, "velocity of left, top y [m/s]")
        np.testing.assert_array_equal(found, velocity[:, 1, 1])
        reaction = results.series("histories", "reaction/base")
        np.testing.assert_array_equal(column(history, "reaction/base z [N]"), reaction[:, 2])
        # Every series of the stream has its columns: 2 points x 3 x 3, and the others.
        assert len(read(history)[0]) == 1 + 18 + 3 + 4 + 1 + 3


@pytest.mark.parametrize(
    ("text", "seen", "written"),
    [
        ("=1+1", "=1+1", "'=1+1"),
        ("-x", "-x", "'-x"),
        ("-1.5e3", "-1.5e3", "-1.5e3"),
        ("-", "-", "-"),
        ("a\x1b[2Jb\u202e=", "a [2Jb =", "a [2Jb ="),
    ],
)
def test_texts_of_files_are_no_formulas_and_no_escapes(tmp_path, capsys, text, seen, written):
    table = {"case": np.array([text], dtype=object), text: np.array([-1.5])}
    found = read(write_table(table, tmp_path / "t.csv"))
    assert found == (["case", written], [[written, "-1.5"]])
    assert f"name      {seen}\n" in repr(Motion(acceleration=np.ones((2, 3)), dt=0.1, name=text))
    assert str(RecordError(text)) == seen
    with ResultsWriter(tmp_path / "r.h5", {"title": text}) as writer:
        writer.start()
    assert cli.main(["info", "--all", str(tmp_path / "r.h5")]) == 0
    assert seen in capsys.readouterr().out


def test_tables_are_not_replaced_by_default(tmp_path, capsys):
    run, out = write_run(tmp_path / "r.h5"), tmp_path / "out"
    out.mkdir()
    (out / "joints.csv").write_text("mine")
    arguments = ["csv", str(run), "--out", str(out)]
    assert cli.main(arguments) == 2
    facts = capsys.readouterr()
    joints = out / "joints.csv"
    expected = f"dolfinx-joints: {joints}: file exists; --force (overwrite=True) replaces it.\n"
    assert facts.err.splitlines(keepends=True)[-1] == expected  # after a warning
    assert [path.name for path in out.iterdir()] == ["joints.csv"]
    assert joints.read_text() == "mine"
    assert cli.main([*arguments, "--force"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        str(out / f"{name}.csv")
        for name in (
            "histories",
            "peaks",
            "energy",
            "joints",
            "joint_extremes",
            "resultants",
            "envelopes",
        )
    ]
    assert read(joints)[0][0] == "joint"
    assert not list(out.glob("*.part"))


def test_tables_that_cannot_be_written_leave_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    taken = tmp_path / "out"
    (taken / "histories.csv").mkdir(parents=True)
    with Results(write_run(tmp_path / "r.h5")) as results:
        for out, words in ((tmp_path / "file" / "in", "file/in"), (taken, "out: .*directory")):
            with pytest.raises(ResultsError, match=f"The tables cannot be written to .*{words}"):
                write_csv(results, out, overwrite=True)
    assert [path.name for path in taken.iterdir()] == ["histories.csv"]


@pytest.mark.parametrize("water", [False, True])
def test_blocks_have_a_row_for_each_record(tmp_path, water):
    # Two blocks, three records; the totals are those without water plus those of the water.
    parts = {"force": "N", "moment": "N m"}
    if water:
        parts |= {"water_force": "N", "water_moment": "N m"}
    values = {name: RANDOM.standard_normal((3, 2, 3)) for name in parts}
    mass, centre = np.array([2.0, 3.0]), RANDOM.random((2, 3))
    with ResultsWriter(tmp_path / "r.h5", {}) as writer:
        writer.static("blocks/mass", mass, "kg", "mass")
        writer.static("blocks/centre", centre, "m", "centre of gravity")
        for name, unit in parts.items():
            writer.series("resultants", f"blocks/{name}", (2, 3), unit, name)
        writer.start()
        for row in range(3):
            record = {f"blocks/{name}": value[row] for name, value in values.items()}
            writer.append("resultants", 0.1 * row, record)
        writer.finish("complete", {})
    with Results(tmp_path / "r.h5") as results:
        (path,) = write_csv(results, tmp_path)
    assert path.name == "blocks.csv"
    assert column(path, "block").tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(column(path, "time [s]"), [0.0, 0.1, 0.2, 0.0, 0.1, 0.2])
    assert column(path, "mass [kg]").tolist() == [2, 2, 2, 3, 3, 3]
    for i, axis in enumerate("xyz"):
        np.testing.assert_array_equal(
            column(path, f"centre {axis} [m]"), np.repeat(centre[:, i], 3)
        )
        for what, label in (
            ("force", f"total force {axis} [N]"),
            ("moment", f"total moment about the centre {axis} [N m]"),
        ):
            total = values[what] + values.get(f"water_{what}", 0.0)
            np.testing.assert_array_equal(column(path, label), total[:, :, i].T.ravel())
        effective = column(path, f"effective force {axis} [N]")
        np.testing.assert_array_equal(effective, values["force"][:, :, i].T.ravel())


def test_resultants_that_were_not_recorded_are_reported(tmp_path):
    with Results(write_run(tmp_path / "r.h5")) as results:
        with pytest.raises(ResultsError, match="no resultants of blocks; record them with Results"):
            block_resultants(results)
        with pytest.raises(ResultsError, match="No joint 'joint_9' in .*it has joint_1, joint_2"):
            joint_resultants(results, "joint_9")


def test_a_file_without_records_has_no_tables(tmp_path):
    with ResultsWriter(tmp_path / "r.h5", {}) as writer:
        declare_histories(writer, [[0.0, 0.0, 1.0]])
    with (
        Results(tmp_path / "r.h5") as results,
        pytest.raises(ResultsError, match="has no records, so there are no tables to write"),
    ):
        write_csv(results, tmp_path)


def test_a_run_that_is_still_writing(tmp_path):
    with ResultsWriter(tmp_path / "r.h5", {"point_names": ["crest"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 1.0]])
        writer.start()
        append(writer, "histories", 0.0)
        writer.flush()
        append(writer, "histories", 0.1)
        with Results(tmp_path / "r.h5") as results:
            path, peaks = write_csv(results, tmp_path)
            assert results.status == "running"
        moved = "displacement of crest from the first record"
        assert read(peaks)[1][0][:4] == [moved, "0.0", "m", "0.0"]
        assert column(path, "time [s]").tolist() == [0.0]


def test_the_law_of_a_joint_may_be_unknown(tmp_path):
    # A file of an earlier version: forces are known, the safety is not.
    with ResultsWriter(tmp_path / "r.h5", {"point_names": ["crest"]}) as writer:
        joint = {"points": POINTS, "frames": np.stack([LEVEL, LEVEL]), "areas": AREAS}
        declare_states(writer, POINTS, [[0, 1]], {"joint_1": {**joint, "facet": [0, 0]}})
        writer.start()
        append(writer, "states", 0.0)
        writer.finish("complete", {})
    with Results(tmp_path / "r.h5") as results:
        joints, _, forces = write_csv(results, tmp_path)
        assert "joint_1" in overview(results.path)
        assert math.isnan(column(joints, "safety_min [-]")[0])
        assert np.isfinite(column(forces, "total force z [N]")).all()


def test_overview_fits_a_screen_and_says_nothing_twice(tmp_path, capsys):
    names = tuple(f"joint_{i}" for i in range(1, 13))
    path = write_run(tmp_path / "r.h5", names)
    assert cli.main(["info", str(path)]) == 0
    shown = capsys.readouterr().out.rstrip("\n")
    assert shown == overview(path)
    lines = shown.splitlines()
    assert len(lines) <= 40
    assert max(len(line) for line in lines[1:]) <= 100
    assert "complete" in lines[0]
    words = [word.strip(",:") for word in shown.split()]
    for name in (*names, f"steps={STEPS}", f"accepted={STEPS}", "joints/*/gap"):
        assert words.count(name) == 1, name
    assert f"stream states: {-(-STEPS // EVERY)} records, 0 to 0.6 s" in lines
    assert "FrictionNoTension, 45 degrees" in shown
    assert cli.main(["info", str(path), "--all"]) == 0
    assert "joints/joint_12/traction" in capsys.readouterr().out


def test_overview_tells_no_rounding_of_a_heel_at_the_origin(tmp_path):
    heel = [-8.0e-17, -2.0e-17, 0.0]  # as Gmsh places it
    facts = {"point_names": ["heel"], "points": {"heel": {"place": [0.0, 0.0], "sides": []}}}
    with ResultsWriter(tmp_path / "r.h5", facts) as writer:
        declare_histories(writer, [heel])
        writer.static("mesh/nodes", np.array([heel, [30.0, 0.0, 0.0]]), "m", "nodes")
        writer.start()
        writer.finish("complete", {})
    assert "points        heel at (0 0 0) m" in overview(tmp_path / "r.h5").splitlines()
