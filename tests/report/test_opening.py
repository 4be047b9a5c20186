# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of the first tables of a report, read back from its cells and compared with the file."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from declared import declare_states
from test_report import Page
from written_runs import JOINT, NODES, SURFACE, WEIGHT, write_envelopes, write_run, write_stages

from dolfinx_joints import report
from dolfinx_joints.postprocessing import measures, peaks
from dolfinx_joints.postprocessing.joints.resultants import JointGeometry
from dolfinx_joints.report import static_section
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")
pytest.importorskip("plotly")


def cells_of(paths: list[Path], folder: Path, **options: object) -> list[str]:
    """Texts of the cells of a report without pictures of the body, signs and spaces plain."""
    out = report.write(paths, folder / "out.html", with_3d=False, **options)
    cells = Page(out.read_text(encoding="utf-8")).cells
    return [cell.replace("\N{MINUS SIGN}", "-").replace("\u202f", " ") for cell in cells]


def after(cells: list[str], heading: str, name: str, count: int) -> list[str]:
    """The cells of the row of a name in the table with a heading."""
    row = cells.index(name, cells.index(heading)) + 1
    return cells[row : row + count]


def test_what_matters_is_what_the_file_holds(tmp_path):
    files = [write_run(tmp_path / f"{n}.h5", n) for n in ("linear", "joints")]
    cells = cells_of(files, tmp_path)
    for name in ("crest displacement from the first record [mm]", "energy error [%]"):
        assert name in cells
    with Results(files[1]) as results:
        point = "mid-crest"
        best = max(
            "xyz", key=lambda c: abs(measures.displacement_history(results, point, c)[1]).max()
        )
        time, u = measures.displacement_history(results, point, best)
        at = int(np.argmax(np.abs(u)))
        shown = after(cells, "linear", "crest displacement from the first record [mm]", 2)[1]
        value, where = shown.split(" ", 1)
        assert float(value) == pytest.approx(1e3 * u[at], rel=1e-3)  # mm
        assert where == f"{point} {best}, {time[at]:.4g} s"
        # 1.3 mm sin(2 pi 5.22 t), sampled in steps of 0.01 s.
        assert abs(float(value)) == pytest.approx(1.3, rel=5e-3)
        # Steps of 0.01 s: ten of them to a period at 10 Hz.
        band = "low-passed at 25 Hz, resolved to 10 Hz by the step"
        title = f"crest acceleration, absolute, {band} [m/s²]"
        largest = max(abs(measures.acceleration_history(results, point, c)[1]).max() for c in "xyz")
        shown = after(cells, "linear", title, 2)[1]
        assert abs(float(shown.split(" ")[0])) == pytest.approx(largest, rel=1e-3)
        assert float(shown.split(", ")[2].removesuffix(" g")) == pytest.approx(
            largest / 9.80665, rel=1e-3
        )


def test_joints_have_values_times_and_places(tmp_path):
    cells = cells_of([write_run(tmp_path / "joints.h5")], tmp_path)
    opening, slip, safety = after(cells, "smallest safety [-]", "joint_1", 3)
    # 3 mm at the end at the upper points; the first of them is named.
    assert opening == "3.000 1 s at (0.5, 0, 1.5) m"
    assert slip == "0"  # of what never moved there is no time
    assert safety == "–"  # the file knows no friction angle


def test_error_bars_are_next_to_the_values_of_their_run(tmp_path):
    """Errors of 1/8 of the values; the linear run has another displacement, and no bar."""
    files = [write_run(tmp_path / f"{n}.h5", n) for n in ("linear", "joints")]
    with Results(files[1]) as results:
        values = peaks.main_values(results)
    bars = {name: (value, 0.125 * value) for name, value in values.items()}
    cells = cells_of(files, tmp_path, bars=bars)
    title = "crest displacement from the first record [mm]"
    linear, joints = after(cells, "linear", title, 2)
    assert "±" not in linear
    assert joints.split(" ", 1)[1].startswith("± 0.1625, mid-crest ")  # of 1.3 mm
    opening, _slip, _safety = after(cells, "smallest safety [-]", "joint_1", 3)
    assert opening == "3.000 ± 0.375, 1 s at (0.5, 0, 1.5) m"
    *_, acceleration = (cell for cell in cells if "±" in cell and cell.endswith(" g"))
    assert float(acceleration.split(" ")[2].rstrip(",")) == pytest.approx(1.9425 / 8.0, rel=1e-3)
    bars["joint_1: opening [m]"] = (3e-3, np.inf)
    cells = cells_of(files, tmp_path, bars=bars)
    opening, *_ = after(cells, "smallest safety [-]", "joint_1", 1)
    assert opening == "3.000 grows with finer cells, 1 s at (0.5, 0, 1.5) m"


def test_error_bars_without_a_place_are_refused_or_named(tmp_path):
    file, name = write_run(tmp_path / "r.h5"), "joint_1: opening [m]"
    for bar in ((np.nan, 1e-4), (3e-3, np.nan), (3e-3, -1.0)):
        with pytest.raises(ValueError, match="must be pairs of a number and an error of 0 or"):
            cells_of([file], tmp_path, bars={name: bar})
    other_band = "crest acceleration below 12.5 Hz [m/s^2]"
    bars = {"openning [m]": (3e-3, 1e-4), other_band: (1.0, 0.1), name: (2e-3, 1e-4)}
    with pytest.warns(UserWarning, match=re.escape(f"these values: {', '.join(bars)}.")):
        cells_of([file], tmp_path, bars=bars)


@pytest.mark.parametrize("heights", [[10.0, 9.95, 4.0, 0.0], [10.0, 10.0 + 2e-15]])
def test_the_crest_is_the_highest_points(tmp_path, heights):
    points = [[0.0, 5.0, height] for height in heights]
    with ResultsWriter(tmp_path / "r.h5", {"point_names": list("abcd"[: len(points)])}) as writer:
        writer.static("histories/points", points, "m", "points")
        writer.static("mesh/nodes", [[0.0, 0.0, 0.0], *points], "m", "nodes")
        writer.start()
        writer.finish("complete", {})
    with Results(tmp_path / "r.h5") as results:
        assert peaks.crest_points(results) == ["a", "b"]


def test_largest_tension_has_its_place(tmp_path):
    stress = np.linspace(-1e6, 2e6, len(NODES))
    path = write_envelopes(tmp_path / "e.h5", {"principal_max": stress, "principal_min": -stress})
    with Results(path) as results:
        peak = peaks.stress_peak(results, "principal_max")
        assert peak.value == 2e6
        np.testing.assert_array_equal(peak.place, NODES[-1])
        assert peaks.stress_peak(results, "principal_min").value == -2e6
        assert np.isnan(peaks.stress_peak(results, "arch_max").value)
    cells = cells_of([path], tmp_path)
    x, y, z = NODES[-1]
    assert after(cells, "e", "largest tension since the first record [MPa]", 1) == [
        f"2.000 at ({x:g}, {y:g}, {z:g}) m"
    ]
    assert after(cells, "e", "largest compression since the first record [MPa]", 1)[0].startswith(
        "-2.000 at "
    )


def test_a_file_with_joints_and_no_records_is_reported(tmp_path):
    with ResultsWriter(tmp_path / "r.h5", {}) as writer:
        declare_states(writer, NODES, SURFACE, {"joint_1": JOINT})
        writer.start()
        writer.finish("complete", {})
    cells = cells_of([tmp_path / "r.h5"], tmp_path)
    assert "smallest safety [-]" not in cells


def test_curved_joints_are_named_below_their_forces(tmp_path, monkeypatch):
    curved = JointGeometry(centroid=np.zeros(3), normal=np.zeros(3), area=1.0, flatness=0.75)
    monkeypatch.setattr(static_section, "joint_geometry", lambda *_: curved)
    path = write_stages(
        tmp_path / "s.h5", {"static_stages": {WEIGHT: "Gravity; inactive: joint_1"}}
    )
    page = report.write([path], tmp_path / "out.html", with_3d=False)
    assert "joint was active are not openings" in page.read_text()
    assert (
        "joint_1 is curved (flatness 0.75): the mean normal does not represent it"
        in page.read_text()
    )


def test_blocks_that_are_absent_are_told_by_the_pictures(tmp_path):
    for lacks, absent in (("; absent: block_2", True), ("; inactive: joint_1", False), ("", None)):
        made = {"static_stages": {WEIGHT: f"Gravity{lacks}", "winter": "Gravity"}}
        path = write_stages(tmp_path / f"{absent}.h5", made)
        page = report.write([path], path.with_suffix(".html"), with_3d=False).read_text()
        assert ("Blocks that are absent in a stage are drawn undeformed." in page) == bool(absent)
        assert ("joint was active are not openings" in page) == (absent is not None)


def test_a_file_without_stages_shows_its_first_record(tmp_path):
    cells = cells_of([write_run(tmp_path / "joints.h5")], tmp_path)
    assert after(cells, "first record", "mid-crest", 3) == ["0", "0", "0"]
    # The lower two points are pressed by 1 micrometre at 1e11 Pa/m: 0.1 MPa on 2 m^2.
    head = cells[cells.index("joint", cells.index("first record")) + 1 :]
    found = after(
        cells[cells.index("joint", cells.index("first record")) :], "first record", "joint_1", 8
    )
    row = dict(zip(head, found, strict=False))
    assert row["largest pressure [MPa]"] == "0.1"
    assert row["area under pressure [%]"] == "50"
    assert row["normal force, pressure > 0 [MN]"] == "0.2"


def test_a_first_record_that_moves_is_not_a_static_state(tmp_path):
    path = write_run(tmp_path / "joints.h5")
    with h5py.File(path, "r+") as file:
        file["streams/energy/kinetic"][0] = 1.0  # [J]
    assert "first record" not in cells_of([path], tmp_path)


@pytest.mark.parametrize("left_out", [[], ["winter"]])
def test_static_stages_of_two_runs_stand_in_the_order_of_construction(tmp_path, left_out):
    built = ["weight", "grouting", "full reservoir", "winter"]
    monolith = [stage for stage in built if stage != "grouting"]
    jointed = [stage for stage in built if stage not in left_out]
    paths = []
    for name, stages in (("monolith", monolith), ("joints", jointed)):
        made = {"static_stages": {stage: f"loads of {stage}" for stage in stages}}
        paths.append(write_run(tmp_path / f"{name}.h5", facts={"manifest": made}))
    cells = cells_of(paths, tmp_path)
    assert [cell for cell in cells if cell in built] == built


def test_parameters_are_tables_in_their_units(tmp_path):
    made = {
        "material": {
            "concrete": "Elastic(young=24000000000.0, poisson=0.2, density=2400.0)",
            "rock": "Orthotropic(young=(20000000000.0, 20000000000.0, 1e10), density=2600.0)",
        },
        "joint_laws": {f"joint_{i}": "FrictionNoTension(normal_stiffness=2e10)" for i in (1, 2)},
        "loads": [
            "Gravity(acceleration=None)",
            "Water(level=12.5, factor=<function f.<locals>.<lambda>>)",
        ],
        "settings": {"time step": 0.01, "time scheme": "EnergyConsistent()", "solver": "auto"},
    }
    path = write_run(tmp_path / "run.h5", facts={"manifest": made}, seconds=0.05)
    cells = cells_of([path], tmp_path)
    assert after(cells, "concrete: Elastic", "Young's modulus [GPa]", 1) == ["24"]
    assert after(cells, "concrete: Elastic", "density [kg/m³]", 1) == ["2400"]
    assert after(cells, "rock: Orthotropic", "Young's modulus [GPa]", 1) == ["20, 20, 10"]
    law = "joint_1, joint_2: FrictionNoTension"
    assert after(cells, law, "normal stiffness k_n [GPa/m]", 1) == ["20"]
    assert after(cells, "Water", "level [m]", 1) == ["12.5"]
    assert after(cells, "Water", "factor", 1) == ["function f.locals.lambda"]
    assert after(cells, "Water", "time scheme", 1) == ["EnergyConsistent"]
    assert "Gravity" in cells
    assert not any("{" in cell for cell in cells)
