# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and curves of a report against measures and file, in the unit that stands beside them.

Rows are found by their names and columns by words, so that tables may move and grow.
"""

import base64
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from declared import declare_energy, write_states
from reading_back import Tables, captions, curves, lines, low_passed
from reading_back import number as number_of
from written_runs import (
    JOINT,
    NODES,
    SURFACE,
    WEIGHT,
    write_distinct,
    write_run,
    write_stages,
)

from dolfinx_joints import report
from dolfinx_joints.common.errors import PlausibilityWarning
from dolfinx_joints.motions.spectra import equally_spaced, fourier_amplitude, response_spectrum
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants
from dolfinx_joints.report import (
    body_sections,
    joint_sections,
    response_sections,
    static_section,
)
from dolfinx_joints.report.page import Drawings, Html
from dolfinx_joints.report.runs import Content, Run
from dolfinx_joints.results.layout import Cells
from dolfinx_joints.results.quantities import ENERGY_TERMS
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")
pytest.importorskip("plotly")

POINTS = ("crest", "heel")


@pytest.fixture(scope="module", autouse=True)
def no_pictures() -> Iterator[None]:
    """Leave out what takes the longest and is not read here."""

    def save(drawings: Drawings, name: str, drawn: Any, dpi: int = 130) -> Path:
        drawings.folder.mkdir(parents=True, exist_ok=True)
        path = drawings.folder / f"{name}.png"
        path.touch()
        return path

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Drawings, "save", save)
        yield


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, Results]]]:
    """A report on two runs, and the runs by the names that it gives them."""
    folder = tmp_path_factory.mktemp("distinct")
    paths = [write_distinct(folder / f"{name}.h5", i) for i, name in enumerate(("a", "b"), 1)]
    html = report.write(paths, folder / "out.html", with_3d=False).read_text(encoding="utf-8")
    with Results(paths[0]) as one, Results(paths[1]) as other:
        yield html, {"a": one, "b": other}


def shown(found: float, expected: float) -> None:
    """Equal to the four digits of a cell."""
    np.testing.assert_allclose(found, expected, rtol=6e-4)


def test_cells_of_motions_are_measures(two: tuple[str, dict[str, Results]]) -> None:
    html, runs = two
    tables = Tables(html)
    for point in POINTS:
        for label, run in runs.items():
            until = measures.strong_phase_end(run)
            peaks = measures.peaks(run, point, strong_until=until)
            for c in "xyz":
                row = f"{point}, {c}, {label}"
                shown(tables.value(row, "strong phase"), until)
                shown(tables.value(row, "largest", "before"), peaks[c]["strong"])
                shown(tables.value(row, "largest", "after"), peaks[c]["later"])
                found = measures.fourier_peaks(run, point, c)  # type: ignore[arg-type]
                shown(tables.value(row, "Fourier", "[Hz]"), found.frequency)
                shown(tables.value(row, "±"), found.bin_width / 2)
                shown(tables.value(row, "Fourier", "[mm s]"), found.amplitude)
                _, a = measures.acceleration_history(run, point, c)  # type: ignore[arg-type]
                shown(tables.value(f"{point}, {label}", f"{c} ["), np.abs(a).max())
        for name, words in (("principal_max", "tension"), ("principal_min", "compression")):
            for label, run in runs.items():
                stress = measures.stress_extremes(run)[name]
                shown(
                    tables.value(f"largest {words} since the first record [MPa]", label),
                    stress,
                )


def test_the_motion_of_the_ground_is_that_of_the_file(
    two: tuple[str, dict[str, Results]],
) -> None:
    html, runs = two
    (table,) = Tables(html).having("duration [s]").tables
    drawn = curves(html, "ground-motion")
    for row, (label, run) in zip(table[1:], runs.items(), strict=True):
        time = run.time("histories")
        ground = run.series("histories", "ground_acceleration")
        shown(number_of(row[1]), time[-1] - time[0])
        for axis in range(3):
            shown(number_of(row[3 + axis]), np.abs(ground[:, axis]).max() / 9.80665)
            np.testing.assert_allclose(drawn[label, axis][1], ground[:, axis], rtol=1e-6)


def test_rounding_errors_are_zero_in_static_tables() -> None:
    # Shear of 1e-12 of the normal force is rounding, so its safety is undefined: a dash.
    forces = {"normal_force": 4e6, "shear_force": 4e-6, "water_force": -1e6}
    safeties = {"plane_safety": np.inf, "sliding_safety": 98.0}
    others = {"contact": 1.0, "opening_max": 1e-12, "slip_max": 2e-3, "pressure_max": 1e6}
    cells = static_section._joint_cells(measures.StageJoint(**forces, **safeties, **others))
    assert cells == [0.0, 2.0, 4.0, 0.0, None, 98.0, 100.0, 1.0, -1.0]
    assert static_section._shown(-3e-10, 1.0) == 0.0
    assert static_section._shown(-3e-8, 1.0) == -3e-8


def test_pictures_show_the_data_of_the_plots(
    two: tuple[str, dict[str, Results]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each plot of the page has a picture with the curves, axes and names of the plot."""
    html, runs = two
    drawn = {}
    monkeypatch.setattr(
        Drawings, "save", lambda _, name, figure, dpi=0: drawn.update({name: figure})
    )
    monkeypatch.setattr(Drawings, "picture", lambda *_: Html(""))
    content = Content(
        [Run(r, n) for n, r in runs.items()], Drawings(Path(), printed=True), *[None] * 2
    )  # type: ignore[arg-type]
    for make in (response_sections.displacements, response_sections.response_spectra):
        make(content)
    assert set(drawn) == {f"{k}-{n}" for k in ("history", "fourier", "response") for n in (1, 2)}
    for name, figure in drawn.items():
        expected = curves(html, name)
        (legend,) = figure.legends
        names = [text.get_text() for text in legend.get_texts()]
        assert names == list(dict.fromkeys(name for name, _ in expected))
        found = [line for ax in figure.axes for line in lines(ax, figure.axes[-1])]
        assert len(found) == len(expected)
        for line, curve in zip(found, expected.values(), strict=True):
            np.testing.assert_array_equal(line, curve)
    assert sum(text.startswith("Displacement of ") for text in captions(html)) == len(POINTS)


@pytest.mark.parametrize("law", [{"kind": "KeyedJoint"}, {"friction_angle_deg": 0.0}])
def test_mobilised_friction_is_drawn_of_joints_with_friction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, law: dict[str, Any]
) -> None:
    path, drawn = write_distinct(tmp_path / "run.h5", joint_2=law), {}

    def save(_: Drawings, name: str, figure: Any, dpi: int = 0) -> None:
        drawn[name] = [ax.get_title(loc="left") for ax in figure.axes[:-1]]

    monkeypatch.setattr(Drawings, "save", save)
    monkeypatch.setattr(Drawings, "picture", lambda *_: Html(""))
    with Results(path) as run:
        drawings = Drawings(Path(), printed=True)
        joint_sections.joints(Content([Run(run, "a")], drawings, None, None))  # type: ignore[arg-type]
    assert drawn["joints_tangential"] == ["joint_1", "joint_2"]
    assert drawn["joints_mobilised"] == ["joint_1"]


def test_cells_of_joints_are_measures(tmp_path: Path) -> None:
    path = write_distinct(tmp_path / "run.h5", 3)
    html = report.write([path], tmp_path / "out.html", with_3d=False).read_text(encoding="utf-8")
    tables = Tables(html)
    opening, motion, static = (
        tables.having(words) for words in ("smallest safety", "residual slip", "normal force")
    )
    with Results(path) as run:
        for joint, found in measures.joint_measures(run).items():
            for words, name in {
                "opening in the first record": "opening_static",
                "largest opening [": "opening_max",
                "residual opening": "opening_residual",
                "largest opening at": "opening_time",
                "largest slip [": "slip_max",
                "residual slip": "slip_residual",
                "largest slip at": "slip_time",
                "open [": "share_open",
                "sliding [": "share_sliding",
                "largest pressure [": "pressure_max",
                "largest mean pressure [": "mean_pressure_max",
                "cohesion lost": "share_broken",
            }.items():
                shown(motion.value(joint, words), found[name])
            safety = measures.joint_extremes(run, joint).safety
            shown(opening.value(joint, "largest opening"), found["opening_max"])
            shown(opening.value(joint, "largest slip"), found["slip_max"])
            shown(opening.value(joint, "smallest safety"), np.nanmin(safety))
            gap, t = (run.series("states", f"joints/{joint}/{n}", 0) for n in ("gap", "traction"))
            forces = joint_resultants(run, joint)
            shown(static.value(joint, "opening"), max(gap[:, 0].max(), 0.0))
            shown(static.value(joint, "tangential gap"), np.linalg.norm(gap[:, 1:], axis=1).max())
            shown(static.value(joint, "largest pressure"), -t[:, 0].min())
            shown(static.value(joint, "normal force"), forces.normal_force[0])
            shown(static.value(joint, "shear force"), forces.shear_force[0])


def test_stresses_and_the_view_in_space(
    two: tuple[str, dict[str, Results]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cells, and what the page's script draws; no pictures, which have tests of their own."""
    monkeypatch.setattr(body_sections, "_envelope", lambda *_: Html(""))
    runs = [Run(results, label) for label, results in two[1].items()]
    content = Content(runs, Drawings(tmp_path), main=runs[0], reference=None)
    tables = Tables("".join(body_sections.stresses(content).pieces))
    for run in runs:
        for name, value in measures.stress_extremes(run.results).items():
            shown(tables.value(name.replace("_", ", "), run.label), value)
    body_sections.space(content)
    for scene, run in zip(content.drawings.scene, runs, strict=True):
        assert scene["label"] == run.label
        assert [frame["time"] for frame in scene["frames"]] == run.results.time("states").tolist()
        u = run.results.series("states", "displacement")
        for frame, moved in zip(scene["frames"], u, strict=True):
            drawn = np.frombuffer(base64.b64decode(frame["displacement"]["f4"]), dtype="<f4")
            np.testing.assert_allclose(drawn.reshape(-1, 3), moved, rtol=1e-6)
        gaps = (run.results.series("states", f"joints/{j}/gap") for j in run.results.joints)
        widest = np.maximum([gap[..., 0].max(axis=1) for gap in gaps], 0.0)  # a facet each
        for frame, expected in zip(scene["frames"], widest.T, strict=True):
            drawn = np.frombuffer(base64.b64decode(frame["opening"]["f4"]), dtype="<f4")
            np.testing.assert_allclose(drawn, 1e3 * expected, rtol=1e-6)  # mm
        assert scene["widest"] == pytest.approx(1e3 * widest.max())
        # The largest displacement and its record, read in blocks of one record and all at once.
        sizes = np.linalg.norm(u, axis=2).max(axis=1)
        for block in (1, 2**21):
            monkeypatch.setattr(body_sections, "_BLOCK", block)
            again = body_sections.scene(run)
            assert again["start"] == np.argmax(sizes)
            assert again["largest"] == pytest.approx(1e3 * sizes.max())


def test_the_view_in_space_shows_the_groups_with_joints(tmp_path: Path) -> None:
    """The 3-D view shows two cubes and the sides of their joint, but not the cube of rock."""
    rock = NODES[8:] + np.array([0.0, 3.0, 0.0])
    nodes, surface = np.concatenate([NODES, rock]), [*SURFACE, *(SURFACE[SURFACE.min(1) > 7] + 8)]
    cubes = [8 * n + np.array([0, 1, 3, 2, 4, 5, 7, 6]) for n in range(3)]
    cells, path = Cells(12, cubes, {"dam": [0, 1], "rock": [2]}), tmp_path / "r.h5"
    write_states(path, nodes, surface, {"joint_1": JOINT}, (0.0, {}), cells=cells)
    with Results(path) as results:
        scene = body_sections.scene(Run(results, "r"))
    drawn, facets, triangles = (
        np.frombuffer(base64.b64decode(data[kind]), dtype=f"<{kind}")
        for data, kind in (
            (scene["nodes"], "f4"),
            (scene["facets"], "i4"),
            (scene["joints"]["i"], "i4"),
        )
    )
    np.testing.assert_array_equal(drawn.reshape(-1, 3), NODES)
    np.testing.assert_array_equal(facets.reshape(-1, 4), SURFACE)
    assert len(triangles) == 4  # two of each side


def test_cells_of_static_stages_are_measures(tmp_path: Path) -> None:
    path = write_stages(tmp_path / "s.h5")
    html = report.write([path], tmp_path / "out.html", with_3d=False).read_text(encoding="utf-8")
    with Results(path) as run:
        stages = measures.static_stages(run)
    assert [stage.name for stage in stages] == [WEIGHT, "winter"]
    assert [f"after {stage.name}" in html for stage in stages] == [True, True]  # pictures
    assert "Energies of the static stages" not in html  # there are none in earlier versions' files
    for stage in stages:
        tables = Tables(html).under(stage.name)
        for point, moved in stage.displacement.items():
            for c, u in zip("xyz", moved, strict=True):
                shown(tables.value(point, f"{c} [mm]"), u)
        for support, force in stage.reaction.items():
            for c, value in zip("xyz", force, strict=True):
                shown(tables.value(support, f"{c} [MN]"), value)
        for name, joint in stage.joints.items():
            shown(tables.value(name, "opening"), joint.opening_max)
            shown(tables.value(name, "tangential gap"), joint.slip_max)
            shown(tables.value(name, "normal force"), joint.normal_force)
            shown(tables.value(name, "shear force"), joint.shear_force)
            shown(tables.value(name, "N tan φ / V"), joint.plane_safety)
            shown(tables.value(name, "magnitudes"), joint.sliding_safety)
            shown(tables.value(name, "under pressure"), joint.contact)
            shown(tables.value(name, "largest pressure"), joint.pressure_max)
            shown(tables.value(name, "water"), joint.water_force)


def test_what_is_resolved_is_told(tmp_path: Path) -> None:
    # Steps of 0.01 s, ten to a period: 10 Hz; what the file says of mesh and joints.
    limits = {"step": 20.0, "mesh": 12.0, "joints": 500.0}
    path = write_run(tmp_path / "run.h5", facts={"manifest": {"resolved_hz": limits}})
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)  # the page tells of them instead
        out = report.write([path], tmp_path / "out.html", with_3d=False)
    html = out.read_text(encoding="utf-8")
    tables = Tables(html)
    shown(tables.value("time step, 10 steps per period", "run"), 10.0)
    shown(tables.value("mesh, 10 nodes per shear wavelength", "run"), 12.0)
    shown(tables.value("closed joints, which transmit half of the wave energy", "run"), 500.0)
    band = "low-passed at 25 Hz, resolved to 10 Hz by the step"
    assert f"crest acceleration, absolute, {band} [m/s²]" in html
    (ends,) = set(re.findall(r'"x0":([\d.]+),"x1":([\d.]+),', html))  # of the shade, [s]
    np.testing.assert_allclose([float(end) for end in ends], [0.03, 0.1])
    (doubt,) = re.findall("<li>(run: accelerations.*?)</li>", html)
    assert "up to 25 Hz, but" in doubt
    assert "the step up to 10 Hz and the mesh up to 12 Hz; use" in doubt


def test_curves_are_those_of_the_file(two: tuple[str, dict[str, Results]]) -> None:
    html, runs = two

    def same(found: Any, x: np.ndarray, y: np.ndarray) -> None:
        np.testing.assert_allclose(found[0], x, rtol=1e-6)
        np.testing.assert_allclose(found[1], y, rtol=1e-5, atol=1e-6 * np.nanmax(np.abs(y)))

    periods = np.geomspace(0.03, 3.0, 80)
    longest = max(np.diff(run.time("histories")).max() for run in runs.values())
    named = f"low-passed at 25 Hz, resolved to {0.1 / longest:.3g} Hz by the step"
    assert f"Largest absolute accelerations, {named}" in html
    shown_captions = captions(html)
    counts = (
        sum(text.startswith("Pseudo-acceleration of") for text in shown_captions),
        sum(
            f"Accelerations are {named}; unresolved periods are" in text for text in shown_captions
        ),
    )
    assert counts == (len(POINTS), len(POINTS))
    for number, point in enumerate(POINTS, 1):
        for (label, panel), found in curves(html, f"history-{number}").items():
            same(found, *measures.displacement_history(runs[label], point, "xyz"[panel]))  # type: ignore[arg-type]
        for (label, panel), found in curves(html, f"fourier-{number}").items():
            moved = measures.displacement_history(runs[label], point, "xyz"[panel])  # type: ignore[arg-type]
            dt, u = equally_spaced(*moved)
            frequency, amplitude = fourier_amplitude(u, dt)
            below = frequency <= 15.0
            same(found, frequency[below], amplitude[below])
        for (label, panel), found in curves(html, f"response-{number}").items():
            if label in runs:
                moved = measures.acceleration_history(runs[label], point, "xyz"[panel])  # type: ignore[arg-type]
            else:
                ground = runs["a"].series("histories", "ground_acceleration")[:, panel]
                dt, ground = equally_spaced(runs["a"].time("histories"), ground)
                moved = dt * np.arange(len(ground)), low_passed(ground, dt, 25.0)
            dt, a = equally_spaced(*moved)
            same(found, periods, response_spectrum(a, dt, periods, 0.05).pseudo_acceleration)
    for number, run in enumerate(runs.values(), 1):
        found = curves(html, f"energies-{number}")
        assert {term for term, _ in found} == set(ENERGY_TERMS)
        for (term, _), line in found.items():
            same(line, run.time("energy"), run.series("energy", term))
    for (joint, panel), found in curves(html, "joint-histories").items():
        extremes = measures.joint_extremes(runs["a"], joint)
        series = ("opening", "slip", "pressure", "mean_pressure", "mobilised")
        same(found, extremes.time, extremes.values[series[panel]])
    names = ("iterations", "joint_open", "joint_stick", "joint_slip")
    for (label, panel), found in curves(html, "iterations-plot").items():
        run = runs[label]
        same(found, run.time("histories"), run.series("histories", names[panel]))


def test_energies_of_a_reservoir_are_told_apart_from_its_waves(tmp_path: Path) -> None:
    """Waves take 2 kJ out of a dam and bring rounding; the legend is below the axis's name.

    Files of older versions may have a line ``dissipation``, which is not drawn.
    """
    further = ("water", "absorbed", "plastic", "impact", "dissipation")
    path = tmp_path / "lake.h5"
    with ResultsWriter(path, {"point_names": []}) as writer:
        declare_energy(writer, (), ["FarField_reservoir"])
        for term in further:
            writer.series("energy", term, (), "J", term)
        writer.start()
        for t in (0.0, 1.0):
            row = dict.fromkeys((*ENERGY_TERMS, *further), 0.0) | {"kinetic": 5e3 * t}
            row |= {"absorbed": 2e3 * t, "viscous": 2e3 * t, "loads/FarField_reservoir": -1e-21 * t}
            writer.append("energy", t, row)
        writer.finish("complete", {})
    html = report.write([path], tmp_path / "out.html", with_3d=False).read_text(encoding="utf-8")
    assert (
        "entered through absorbing boundaries of rock or water minus the energy that left: "
        "0 minus 2 kJ at the end"
    ) in html
    with Results(path) as results:
        ax = plots.energies(results)
    assert ax.get_ylabel() == "energy [kJ]"
    words = ax.get_legend().get_texts()
    assert (words[0].get_text(), len(words)) == ("waves, 0 kJ in minus 2 kJ out", 12)
    ax.figure.draw_without_rendering()
    name, legend = ax.xaxis.label.get_window_extent(), ax.get_legend().get_window_extent()
    assert 0.0 < legend.y0 < legend.y1 < name.y0
