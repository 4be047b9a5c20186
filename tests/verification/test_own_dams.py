# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of dams on meshes of the user: a gravity dam from arrays, an arch dam from a STEP file.

Each dam has one number that equilibrium gives by hand: the sliding safety of a lift joint, and the
hoop stress of a ring under pressure. The number is read from the table of checks and from the
report.
"""

from itertools import product

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("matplotlib")
pytest.importorskip("plotly")
pytest.importorskip("gmsh")

import gmsh
from reading_back import Tables, number
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints import report
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.geometry.from_step import from_step
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.postprocessing import plots, views

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
STRENGTH = dj.Strength(tensile=2e6, compressive=25e6)


def at_rest(path, model, **options):
    """Write a run of a few steps without a motion from the static state; return the path."""
    monitor = dj.ResultsMonitor(path, envelopes=True, strength=STRENGTH, **options)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=0.005, steps=4)
    return path


def checked(path, kind, name):
    """Return the value of a check from the table and from the report."""
    with dj.Results(path) as results:
        (row,) = (row for row in dj.checks(results, kind) if row.criterion == name)
    page = report.write([path], path.with_suffix(".html")).read_text(encoding="utf-8")
    (line,) = (
        line
        for table in Tables(page).having("criterion", "limit").tables
        for line in table
        if line[0] == name
    )
    return row.value, number(line[2])


# Gravity dam: vertical upstream face at x = 0, crest at HEIGHT, lift joint at LIFT.
HEIGHT, LIFT, BASE, CREST, FRICTION = 40.0, 10.0, 30.0, 5.0, 45.0
ALONG, UP = 8, 16


def width(y):
    """Return the thickness of the dam at a height [m]."""
    return BASE + (CREST - BASE) * y / HEIGHT


def gravity_dam(comm):
    heights = np.linspace(0.0, HEIGHT, UP + 1)
    x = [(width(y) * i / ALONG, y) for y in heights for i in range(ALONG + 1)]

    def number(i, j):
        return j * (ALONG + 1) + i

    cells = [
        [number(i, j), number(i + 1, j), number(i, j + 1), number(i + 1, j + 1)]
        for j, i in product(range(UP), range(ALONG))
    ]

    def level(j):
        return [[number(i, j), number(i + 1, j)] for i in range(ALONG)]

    lift = round(LIFT / HEIGHT * UP)
    groups = {
        "base": level(0),
        "joint_lift": level(lift),
        "upstream": [[number(0, j), number(0, j + 1)] for j in range(UP)],
    }
    mesh = dj.mesh_from_arrays(
        comm, cell="quadrilateral", x=np.array(x), cells=np.array(cells), facet_groups=groups
    )
    law = dj.FrictionNoTension(
        normal_stiffness=1e11, shear_stiffness=5e10, friction_angle_deg=FRICTION
    )
    loads = [dj.Gravity(), dj.HydrostaticPressure(group="upstream", level=HEIGHT)]
    supports = [dj.Fixed(group="base")]
    return dj.Model(mesh, material=CONCRETE, joints=law, supports=supports, loads=loads)


def test_gravity_dam_from_arrays(comm, new_path):
    # The lift carries the weight W above it and the thrust V of the water above it. Its traction is
    # compression everywhere and its shear points downstream, so that the safety is W tan(phi) / V.
    above = HEIGHT - LIFT
    weight = 0.5 * (width(LIFT) + CREST) * above * CONCRETE.density * STANDARD_GRAVITY
    thrust = 0.5 * 1000.0 * STANDARD_GRAVITY * above**2
    expected = weight * np.tan(np.deg2rad(FRICTION)) / thrust
    path = at_rest(new_path("gravity.h5"), gravity_dam(comm), points={"crest": (0.0, HEIGHT)})

    def look():
        value, printed = checked(
            path, "gravity", "least sliding safety (1: slides at some instant)"
        )
        assert value == pytest.approx(expected, rel=1e-6)
        assert printed == pytest.approx(expected, rel=5e-4)
        with dj.Results(path) as results:
            for figure in (views.envelope(results, "principal_max"), plots.joint_profiles(results)):
                assert figure is not None

    on_root(comm, look)


# Arch dam: a quarter of a ring of three blocks between planes of symmetry, pressed from outside.
INSIDE, OUTSIDE, TALL, PRESSURE = 40.0, 46.0, 12.0, 1e6


def arch_step(path):
    """Write the three blocks to a STEP file in millimetres."""
    with gmsh_model.gmsh_session():
        for k in range(3):
            face = gmsh.model.occ.addRectangle(INSIDE, 0.0, 0.0, OUTSIDE - INSIDE, TALL)
            gmsh.model.occ.rotate([(2, face)], 0, 0, 0, 1, 0, 0, np.pi / 2)
            gmsh.model.occ.rotate([(2, face)], 0, 0, 0, 0, 0, 1, k * np.pi / 6)
            swept = gmsh.model.occ.revolve([(2, face)], 0, 0, 0, 0, 0, 1, np.pi / 6)
            gmsh.model.occ.dilate(swept, 0, 0, 0, 1e3, 1e3, 1e3)
        gmsh.model.occ.remove([(2, 1)])
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path


def arch_dam(comm, folder):
    mesh = None
    if comm.rank == 0:
        mesh = from_step(
            folder.with_suffix(".msh"),
            arch_step(folder.with_suffix(".step")),
            size=6.0,
            surfaces={
                "upstream": ("+x", 80.0),
                "right": ("y", "min"),
                "left": ("x", "min"),
                "base": ("z", "min"),
            },
        )
    jointed = dj.read_msh(comm.bcast(mesh), comm)
    law = dj.FrictionNoTension(normal_stiffness=1e13, shear_stiffness=5e12, friction_angle_deg=30.0)
    planes = {"right": "y", "left": "x", "base": "z"}
    return dj.Model(
        jointed,
        material=CONCRETE,
        joints=law,
        supports=[dj.Fixed(group=name, components=axis) for name, axis in planes.items()],
        loads=[dj.Pressure(group="upstream", value=PRESSURE)],
        body=dj.Body(degree=2),
    )


def test_arch_dam_from_a_step_file(comm, new_path):
    # Lame: the hoop stress of a ring under outer pressure p is 2 p b^2 / (b^2 - a^2) at its inside.
    hoop = 2.0 * PRESSURE * OUTSIDE**2 / (OUTSIDE**2 - INSIDE**2)
    expected = hoop / STRENGTH.compressive
    path = new_path("arch.h5")
    at_rest(path, arch_dam(comm, path), points={"crest": (INSIDE, 0.0, TALL)})

    def look():
        value, printed = checked(path, "arch", "static compression / compressive strength")
        assert value == pytest.approx(expected, rel=0.02)
        assert printed == pytest.approx(value, rel=5e-4)

    on_root(comm, look)
