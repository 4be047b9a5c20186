# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time of overstress and checks of stresses in a plate whose stress history is known exactly.

All boundaries are fixed, and the temperature falls by CHANGE sin(2 pi t / PERIOD): the body does
not move, and all principal stresses are PEAK sin(2 pi t / PERIOD), with
PEAK = (3 lambda + 2 mu) alpha CHANGE in plane strain.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import box
from shaken_wall import Killed, Killer
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints.postprocessing import views
from dolfinx_joints.postprocessing.criteria.checks import CRITERIA
from dolfinx_joints.postprocessing.envelopes import LEVELS, Envelopes

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
CHANGE, EXPANSION, PERIOD, DT = 10.0, 1e-5, 0.8, 0.01
PEAK = (3 * CONCRETE.first_lame("strain") + 2 * CONCRETE.shear_modulus) * EXPANSION * CHANGE
DCR = 1.65  # largest ratio of tension to dynamic tensile strength in the lower part
STRENGTH = dj.Strength(tensile=PEAK / (1.5 * DCR), compressive=1.25 * PEAK, dynamic_factor=1.5)
ROWS, LOWER = 10, 4  # rows of cells, of which the lower ones have the strength


def cooling(time):
    return -np.sin(2 * np.pi * time / PERIOD)


def plate(**options):
    """Return the plate of 2 m x 5 m with cell groups below and above a height of 2 m."""
    sides = {
        "sides": lambda x: (x[0] < 1e-9) | (x[0] > 2 - 1e-9) | (x[1] < 1e-9) | (x[1] > 5 - 1e-9)
    }
    cells = {"lower": (0.0, 2.0), "upper": (2.0, 5.0)}
    heat = dj.Temperature(value=CHANGE, reference=0.0, expansion=EXPANSION, factor=cooling)
    return dj.Model(
        box((2.0, 5.0), (4, ROWS), groups=sides, cells=cells, **options),
        material=CONCRETE,
        supports=[dj.Fixed(group="sides")],
        loads=[heat],
        body=dj.Body(plane="strain"),
    )


def run(path, strength, steps, *, kill=None, checkpoint=None):
    points = {"top": (1.0, 5.0)}
    monitor = dj.ResultsMonitor(path, points=points, envelopes=True, strength=strength)
    simulation = dj.Simulation(plate(), monitors=[monitor, Killer(kill)])
    if checkpoint is None or not checkpoint.resume:
        simulation.statics()
    simulation.dynamics(dt=DT, steps=steps, checkpoint=checkpoint)


def time_above(level, ratio=DCR):
    """Return the time of a period for which ratio sin(2 pi t / PERIOD) exceeds a level."""
    return PERIOD / np.pi * np.arccos(np.minimum(np.asarray(level) / ratio, 1.0))


def test_time_above_each_level_is_that_of_a_sine(comm, new_path):
    # Each crossing is a root of the chord instead of the sine: its error is at most
    # DT^2 / 8 |f''| / |f'| = DT^2 / 8 (2 pi / PERIOD) L / sqrt(DCR^2 - L^2). The level 1.6 is
    # nearest to the peak. There are two crossings. The static stage counts no time.
    path = new_path("sine.h5")
    strength = {"lower": STRENGTH, "upper": replace(STRENGTH, tensile=4 * STRENGTH.tensile)}
    run(path, strength, round(PERIOD / DT))

    def look():
        with dj.Results(path) as results:
            nodes = results.static("mesh/nodes")[results.static("envelopes/nodes")]
            below = nodes[:, 1] < 2.0 + 1e-9  # vertices between the groups have the lower strength
            dynamic = results.static("envelopes/strength/dynamic_tensile")
            np.testing.assert_allclose(PEAK / dynamic, np.where(below, DCR, DCR / 4))
            time = results.series("envelopes", "overstress_time", -1)
            crossed = LEVELS[LEVELS < DCR]
            slope = crossed / np.sqrt(DCR**2 - crossed**2)
            bound = 2 * DT**2 / 8 * 2 * np.pi / PERIOD * slope
            recorded = time[below][:, : len(crossed)]
            assert (np.abs(recorded - time_above(crossed)) <= 1.01 * bound).all()
            assert not time[:, len(crossed) :].any()
            assert not time[~below].any()

            rows = {row.criterion: row for row in dj.checks(results, "gravity")}
            value = {name: row.value for name, row in rows.items()}
            # Stress and strength behind the ratio; places of plane models have two coordinates.
            strength = 1.5e-6 * STRENGTH.tensile
            stated = f"{DCR * strength:.4g} MPa of {strength:.4g} MPa, lower ("
            where = rows["tension / dynamic tensile strength"].where
            assert where.startswith(stated)
            assert where.count(",") == 2
            assert value["tension / dynamic tensile strength"] == pytest.approx(DCR)
            assert value["compression / compressive strength"] == pytest.approx(0.8)
            assert value["static tension / tensile strength"] == pytest.approx(0.0, abs=1e-9)
            # A row of vertices has the area of a row of cells, the lowest row half of it.
            share = (LOWER + 0.5) / ROWS
            assert value["overstressed share of the area"] == pytest.approx(share)
            assert rows["overstressed share of the area"].met == "no"
            longest = rows["time of overstress"]
            ratio = time_above(crossed) / (0.3 * (2.0 - crossed))
            worst = ratio.argmax()
            assert longest.value == pytest.approx(time_above(crossed)[worst], abs=bound.max())
            assert longest.limit == pytest.approx(0.3 * (2.0 - crossed[worst]))
            assert longest.where.startswith(
                f"above {crossed[worst]:.1f} x dynamic tensile strength, lower ("
            )
            assert rows["crest displacement / height"].met == "not recorded"

            of_upper = {r.criterion: r for r in dj.checks(results, "arch", groups=["upper"])}
            # The lowest vertices of the upper group have the strength of the lower one.
            share = 0.5 / (ROWS - LOWER)
            assert of_upper["overstressed share of the area"].value == pytest.approx(share)
            assert of_upper["overstressed share of the area"].limit == 0.2
            none = {r.criterion: r for r in dj.checks(results, "arch", overstress_time=None)}
            assert none["time of overstress"].met == "no limit"
            assert none["time of overstress"].value == pytest.approx(
                time_above(1.0), abs=bound.max()
            )
            none = {r.criterion: r for r in dj.checks(results, "arch", overstress_time=0.0)}
            assert none["time of overstress"].met == "no"
            assert none["time of overstress"].limit == 0.0
            with pytest.raises(ValueError, match="tensoin is 1; it must be a limit"):
                dj.checks(results, "arch", tensoin=1)

    on_root(comm, look)


def test_continued_run_has_the_same_times(comm, new_path):
    whole, resumed, kept = new_path("whole.h5"), new_path("resumed.h5"), new_path("run.ckpt")
    run(whole, STRENGTH, 24)
    checkpoint = dj.Checkpoints(kept, every=10)
    with pytest.raises(Killed):
        run(resumed, STRENGTH, 24, kill=17, checkpoint=checkpoint)
    run(resumed, STRENGTH, 24, checkpoint=replace(checkpoint, resume=True))

    def look():
        with dj.Results(whole) as one, dj.Results(resumed) as two:
            time = one.series("envelopes", "overstress_time", -1)
            assert time.max() > 5 * DT
            np.testing.assert_array_equal(two.series("envelopes", "overstress_time", -1), time)

    on_root(comm, look)
    with pytest.raises(dj.JointsError, match="recorded with strength="):
        run(resumed, None, 24, checkpoint=replace(checkpoint, resume=True))


def test_a_run_without_strength_says_so(comm, new_path):
    path = new_path("none.h5")
    run(path, None, 2)

    def look():
        with dj.Results(path) as results:
            rows = dj.checks(results, "arch")
            assert {row.met for row in rows} == {"not recorded"}
            assert "not recorded" in str(rows)
            assert "overstress_time" not in results.streams["envelopes"]

    on_root(comm, look)
    with pytest.raises(ValueError, match="set envelopes=True"):
        dj.ResultsMonitor(path, points={}, strength=STRENGTH)
    with pytest.raises(ValueError, match="must be a Strength"):
        dj.ResultsMonitor(path, points={}, strength=2e6, envelopes=True)


def test_the_page_and_the_docstring_name_all_limits():
    page = (Path(__file__).parents[2] / "docs/guide/results.md").read_text(encoding="utf-8")
    cells = [[c.strip() for c in line.split("|")[1:-1]] for line in page.splitlines()]
    listed = {row[0].strip("`"): tuple(row[1:]) for row in cells if len(row) == 5}
    for name, (text, unit, *limits) in CRITERIA.items():
        words = ["none" if limit is None else f"{limit:g}" for limit in limits]
        assert listed[name] == (text, unit, *words)
        assert f"``{name}``" in dj.checks.__doc__


def test_a_crest_at_the_lowest_node_has_no_drift(comm, new_path):
    path = new_path("low.h5")
    monitor = dj.ResultsMonitor(path, points={"low": (1.0, 0.0), "top": (1.0, 5.0)})
    dj.Simulation(plate(), monitors=[monitor]).dynamics(dt=DT, steps=2)

    def look():
        with dj.Results(path) as results:
            low, top = (dj.checks(results, "gravity", crest=c)[-1] for c in ("low", "top"))
            assert (low.met, top.met) == ("not recorded", "no limit")
            assert low.where == "low is not above the lowest node of the groups"
            assert top.where == "top, height 5 m, from the first record"

    on_root(comm, look)


def test_area_is_that_of_the_recorded_faces(comm, new_path):
    # A wall one cell thick: crest, base and ends have stresses at all vertices, but only the two
    # faces of 2 m x 5 m are recorded. Of each, the lower 2.25 m are overstressed, as in the plate.
    path = new_path("wall.h5")
    faces = {"upstream": (0, 0.0), "downstream": (0, 1.0)}
    outer = {"outer": lambda x: np.any((x < 1e-9) | (x > [[1 - 1e-9], [2 - 1e-9], [5 - 1e-9]]), 0)}
    cells = {"lower": (0.0, 2.0), "upper": (2.0, 5.0)}
    mesh = box((1.0, 2.0, 5.0), (1, 2, ROWS), groups=outer | faces, cells=cells)
    heat = dj.Temperature(value=CHANGE, reference=0.0, expansion=EXPANSION, factor=cooling)
    supports = [dj.Fixed(group="outer")]
    model = dj.Model(mesh, material=CONCRETE, supports=supports, loads=[heat])
    strength = {"lower": STRENGTH, "upper": replace(STRENGTH, tensile=4 * STRENGTH.tensile)}
    monitor = dj.ResultsMonitor(
        path, points={"top": (0.0, 0.0, 5.0)}, envelopes=list(faces), strength=strength
    )
    dj.Simulation(model, monitors=[monitor]).dynamics(dt=PERIOD / 4, steps=1)

    def look():
        with dj.Results(path) as results:
            rows = {row.criterion: row for row in dj.checks(results, "arch")}
            area = rows["overstressed share of the area"]
            assert area.where == "of 20 m²"
            assert area.value == pytest.approx((LOWER + 0.5) / ROWS)

    on_root(comm, look)


def test_jump_over_a_level_counts_its_share():
    # From 0 to 2 times the strength in 1 s and back in 3 s: above 1.5 times for 0.25 + 0.75 s.
    # The second point has no strength.
    seen = Envelopes(np.full((2, 3), np.nan), np.full((2, 3), np.nan), np.array([1e6, np.inf]))
    for time, tension in ((5.0, 0.0), (6.0, 2e6), (9.0, 0.0)):
        stress = np.zeros((2, 6))
        stress[:, 1] = tension
        seen.see(stress, time)
    assert LEVELS[5] == 1.5
    assert seen.columns[:, 6 + 5].tolist() == [1.0, 0.0]


def test_the_strength_is_a_line_in_the_picture(comm, new_path):
    path = new_path("line.h5")
    run(path, STRENGTH, 2)

    def look():
        with dj.Results(path) as results:
            title = views.envelope(results, "principal_max").get_suptitle()
            assert f"dynamic tensile strength, {1.5e-6 * STRENGTH.tensile:.3g} MPa" in title
            assert "strength" not in views.envelope(results, "principal_min").get_suptitle()

    on_root(comm, look)
