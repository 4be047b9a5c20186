# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two runs compared: differences planted in copies of a file are found where they are."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from declared import declare_histories
from written_runs import write_distinct, write_run, write_stages, write_tip

from dolfinx_joints import cli
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.comparison import Comparison, Difference, compare
from dolfinx_joints.results.quantities import TABLE
from dolfinx_joints.results.reader import STAGE_NAME_BYTES
from dolfinx_joints.results.writer import ResultsWriter

pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
MEASURES = ("summary/", "measures/", "peaks/", "stages/", "modes/")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a run of two joints and two points in which all numbers differ."""
    return write_distinct(tmp_path_factory.mktemp("runs") / "a.h5")


def changed(path: Path, folder: Path, change: Callable[[h5py.File], Any]) -> Path:
    """Copy a file and change the copy."""
    copy = Path(shutil.copy(path, folder / "b.h5"))
    with h5py.File(copy, "r+") as file:
        change(file)
    return copy


def added(name: str, index: Any, change: float) -> Callable[[h5py.File], Any]:
    """Return a function that adds a number to entries of a dataset of a stream."""

    def add(file: h5py.File) -> None:
        file["streams"][name][index] += change

    return add


def differing(comparison: Comparison, *, measures: bool = False) -> list[Difference]:
    """Return the rows of series, or of measures, whose difference is not zero."""
    return [row for row in comparison.rows if row.difference and is_measure(row) == measures]


def is_measure(row: Difference) -> bool:
    return row.quantity.startswith(MEASURES)


def row_of(comparison: Comparison, quantity: str, where: str = "") -> Difference:
    (row,) = (r for r in comparison.rows if r.quantity == quantity and r.where.startswith(where))
    return row


def largest(path: Path, *names: str) -> float:
    """Return the largest absolute value of datasets of streams."""
    with h5py.File(path) as file:
        return max(float(np.nanmax(np.abs(file["streams"][name][()]))) for name in names)


def test_a_run_equals_itself(run: Path) -> None:
    comparison = compare(run, run, tolerance=0.0)
    assert comparison.within
    assert (comparison.notes, comparison.only) == ([], [[], []])
    assert not any(row.difference or row.relative for row in comparison.rows)
    quantities = {row.quantity for row in comparison.rows}
    assert len(quantities) > 50
    assert str(comparison) == f"{len(quantities)} of {len(quantities)} quantities are equal."


GAPS = [f"states/joints/joint_{number}/gap" for number in (1, 2)]


@pytest.mark.parametrize(
    ("name", "index", "change", "quantity", "where", "kind"),
    [
        ("histories/displacement", (13, 0, 2), 1e-3, "histories/displacement", "crest[2]", ()),
        ("histories/acceleration", (60, 1, 0), -2.0, "histories/acceleration", "heel[0]", ()),
        ("histories/joint_open", 5, 0.01, "histories/joint_open", "", ()),
        ("energy/friction", 20, 5e4, "energy/friction", "", ["energy"]),
        ("states/displacement", (2, 5, 1), 1e-4, "states/displacement", "[5, 1]", ()),
        (GAPS[1], (3, 1, 0), -1e-4, "states/joints/*/gap", "joint_2[1, 0]", GAPS),
        ("envelopes/principal_max", (0, 7), 1e5, "envelopes/principal_max", "[7]", ()),
    ],
)
def test_one_changed_number_is_found(
    run: Path,
    tmp_path: Path,
    name: str,
    index: Any,
    change: float,
    quantity: str,
    where: str,
    kind: Any,
) -> None:
    """Find the planted change; the scale is the largest of its kind, for an energy of all."""
    other = changed(run, tmp_path, added(name, index, change))
    (row,) = differing(compare(run, other))
    record = index[0] if isinstance(index, tuple) else index
    with h5py.File(run) as one, h5py.File(other) as two:
        time = one["streams"][name.partition("/")[0]]["time"][record]
        assert (row.a, row.b) == (one["streams"][name][index], two["streams"][name][index])
        if kind == ["energy"]:
            kind = [f"energy/{term}" for term in one["streams/energy"] if term != "time"]
    assert (row.quantity, row.where) == (quantity, f"{where}, t = {time:.6g} s".removeprefix(", "))
    assert row.difference == pytest.approx(abs(change), rel=1e-9)
    scale = max(largest(path, *(kind or [name])) for path in (run, other))
    assert row.scale == scale
    assert row.relative == row.difference / scale
    assert row.within is (row.relative <= 1e-3)


def test_measures_of_each_joint_are_side_by_side(run: Path, tmp_path: Path) -> None:
    """Opening of 8 mm at one point of joint_2, more than any other in the file."""

    def open_joint(file: h5py.File) -> None:
        file["streams"][GAPS[1]][3, 2, 0] = 8e-3

    comparison = compare(run, changed(run, tmp_path, open_joint))
    one, two = (row_of(comparison, "measures/opening_max", f"joint_{i}") for i in (1, 2))
    assert (one.difference, one.scale, one.unit, one.within) == (0.0, 8e-3, "m", True)
    with h5py.File(run) as file:
        before = file["streams"][GAPS[1]][:, :, 0].max()
    assert (two.a, two.b, two.difference) == (before, 8e-3, 8e-3 - before)
    assert two.within is False
    assert row_of(comparison, "measures/opening_time", "joint_2").within is None


def test_a_quantity_that_is_zero_in_one_run_is_relative_to_all_joints(
    run: Path, tmp_path: Path
) -> None:
    def close(file: h5py.File) -> None:
        file["streams"][GAPS[0]][...] = 0.0

    shut = changed(run, tmp_path, close)
    row = row_of(compare(run, shut), "states/joints/*/gap", "joint_1")
    assert row.relative == largest(run, GAPS[0]) / largest(run, *GAPS)
    both = compare(shut, shut)
    assert row_of(both, "states/joints/*/gap", "joint_1").relative == 0.0
    # Rounding: displacements of 1e-15 m count relative to 1e-9 of the largest gap, also in metres.
    for path, size in ((shut, 1e-15), (run, -1e-15)):
        noise = Path(shutil.copy(path, tmp_path / f"{size}.h5"))
        with h5py.File(noise, "r+") as file:
            file["streams/states/displacement"][...] = size
    row = row_of(compare(tmp_path / "1e-15.h5", tmp_path / "-1e-15.h5"), "states/displacement")
    assert (row.difference, row.scale) == (2e-15, 1e-9 * largest(run, *GAPS))


def test_nan_equals_nan_alone(run: Path, tmp_path: Path) -> None:
    def lose(file: h5py.File) -> None:
        file["streams/histories/displacement"][4, 1, 1] = np.nan

    lost = changed(run, tmp_path, lose)
    (row,) = (r for r in differing(compare(run, lost)) if r.unit == "m")
    assert (row.where[:7], row.relative, row.within) == ("heel[1]", np.inf, False)
    assert differing(compare(lost, lost)) == []
    still = write_run(tmp_path / "still.h5")  # joint_slip is zero in all steps
    (row,) = differing(
        compare(still, changed(still, tmp_path, added("histories/joint_slip", 2, np.nan)))
    )
    assert (row.scale, row.relative, row.within) == (0.0, np.inf, False)


def test_codes_are_listed_and_not_judged(run: Path, tmp_path: Path) -> None:
    other = changed(run, tmp_path, added("histories/iterations", 3, 1))
    comparison = compare(run, other, tolerance=0.0)
    (row,) = differing(comparison)
    assert (row.quantity, row.difference, row.within) == ("histories/iterations", 1.0, None)
    assert comparison.within


def test_names_in_one_run_only(tmp_path: Path) -> None:
    """Runs with the names of one only are not equal, even if all that both have is."""
    linear, joints = (write_run(tmp_path / f"{n}.h5", n) for n in ("linear", "joints"))
    comparison = compare(linear, joints, tolerance=1e9)
    assert comparison.only[0] == []
    assert comparison.only[1][0] == "joint joint_1"
    assert "states: joints/joint_1/gap" in comparison.only[1]
    assert not comparison.within
    assert "Only in b: joint joint_1, energy: joints/joint_1/" in str(comparison)
    tip, top = (write_tip(tmp_path / f"{n}.h5", 3, point_names=[n]) for n in ("tip", "top"))
    assert compare(tip, top).only == [["point tip"], ["point top"]]


def test_streams_in_one_run_only(tmp_path: Path) -> None:
    stages, run = write_stages(tmp_path / "stages.h5"), write_run(tmp_path / "run.h5")
    assert [n for n in compare(run, stages).only[0] if "stream" in n or ":" in n] == [
        "stream energy",
        "stream histories",
        "stream states",
    ]
    with ResultsWriter(tmp_path / "begun.h5", {"point_names": ["mid-crest"]}) as writer:
        declare_histories(writer, [[1.0, 0.0, 2.0]])
        writer.start()
        writer.finish("failed", {})
    comparison = compare(run, tmp_path / "begun.h5")
    assert "histories: not compared, because b has no records." in comparison.notes


def test_points_that_slid_in_one_run_are_listed_and_not_judged(run: Path, tmp_path: Path) -> None:
    files = [Path(shutil.copy(run, tmp_path / name)) for name in ("one.h5", "two.h5")]
    for slid, path in enumerate(files):
        with h5py.File(path, "r+") as file:
            stream = file["streams"].create_group("joint_maxima")
            stream["time"], flags = [1.0], np.array([[0, 0, 1, slid]], dtype=np.int8)
            stream["joint_1/slid"] = flags
    comparison = compare(*files)
    row = row_of(comparison, "joint_maxima/*/slid")
    assert (row.difference, row.within) == (1.0, None)
    assert TABLE["joint_maxima"][-1].dtype == np.int8  # in files of runs


def test_points_are_compared_by_name(run: Path, tmp_path: Path) -> None:
    """Points in another order are equal."""

    def turn(file: h5py.File) -> None:
        for name in ("displacement", "acceleration"):
            values = file["streams/histories"][name]
            values[...] = values[()][:, ::-1]
        text = bytes(file["metadata"][()]).replace(b'"crest", "heel"', b'"heel", "crest"')
        file["metadata"][...] = np.frombuffer(text, dtype=np.uint8)

    comparison = compare(run, changed(run, tmp_path, turn), tolerance=0.0)
    assert comparison.within
    assert not differing(comparison)


def parabola(path: Path, steps: int, dt: float) -> Path:
    """Write a run whose point moves by t^2, with its displacement as acceleration."""
    with ResultsWriter(path, {"point_names": ["tip"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 0.0]], accelerations=True)
        writer.series("resultants", "blocks/mass", (), "kg", "mass")
        writer.start()
        for t in dt * np.arange(steps + 1):
            names = ("joint_open", "joint_stick", "joint_slip", "joint_frictionless", "iterations")
            moved = {name: np.full((1, 3), t**2) for name in ("displacement", "acceleration")}
            others = {"ground_acceleration": np.zeros(3)} | dict.fromkeys(names, 0)
            writer.append("histories", t, moved | others)
            writer.append("resultants", t, {"blocks/mass": t**2})
        writer.finish("complete", {})
    return path


def test_runs_with_other_steps(tmp_path: Path) -> None:
    """Steps of 20 ms are a part of those of 10 ms; 15 ms are not, so that t^2 is interpolated.

    In the middle of a step of h a straight line is off t^2 by h^2 / 4.
    """
    paths = {dt: parabola(tmp_path / f"{dt}.h5", round(0.3 / dt), dt) for dt in (0.01, 0.015, 0.02)}
    for pair in ((0.01, 0.02), (0.02, 0.01)):
        comparison = compare(*(paths[dt] for dt in pair), tolerance=1e-12)
        assert all(r.within is not False for r in comparison.rows if not is_measure(r))
        counts = " and ".join(str(round(0.3 / dt) + 1) for dt in pair)
        assert comparison.notes[0] == f"histories: compared at 16 common times of {counts}."
        assert row_of(comparison, "histories/acceleration").within is None
    comparison = compare(paths[0.01], paths[0.015])
    assert comparison.notes == [
        "histories: interpolated in time at 21 of 31 and 21 times.",
        "resultants: compared at 11 common times of 31 and 21.",
    ]
    row = row_of(comparison, "histories/displacement")
    assert row.difference == pytest.approx(0.01**2 / 4, rel=1e-9)
    assert row_of(comparison, "resultants/blocks/mass").difference == pytest.approx(0.0, abs=1e-15)


def test_fields_of_other_meshes_are_not_compared(run: Path, tmp_path: Path) -> None:
    def move(file: h5py.File) -> None:
        file["static/mesh/nodes"][3] += 1e-3
        file["streams/states/displacement"][...] *= 2.0
        file["streams/histories/displacement"][...] *= 2.0

    comparison = compare(run, changed(run, tmp_path, move))
    (note,) = comparison.notes
    assert note.startswith("Not compared, as the meshes differ: envelopes/arch_max, ")
    assert {row.quantity.split("/")[0] for row in comparison.rows} & {
        "states",
        "envelopes",
    } == set()
    assert row_of(comparison, "histories/displacement").relative == 0.5
    assert row_of(comparison, "histories/acceleration").within is None


def test_static_stages_are_compared_by_name(tmp_path: Path) -> None:
    path = write_stages(tmp_path / "a.h5")

    def rename(file: h5py.File) -> None:
        name = np.frombuffer(b"summer".ljust(STAGE_NAME_BYTES, b"\0"), dtype=np.uint8)
        file["streams/statics/name"][0] = name
        file["streams/statics/reaction/base"][1, 2] = 12e6

    comparison = compare(path, changed(path, tmp_path, rename))
    assert comparison.only == [["static stage Gewicht, größte Höhe"], ["static stage summer"]]
    (row,) = differing(comparison)
    assert row[:5] == ("statics/reaction/*", "N", "base[2], winter", 9e6, 12e6)
    assert row.relative == 0.25
    # 2 MPa on two points of 1 m^2 remain in winter.
    row = row_of(comparison, "stages/normal_force")
    assert row[1:4] == ("N", "winter, joint_1", 4e6)


def test_stages_of_one_name_are_compared_in_their_order(tmp_path: Path) -> None:
    def twice(file: h5py.File) -> None:
        file["streams/statics/name"][0] = file["streams/statics/name"][1]

    path = changed(write_stages(tmp_path / "a.h5"), tmp_path, twice).rename(tmp_path / "twice.h5")
    other = changed(path, tmp_path, added("statics/reaction/base", (0, 0), 3e6))
    (row,) = differing(compare(path, other))
    assert row[2:5] == ("base[0], winter", 0.0, 3e6)


def test_modes(tmp_path: Path) -> None:
    """Compare frequencies of 2 and 4 Hz with those of 2.2 and 4 Hz."""
    paths = [tmp_path / "a.h5", tmp_path / "b.h5"]
    for path, lowest in zip(paths, (2.0, 2.2), strict=True):
        with ResultsWriter(path, {}) as writer:
            writer.static("modes/frequency", [lowest, 4.0], "Hz", "frequencies")
            for name in ("participation", "effective_mass", "effective_share"):
                writer.static(f"modes/{name}", np.ones((2, 3)), "kg", name)
            writer.start()
            writer.finish("complete", {})
    comparison = compare(*paths)
    (row,) = differing(comparison, measures=True)
    assert row[:5] == ("modes/frequency", "Hz", "1", 2.0, 2.2)
    assert (row.scale, row.within, comparison.within) == (4.0, False, False)


def test_files_without_common_values_are_not_equal(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with ResultsWriter(path, {}) as writer:
        writer.start()
        writer.finish("complete", {})
    assert not compare(path, path).within


def test_an_unfinished_run_is_compared_up_to_its_end(run: Path, tmp_path: Path) -> None:
    def kill(file: h5py.File) -> None:
        file["status"][0] = b"running"
        for stream, last in (("histories", 30), ("energy", 30), ("states", 3)):
            file["streams"][stream]["time"][last:] = np.nan

    other = changed(run, tmp_path, kill)
    comparison = compare(run, other)
    assert comparison.notes[0] == f"b is running: {other}"
    assert "histories: compared at 30 common times of 61 and 30." in comparison.notes
    assert "states: compared at 3 common times of 5 and 3." in comparison.notes
    assert comparison.within
    assert not differing(comparison)

    def fail(file: h5py.File) -> None:
        file["status"][0] = b"failed"

    assert not compare(run, changed(run, tmp_path, fail)).within
    judged = {row.within for row in comparison.rows if is_measure(row)}
    assert judged == {None}
    assert differing(comparison, measures=True)


def test_motions_of_other_references_are_named(tmp_path: Path) -> None:
    paths = [write_run(tmp_path / f"{waves}.h5", waves=waves) for waves in (False, True)]
    (note,) = compare(*paths).notes
    assert note == "Motions are relative to the ground in one run, absolute in the other."


def test_files_that_are_no_results(run: Path, tmp_path: Path, capsys: Any) -> None:
    bad = tmp_path / "text.h5"
    bad.write_text("no results")
    with pytest.raises(ResultsError, match=r"text\.h5 is not an HDF5 file"):
        compare(run, bad)
    with pytest.raises(ValueError, match="tolerance is -1"):
        compare(run, run, tolerance=-1.0)
    assert cli.main(["compare", str(bad), str(run)]) == 2
    assert cli.main(["compare", str(run), str(tmp_path / "none.h5")]) == 2
    assert capsys.readouterr().out == ""


def test_command(run: Path, tmp_path: Path, capsys: Any) -> None:
    """Read the table back: names, numbers and places of the rows that differ."""
    other = changed(run, tmp_path, added("energy/friction", 20, 5e4))
    assert cli.main(["compare", str(run), str(run), "--tolerance", "0"]) == 0
    capsys.readouterr()
    assert cli.main(["compare", str(run), str(other), "--tolerance", "1e-6"]) == 1
    count, head, line = capsys.readouterr().out.splitlines()
    (row,) = differing(compare(run, other))
    total = len({r.quantity for r in compare(run, other).rows})
    assert count == f"{total - 1} of {total} quantities are equal."
    assert head.split()[::3] == ["quantity", "difference", "where"]
    name, unit, a, b, difference, relative, within, *where = line.split()
    assert (name, unit, within) == ("energy/friction", "[J]", "NO")
    assert " ".join(where) == row.where
    printed = [float(text) for text in (a, b, difference, relative)]
    np.testing.assert_allclose(printed, [row.a, row.b, 5e4, row.relative], rtol=0.05)
    assert cli.main(["compare", str(run), str(other), "--tolerance", "0.1"]) == 0
    assert "    yes  t = " in capsys.readouterr().out


def test_twice_the_density_is_twice_the_force(new_path: Any, mesh_file: Any, read: Any) -> None:
    """Check forces against the density: by linearity, those of run a are half of run b."""
    import dolfinx_joints as dj
    from dolfinx_joints.geometry.two_blocks import two_blocks

    paths = [new_path("once.h5"), new_path("twice.h5")]
    mesh = read(mesh_file(two_blocks, size=0.5))
    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
    for path, density in zip(paths, (2400.0, 4800.0), strict=True):
        solid = dj.Elastic(young=24e9, poisson=0.2, density=density)
        base, weight = [dj.Fixed(group="base")], [dj.Gravity()]
        model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=weight)
        monitor = dj.ResultsMonitor(path, points={"top": (0.5, 0.5, 2.0)})
        dj.Simulation(model, monitors=[monitor]).statics(name="weight")
    comparison = dj.compare(*paths)
    assert (comparison.notes, comparison.only) == ([], [[], []])
    for quantity in ("stages/normal_force", "statics/reaction/*", "statics/joints/*/traction"):
        assert row_of(comparison, quantity).relative == pytest.approx(0.5, rel=1e-9)
    force = row_of(comparison, "stages/normal_force")
    assert force.b == pytest.approx(4800.0 * 9.80665, rel=1e-9)  # weight of the upper cubic metre
    # The shear is rounding error: 1e-9 of the normal force and less.
    assert row_of(comparison, "stages/shear_force").within
