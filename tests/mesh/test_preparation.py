# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names of groups: those that would be lost in a results file are refused at the split."""

import re

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints as dj

pytestmark = pytest.mark.mpi


def two_blocks(comm, joint, base, cells="all", joints=None):
    """Two squares, one on the other, of 1 m."""
    return dj.mesh_from_arrays(
        comm,
        cell="quadrilateral",
        x=[[0, 0], [1, 0], [0, 1], [1, 1], [0, 2], [1, 2]],
        cells=[[0, 1, 2, 3], [2, 3, 4, 5]],
        facet_groups={joint: [[2, 3]], base: [[0, 1]]},
        cell_groups={cells: [0, 1]},
        joints=joints,
    )


@pytest.mark.parametrize("name", ["joint_lift", "Joint_lift", "JOINT 1"])
def test_groups_that_begin_with_joint_in_any_case_are_joints(comm, name):
    """A body that nobody meant to be whole is not computed as one."""
    assert two_blocks(comm, name, "base").joint_names == (name,)


@pytest.mark.parametrize("name", ["a/b", "../x", "..", "", "line\nbreak"])
def test_names_that_results_cannot_hold_are_refused(comm, name):
    sentence = re.escape(f"The facet group name {name!r} cannot be used in results files")
    for joint, base in ((name, "base"), ("joint", name)):
        with pytest.raises(dj.MeshError, match=sentence):
            two_blocks(comm, joint, base, joints=[joint])


def test_names_that_are_taken_are_read_back(comm, new_path):
    """Joint and support stand in the results under their names; cell groups are not in them."""
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=30.0)
    model = dj.Model(
        two_blocks(comm, "übergang 1.2", "foot of the dam", "all of it/them", ["übergang 1.2"]),
        material={"all of it/them": dj.Elastic(young=1e10, poisson=0.2, density=2400.0)},
        joints=law,
        supports=[dj.Fixed(group="foot of the dam")],
        loads=[dj.Gravity()],
    )
    path = new_path("names.h5")
    simulation = dj.Simulation(model, monitors=[dj.ResultsMonitor(path, points={"top": (0, 2)})])
    simulation.statics()
    simulation.dynamics(dt=1e-3, steps=1)
    comm.barrier()
    with dj.Results(path) as results:
        assert results.joints == ["übergang 1.2"]
        reaction = results.series("histories", "reaction/foot of the dam")[0]
    # Two cubic metres of 2400 kg/m^3; the half of them at the base itself included.
    np.testing.assert_allclose(reaction[1], 2 * 2400.0 * 9.80665, rtol=1e-6)
