# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady vibration against a rod's closed form, sums over modes, and runs in time.

A rod of height L, shaken along its axis, with e^{i w t}: E* u'' + rho w^2 u = rho a, free at the
top, so that y = u - a / w^2 = Y cos k(L - z), k^2 = rho w^2 / E*. E* is E (1 + 2 i zeta) or
E (1 + i w b). On a clamped base y = -a / w^2 there; on dashpots of the impedance s on ground that
moves, E* y' = i w s (y + a / w^2).

Average acceleration is the bilinear transform: the discrete Fourier transform of u over that of
the ground's acceleration at f is the response at tan(pi f dt) / (pi dt), exactly.
"""

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("slepc4py")

from mpi4py import MPI

import shaken_wall
from dolfinx.mesh import CellType, create_rectangle, locate_entities_boundary
from shaken_wall import CONCRETE, LAW

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor

mpi = pytest.mark.mpi

BAR = dj.Elastic(young=25e9, poisson=0.0, density=2400.0)
HEIGHT = 8.0
SIDES = dj.Fixed(group="sides", components="xy")
FREQUENCIES = np.linspace(10.0, 400.0, 14)  # the rod's own: 101 and 303 Hz
TOP = {"top": (0.0, 0.0, HEIGHT)}
UP = (0.0, 0.0, 1.0)


@pytest.fixture
def rod(blocks_file, read):
    sizes = {"lower_height": 4.0, "upper_height": 4.0, "size": 1.0, "angle": 0.0}
    jointed = read(blocks_file(order=2, **sizes), joints=[])

    def make(base, **options):
        return dj.Model(jointed, material=BAR, supports=[SIDES, base], **options)

    return make


def exact_top(modulus, impedance=np.inf):
    """Acceleration of the top over that of the ground."""
    omega = 2.0 * np.pi * FREQUENCIES
    k = omega * np.sqrt(BAR.density / modulus)
    sine, cosine = np.sin(k * HEIGHT), np.cos(k * HEIGHT)
    if np.isinf(impedance):
        return 1.0 / cosine
    dashpot = 1j * omega * impedance
    return dashpot / (dashpot * cosine - modulus * k * sine)


CLAMPED, DASHPOTS = dj.Fixed(group="base"), dj.ViscousBoundary(group="base")
RAYLEIGH = dj.stiffness_proportional(ratio=0.05, frequency=100.0)
VISCOUS = 2.0j * np.pi * FREQUENCIES * RAYLEIGH.stiffness_factor
IMPEDANCE = np.sqrt(BAR.young * BAR.density)


@mpi
@pytest.mark.parametrize(
    ("base", "damping", "hysteretic", "exact"),
    [
        (CLAMPED, None, 0.05, lambda: exact_top(BAR.young * (1.0 + 0.1j))),
        (CLAMPED, RAYLEIGH, 0.0, lambda: exact_top(BAR.young * (1.0 + VISCOUS))),
        (DASHPOTS, None, 0.0, lambda: exact_top(BAR.young, IMPEDANCE)),
    ],
    ids=["hysteretic", "Rayleigh", "viscous boundary"],
)
def test_rods(rod, base, damping, hysteretic, exact):
    options = {"points": TOP, "direction": UP, "hysteretic_ratio": hysteretic}
    found = dj.frequency_response(rod(base, damping=damping), FREQUENCIES, **options)
    np.testing.assert_allclose(found.acceleration("top")[:, 2], exact(), rtol=2e-3)


@pytest.mark.parametrize(("axis", "held"), [("x", "yz"), ("z", "xy")])
def test_rock_whose_sides_are_held_moves_as_the_outcrop(blocks_file, read, axis, held):
    """A wave that rises sees a half space, whose surface lags by k H as seen from the outcrop."""
    sizes = {"lower_height": 4.0, "upper_height": 4.0, "size": 1.0, "angle": 0.0}
    rock = dj.Elastic(young=25e9, poisson=0.25, density=2400.0)
    sides, base = dj.Fixed(group="sides", components=held), dj.ViscousBoundary(group="base")
    model = dj.Model(
        read(blocks_file(order=2, **sizes), joints=[]), material=rock, supports=[sides, base]
    )
    direction = np.eye(3)["xyz".index(axis)]
    found = dj.frequency_response(model, FREQUENCIES, points=TOP, direction=tuple(direction))
    modulus = (1.2 if axis == "z" else 0.4) * rock.young  # of P, 1 - nu over (1 + nu)(1 - 2 nu)
    lag = 2.0 * np.pi * FREQUENCIES * HEIGHT / np.sqrt(modulus / rock.density)
    np.testing.assert_allclose(found.acceleration("top") @ direction, np.exp(-1j * lag), rtol=2e-2)


def test_dashpots_at_the_sides_of_shaken_rock_are_doubted(rod):
    model = rod(dj.ViscousBoundary(group="sides"))
    said = r"dashpots at the sides of the rock \(sides\) disturb the rising wave\."
    with pytest.warns(dj.PlausibilityWarning, match=said):
        dj.frequency_response(model, [10.0], points=TOP)
    kept = []

    class Keeping(dj.Monitor):
        def finish(self, status, summary):
            kept.extend(summary["warnings"])

    with pytest.warns(dj.PlausibilityWarning, match=said) as shown:
        dj.Simulation(model, monitors=[Keeping()]).dynamics(
            dt=1e-3, steps=1, motion=lambda t: (t, 0.0, 0.0)
        )
    (once,) = [each for each in shown if "disturb" in str(each.message)]
    assert once.filename == __file__  # the line that gives the motion
    assert str(once.message) in kept
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dj.frequency_response(rod(dj.ViscousBoundary(group="base")), [10.0], points=TOP)
        dj.Simulation(model).dynamics(dt=1e-3, steps=1)


@pytest.mark.parametrize(
    ("depth", "bottom", "group", "said"),
    [
        (8.0, lambda x: 0.0 * x, "outer", True),  # shallow beside its length of 100 m
        (8.0, lambda x: 0.0 * x, "base", False),
        (40.0, lambda x: 0.2 * x, "base", False),
        (40.0, lambda x: 12.0 * ((x - 50.0) / 50.0) ** 2, "base", False),  # an arc, up to 1 in 2
    ],
)
def test_a_bottom_is_told_from_sides(comm, depth, bottom, group, said):
    mesh = create_rectangle(comm, [(0.0, -depth), (100.0, 0.0)], [20, 2], CellType.quadrilateral)
    base = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], -depth))
    ends = locate_entities_boundary(mesh, 1, lambda x: np.isclose(abs(x[0] - 50.0), 50.0))
    groups = {"base": base, "outer": np.unique(np.concatenate([base, ends]))}
    mesh.geometry.x[:, 1] *= 1.0 - bottom(mesh.geometry.x[:, 0]) / depth
    jointed = dj.split_mesh(mesh, joints={}, groups={group: groups[group]})
    model = dj.Model(jointed, material=BAR, supports=[dj.ViscousBoundary(group=group)])
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        dj.frequency_response(model, [10.0], points={"top": (50.0, 0.0)}, direction=(1.0, 0.0))
    told = [w for w in found if issubclass(w.category, dj.PlausibilityWarning)]
    assert len(told) == (said and comm.rank == 0)


@pytest.fixture
def wall(wall_file, comm):
    """The jointed wall, its modes damped and the rest by mass."""

    def make(on=comm, damping=None):
        damping = damping or dj.ModalRatios(
            ratio=(0.3, 0.25, 0.2), modes=3, beyond=dj.Rayleigh(mass_factor=15.0)
        )
        return shaken_wall.wall(dj.read_msh(wall_file(), on), BONDED, damping=damping)

    return make


STIFFNESS = {"normal_stiffness": 1e11, "shear_stiffness": 1e11}
BONDED = dj.MohrCoulombJoint(
    **STIFFNESS, friction_angle_deg=30.0, cohesion=1e9, tensile_strength=1e9
)
CREST = {"crest": (0.0, 4.0, 20.0)}
ALONG = (0.6, 0.8, 0.0)


@mpi
def test_the_sum_of_all_modes_is_the_solution(wall):
    """With C that couples them, and a factor of K."""
    model, frequencies = wall(), [1.0, 7.0, 20.0]
    options = {"points": CREST, "direction": ALONG, "hysteretic_ratio": 0.05}
    direct = dj.frequency_response(model, frequencies, **options).displacement["crest"]
    every = model.num_dofs - 3 * sum(model.jointed.mesh.comm.allgather(len(model.nodes("base"))))
    summed = dj.frequency_response(model, frequencies, modes=every, **options)
    error = np.abs(summed.displacement["crest"] - direct).max()
    assert error < 1e-7 * np.abs(direct).max()
    few = dj.frequency_response(model, frequencies, modes=8, **options).displacement["crest"]
    assert error < np.abs(few - direct).max() < 0.05 * np.abs(direct).max()


class Crest(Monitor):
    """Displacements at the crest over the steps, on rank 0."""

    def __init__(self, model):
        self._model, self.values = model, []

    def start(self, model, stage, steps, first):
        self.record(first)

    def record(self, record):
        from dolfinx_joints.body.places import nearest_nodes

        _, near = nearest_nodes(self._model.jointed, self._model.V, CREST["crest"])
        mine = record.displacement.getArray().reshape(-1, 3)[near].sum(axis=0)
        self.values.append(np.sum(self._model.jointed.mesh.comm.allgather(mine), axis=0))


def test_a_run_in_time_has_this_response(wall):
    """Bonded joints under a pulse, at two frequencies, to what is left at the end."""
    model, dt, steps = wall(), 2.0**-8, 640
    pulse = lambda t: 1e-3 * np.exp(-(((t - 0.1) / 0.03) ** 2)) * np.array(ALONG)  # noqa: E731
    kept = Crest(model)
    simulation = dj.Simulation(model, monitors=[kept])
    simulation.statics()
    simulation.dynamics(dt=dt, steps=steps, motion=pulse, scheme=dj.Newmark())
    moved = np.array(kept.values) - kept.values[0]
    times = dt * np.arange(len(moved))
    assert np.abs(moved[-1]).max() < 1e-6 * np.abs(moved).max()
    frequencies = np.array([3.0, 11.0])
    waves = np.exp(-2j * np.pi * np.outer(frequencies, times))
    found = (waves @ moved) / (waves @ [np.linalg.norm(pulse(t)) for t in times])[:, None]
    turned = np.tan(np.pi * frequencies * dt) / (np.pi * dt)
    expected = dj.frequency_response(model, turned, points=CREST, direction=ALONG)
    error = np.abs(found - expected.displacement["crest"]).max()
    assert error < 1e-5 * np.abs(found).max()


@mpi
def test_ranks_agree(wall):
    one, all_of_them = (
        dj.frequency_response(wall(on), [2.0, 9.0], points=CREST).displacement["crest"]
        for on in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    np.testing.assert_allclose(one, all_of_them, atol=1e-9 * np.abs(one).max())


@mpi
def test_errors(wall):
    model = wall()
    with pytest.raises(dj.MeshError, match="The point 'far' is"):
        dj.frequency_response(model, [1.0], points={"far": (0.0, 0.0, 90.0)})
    with pytest.raises(ValueError, match="direction is .*; it must be 3 finite numbers"):
        dj.frequency_response(model, [1.0], points=CREST, direction=(1.0, 0.0))
    with pytest.raises(ValueError, match="direction is zero"):
        dj.frequency_response(model, [1.0], points=CREST, direction=np.zeros(3))
    with pytest.raises(ValueError, match="points is .*; it must be coordinates by name"):
        dj.frequency_response(model, [1.0], points=[(0.0, 0.0, 0.0)])
    moving = dj.Prescribed(group="base", component="x", value=lambda t: t)
    model = dj.Model(model.jointed, material=CONCRETE, joints=LAW, supports=[moving])
    with pytest.raises(dj.JointsError, match="supports must not move"):
        dj.frequency_response(model, [1.0], points=CREST)
