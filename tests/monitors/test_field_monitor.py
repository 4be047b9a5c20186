# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView against the results file and against equilibrium, on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import CONCRETE, DT, LAW, POINTS, shaking, valley, wall
from vtk_files import on_root, read_vtk
from whole_vectors import all_of

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.field_monitor import joint_grid_of_rank
from dolfinx_joints.monitors.joint_rows import JointRows

pytestmark = pytest.mark.mpi

WARMER, FACTOR = 20.0, 0.5  # [K], [-]


def test_stresses_balance_the_weight_whatever_the_temperature(comm, wall_file, read, new_path):
    """The mean of zz in a layer of equal hexahedra is that of the weight above its middle.

    This follows from virtual displacements that are zero below the layer, constant above, linear
    in it: exact for trilinear cells, with closed vertical joints. Temperatures do no work on them
    over a whole layer, as what they press is taken off.
    """
    path = new_path("warm.vtkhdf")
    warm = dj.Temperature(
        value=lambda x: 10.0 + WARMER * x[0] / 20.0,
        reference=10.0,
        expansion=1e-5,
        factor=lambda _: FACTOR,
    )
    model = wall(read(wall_file()), loads=[dj.Gravity(), warm])
    simulation = dj.Simulation(model, monitors=[dj.FieldMonitor(path)])
    simulation.statics()

    def look():
        ((_, grid),) = read_vtk(path.with_name(f"{path.stem}_stages.vtkhdf"))
        middle = grid.cell_centers().points
        stress = grid.cell_data["stress [Pa]"]
        for z in np.unique(middle[:, 2].round(9)):
            layer = np.isclose(middle[:, 2], z)
            above = CONCRETE.density * STANDARD_GRAVITY * (20.0 - z)
            assert stress[layer, 2].mean() == pytest.approx(-above, rel=1e-9)
        change = grid.cell_data["temperature change [K]"]
        np.testing.assert_allclose(change, FACTOR * WARMER * middle[:, 0] / 20.0, rtol=1e-12)
        for name, pick in (("largest", np.max), ("smallest", np.min)):
            xx, yy, zz, xy, yz, xz = stress[0]
            tensor = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
            value = grid.cell_data[f"{name} principal stress [Pa]"][0]
            assert value == pytest.approx(pick(np.linalg.eigvalsh(tensor)), rel=1e-12)

    on_root(comm, look)


@pytest.mark.parametrize(
    ("plane", "cell", "order"), [("strain", "quad", 1), ("strain", "tri", 2), ("stress", "quad", 2)]
)
def test_plane_body(comm, two_rectangles_file, read, new_path, plane, cell, order):
    """A column between a pressure q and its base, warm and free to widen, by hand.

    yy = -q, xx = 0, and where it cannot widen across its plane zz = -nu q - E alpha dT. The joint,
    1 m above the base, sinks with the lower block and by half of its own compression q/k_n.
    """
    q, path, warmth = 2e6, new_path("plane.vtkhdf"), 1e-5 * WARMER
    model = wall(
        read(two_rectangles_file(cell=cell, order=order, angle=0.0)),
        body=dj.Body(plane=plane),
        supports=[
            dj.Fixed(group="base", components="y"),
            dj.Spring(group="sides", normal_stiffness=1.0),
        ],
        loads=[
            dj.Pressure(group="top", value=q),
            dj.Temperature(value=10.0 + WARMER, reference=10.0, expansion=1e-5),
        ],
    )
    simulation = dj.Simulation(model, monitors=[dj.FieldMonitor(path)])
    simulation.statics()
    E, nu = CONCRETE.young, CONCRETE.poisson
    zz = -nu * q - E * warmth if plane == "strain" else 0.0
    sinks = (-q - nu * zz) / E + warmth - 0.5 * q / LAW.normal_stiffness

    def look():
        ((_, body),) = read_vtk(path.with_name(f"{path.stem}_stages.vtkhdf"))
        stress = body.cell_data["stress [Pa]"]
        wanted = np.tile([0.0, -q, zz, 0.0, 0.0, 0.0], (len(stress), 1))
        np.testing.assert_allclose(stress, wanted, rtol=1e-6, atol=1e-6 * q)
        ((_, joint),) = read_vtk(path.with_name(f"{path.stem}_stages_joints.vtkhdf"))
        np.testing.assert_allclose(joint.points[:, 1], 1.0)
        np.testing.assert_allclose(joint.point_data["displacement [m]"][:, 1], sinks, rtol=1e-6)

    on_root(comm, look)


WATER = dj.ReservoirWaves(group="y_min", level=18.5, length=30.0, bottom_reflection=0.7)


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
@pytest.mark.parametrize(
    ("waves", "volume"),
    [
        (lambda: WATER, 18.5 * 30.0 * 20.0),
        (lambda: replace(WATER, gravity_waves=True), 18.5 * 30.0 * 20.0),
        (valley, 60.0 * 20.0 * 16.35),
    ],
)
def test_pressure_in_the_reservoir(comm, wall_file, read, new_path, waves, volume):
    """p = -rho dphi/dt: all pressures in time make the potential; those on the face the force."""
    path, run, steps = new_path("lake.vtkhdf"), new_path("run.h5"), 6
    monitors = [dj.FieldMonitor(path, every=1), dj.ResultsMonitor(run, points=POINTS)]
    model = wall(read(wall_file()), water=waves())
    outcome = dj.Simulation(model, monitors=monitors).dynamics(dt=DT, steps=steps, motion=shaking)
    lake, end = model.coupled, outcome.state
    phi = 1440.0 * np.concatenate(comm.allgather(lake.of_water(end.displacement)))
    on_face = lake.pressure(end.velocity)

    def look():
        times, grids = zip(*read_vtk(path.with_name(f"{path.stem}_reservoir.vtkhdf")), strict=True)
        np.testing.assert_allclose(times, DT * np.arange(steps + 1), rtol=0.0, atol=1e-12)
        p = np.array([grid.point_data["hydrodynamic pressure [Pa]"] for grid in grids])
        means = (p[1:] + p[:-1]) / 2.0
        size = len(phi)
        found = -DT / 1000.0 * means.sum(axis=0)
        np.testing.assert_allclose(found[:size], phi, rtol=0.0, atol=1e-10 * np.abs(phi).max())
        assert not found[size:].any()
        grid, water = grids[-1], lake.water
        np.testing.assert_array_equal(grid.points[:size], water.places)
        np.testing.assert_array_equal(p[-1][water.face], on_face)
        sizes = grid.compute_cell_sizes(length=False, area=False)["Volume"]
        assert sizes.min() > 0.0
        assert sizes.sum() == pytest.approx(volume, rel=1e-6)
        with dj.Results(run) as results:
            force = results.series("histories", "reservoir_force")[-1, 1]
        face = grid.extract_surface().compute_normals(cell_normals=True, point_normals=False)
        at_dam = np.isclose(face.cell_centers().points[:, 1], 0.0)
        each = face.point_data_to_cell_data()["hydrodynamic pressure [Pa]"][at_dam]
        area = face.compute_cell_sizes()["Area"][at_dam]
        assert force == pytest.approx(each @ area, rel=1e-3)

    on_root(comm, look)


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_names_keep_their_dots_and_files_their_content(comm, wall_file, read, new_path):
    path = new_path("dt0.005")
    simulation = dj.Simulation(wall(read(wall_file())), monitors=[dj.FieldMonitor(path)])
    simulation.dynamics(dt=DT, steps=1, motion=shaking)
    with pytest.raises(dj.ResultsError, match=r"dt0\.005\.vtkhdf, .*_joints\.vtkhdf: file exists"):
        simulation.dynamics(dt=DT, steps=1, motion=shaking)
    with pytest.raises(dj.ResultsError, match="is a folder; give the name of a file"):
        dj.FieldMonitor(path.parent)


def test_joints_are_drawn_alike_on_any_ranks(comm, mesh_file, read):
    """Skew facets: four bisectors that meet in a point but for rounding, which is of the ranks."""
    path, found = mesh_file(ambiesta, size=8.0, order=1), []
    for each in (comm, MPI.COMM_SELF):
        model = wall(read(path, on=each))
        nodes = NodeNumbering(model.V)
        grid, at = joint_grid_of_rank(model, nodes, JointRows(model.operator))
        # Motions by a field that is different at every node.
        moved = grid.motion @ at(nodes.positions**2)
        lengths = np.diff(grid.offsets)
        found.append([all_of(each, part) for part in (lengths, grid.points, moved)])
    (lengths, points, moved), alone = found
    np.testing.assert_array_equal(lengths, alone[0])
    np.testing.assert_allclose(points, alone[1], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(moved, alone[2], rtol=1e-9, atol=1e-9)
    ends = np.cumsum(lengths)
    for first, end in zip(ends - lengths, ends, strict=True):
        sides = np.diff(points[[*range(first, end), first]], axis=0)
        assert np.linalg.norm(sides, axis=1).min() > 1e-6
