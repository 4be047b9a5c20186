# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns and blocks of rock on viscous boundaries against travelling waves.

A wave that arrives along the normal leaves through dashpots rho c; a wave v(t) that rises from the
base moves the free surface, H above it, by 2 v(t - H/c), and comes back. Cells are a twentieth of
the pulse long, or a tenth where they are quadratic.

Measured: of the energy of a pulse
that arrives the bottom sends back 7e-8 with quadratic cells and 4e-6 with linear ones, P and S
alike; the free surface is within 0.3 % of 2 v(t - H/c) in a column, and within 0.4 % everywhere on
a block with the free field on its sides, where dashpots with the wave at the bottom alone leave
80 to 100 %.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows, box, largest
from dolfinx.mesh import CellType

import dolfinx_joints as dj

pytestmark = pytest.mark.mpi

ROCK = dj.Elastic(young=6e9, poisson=0.25, density=2400.0)
SHEAR = math.sqrt(ROCK.shear_modulus / ROCK.density)  # 1000 m/s
PRESSURE = math.sqrt((ROCK.first_lame("strain") + 2 * ROCK.shear_modulus) / ROCK.density)
HEIGHT = 100.0


def ground(comm, cell, size, divisions, parts=None):
    """A box from the origin with the groups base, top and x_min, x_max, y_min, y_max.

    And with cell groups from one height to another, if ``parts`` has these by name.
    """
    last = len(size) - 1
    groups = {"base": (last, 0.0), "top": (last, size[-1])}
    for axis in range(last):
        groups |= {f"{'xy'[axis]}_min": (axis, 0.0), f"{'xy'[axis]}_max": (axis, size[axis])}
    return box(size, divisions, cell, groups=groups, cells=parts or {}, comm=comm)


def pulse(length):
    """(1 - cos)^2 / 4 over a time [s], three times differentiable."""
    return lambda t: math.sin(math.pi * t / length) ** 4 if 0.0 < t < length else 0.0


def sides_of(jointed):
    return [name for name in jointed.facet_groups if name[1:] in ("_min", "_max")]


def one_way(jointed, axis):
    """Supports of the sides that let a column move along one axis only."""
    others = "".join(c for c in "xyz"[: jointed.mesh.geometry.dim] if c != "xyz"[axis])
    return [
        dj.Fixed(group=group, components=others) for group in (*sides_of(jointed), "top", "base")
    ]


COLUMNS = [
    ("quad", CellType.quadrilateral, 2, 20, 2),
    ("quad1", CellType.quadrilateral, 2, 40, 1),
    ("tri", CellType.triangle, 2, 40, 1),
    ("hex", CellType.hexahedron, 3, 20, 2),
    ("tet", CellType.tetrahedron, 3, 40, 1),
]
# What ranks can change is the same for all of them.
MANY = MPI.COMM_WORLD.size > 1
COLUMNS = COLUMNS[:1] if MANY else COLUMNS
WAVES = ["S"] if MANY else ["P", "S"]
HEXAHEDRON = pytest.param(CellType.hexahedron, marks=pytest.mark.slow)
BLOCKS = [CellType.triangle, CellType.quadrilateral, HEXAHEDRON][: 1 if MANY else 3]


def reflected(comm, cell, dim, cells, degree, wave):
    """Energy left once a pulse from the top has met the bottom, over that of the pulse."""
    size = [HEIGHT / cells] * (dim - 1) + [HEIGHT]
    jointed = ground(comm, cell, size, [1] * (dim - 1) + [cells])
    axis, speed = (dim - 1, PRESSURE) if wave == "P" else (0, SHEAR)
    length = 0.5 * HEIGHT / speed
    push = dj.Traction(group="top", value=1e5 * np.eye(dim)[axis], factor=pulse(length))
    supports = [dj.ViscousBoundary(group="base"), *one_way(jointed, axis)]
    model = dj.Model(jointed, material=ROCK, supports=supports, body=dj.Body(degree=degree))
    dt = length / 100.0
    on_the_way = dj.Simulation(model).dynamics(dt=dt, steps=150, loads=[push])
    # The front is down after 200 steps, the end after 300; a reflection is up again after 400.
    after = dj.Simulation(model).dynamics(dt=dt, steps=360, loads=[push])
    assert after.imbalance < 1e-9
    assert after.energy.viscous == pytest.approx(after.energy.input, rel=0.01)
    return after.energy.stored / on_the_way.energy.stored


@pytest.mark.parametrize("wave", WAVES)
@pytest.mark.parametrize("column", COLUMNS, ids=lambda c: c[0])
def test_arriving_pulse_is_absorbed(comm, column, wave):
    assert reflected(comm, *column[1:], wave) < 0.01


def rising(axis, dim, length, amplitude=0.1):
    shape = pulse(length)
    return lambda t: amplitude * shape(t) * np.eye(dim)[axis]


def surface_error(model, wave_axis, length, groups):
    """Largest difference of the free surface to 2 v(t - H/c), over the largest 2 v."""
    dim = model.gdim
    speed = PRESSURE if wave_axis == dim - 1 else SHEAR
    incident = rising(wave_axis, dim, length)
    field = dj.FreeField(groups=groups, incident=incident, surface=HEIGHT)
    nodes = model.nodes("top")
    top = Rows(lambda record: (record.time, record.velocity.array.reshape(-1, dim)[nodes]))
    dt = length / 100.0
    steps = int((2 * HEIGHT / speed + length) / dt) + 40
    outcome = dj.Simulation(model, monitors=[top]).dynamics(dt=dt, steps=steps, loads=[field])
    assert outcome.imbalance < 1e-9
    times, velocities = (np.array(column) for column in zip(*top.rows, strict=True))
    exact = np.array([2.0 * incident(t - HEIGHT / speed) for t in times])
    return largest(velocities - exact[:, None, :]) / 0.2, outcome


def column_error(comm, wave):
    """Error of the surface of a column whose sides let it move along one axis."""
    jointed = ground(comm, CellType.quadrilateral, [5.0, HEIGHT], [1, 20])
    axis = 1 if wave == "P" else 0
    supports = [dj.ViscousBoundary(group="base"), *one_way(jointed, axis)]
    model = dj.Model(jointed, material=ROCK, supports=supports, body=dj.Body(degree=2))
    length = 0.5 * HEIGHT / (PRESSURE if wave == "P" else SHEAR)
    return surface_error(model, axis, length, ["base"])


@pytest.mark.parametrize("wave", WAVES)
def test_free_surface_of_a_column(comm, wave):
    """And the wave that came back from the surface has left by the bottom in the end."""
    error, outcome = column_error(comm, wave)
    assert error < 0.01
    assert outcome.energy.stored < 1e-3 * outcome.energy.input


def on_dashpots(jointed, material=ROCK):
    """A model on dashpots all around, and their groups."""
    groups = ["base", *sides_of(jointed)]
    supports = [dj.ViscousBoundary(group=group) for group in groups]
    return dj.Model(jointed, material=material, supports=supports, body=dj.Body(degree=2)), groups


def block_error(comm, cell, wave):
    """Error of the surface of a block on dashpots, with the free field and with the bottom's."""
    size, divisions = ([60.0, HEIGHT], [12, 20])
    if cell == CellType.hexahedron:
        size, divisions = ([20.0, 10.0, HEIGHT], [4, 2, 20])
    jointed = ground(comm, cell, size, divisions)
    model, groups = on_dashpots(jointed)
    axis = len(size) - 1 if wave == "P" else 0
    length = 0.5 * HEIGHT / (PRESSURE if wave == "P" else SHEAR)
    return [surface_error(model, axis, length, which)[0] for which in (groups, ["base"])]


@pytest.mark.parametrize("wave", WAVES)
@pytest.mark.parametrize("cell", BLOCKS)
def test_free_surface_of_a_block(comm, cell, wave):
    """Sides on dashpots with the free field: the whole surface moves as that of the column."""
    error, alone = block_error(comm, cell, wave)
    assert error < 0.01
    assert alone > 0.1
