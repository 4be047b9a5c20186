# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks on a perimetral joint, built one after another, grouted joint by joint."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY

pytestmark = pytest.mark.mpi

DENSITY, YOUNG, SIZE = 2400.0, 25e9, 2.0
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=40.0)
RIGID = dj.RigidJoint(friction_angle_deg=40.0)


def blocks_on_rock(blocks=3, across=2, lifts=1, high=3, deep=2):
    """Blocks side by side in lifts on rock, cells of 2 m; arguments of `mesh_from_arrays`.

    Joints: ``joint_base`` on the rock, ``joint_1``, ... between blocks, ``joint_lift_1``, ...
    """
    n_x, n_y = blocks * across, deep + lifts * high
    grid = np.arange((n_x + 1) * (n_y + 1)).reshape(n_y + 1, n_x + 1)
    cell = np.arange(n_x * n_y).reshape(n_y, n_x)
    level = {"base": 0, "joint_base": deep, "crest": n_y}
    level |= {f"joint_lift_{k}": deep + k * high for k in range(1, lifts)}
    upright = {"left": 0} | {f"joint_{k}": k * across for k in range(1, blocks)}
    sides = {name: (grid[j, :-1], grid[j, 1:]) for name, j in level.items()}
    sides |= {name: (grid[deep:-1, i], grid[deep + 1 :, i]) for name, i in upright.items()}
    groups = {"rock": cell[:deep].ravel()}
    for i in range(blocks):
        for k in range(lifts):
            part = cell[deep + k * high : deep + (k + 1) * high, i * across : (i + 1) * across]
            groups[f"block_{i + 1}" + (f"_lift_{k + 1}" if lifts > 1 else "")] = part.ravel()
    y, x = np.indices(grid.shape)
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    return {
        "cell": "quadrilateral",
        "x": SIZE * np.column_stack([x.ravel(), y.ravel() - deep]),
        "cells": np.column_stack([corner.ravel() for corner in corners]),
        "facet_groups": {name: np.column_stack(ends) for name, ends in sides.items()},
        "cell_groups": groups,
    }


@pytest.fixture
def dam(comm):
    """``dam(loads, law=, poisson=, **parameters)``: blocks on rock without weight."""

    def make(loads, *, law=LAW, poisson=0.2, **parameters):
        arrays = blocks_on_rock(**parameters)
        rock = dj.Elastic(young=15e9, poisson=poisson, density=0.0)
        concrete = dj.Elastic(young=YOUNG, poisson=poisson, density=DENSITY)
        return dj.Model(
            dj.mesh_from_arrays(comm, **arrays),
            material={n: rock if n == "rock" else concrete for n in arrays["cell_groups"]},
            joints=law,
            supports=[dj.Fixed(group="base")],
            loads=loads,
        )

    return make


def normal_forces(run):
    """Normal force of each joint, compression positive [N]."""
    return {k: f.normal_force for k, f in dj.JointForces(run.model)(run.static.joints).items()}


# Three blocks of 4 m by 6 m, 1 m thick.
BLOCK = 4.0 * 6.0 * DENSITY * STANDARD_GRAVITY


@pytest.mark.parametrize(
    ("law", "solver"), [(LAW, "auto"), (LAW, "condensed"), (LAW, "forms"), (RIGID, "auto")]
)
def test_weight_rests_on_the_perimetral_joint_alone(dam, law, solver):
    """Contraction joints carry nothing before they are grouted, then a part of the water."""
    weight, water = dj.Gravity(), dj.HydrostaticPressure(group="left", level=5.0)
    run = dj.Simulation(dam([weight, water], law=law), solver=solver)
    run.statics(joints=["joint_base"], loads=[weight])
    assert run.static.inactive == ("joint_1", "joint_2")
    forces = normal_forces(run)
    assert forces["joint_base"] == pytest.approx(3.0 * BLOCK, rel=1e-9)
    assert (forces["joint_1"], forces["joint_2"]) == (0.0, 0.0)
    run.grout()
    assert not run.static.inactive
    run.statics()
    later = normal_forces(run)
    assert later["joint_base"] == pytest.approx(3.0 * BLOCK, rel=1e-9)
    # Of rho g h^2 / 2 of the water, 123 kN, what the block before does not take.
    assert 123e3 > later["joint_1"] > later["joint_2"] > 1e3
    outcome = run.dynamics(dt=2e-3, steps=5, motion=dj.synthetic_motion())
    assert outcome.energy_error < 1e-11


def test_joints_grouted_one_after_the_other(dam):
    """A joint that is left inactive carries nothing of what comes between, and moves on."""
    weight, water = dj.Gravity(), dj.HydrostaticPressure(group="left", level=5.0)
    run = dj.Simulation(dam([weight, water]))
    run.statics(joints=["joint_base"], loads=[weight])
    run.grout(["joint_1"])
    between = run.statics(joints=["joint_base", "joint_1"])
    assert between.inactive == ("joint_2",)
    forces = normal_forces(run)
    assert forces["joint_1"] > 1e3
    assert forces["joint_2"] == 0.0
    contact = run.model.contact
    second = contact.operator.joint == run.model.jointed.joint_names.index("joint_2")
    # Its gap counts from the mesh, as that of a joint never grouted.
    gap = contact.gap(between.displacement)[second]
    np.testing.assert_allclose(between.joints.state.gap[second], gap, rtol=0, atol=1e-15)
    with pytest.raises(dj.JointsError, match="still inactive: joint_2; call grout"):
        run.statics()
    run.grout(["joint_2"])
    run.statics(loads=[weight])  # the water goes again
    assert normal_forces(run)["joint_base"] == pytest.approx(3.0 * BLOCK, rel=1e-9)


def test_blocks_built_one_after_the_other(dam):
    """Each has its weight from the stage on that has it; what is not there leaves no trace."""
    run = dj.Simulation(dam([dj.Gravity()]))
    for built in (1, 2, 3):
        absent = ["block_1", "block_2", "block_3"][built:]
        state = run.statics(joints=["joint_base"], absent=absent)
        assert state.absent == tuple(absent)
        assert normal_forces(run)["joint_base"] == pytest.approx(built * BLOCK, rel=1e-9)
        support = run.model.resultant(state.reaction, "base")
        assert support == pytest.approx([0.0, built * BLOCK], rel=1e-9, abs=1e-9 * BLOCK)
        if absent:
            with pytest.raises(
                dj.JointsError, match="block_3 is absent in the static state, and its"
            ):
                dj.Simulation.dynamics(_grouted(run), dt=1e-3, steps=1)


def _grouted(run):
    """Another run from the same static state, grouted."""
    other = dj.Simulation(run.model)
    other.static = run.static
    other.grout()
    return other


@pytest.mark.parametrize("law", [LAW, RIGID])
def test_a_lift_is_cast_on_the_one_below(dam, comm, law):
    """A column of two lifts of h, without Poisson's ratio, on rock half as high and without weight.

    Under its own weight a lift shortens by rho g h^2 / 2 E, under the next one by rho g h^2 / E.
    The second lift is cast where the mesh has it: what the first has settled before, it has not.
    """
    run = dj.Simulation(
        dam([dj.Gravity()], law=law, poisson=0.0, blocks=1, across=1, lifts=2, high=2, deep=1)
    )
    h, stiffness = 2 * SIZE, 1e11
    pressure = DENSITY * STANDARD_GRAVITY * h  # of one lift
    rock, soft = 0.5 * h / 15e9, 0.0 if law is RIGID else 1.0 / stiffness
    first = run.statics(absent=["block_1_lift_2"])
    below = pressure * (rock + soft + h / (2.0 * YOUNG))
    assert _crest(run, first) == 0.0
    second = run.statics()
    # Onto rock, joint, lift and joint comes the second; it shortens under itself.
    expected = pressure * (rock + 2.0 * soft + h / YOUNG + h / (2.0 * YOUNG))
    assert -_crest(run, second) == pytest.approx(expected, rel=1e-9)
    at_once = -_crest(run, dj.Simulation(run.model).statics())
    assert at_once == pytest.approx(expected + below, rel=1e-9)
    assert normal_forces(run)["joint_lift_1"] == pytest.approx(pressure * SIZE, rel=1e-9)


def _crest(run, state):
    """Mean displacement upwards of the crest [m]."""
    nodes = run.model.nodes("crest")
    values = state.displacement.getArray(readonly=True).reshape(-1, 2)[nodes, 1]
    comm = run.model.jointed.mesh.comm
    return comm.allreduce(float(values.sum())) / comm.allreduce(len(nodes))


def test_weight_of_a_group_of_cells(dam):
    """Parts of the weight add up to the whole, and bear their names."""
    parts = [dj.Gravity(cells=f"block_{k}") for k in (1, 2, 3)]
    model = dam([dj.Gravity(), *parts])
    (whole, _), *each = [pattern for load in model.loads for pattern in load.patterns(model)]
    for part, _ in each:
        assert part.sum() == pytest.approx(-BLOCK, rel=1e-12)
        whole.axpy(-1.0, part)
    assert whole.norm() < 1e-12 * BLOCK
    assert model.system().load_names[1:] == [
        "Gravity_block_1",
        "Gravity_block_2",
        "Gravity_block_3",
    ]
    with pytest.raises(dj.MeshError, match="no cell group 'block_9'; its cell groups are: block_1"):
        dam([dj.Gravity(cells="block_9")])


def test_what_does_not_stand_is_refused(comm, dam):
    run = dj.Simulation(dam([dj.Gravity()], lifts=2))
    lifts = ["joint_lift_1"]
    with pytest.raises(
        dj.JointsError,
        match=r"around \(2, 6\) m is restrained by supports and active joints, which prevent 0",
    ):
        run.statics(joints=lifts)
    with pytest.raises(
        dj.MeshError, match="'joint_7'; the joints are: joint_1, joint_2, joint_base"
    ):
        run.statics(joints=["joint_7"])
    with pytest.raises(dj.JointsError, match=r"around \(2, 9\) m is .* list the block in absent="):
        run.statics(joints=["joint_base"])
    upper = [f"block_{k}_lift_2" for k in (1, 2, 3)]
    run.statics(joints=["joint_base"], absent=upper)
    with pytest.raises(dj.JointsError, match="'block_1_lift_1' cannot be absent: it was present"):
        run.statics(joints=["joint_base"], absent=[*upper, "block_1_lift_1"])
    joined = dj.Simulation(
        dj.Model(
            dj.mesh_from_arrays(comm, **blocks_on_rock(blocks=1, lifts=2), joints=["joint_base"]),
            material=dj.Elastic(young=YOUNG, poisson=0.2, density=DENSITY),
            joints=LAW,
            supports=[dj.Fixed(group="base")],
            loads=[dj.Gravity()],
        )
    )
    with pytest.raises(dj.MeshError, match="'block_1_lift_2' contains only a part of a block"):
        joined.statics(absent=["block_1_lift_2"])
    with pytest.raises(dj.MeshError, match="which are all blocks; at least one must exist"):
        dj.Simulation(run.model).statics(absent=list(run.model.jointed.cell_groups))
