# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Waves in a reservoir against exact solutions, and their energy beside that of a jointed dam.

Forces on a rigid vertical face, before endless water or up to a wall, and of a floor that
accelerates upwards are those of `benchmarks.reservoir_waves.exact`.

On a surface that moves, p = rho g times its height: waves of a rigid basin have

    w^2 = g K tanh K H,  K^2 = k^2 - (w / c)^2,

k = n pi / L in the plane; with quick sound a wall that moves together with the one at L feels,
over odd n,

    F = -rho a (L H / 2 + sum 4 w^2 tanh k H / (L k^3 (g k tanh k H - w^2))),

and under a floor that accelerates upwards p = -rho a f with f'' = -k^2 f, f' = 1 + i w q f on the
floor and f' = 1 + w^2 f / g on the surface, heights and pressures being those seen from the ground.

The field y = z - H has no pressure at the level, is linear, and flows through floor and face only:
K y is the flux of its gradient there, for any shape of the face and wherever the level cuts it.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows, box
from dolfinx.mesh import CellType
from scipy.optimize import brentq
from scipy.sparse.linalg import eigsh
from shaken_wall import CONCRETE, shaking, wall

import dolfinx_joints as dj
from benchmarks.reservoir_waves import exact, spectrum
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.loads.water.far_field import FarField
from dolfinx_joints.postprocessing.energy_lines import energy_lines
from dolfinx_joints.simulation.monitor import Monitor

mpi = pytest.mark.mpi
TETRAHEDRON = CellType.tetrahedron

H, RHO, C = 100.0, 1000.0, 1440.0
FIRST = C / (4.0 * H)
RIGID = dj.Elastic(young=1e17, poisson=0.2, density=2400.0)
UP = {"up": (0, 0.0)}


def forces_kept():
    """A monitor that keeps times and forces of the water."""
    return Rows(lambda record: (record.time, record.reservoir_force))


class Crest(Monitor):
    """Displacement along x of the highest node at the face, on every rank."""

    def __init__(self, model):
        x = model.V.tabulate_dof_coordinates()[: model.V.dofmap.index_map.size_local]
        here = np.flatnonzero(np.isclose(x[:, 0], 0.0) & np.isclose(x[:, 1], H))
        self._node, self._comm, self.values = here, model.jointed.mesh.comm, []

    def record(self, record):
        mine = record.displacement.getArray().reshape(-1, 2)[self._node, 0]
        self.values.append(np.concatenate(self._comm.allgather(mine))[0])


def rigid_dam(comm, waves, cells=16):
    jointed = box([20.0, H], [1, cells], groups=UP | {"down": (0, 20.0)}, comm=comm)
    return dj.Model(jointed, material=RIGID, supports=[dj.Fixed(group="down")], water=waves)


def error_of_force(*case, **options):
    """Largest error of `spectrum` over the largest force, over 0 to 3 times the first frequency."""
    _, found, exact, imbalance = spectrum(*case, **options)
    assert imbalance < 1e-10
    return np.abs(found - exact).max() / np.abs(exact).max()


def test_force_on_a_rigid_face():
    # Below all frequencies it is Westergaard's incompressible water.
    slow = abs(exact("stream", np.array([0.02 * FIRST]), 0.75)[0])
    assert slow == pytest.approx(0.543 * RHO * H**2, rel=2e-3)
    errors = [error_of_force("stream", 0.75, n, 0.0, "radiating", 2000) for n in (5.0, 10.0)]
    assert errors[1] < 0.01
    assert errors[1] < errors[0] / 4.0


def test_a_wall_at_the_far_end_moves_with_the_ground():
    assert error_of_force("stream", 0.75, 2.0, 0.0, "rigid", 2000, layers=48) < 0.02


@pytest.mark.parametrize("far_end", ["rigid", "radiating"])
def test_floor_that_shakes_upwards(far_end):
    """However near the far end is: it takes nothing of the wave of the cross-section."""
    assert error_of_force("upwards", 0.75, 0.5, 0.0, far_end, 2500, layers=4) < 0.01


@mpi
@pytest.mark.parametrize(
    ("alpha", "length", "absorbing", "error"), [(0.75, 10.0, 0.0, 0.01), (1.0, 30.0, 25.0, 0.02)]
)
def test_frequency_response_before_a_rigid_dam(comm, alpha, length, absorbing, error):
    """The same forces without a run in time, along the stream and upwards."""
    frequencies = np.linspace(0.11, 2.91, 29) * FIRST
    if alpha == 1.0:  # not at the poles
        frequencies = frequencies[np.abs((frequencies / FIRST) % 2.0 - 1.0) > 0.05]
    waves = dj.ReservoirWaves(
        group="up",
        level=H,
        length=length * H,
        bottom_reflection=alpha,
        sound_speed=C,
        absorbing_length=absorbing * H,
    )
    model, points = rigid_dam(comm, waves), {"crest": (0.0, H)}
    for direction, axes in (("stream", (1.0, 0.0)), ("upwards", (0.0, 1.0))):
        right = exact(direction, frequencies, alpha)
        found = dj.frequency_response(model, frequencies, points=points, direction=axes)
        assert np.abs(found.reservoir_force[:, 0] - right).max() < error * np.abs(right).max()
        if direction == "stream":
            np.testing.assert_allclose(found.acceleration("crest")[:, 0], 1.0, atol=1e-6)


def test_frequency_response_of_a_dam_that_bends_is_that_of_a_run_in_time(comm):
    """By the Fourier transform of crest and force under a pulse, at the rule's own frequency."""
    jointed = box([30.0, H], [2, 8], groups=UP | {"base": (1, 0.0)}, comm=comm)
    waves = dj.ReservoirWaves(group="up", level=H, length=3.0 * H, bottom_reflection=0.3)
    model = dj.Model(
        jointed,
        material=CONCRETE,
        supports=[dj.Fixed(group="base")],
        water=waves,
        damping=dj.ModalRatios(ratio=0.3, modes=2, beyond=dj.Rayleigh(mass_factor=4.0)),
    )
    dt, frequencies = 2.0**-7, np.array([0.7, 1.6, 2.5])
    pulse = lambda t: np.exp(-(((t - 0.3) / 0.05) ** 2)) * np.array([1.0, 0.0, 0.5])  # noqa: E731
    crest, kept = Crest(model), forces_kept()
    dj.Simulation(model, monitors=[crest, kept]).dynamics(dt=dt, steps=768, motion=pulse)
    times, forces = (np.array(column) for column in zip(*kept.rows, strict=True))
    waves = np.exp(-2j * np.pi * np.outer(frequencies, times))
    ground = (waves @ [pulse(t) for t in times])[:, :1] * np.hypot(1.0, 0.5)
    turned = np.tan(np.pi * frequencies * dt) / (np.pi * dt)
    found = dj.frequency_response(model, turned, points={"crest": (0.0, H)}, direction=(1.0, 0.5))
    moved = (waves @ np.append(0.0, crest.values)) / ground[:, 0]
    force = (waves @ forces)[:, 0] / ground[:, 0]
    for one, other in (
        (moved, found.displacement["crest"][:, 0]),
        (force, found.reservoir_force[:, 0]),
    ):
        assert np.abs(one - other).max() < 2e-3 * np.abs(other).max()


def leaning(x):
    """A face of a cylinder that leans, on a floor that rises, seen from x < 0."""
    place = x.copy()
    place[:, 2] = x[:, 2] + 0.05 * x[:, 1]
    place[:, 0] = x[:, 0] + 0.2 * x[:, 2] + 0.1 * np.sin(x[:, 1] / 4.0)
    return place


@mpi
@pytest.mark.parametrize("cell", [CellType.tetrahedron, CellType.hexahedron])
def test_a_linear_field_flows_through_face_and_floor(comm, cell):
    jointed = box([4.0, 12.0, 12.0], [1, 5, 6], cell, groups=UP, place=leaning, comm=comm)
    level, length = 9.7, 20.0
    waves = dj.ReservoirWaves(
        group="up", level=level, length=length, bottom_reflection=0.0, layers=3, upstream=(-1, 0, 0)
    )
    water = waves.water(dj.Model(jointed, material=CONCRETE))
    rows = water.rows(0, water.size)
    depth = water.places[:, 2] - level
    inner = water.size - len(water.face)  # the far end has a flux of its own
    flux = RHO * C**2 * water.driven[:, 2]
    np.testing.assert_allclose(
        (rows.stiffness @ depth)[:inner], flux[:inner], atol=1e-9 * abs(flux).max()
    )
    # The same field q all along feels its cross-section, and what the far end is told of it.
    section, q = water.section, np.random.default_rng(1).normal(size=len(water.face))
    widths = length / 3.0 * np.array([0.5, 1.0, 1.0, 0.5])
    alike, beyond = np.tile(q, 4), len(water.face)
    rest = rows.losses @ alike - np.kron(widths, section.losses @ q)
    np.testing.assert_allclose(rest, section.by_rate @ q, atol=1e-9 * abs(rest).max())
    rest = (rows.stiffness @ alike - np.kron(widths, section.stiffness @ q))[beyond:]
    expected = (section.by_place @ q)[beyond:]
    np.testing.assert_allclose(rest, expected, atol=1e-9 * abs(rest).max())
    # Rows made in parts, as ranks make them, are those of the whole.
    parts = [water.rows(*ends) for ends in ((0, 17), (17, water.size))]
    for name in ("mass", "stiffness", "losses"):
        whole = getattr(rows, name).toarray()
        found = np.concatenate([getattr(part, name).toarray() for part in parts])
        np.testing.assert_array_equal(found, whole)


def test_far_field_is_of_second_order_at_its_steps_and_between_them(comm):
    """Under a smooth motion, against a march of much shorter steps; in any order of the times."""
    waves = dj.ReservoirWaves(group="up", level=H, length=50.0, bottom_reflection=0.5)
    section = waves.water(rigid_dam(comm, waves)).section
    upwards = [[lambda _: 0.0, lambda time: np.sin(9.0 * time) ** 4]]
    times = [0.122, 0.013, 0.16, 0.159, 0.2]
    exact, *found = (
        np.array([field.force(time) for time in times])
        for field in (FarField(section, upwards, step) for step in (1e-4, 4e-3, 1e-3))
    )
    errors = [np.abs(each - exact).max() for each in found]
    assert errors[0] < 0.005 * np.abs(exact).max()
    assert errors[1] < errors[0] / 14.0


def test_energies_of_a_box_of_water(comm):
    """y = H - z: rho y^2 / 2 over the water, rho c y^2 over floor, banks and the far end."""
    jointed = box([4.0, 12.0, 12.0], [1, 4, 5], groups=UP, comm=comm)
    waves = dj.ReservoirWaves(group="up", level=10.0, length=20.0, bottom_reflection=0.0)
    water = waves.water(dj.Model(jointed, material=CONCRETE))
    rows, y = water.rows(0, water.size), 10.0 - water.places[:, 2]
    volume, floor = 20.0 * 12.0, 20.0 * 12.0 * 10.0**2
    banks, end = 2 * 20.0 * 10.0**3 / 3.0, 12.0 * 10.0**3 / 3.0
    assert y @ (rows.mass @ y) == pytest.approx(RHO * volume * 10.0**3 / 3.0)
    assert y @ (rows.stiffness @ y) == pytest.approx(RHO * C**2 * volume * 10.0)
    assert y @ (rows.losses @ y) == pytest.approx(RHO * C * (floor + banks + end))
    # With the surface at y = 1 higher: rho g eta^2 / 2 = rho c^2 / g dy/dt^2 / 2 there.
    water = replace(waves, gravity_waves=True).water(dj.Model(jointed, material=CONCRETE))
    y = 11.0 - water.places[:, 2]
    squares = volume * (11.0**3 - 1.0) / 3.0 + C**2 / STANDARD_GRAVITY * 20.0 * 12.0
    assert y @ (water.rows(0, water.size).mass @ y) == pytest.approx(RHO * squares)
    np.testing.assert_allclose(water.driven[:, 2].sum(), 0.0, atol=1e-9)  # a closed box


def meshed(corners, cells, groups, cell=None, place=None, **options):
    """Water with a mesh of its own; groups are planes."""
    bottom = [name for name in groups if name == "floor" or "bank" in name]
    jointed = box(corners, cells, cell, groups=groups, place=place, comm=MPI.COMM_SELF)
    return dj.MeshedReservoir(group="up", mesh=jointed, face="face", bottom=bottom, **options)


def test_meshed_water_is_the_moved_face_where_both_have_the_same_elements(comm):
    """Bilinear squares in a mesh of their own, in an order of their own."""
    groups = {"face": (0, 0.0), "floor": (1, 0.0), "far": (0, -2.0 * H)}
    extent = [[-2.0 * H, 0.0], [0.0, H]], [32, 16]
    water = meshed(*extent, groups, far_end="far", bottom_reflection=0.5)
    moved = dj.ReservoirWaves(group="up", level=H, length=2.0 * H, bottom_reflection=0.5, layers=32)
    forces = []
    for waves in (water, moved):
        kept = forces_kept()
        dj.Simulation(rigid_dam(comm, waves), monitors=[kept]).dynamics(
            dt=2e-3, steps=50, motion=lambda t: np.array([np.sin(9.0 * t), 0.0, np.sin(7.0 * t)])
        )
        forces.append(np.array([force for _, force in kept.rows]))
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-9 * np.abs(forces[1]).max())


def rising(x):
    """A floor that rises from the dam on and a face that leans."""
    place = x.copy()
    place[:, 2] = 10.0 - (10.0 - x[:, 2]) * (1.0 + 0.02 * x[:, 0] + 0.01 * x[:, 1])
    place[:, 0] = x[:, 0] + 0.2 * (10.0 - x[:, 2]) * (1.0 + x[:, 0] / 20.0)
    return place


@mpi
def test_a_linear_field_flows_through_a_floor_of_any_shape(comm):
    """Before a dam with other nodes on its face."""
    groups = {"face": (0, 0.0), "floor": (2, 0.0), "far": (0, -20.0)}
    groups |= {"left bank": (1, 0.0), "right bank": (1, 12.0)}
    extent = [[-20.0, 0.0, 0.0], [0.0, 12.0, 10.0]], [4, 3, 3]
    waves = meshed(*extent, groups, TETRAHEDRON, rising, far_end="far")
    bent = lambda x: rising(x * [0.0, 1.0, 1.0]) + x * [1.0, 0.0, 0.0]  # noqa: E731
    body = box([4.0, 12.0, 10.0], [1, 3, 3], TETRAHEDRON, groups=UP, place=bent, comm=comm)
    model = dj.Model(body, material=CONCRETE)
    water = waves.water(model)
    rows = water.rows(0, water.size)
    flux = rows.stiffness @ (water.places[:, 2] - 10.0)
    inner = water.places[:, 0] > water.places[:, 0].min() + 4.0  # the far end has its own flux
    expected = RHO * C**2 * water.driven[:, 2]
    assert 0 < inner.sum() < water.size
    np.testing.assert_allclose(flux[inner], expected[inner], atol=1e-9 * abs(expected).max())


def basin(height, length, cells, **options):
    """Closed water with a mesh of its own, twice as long as high or so."""
    groups = {"face": (0, 0.0), "floor": (1, 0.0), "far bank": (0, -length)}
    extent = [[-length, 0.0], [0.0, height]], [2 * cells, cells]
    return meshed(*extent, groups, gravity_waves=True, **options)


def moved(height, length, cells, far_end="rigid", **options):
    """The same by its face alone."""
    extent = {"level": height, "length": length, "layers": 2 * cells, "far_end": far_end}
    return dj.ReservoirWaves(group="up", gravity_waves=True, **extent, **options)


@mpi
@pytest.mark.parametrize(
    ("make", "gdim"), [(basin, 2), (moved, 2), (moved, 3)], ids=["mesh", "plane", "space"]
)
def test_waves_on_the_surface_of_a_basin(comm, make, gdim):
    """Squares of frequencies, in sound slow enough to change them by 7 %, are of second order."""
    length, depth, width, sound = 40.0, 10.0, 25.0, 30.0
    along, across = np.meshgrid(np.arange(5), np.arange(5 if gdim == 3 else 1))
    wave_numbers = np.sort(np.hypot(along * np.pi / length, across * np.pi / width).ravel())[1:5]

    def miss(square, k):
        inner = np.emath.sqrt(k**2 - square / sound**2)
        return square - (STANDARD_GRAVITY * inner * np.tanh(inner * depth)).real

    exact = [brentq(miss, 0.0, STANDARD_GRAVITY * k, args=(k,)) for k in wave_numbers]
    errors = []
    for cells in (6, 12):
        if gdim == 3:
            size, counts, cell = [4.0, width, 12.0], [1, cells, cells], TETRAHEDRON
        else:
            size, counts, cell = [4.0, 12.0], [1, cells], CellType.triangle
        # The level cuts cells of the body.
        dam = dj.Model(box(size, counts, cell, groups=UP, comm=comm), material=CONCRETE)
        water = make(depth, length, cells, sound_speed=sound).water(dam)
        rows = water.rows(0, water.size)
        found = eigsh(rows.stiffness, 5, rows.mass, sigma=-0.1, return_eigenvectors=False)
        errors.append(np.abs(np.sort(found)[1:] / exact - 1.0).max())
    assert errors[1] < 0.02
    assert errors[1] < errors[0] / 3.5


@pytest.mark.filterwarnings("ignore:.*sound_speed")
@mpi
@pytest.mark.parametrize("make", [basin, moved])
def test_force_of_waves_on_the_surface(comm, make):
    """Along the stream, below, between and above the frequencies of the first three."""
    length = 2.0 * H
    k = (2.0 * np.arange(400) + 1.0) * np.pi / length
    free = STANDARD_GRAVITY * k * np.tanh(k * H)
    omega = np.sqrt(free[0]) * np.array([0.3, 0.8, 1.2, 1.5, 2.5])
    square = omega[:, None] ** 2
    each = 4.0 * square * np.tanh(k * H) / (length * k**3 * (free - square))
    exact = -RHO * (length * H / 2.0 + each.sum(axis=1))
    model = rigid_dam(comm, make(H, length, 32, sound_speed=1e5), cells=32)
    found = dj.frequency_response(model, omega / (2.0 * np.pi), points={"crest": (0.0, H)})
    np.testing.assert_allclose(found.reservoir_force[:, 0], exact, rtol=0.01)


@mpi
@pytest.mark.parametrize("make", [basin, moved, partial(moved, far_end="radiating")])
def test_surface_over_a_floor_that_shakes_upwards(comm, make):
    """However slowly: the surface goes with the ground, and no pressure is left of that."""
    frequencies = np.array([0.01, 0.1, 0.5, 1.3, 2.2]) * FIRST
    k, steep = 2.0 * np.pi * frequencies / C, (2.0 * np.pi * frequencies) ** 2 / STANDARD_GRAVITY
    sine, cosine = np.sin(k * H), np.cos(k * H)
    # f = A cos k z + sin k z / k
    factor = (cosine - steep * sine / k - 1.0) / (k * sine + steep * cosine)
    exact = -RHO * (factor * sine / k + (1.0 - cosine) / k**2)
    model = rigid_dam(comm, make(H, H, 16))
    points = {"crest": (0.0, H)}
    found = dj.frequency_response(model, frequencies, points=points, direction=(0.0, 1.0))
    np.testing.assert_allclose(found.reservoir_force[:, 0], exact, rtol=0.02)


@pytest.fixture(scope="module")
def jointed_dam(wall_file, read):
    def make(on=None, gravity_waves=False, **options):
        waves = dj.ReservoirWaves(
            group="y_min",
            level=19.0,
            length=50.0,
            bottom_reflection=0.8,
            gravity_waves=gravity_waves,
        )
        return wall(read(wall_file(divisions=(8, 2, 6)), on), water=waves, **options)

    return make


@pytest.mark.filterwarnings("ignore:.*sound_speed")
def test_fast_sound_is_the_added_mass(comm):
    """A dam that bends, before water that hardly compresses, against `ReservoirMass`."""
    jointed = box([30.0, H], [3, 12], groups=UP | {"base": (1, 0.0)}, comm=comm)
    # The wall at the far end moves with the ground here and rests there: two thousandths of it.
    water = {"group": "up", "level": H, "length": 4.0 * H}
    waves = dj.ReservoirWaves(**water, sound_speed=1e5, far_end="rigid", layers=96)
    crests = []
    for before in (waves, dj.ReservoirMass(**water), None):
        model = dj.Model(
            jointed,
            material=CONCRETE,
            supports=[dj.Fixed(group="base")],
            water=before,
            body=dj.Body(degree=2),
        )
        kept = Crest(model)
        dj.Simulation(model, monitors=[kept]).dynamics(
            dt=5e-3, steps=200, motion=lambda t: np.array([np.sin(12.0 * t) ** 3, 0.0, 0.0])
        )
        crests.append(np.array(kept.values))
    error, effect = (np.abs(crests[i] - crests[1]).max() for i in (0, 2))
    assert error < 0.01 * np.abs(crests[1]).max()
    assert effect > 0.2 * np.abs(crests[1]).max()


@mpi
@pytest.mark.parametrize(
    ("solver", "gravity_waves"), [("condensed", False), ("condensed", True), ("monolithic", True)]
)
def test_jointed_dam_balances_its_energy(comm, jointed_dam, solver, gravity_waves):
    """The ledger with the energy and losses of the water closes, at joints that slide and open."""
    simulation = dj.Simulation(jointed_dam(gravity_waves=gravity_waves), solver=solver)
    simulation.statics()
    outcome = simulation.dynamics(dt=4e-3, steps=100, motion=shaking)
    assert outcome.energy_error < 1e-10
    assert outcome.imbalance < 1e-10
    last = outcome.energy
    assert min(last.friction, last.water, last.absorbed) > 0.0
    assert last.absorbed < last.viscous


@mpi
@pytest.mark.parametrize("gravity_waves", [False, True])
def test_results_do_not_depend_on_the_ranks(comm, jointed_dam, gravity_waves):
    def run(on):
        kept = forces_kept()
        simulation = dj.Simulation(jointed_dam(on, gravity_waves), monitors=[kept])
        simulation.statics()
        outcome = simulation.dynamics(dt=4e-3, steps=30, motion=shaking)
        forces = np.array([force for _, force in kept.rows])
        return forces, outcome.state.displacement.norm(), outcome.energy.water

    for found, expected in zip(run(comm), run(MPI.COMM_SELF), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_results_hold_force_and_energies(comm, jointed_dam, tmp_path):
    """The force is that of the pressures on the face."""
    path, kept = tmp_path / "waves.h5", forces_kept()
    monitor = dj.ResultsMonitor(path, points={"crest": (10.0, 0.0, 20.0)})
    model = jointed_dam()
    simulation = dj.Simulation(model, monitors=[monitor, kept])
    simulation.statics()
    outcome = simulation.dynamics(dt=4e-3, steps=20, motion=shaking)
    with dj.Results(path) as results:
        forces = results.series("histories", "reservoir_force")
        np.testing.assert_array_equal(forces, [force for _, force in kept.rows])
        lines = energy_lines(results)
        assert lines["water"][-1] == outcome.energy.water
        assert "bottom_reflection=0.8" in results.metadata["manifest"]["reservoir"]
        brought = results.series("energy", "loads/FarField_reservoir")
        absorbed = results.series("energy", "absorbed")
        np.testing.assert_array_equal(lines["waves"], brought - absorbed)
    pressures, water = model.coupled.pressure(outcome.state.velocity), model.coupled.water
    area = -water.driven[water.face, 1]  # of the banks and the floor nothing is along y
    assert forces[-1, 1] == pytest.approx(-pressures @ area, rel=1e-12)


def test_water_stays_at_rest_before_a_dam_at_rest(comm, jointed_dam):
    simulation = dj.Simulation(jointed_dam())
    simulation.statics()
    outcome = simulation.dynamics(dt=4e-3, steps=3)
    assert outcome.energy.water < 1e-12 * outcome.energy.strain


@mpi
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"level": 25.0}, "must reach up to the level"),
        ({"level": 0.0}, "no part of the face is below the level"),
        ({"absorbing_length": 60.0}, "must not exceed length"),
    ],
)
def test_errors(comm, wall_file, read, given, message):
    with pytest.raises(ValueError, match=message):
        wall(
            read(wall_file()),
            water=dj.ReservoirWaves(**{"group": "y_min", "level": 19.0, "length": 50.0} | given),
        )


@mpi
def test_water_that_is_not_before_the_dam(comm):
    groups = {"face": (0, -2.0), "floor": (1, 0.0)}
    water = meshed([[-50.0, 0.0], [-2.0, H]], [4, 4], groups)
    with pytest.raises(dj.MeshError, match=r"wet face at \(.*\) m is 2 m away from the water"):
        rigid_dam(comm, water)


@mpi
def test_water_with_waves_and_an_added_mass_is_doubted(comm, wall_file, read):
    waves = dj.ReservoirWaves(group="y_min", level=19.0, length=50.0)
    mass = dj.WestergaardMass(group="y_min", level=19.0)
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        model = wall(read(wall_file()), water=[mass, waves])
    expected = [
        "WestergaardMass on 'y_min': the mass of this water is counted twice, as the group "
    ]
    assert [text[: len(expected[0])] for text in model.doubts] == expected * (comm.rank == 0)


def test_what_waves_do_not_go_with(comm, jointed_dam):
    model = jointed_dam()
    run = {"dt": 4e-3, "steps": 1, "motion": shaking}
    with pytest.raises(dj.JointsError, match="cannot be used with reservoir waves"):
        dj.Simulation(model).dynamics(**run, scheme=dj.EnergyConsistent(exact_modes=4))
    by_forms = dj.Simulation(model, solver="forms")
    by_forms.statics()  # the water is at rest: the body alone
    with pytest.raises(dj.JointsError, match="does not support a reservoir with waves"):
        by_forms.dynamics(**run)
    options = dj.SolverOptions(linear="iterative")
    with pytest.raises(ValueError, match="does not support waves in"):
        dj.Simulation(model, options=options).dynamics(**run)
    given = dj.BaseMotion(acceleration=shaking)
    with pytest.raises(ValueError, match="need the velocity of the ground"):
        dj.Simulation(model).dynamics(dt=4e-3, steps=1, loads=[given])
