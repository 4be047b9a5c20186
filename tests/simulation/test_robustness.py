# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What must not pass in silence, crash or grow, on any number of ranks."""

import gc

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import shaken_wall
import ufl

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor

NAN = float("nan")


@pytest.fixture
def wall(wall_file, read):
    """Makes a small jointed wall with what is changed."""
    return lambda **changes: shaken_wall.wall(read(wall_file()), **changes)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"loads": [dj.Traction(group="crest", value=(0, 0, 1), factor=lambda t: NAN)]},
            "The factor of Traction_crest at t = 0 s is nan; it must be",
        ),
        (
            {
                "joints": dj.Joints(
                    shaken_wall.LAW, initial_gaps={"joint_1": lambda x: np.zeros((2, 2))}
                )
            },
            "is an array of shape",
        ),
        (
            {"loads": [dj.FormLoad(form=lambda v: None)]},
            "FormLoad: A load must be a linear UFL form of v",
        ),
        (
            {"body": dj.Body(extra_stiffness=lambda u, v: v[0] * ufl.dx)},
            "extra_stiffness must return a bilinear UFL form",
        ),
        ({"loads": dj.Gravity()}, "loads is Gravity.*; it must be a sequence of values"),
        ({"damping": 0.05}, "it must be a Rayleigh"),
    ],
)
def test_refused_on_all_ranks_alike(wall, changes, text):
    with pytest.raises(ValueError, match=text):
        dj.Simulation(wall(**changes)).statics()


@pytest.mark.mpi
def test_what_a_model_made_outlives_it(wall):
    def made():
        model = wall()
        return dj.modes(model.system(), 1).shapes, dj.Simulation(model).statics().displacement

    shapes, displacement = made()
    gc.collect()
    made()
    gc.collect()
    assert shapes[0].copy().norm() == pytest.approx(shapes[0].norm())
    assert displacement.copy().norm() > 0.0


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
@pytest.mark.mpi
def test_memory_does_not_grow_with_the_steps(wall_file, comm):
    # A dozen vectors are made in each step; on several ranks PETSc would keep them all.
    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096 / 1e6

    sizes = []

    class Watch(Monitor):
        def record(self, record):
            sizes.append(resident())

    jointed = dj.read_msh(wall_file(divisions=(12, 4, 10)), comm, joints=[])
    model = shaken_wall.wall(jointed, None, body=dj.Body(degree=2))
    dj.Simulation(model, monitors=[Watch()]).dynamics(dt=0.005, steps=140)
    assert sizes[-1] - sizes[40] < 10.0


def test_prescribed_displacements_do_not_jump(wall):
    top = dj.Prescribed(group="crest", component="x", value=lambda t: 1e-4 * t)
    simulation = dj.Simulation(wall(supports=[dj.Fixed(group="base"), top]))
    simulation.quasi_statics([1.0])
    with pytest.raises(
        ValueError, match="of the supports at t = 0 s differ from the displacements at"
    ):
        simulation.dynamics(dt=0.005, steps=1)
