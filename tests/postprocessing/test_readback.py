# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every array drawn and every column written is that of the file, in the unit that its label says.

No two numbers of the run are alike, so that another point, joint, component or record, a shifted
time, a sign or a factor shows.
"""

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from reading_back import equal_means, lines, low_passed, si
from written_runs import write_distinct

from dolfinx_joints.export.tables import write_csv
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.spectra import equally_spaced, response_spectrum
from dolfinx_joints.postprocessing import measures, motion_plots, plots, rendering, views
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants, resultant_measures
from dolfinx_joints.postprocessing.joints.surface import OVER_RUN, MapQuantity
from dolfinx_joints.results.reader import Results

pytest.importorskip("matplotlib")

BOTH = [(point, component) for point in ("crest", "heel") for component in "xyz"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Results, Results]]:
    """A run and another to draw behind it."""
    folder = tmp_path_factory.mktemp("distinct")
    with (
        Results(write_distinct(folder / "own.h5", 1)) as own,
        Results(write_distinct(folder / "other.h5", 2)) as other,
    ):
        yield own, other


def same(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=0.0)


def moved(run: Results, point: str, component: str, relative_to: str | None = None) -> np.ndarray:
    """Displacement of a point since the first record, from that of another [m]."""
    u = run.series("histories", "displacement")[..., "xyz".index(component)]
    u, names = u - u[0], run.point_names
    return u[:, names.index(point)] - (u[:, names.index(relative_to)] if relative_to else 0.0)


@pytest.mark.parametrize("relative_to", [None, "heel"])
def test_histories(runs: tuple[Results, Results], relative_to: str | None) -> None:
    own, other = runs
    for point, component in BOTH:
        ax = plots.history(own, point, component, reference=other, relative_to=relative_to)
        for run, (time, u) in zip((other, own), lines(ax), strict=True):
            same(time, run.time("histories"))
            same(u, moved(run, point, component, relative_to))
        assert ax.get_ylabel() == f"displacement {component}\nfrom the first record [mm]"
        assert ax.get_title(loc="left").startswith(f"{point}: displacement {component}")


def test_fourier_amplitudes(runs: tuple[Results, Results]) -> None:
    """|sum u exp(-2 pi i f t)| dt of the motion from the first record, at equal steps."""
    own, other = runs
    for point, component in BOTH:
        ax = plots.fourier(own, point, component, reference=other)
        for run, (frequency, amplitude), line in zip(
            (other, own), lines(ax), ax.get_lines(), strict=True
        ):
            u = moved(run, point, component)
            dt, u = equally_spaced(run.time("histories"), u - u[0])
            turns = np.outer(frequency, dt * np.arange(len(u)))
            expected = dt * np.abs(np.exp(-2j * np.pi * turns) @ u)
            np.testing.assert_allclose(amplitude, expected, atol=1e-9 * expected.max())
            peak = measures.fourier_peaks(run, point, component).frequency
            assert peak > 15.0 or f"peak at {peak:.2f} Hz" in str(line.get_label())


def test_response_spectra(runs: tuple[Results, Results]) -> None:
    """Of the ground's acceleration added to the point's, in the band that the title names."""
    own, other = runs
    periods = [0.05, 0.2, 1.0]
    for point, component in BOTH:
        drawn = plots.response_spectra(own, point, component, reference=other, periods=periods)
        assert drawn.get_title(loc="left").endswith("low-passed at 25 Hz")
        *of_points, of_ground = lines(drawn)
        k = "xyz".index(component)
        for run, (natural, found) in zip((other, own), of_points, strict=True):
            same(natural, periods)
            time, ground = run.time("histories"), run.series("histories", "ground_acceleration")
            a = run.series("histories", "acceleration")[1:, run.point_names.index(point), k]
            a = a + (ground[1:, k] + ground[:-1, k]) / 2
            dt, a = equal_means(time, a)
            a = low_passed(a, dt, 25.0)
            same(found, response_spectrum(a, dt, periods, 0.05).pseudo_acceleration)
        dt, a = equally_spaced(
            own.time("histories"), own.series("histories", "ground_acceleration")[:, k]
        )
        a = low_passed(a, dt, 25.0)
        same(of_ground[1], response_spectrum(a, dt, periods, 0.05).pseudo_acceleration)


def test_energies_and_states(runs: tuple[Results, Results]) -> None:
    own, _ = runs
    ax = plots.energies(own)
    found = dict(zip([str(line.get_label()) for line in ax.get_lines()], lines(ax), strict=True))
    for label, (time, energy) in found.items():
        same(time, own.time("energy"))
        same(energy, own.series("energy", label.split(",")[0]))
    ax = plots.joint_states(own)
    for name, (time, share) in zip(("joint_open", "joint_slip"), lines(ax), strict=True):
        same(time, own.time("histories"))
        same(share, own.series("histories", name))


EXTREMES = ("opening", "slip", "pressure", "mean_pressure", "mobilised")


def test_histories_of_joints(runs: tuple[Results, Results]) -> None:
    """All joints in grey, then the worst, whose legend says how much and when."""
    own, _ = runs
    panels = plots.joint_histories(own)
    time = own.time("states")
    assert "[s]" in panels[-1].get_xlabel()
    extremes = {joint: measures.joint_extremes(own, joint) for joint in own.joints}
    for ax, what in zip(panels, EXTREMES, strict=True):
        drawn = [line for line in ax.get_lines() if len(line.get_xdata()) == len(time)]
        values = [si(ax.get_ylabel(), line.get_ydata()) for line in drawn]
        each = {joint: getattr(found, what) for joint, found in extremes.items()}
        worst = max(each, key=lambda joint: np.max(each[joint]))
        for line, found, joint in zip(drawn, values, [*own.joints, worst], strict=True):
            same(line.get_xdata(), time)
            same(found, each[joint])
        label = drawn[-1].get_label()
        name, value, unit, when = re.fullmatch(
            r"(\w+): (\S+)( mm| MPa)? at (\S+) s", label
        ).groups()
        factor = {" mm": 1e-3, " MPa": 1e6}.get(unit, 1.0)
        assert name == worst
        grey = [line.get_label() for line in drawn[:-1] if line.get_label()[0] != "_"]
        others = [joint for joint in own.joints if joint != worst]
        assert grey == (others if len(others) == 1 else [f"{len(others)} other joints"])
        assert factor * float(value) == pytest.approx(np.max(each[worst]), rel=5e-3)
        assert float(when) == pytest.approx(time[np.argmax(each[worst])], rel=1e-5)
    gap = own.series("states", "joints/joint_2/gap")
    same(extremes["joint_2"].opening, np.maximum(gap[..., 0], 0.0).max(axis=1))


def of_map(run: Results, joint: str, quantity: str, record: int) -> np.ndarray:
    """What a map shows of each point, in SI; NaN where a traction is that of an open point."""
    gap, traction, status = (
        run.series("states", f"joints/{joint}/{name}", record)
        for name in ("gap", "traction", "status")
    )
    shear = np.linalg.norm(traction[:, 1:], axis=1)
    if quantity == "mobilised":
        pressure = np.where(traction[:, 0] < 0.0, -traction[:, 0], np.nan)
        return shear / (np.tan(np.radians(35.0)) * pressure)
    value = {
        "opening": np.maximum(gap[:, 0], 0.0),
        "slip": np.linalg.norm(gap[:, 1:], axis=1),
        "state": status,
        "normal": traction[:, 0],
        "tangential": shear,
    }[quantity]
    is_open = (gap[:, 0] > 0.0) & (traction[:, 0] == 0.0)
    return np.where(is_open & (quantity in ("normal", "tangential")), np.nan, value)


@pytest.mark.parametrize("quantity", [q for q in get_args(MapQuantity) if q not in OVER_RUN])
def test_maps_of_joints(runs: tuple[Results, Results], quantity: MapQuantity) -> None:
    own, _ = runs
    for record in (1, 3):
        time = own.time("states")[record]
        figure = plots.joint_maps(own, quantity, time=time + 1e-3)
        first, second, bar = figure.axes
        assert f"t = {time:.3f} s" in figure.get_suptitle()
        unit = "[-]" if quantity == "state" else bar.get_xlabel()
        for ax, joint in zip((first, second), own.joints, strict=True):
            assert ax.get_title(loc="left") == joint
            shown = np.ma.filled(ax.collections[0].get_array(), np.nan)
            same(si(unit, shown), of_map(own, joint, quantity, record))
            if quantity in ("normal", "tangential", "mobilised"):
                alone = plots.joint_traction(own, joint, quantity, index=record)
                assert alone.get_title() == f"{joint} at t = {time:.3f} s"
                shown = np.ma.filled(alone.collections[0].get_array(), np.nan)
                label = alone.figure.axes[-1].get_ylabel()
                same(si(label, shown), of_map(own, joint, quantity, record))


def test_pictures_of_the_body(
    runs: tuple[Results, Results], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every node where its displacement brings it, and the stress or the joint's value on it."""
    pytest.importorskip("pyvista")
    own, _ = runs
    seen: list[rendering.Scene] = []

    def render(scene: rendering.Scene, camera: rendering.Camera) -> np.ndarray:
        seen.append(scene)
        return np.full((8, 8, 3), 255, dtype=np.uint8)

    monkeypatch.setattr(rendering.Scene, "render", render)
    nodes = own.static("mesh/nodes")
    for record in (1, 3):
        figure = views.deformed(own, index=record, scale=50.0)
        body, contours, sides = (data for data, _ in seen[-1].layers[:3])
        u = own.series("states", "displacement", record)
        for part in (body, sides):
            np.testing.assert_allclose(part.points, nodes + 50.0 * u, rtol=1e-6)
        size = si(figure.axes[-1].get_ylabel(), body.point_data["value"])
        same(size, np.linalg.norm(u, axis=1))
        ticks = figure.axes[-1].get_yticks()
        assert set(contours.point_data["value"].round(9)) <= set(ticks.round(9))
        title = figure.get_suptitle().split("\n")
        assert f"t = {own.time('states')[record]:.3f} s, displacements x 50" in title[0]
        gap = {j: own.series("states", f"joints/{j}/gap", record) for j in own.joints}
        sizes = {
            "widest opening": {j: values[:, 0].max() for j, values in gap.items()},
            "largest slip": {j: np.hypot(*values[:, 1:].T).max() for j, values in gap.items()},
        }
        for line, (quantity, of_joints) in zip(title[1:], sizes.items(), strict=True):
            joint = max(of_joints, key=lambda name: of_joints[name])
            assert line == f"{quantity} {1e3 * of_joints[joint]:.3g} mm, {joint}"
        for quantity in ("normal", "opening"):
            figure = views.joint_map(own, quantity, index=record)  # type: ignore[arg-type]
            label = figure.axes[-1].get_ylabel()
            for (data, _), name in zip(seen[-1].layers[1:], own.joints, strict=True):
                same(si(label, data.cell_data["value"]), of_map(own, name, quantity, record))
    for name in ENVELOPE_NAMES:
        figure = views.envelope(own, name)
        value = si(figure.axes[-1].get_ylabel(), seen[-1].layers[0][0].point_data["value"])
        same(value, own.series("envelopes", name, -1))


def test_motions() -> None:
    """Each component apart, a reference of another step; integrals by trapezoids from rest."""
    random = np.random.default_rng(5)
    one, other = (
        Motion(acceleration=random.standard_normal((n, 3)), dt=dt, name="shaking")
        for n, dt in ((50, 0.01), (80, 0.005))
    )
    for component, k in zip("xyz", range(3), strict=True):
        for quantity in ("acceleration", "velocity", "displacement"):
            ax = motion_plots.history(one, component, quantity, reference=other)  # type: ignore[arg-type]
            assert f"{quantity} {component}" in ax.get_ylabel()
            for motion, (time, values) in zip((other, one), lines(ax), strict=True):
                same(time, motion.dt * np.arange(len(motion.acceleration)))
                v, u = motion.integrated()
                source = {"acceleration": motion.acceleration, "velocity": v, "displacement": u}
                same(values, source[quantity][:, k])
    periods = [0.05, 0.2, 1.0]
    drawn = lines(motion_plots.response_spectra(one, reference=other, periods=periods))
    for i, (natural, found) in enumerate(drawn):
        motion = (other, one)[i // 3]
        spectrum = response_spectrum(motion.acceleration[:, i % 3], motion.dt, periods, 0.05)
        same(natural, periods)
        same(found, spectrum.pseudo_acceleration)
    v = one.integrated()[0]
    same(np.diff(v, axis=0), 0.005 * (one.acceleration[1:] + one.acceleration[:-1]))


def columns(path: Path) -> dict[str, Any]:
    """Columns of a table by name, numbers in SI."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    found: dict[str, Any] = {}
    for name, column in zip(header, zip(*rows, strict=True), strict=True):
        plain = name.split(" [")[0]
        assert plain not in found
        found[plain] = si(name, column) if "[" in name else np.array(column)
    return found


def check_peaks(results: Results, table: dict[str, Any]) -> None:
    """Each value is the largest, or smallest, of the history that its name says, at its time."""
    names = ("peak", "value", "unit", "time", "component")
    for what, value, unit, time, component in zip(*(table[name] for name in names), strict=True):
        kind, _, of = what.partition(" of ")
        if kind == "displacement":
            point, _, datum = of.partition(" from ")
            assert datum == "the first record"
            known = measures.displacement_history(results, point, component)
        elif kind == "absolute acceleration":
            point, _, band = of.partition(" up to ")
            assert band == f"{measures.common_band(results):.3g} Hz"
            known = measures.acceleration_history(results, point, component)
        else:
            joint, *datum = of.split(" from ")
            assert datum == ["the first record"] * (kind == "slip")
            extremes = measures.joint_extremes(results, joint)
            known = extremes.time, getattr(extremes, kind)
        times, values = known
        at = np.nanargmin(values) if kind == "safety" else np.nanargmax(np.abs(values))
        assert (float(value), time) == (values[at], times[at]), what
        units = {"displacement": "m", "opening": "m", "slip": "m", "safety": "-"}
        assert unit == units.get(kind, "m/s^2")


def test_tables(runs: tuple[Results, Results], tmp_path: Path) -> None:
    """Every column of numbers is compared, with the measure of its row's joint and time."""
    own, _ = runs
    tables = {path.stem: columns(path) for path in write_csv(own, tmp_path)}
    check_peaks(own, tables.pop("peaks"))
    wanted: dict[str, dict[str, Any]] = {name: {} for name in tables}
    for stream in ("histories", "energy"):
        wanted[stream]["time"] = own.time(stream)
        for name in own.streams[stream]:
            values = own.series(stream, name)
            if values.ndim == 3:
                shown, zero = f"raw {name}" if name == "acceleration" else name, ""
                if name == "displacement":
                    values, zero = values - values[0], " from the first record"
                for i, point in enumerate(own.point_names):
                    wanted[stream] |= by_axis(f"{shown} of {point}{zero}", values[:, i])
            else:
                wanted[stream] |= {name: values} if values.ndim == 1 else by_axis(name, values)
    for name in ("joint_extremes", "resultants"):
        wanted[name]["time"] = np.tile(own.time("states"), 2)
    each = [measures.joint_extremes(own, joint) for joint in own.joints]
    for name in ("opening", "slip", "pressure"):
        values = np.concatenate([getattr(one, name) for one in each])
        zero = " from the first record" if name == "slip" else ""
        wanted["joint_extremes"][f"largest {name}{zero}"] = values
        if name != "pressure":
            places = np.concatenate([getattr(one, f"{name}_at") for one in each])
            wanted["joint_extremes"] |= by_axis(f"largest {name} at", places)
    means = np.concatenate([one.mean_pressure for one in each])
    wanted["joint_extremes"]["mean pressure"] = means
    wanted["joint_extremes"]["sliding safety"] = np.concatenate([one.safety for one in each])
    used = np.concatenate([one.mobilised for one in each])
    wanted["joint_extremes"]["mobilised friction"] = used
    forces = [joint_resultants(own, joint) for joint in own.joints]
    for name, attribute in {
        "effective force": "force",
        "moment about the centroid": "moment",
        "total force": "total_force",
        "total moment about the centroid": "total_moment",
        "normal force": "normal_force",
        "shear force": "shear_force",
        "sliding safety": "sliding_safety",
        "sliding safety of the resultants": "plane_safety",
        "share of area under pressure": "contact",
        "normal force acts at": "line_of_action",
    }.items():
        values = np.concatenate([getattr(one, attribute) for one in forces])
        wanted["resultants"] |= {name: values} if values.ndim == 1 else by_axis(name, values)
    wanted["resultants"] |= by_axis("shear force", np.concatenate([one.shear for one in forces]))
    wanted["resultants"]["flatness"] = np.repeat([one.geometry.flatness for one in forces], 5)
    motion, resultants = measures.joint_measures(own), resultant_measures(own)
    for name in (*measures.JOINT_MEASURES, *resultants["joint_1"]):
        wanted["joints"][name] = [(motion[j] | resultants[j])[name] for j in own.joints]
    nodes = own.static("envelopes/nodes")
    wanted["envelopes"] = {n: own.series("envelopes", n, -1) for n in ENVELOPE_NAMES}
    wanted["envelopes"] |= {"node": nodes, **by_axis("position", own.static("mesh/nodes")[nodes])}
    for name, table in tables.items():
        if table.get("joint", nodes).dtype.kind == "U":  # in the energies a number
            joints = table.pop("joint")
            assert joints.tolist() == np.repeat(own.joints, len(joints) // 2).tolist()
        assert set(table) == set(wanted[name]), name
        for column, values in table.items():
            np.testing.assert_array_equal(values, wanted[name][column], err_msg=f"{name} {column}")


def by_axis(name: str, vectors: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of the components of vectors, shape (rows, 3)."""
    return {f"{name} {axis}": vectors[:, k] for k, axis in enumerate("xyz")}
