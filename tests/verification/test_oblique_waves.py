# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rock without a dam under free fields: oblique plane waves, and level layers.

Oblique: a part of a homogeneous half space on dashpots must move as the half space does, by the
incident wave and what its surface reflects. Coefficients are those of Aki and Richards,
*Quantitative Seismology* (1980), equations (5.26) to (5.30), of displacements in the directions
given there.

Layers: on a half space of impedance Z1 lies a layer Z2. A wave v that arrives at the surface after
the time t1 + t2 moves it by the echoes 2 T sum over n of R^n v(t - t1 - t2 - 2 n t2), with
T = 2 Z1 / (Z1 + Z2) and R = (Z2 - Z1) / (Z1 + Z2).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows, largest
from dolfinx.mesh import CellType
from shaken_wall import Killed, Killer

import dolfinx_joints as dj
from dolfinx_joints.loads.column import Column
from tests.verification.test_absorbing import PRESSURE, ROCK, SHEAR, ground, on_dashpots

LENGTH, SIZE = 0.1, 0.2  # of the pulse [s], [m/s]
# What ranks can change is the same for all meshes and waves.
MANY = MPI.COMM_WORLD.size > 1


def pulse(time):
    """sin^4, three times differentiable."""
    return SIZE * np.sin(np.pi * np.clip(time, 0.0, LENGTH) / LENGTH) ** 4


def reflected(wave, p):
    """Sizes of the P and SV waves that a free surface reflects, of slowness p."""
    a, b = PRESSURE, SHEAR
    cos_i, cos_j = math.sqrt(1.0 - (p * a) ** 2), math.sqrt(1.0 - (p * b) ** 2)
    across, both = 1.0 / b**2 - 2.0 * p**2, 4.0 * p**2 * cos_i / a * cos_j / b
    whole = across**2 + both
    if wave == "P":
        return (both - across**2) / whole, 4.0 * a / b * p * cos_i / a * across / whole
    return 4.0 * b / a * p * cos_j / b * across / whole, (across**2 - both) / whole


def plane_waves(wave, angle, way):
    """(d, s) of all waves, along (way, up)."""
    p = math.sin(angle) / (PRESSURE if wave == "P" else SHEAR)
    sin_i, sin_j = p * PRESSURE, p * SHEAR
    cos_i, cos_j = math.sqrt(max(1.0 - sin_i**2, 0.0)), math.sqrt(1.0 - sin_j**2)
    if wave == "P":
        incident = (np.array([sin_i, cos_i]), np.array([p, cos_i / PRESSURE]))
    else:
        incident = (np.array([cos_j, -sin_j]), np.array([p, cos_j / SHEAR]))
    of_p, of_s = reflected(wave, p)
    found = [
        incident,
        (of_p * np.array([sin_i, -cos_i]), np.array([p, -cos_i / PRESSURE])),
        (of_s * np.array([cos_j, sin_j]), np.array([p, -cos_j / SHEAR])),
    ]
    turned = np.array([way, 1.0])
    return [(d * turned, s * turned) for d, s in found]


def march(comm, size, divisions, dt, end, load, material=ROCK, parts=None):
    """Nodes, times, velocities of the nodes and the free surface, on dashpots all around."""
    cell = CellType.quadrilateral if len(size) == 2 else CellType.hexahedron
    model, groups = on_dashpots(ground(comm, cell, size, divisions, parts), material)
    gdim = model.gdim
    seen = Rows(
        lambda record: (
            record.time,
            record.velocity.array.reshape(-1, gdim).copy(),
            record.free_surface(record.time),
        )
    )
    steps = round(end / dt)
    outcome = dj.Simulation(model, monitors=[seen]).dynamics(
        dt=dt, steps=steps, loads=[load(groups)]
    )
    assert outcome.imbalance < 1e-11
    times, velocities, free = (np.array(column) for column in zip(*seen.rows, strict=True))
    x = model.V.tabulate_dof_coordinates()[: velocities.shape[1], :gdim]
    return x, times, velocities, free


WIDTH, HEIGHT = 60.0, 60.0


def oblique_error(comm, wave, angle_deg, azimuth_deg, cells):
    """Largest difference to the half space, over the size of the incident wave."""
    way = 1.0 if azimuth_deg == 0.0 else -1.0

    def load(groups):
        return dj.ObliqueFreeField(
            groups=groups,
            wave=wave,
            angle_deg=angle_deg,
            azimuth_deg=azimuth_deg,
            incident=pulse,
            surface=HEIGHT,
        )

    dt = LENGTH / (10 * cells)
    x, t, v, free = march(comm, [WIDTH, HEIGHT], [cells, cells], dt, 0.25, load)
    waves = plane_waves(wave, math.radians(angle_deg), way)
    first = min(0.0, waves[0][1][0] * WIDTH)  # phase of the corner that is reached first
    up = np.array([0.0, HEIGHT])
    exact, above = np.zeros_like(v), np.zeros((len(t), 2))
    for d, s in waves:
        start = first + (s - waves[0][1]) @ up  # the same phase at the surface
        exact += pulse(t[:, None] - x @ s + start)[..., None] * d
        above += pulse(t - (s @ np.array([WIDTH / 2, HEIGHT]) - start))[:, None] * d
    np.testing.assert_allclose(free[:, :2], above, atol=1e-12)
    return largest(v - exact) / SIZE


@pytest.mark.parametrize(
    ("wave", "angle", "azimuth"), [("P", 35.0, 0.0), ("SV", 25.0, 180.0), ("P", 60.0, 180.0)]
)
def test_an_oblique_wave_passes_as_in_the_half_space(comm, wave, angle, azimuth):
    """Order 2 of mesh and step together."""
    coarse, fine = (oblique_error(comm, wave, angle, azimuth, cells) for cells in (6, 12))
    assert fine < 0.01
    assert coarse > 3.0 * fine


def test_an_sh_wave_passes_as_in_the_half_space(comm):
    """In space, along 30 degrees to the left of x: d (v(t - s.x) + v(t - s'.x))."""
    size, slope, way = [20.0, 10.0, 40.0], math.radians(40.0), math.radians(30.0)

    def load(groups):
        return dj.ObliqueFreeField(
            groups=groups, wave="SH", angle_deg=40.0, azimuth_deg=30.0, incident=pulse, surface=40.0
        )

    x, t, v, _ = march(comm, size, [4, 2, 8], 1e-3, 0.2, load)
    ahead = np.array([math.cos(way), math.sin(way)]) * math.sin(slope) / SHEAR
    late, up = t[:, None] - x[:, :2] @ ahead, math.cos(slope) / SHEAR
    speed = pulse(late - x[:, 2] * up) + pulse(late - (2.0 * size[2] - x[:, 2]) * up)
    exact = speed[..., None] * np.array([-math.sin(way), math.cos(way), 0.0])
    assert largest(v - exact) < 0.01 * SIZE


@pytest.mark.mpi
def test_a_wave_that_rises_vertically_is_the_free_field(comm):
    """P and S together, but for the cubics between levels, which err by 1e-5 of such a pulse."""
    oblique = {"angle_deg": 0.0, "incident": pulse, "surface": 20.0}

    def found(make):
        model, groups = on_dashpots(ground(comm, CellType.quadrilateral, [20.0, 20.0], [4, 4]))
        return dj.Simulation(model).dynamics(dt=2e-3, steps=35, loads=make(groups)).state.velocity

    plain = found(
        lambda groups: [
            dj.FreeField(groups=groups, incident=lambda t: (pulse(t), pulse(t)), surface=20.0)
        ]
    )
    both = found(
        lambda groups: [
            dj.ObliqueFreeField(groups=groups, wave=wave, **oblique) for wave in ("P", "SV")
        ]
    )
    both.axpy(-1.0, plain)
    assert both.norm() < 2e-5 * plain.norm()


SOFT = dj.Elastic(young=1.5e9, poisson=0.3, density=2000.0)
DEEP, TOP = 40.0, 60.0  # heights of the layer's bottom and of the surface [m]


def speed_of(solid, axis):
    modulus = solid.shear_modulus + axis * (solid.first_lame("strain") + solid.shear_modulus)
    return math.sqrt(modulus / solid.density)


def layer_error(comm, axis, cells):
    """Largest difference of the surface to the echoes in a layer, over 2 v."""

    def load(groups):
        wave = lambda t: pulse(t) * np.eye(2)[axis]  # noqa: E731
        return dj.FreeField(groups=groups, incident=wave, surface=TOP)

    x, t, v, free = march(
        comm,
        [20.0, TOP],
        [cells, 3 * cells],
        LENGTH / (20 * cells),
        0.35,
        load,
        {"rock": ROCK, "soil": SOFT},
        {"rock": (0.0, DEEP), "soil": (DEEP, TOP)},
    )
    slow, fast = speed_of(SOFT, axis), speed_of(ROCK, axis)
    below, above = ROCK.density * fast, SOFT.density * slow
    through, back = 2.0 * below / (below + above), (above - below) / (below + above)
    late, echo = DEEP / fast + (TOP - DEEP) / slow, 2.0 * (TOP - DEEP) / slow
    exact = sum(2.0 * through * back**n * pulse(t - late - n * echo) for n in range(12))
    np.testing.assert_allclose(free[:, axis], exact, atol=1e-5 * SIZE)
    surface = v[:, np.isclose(x[:, 1], TOP)]
    return largest(surface - exact[:, None, None] * np.eye(2)[axis]) / (2.0 * SIZE)


@pytest.mark.mpi
@pytest.mark.parametrize("axis", [0] if MANY else [0, 1], ids=["S", "P"][: 1 if MANY else 2])
def test_a_layer_on_rock_echoes(comm, axis):
    """Order 2 of mesh and step together."""
    coarse = layer_error(comm, axis, 2)
    assert coarse < 0.02
    if not MANY:
        assert layer_error(comm, axis, 4) < coarse / 3.0


def test_an_interrupted_run_goes_on(comm, new_path):
    """With waves in layers and an oblique one, to rounding: BLAS sums by where its vectors lie."""
    parts = {"rock": (0.0, 20.0), "soil": (20.0, 30.0)}
    jointed = ground(comm, CellType.quadrilateral, [20.0, 30.0], [4, 6], parts)
    kept = dj.Checkpoints(new_path("waves.ckpt"), every=4)

    def run(*monitors, **options):
        model, groups = on_dashpots(jointed, {"rock": ROCK, "soil": SOFT})
        rising = dj.FreeField(groups=groups, incident=lambda t: (pulse(t), 0.0), surface=30.0)
        oblique = dj.ObliqueFreeField(
            groups=["base"], wave="P", angle_deg=10.0, incident=pulse, surface=30.0
        )
        simulation = dj.Simulation(model, monitors=monitors)
        return simulation.dynamics(dt=5e-3, steps=20, loads=[rising, oblique], **options)

    whole = run().state
    with pytest.raises(Killed):
        run(Killer(11), checkpoint=kept)
    again = run(Killer(), checkpoint=replace(kept, resume=True)).state
    for name in ("displacement", "velocity"):
        goal, found = getattr(whole, name).array, getattr(again, name).array
        np.testing.assert_allclose(found, goal, rtol=0, atol=1e-14 * np.abs(goal).max())


def test_four_layers_against_transfer_functions():
    """From the surface down in frequency: the waves of a layer follow from those above it."""
    impedances, travels, samples = [8e6, 1e6, 3e6, 5e5], [0.03, 0.011, 0.023, 0.004], 2**17
    dt = 2e-4
    column = Column(lambda t: float(pulse(t)), impedances, travels, dt)
    times = dt * np.arange(samples)
    omega = 2.0 * np.pi * np.fft.rfftfreq(samples, dt)
    rising, falling = [np.exp(1j * omega * travels[-1])], [np.exp(-1j * omega * travels[-1])]
    for above, below, travel in zip(
        impedances[:0:-1], impedances[-2::-1], travels[-2::-1], strict=True
    ):
        speed, stress = rising[-1] + falling[-1], (rising[-1] - falling[-1]) * above / below
        rising.append(0.5 * (speed + stress) * np.exp(1j * omega * travel))
        falling.append(0.5 * (speed - stress) * np.exp(-1j * omega * travel))
    spectrum = np.fft.rfft(pulse(times)) / rising[-1]  # of the surface, half of its velocity
    for layer in range(4):
        number = 3 - layer
        for waves, found, late in (
            (rising, column.rising, 0.0),
            (falling, column.falling, travels[layer]),
        ):
            expected = np.fft.irfft(waves[number] * spectrum * np.exp(1j * omega * late), samples)
            shown = [found(layer, float(t)) for t in times[:2000]]
            np.testing.assert_allclose(shown, expected[:2000], atol=2e-7 * SIZE)


@pytest.mark.mpi
def test_what_is_no_such_wave(comm):
    for dim, options, message in (
        (2, {"wave": "SV", "angle_deg": 36.0}, r"critical angle of 35\.26, above which"),
        (2, {"wave": "SH", "angle_deg": 10.0}, "in 2-D, wave must be P or SV and azimuth_deg 0"),
        (2, {"wave": "P", "angle_deg": 10.0, "azimuth_deg": 45.0}, "azimuth_deg 45; in 2-D"),
        (3, {"wave": "P", "angle_deg": 10.0, "groups": ["base", "top"]}, "'top' has no viscous"),
    ):
        cell = CellType.quadrilateral if dim == 2 else CellType.hexahedron
        jointed = ground(comm, cell, [1.0] * dim, [1] * dim)
        model = dj.Model(jointed, material=ROCK, supports=[dj.ViscousBoundary(group="base")])
        given = {"groups": ["base"], "incident": pulse, "surface": 1.0} | options
        with pytest.raises(ValueError, match=message):
            dj.ObliqueFreeField(**given).patterns(model)
    parts = {"rock": (0.0, 1.0), "soil": (1.0, 2.0)}
    jointed = ground(comm, CellType.quadrilateral, [1.0, 2.0], [1, 2], parts)
    groups = ["base", "x_min"]
    model = dj.Model(
        jointed,
        material={"rock": ROCK, "soil": SOFT},
        supports=[dj.ViscousBoundary(group=group) for group in groups],
    )
    wave = {"wave": "P", "angle_deg": 10.0, "incident": pulse, "surface": 2.0}
    with pytest.raises(ValueError, match="base, x_min has 2 layers; it must be one material"):
        dj.ObliqueFreeField(groups=groups, **wave).patterns(model)
