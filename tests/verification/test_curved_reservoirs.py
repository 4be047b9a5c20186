# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Water with a curved face and a mesh of its own, before rigid walls that are shaken slowly.

Nodes of wall and water differ. The water fills half a round canal in the plane, or half a round
tank, whose plane of symmetry is a rigid bound. Its mesh is a rectangle made round: the cells at the
corners of the rectangle have two facets on the curved face. Incompressible water without pressure
at the level, which a wall moves with the acceleration a, exerts the force (by separation)

    canal of radius R   rho a R^2 sum (pi / 2) c_k^2 / (2 k),  c_k = 8 k / (pi (4 k^2 - 1))
    tank, height H      rho a pi R / 2 sum (2 / (k^3 H)) I_1(k R) / I_1'(k R),
                        k = (2 n - 1) pi / (2 H)

and the sound of 1440 m/s changes it by some millionths at the frequency taken.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from rings import nodes_of_boxes
from scipy.special import ive

import dolfinx_joints as dj
from dolfinx_joints.mesh import closest_points
from dolfinx_joints.mesh.cells import CellShape, facet_slots

pytestmark = pytest.mark.mpi

R, RHO, SLOW = 10.0, 1000.0, 0.05  # [m], [kg/m^3], [Hz]
THICK = 1.0  # of the wall [m]
RIGID = dj.Elastic(young=1e16, poisson=0.2, density=2400.0)


def boxes(comm, cell, degree, counts, place, groups):
    """A mesh of boxes in the unit cube, moved; groups are sides, as (axis, 0 or 1)."""
    shape = CellShape(name=cell, degree=degree)
    counts = degree * np.array(counts)
    steps = np.meshgrid(*(np.arange(n + 1) for n in counts), indexing="ij")
    node = np.stack(steps, axis=-1)
    number = np.arange(node[..., 0].size).reshape(counts + 1)
    node = node.reshape(-1, shape.dim)
    first = node[np.all((node % degree == 0) & (node < counts), axis=1)]
    cells = np.concatenate(
        [number[tuple(np.moveaxis(first[:, None] + own, -1, 0))] for own in nodes_of_boxes(shape)]
    )
    facets = cells[:, shape.facet_vertices].reshape(-1, shape.facet_vertices.shape[1])
    found = {}
    for name, sides in groups.items():
        on = [np.all(node[facets, axis] == end * counts[axis], axis=1) for axis, end in sides]
        found[name] = np.unique(np.sort(facets[np.any(on, axis=0)], axis=1), axis=0)
    return dj.mesh_from_arrays(
        comm, cell=cell, x=place(node / counts), cells=cells, facet_groups=found
    )


def half_disc(unit):
    """The unit square as the half disc below: its sides x = 0, 1 and y = 1 make the arc."""
    s, t = 2.0 * unit[:, 0] - 1.0, unit[:, 1]
    return R * np.column_stack([s * np.sqrt(1.0 - t**2 / 2.0), -t * np.sqrt(1.0 - s**2 / 2.0)])


def arc(unit, radius):
    angle = np.pi * unit[:, 1]
    return (radius + THICK * unit[:, 0])[:, None] * np.column_stack([np.cos(angle), -np.sin(angle)])


ROUND = [(0, 0), (0, 1), (1, 1)]  # sides of the unit square that make the arc


def wall_and_water(comm, cell, degree, cells, place, radius, wall_cells, **options):
    """A model of ``cells`` of the water along R, and others of the wall along the arc and upwards.

    Coordinates are ``place`` of those in the plane of the arc and those in the unit cube.
    """
    upright = len(wall_cells) == 2
    bottom = ["floor"] if upright else []
    water = boxes(
        MPI.COMM_SELF,
        cell,
        degree,
        (2 * cells, cells, cells)[: 2 + upright],
        lambda unit: place(half_disc(unit), unit),
        {"face": ROUND, **{name: [(2, 0)] for name in bottom}},
    )
    wall = boxes(
        comm,
        cell,
        degree,
        (1, *wall_cells),
        lambda unit: place(arc(unit, radius), unit),
        {"wet": [(0, 0)], "outer": [(0, 1)]},
    )
    waves = dj.MeshedReservoir(group="wet", mesh=water, face="face", bottom=bottom, **options)
    fixed = [dj.Fixed(group="outer")]
    return dj.Model(wall, material=RIGID, supports=fixed, body=dj.Body(degree=1), water=waves)


def canal(comm, cell, degree, cells, radius=R, along=None, **options):
    """The arc is in the plane of gravity; 4 facets of the water per cell along R, 3 of the wall."""
    wall = (along or 3 * cells,)
    return wall_and_water(
        comm, cell, degree, cells, lambda plane, _: plane, radius, wall, **options
    )


def tank(comm, cell, degree, cells, radius=R, **options):
    """The arc is horizontal; heights of the layers of wall and water differ as well."""

    def place(plane, unit):
        return np.column_stack([plane, R * unit[:, 2]])

    wall = (3 * cells, cells - 1)
    return wall_and_water(comm, cell, degree, cells, place, radius, wall, **options)


def force(model):
    """Force of the water per acceleration along x."""
    points = {"wall": (R + THICK, *[0.0] * (model.gdim - 1))}
    return abs(dj.frequency_response(model, [SLOW], points=points).reservoir_force[0, 0])


def exact_canal():
    k = np.arange(1, 2000)
    coefficients = 8.0 * k / (np.pi * (4.0 * k**2 - 1.0))
    return RHO * R**2 * np.sum(np.pi / 4.0 * coefficients**2 / k)


def exact_tank():
    k = (2.0 * np.arange(1, 200) - 1.0) * np.pi / (2.0 * R)
    slope = (ive(0, k * R) + ive(2, k * R)) / 2.0  # of I_1, scaled as ive is
    return RHO * np.pi * R / 2.0 * np.sum(2.0 / (k**3 * R) * ive(1, k * R) / slope)


CASES = [
    (canal, exact_canal, (4, 8), "quadrilateral", (0.01, 5e-4)),
    (canal, exact_canal, (4, 8), "triangle", (0.03, 1e-3)),
    (tank, exact_tank, (3, 6), "hexahedron", (0.02, 1e-3)),
    (tank, exact_tank, (3, 6), "tetrahedron", (0.04, 2e-3)),
]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("make", "exact", "cells", "cell", "errors"), CASES)
def test_force_on_a_round_wall(comm, make, exact, cells, cell, errors, degree):
    """Of second order with cells of both degrees: the pressure is r log r where wall meets level.

    Curved cells have no chords: their errors are smaller by far.
    """
    coarse, fine = (abs(force(make(comm, cell, degree, n)) / exact() - 1.0) for n in cells)
    assert fine < errors[degree - 1]
    assert fine < coarse / 3.0


def test_some_cells_have_two_facets_on_the_face():
    """The cells that the tests of this file are about: two at the ends of the bottom."""
    water = canal(MPI.COMM_SELF, "quadrilateral", 1, 4).reservoir.mesh
    cells, _ = facet_slots(water.mesh, water.facets("face"))
    assert np.sum(np.bincount(cells) == 2) == 2


@pytest.mark.parametrize(("make", "area"), [(canal, 2.0 * R), (tank, 2.0 * R * R)])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_uniform_pressure_is_kept(comm, make, area, degree):
    """The wall's normals, which look at the water, add up to the open side, whatever its nodes."""
    cell = "quadrilateral" if make is canal else "hexahedron"
    model = make(comm, cell, degree, 3, gravity_waves=True)  # pressures at the level count
    coupling = model.coupled.water.coupling
    found = [coupling[:, axis :: model.gdim].sum() for axis in range(2)]
    np.testing.assert_allclose(found, [0.0, area], atol=1e-10 * area)


@pytest.mark.parametrize(("along", "cells"), [(6, 16), (48, 2)])
def test_chords_of_one_face_are_no_gap_before_short_facets_of_the_other(comm, along, cells):
    """Sides of 30 degrees leave the arc by 0.34 m, a third of the short facets."""
    assert force(canal(comm, "quadrilateral", 1, cells, along=along)) == pytest.approx(
        exact_canal(), rel=0.1
    )


@pytest.mark.parametrize("make", [canal, tank])
@pytest.mark.parametrize("gap", [-0.8, 0.8, 80.0])
def test_a_gap_is_refused_in_metres(comm, make, gap):
    """A wall of another radius, within the water or outside; curved cells follow the arcs."""
    cell = "quadrilateral" if make is canal else "hexahedron"
    with pytest.raises(dj.MeshError, match="m away from the water's face 'face'; ") as at:
        make(comm, cell, 2, 4, radius=R + gap).system()
    text = str(at.value)
    found = float(text.partition(") m is ")[2].split()[0])
    allowed = float(text.partition("'face'; the limit is ")[2].split()[0])
    place = [float(x) for x in text.partition("(")[2].partition(")")[0].split(",")]
    assert found == pytest.approx(abs(gap), rel=0.01)
    assert np.hypot(*place[:2]) == pytest.approx(R + gap, rel=0.001)
    assert allowed < abs(gap)


def test_a_small_gap_is_accepted(comm):
    """5 cm before facets of 1 m: the force is that of a canal with this radius, to 1 %."""
    model = canal(comm, "quadrilateral", 2, 8, radius=R + 0.05)
    assert force(model) == pytest.approx(exact_canal() * (1.0 + 0.05 / R) ** 2, rel=0.01)


def test_a_closest_point_that_is_not_found_is_an_error(comm, monkeypatch):
    monkeypatch.setattr(closest_points, "ITERATIONS", 1)
    with pytest.raises(
        dj.MeshError, match=r"on the water's face 'face' closest .* did not converge"
    ):
        canal(comm, "quadrilateral", 2, 4).system()
