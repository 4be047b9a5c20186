# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bodies that warm or cool, with stresses and joint openings known by hand.

A bar along its last axis, [0, 4] m, held at both ends along it and free to shrink sideways (planes
of symmetry at x = 0 and, in space, y = 0). With e = alpha dT in space and plane stress and
(1 + nu) alpha dT in plane strain, and E' = E / (1 - nu^2) in plane strain:

    cooled, with a joint         opening  -e 4 m, no stress
    warmed, monolithic           stress   -E' e
    warmed, with a joint         stress   -e / (1/E' + 1/(k_n 4 m))   bar and joint in series

A temperature that is linear in the place strains a free body without stress: T = g x bends it to
u = alpha g ((x^2 - y^2 - z^2)/2, x y, x z), of degree 2.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from boxes import box
from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.surface_stress import StressEnvelopes, SurfaceStress
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
ALPHA, LENGTH, K_N = 1e-5, 4.0, 1e10
LAW = dj.FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_N, friction_angle_deg=30.0)
KINDS = [("hexahedron", "strain"), ("tetrahedron", "strain")]
KINDS += [("quadrilateral", "strain"), ("triangle", "stress")]


def bar(comm, cell="hexahedron", *, joint=True):
    """1 m thick, cut at 1.5 m; cell groups ``low`` and ``high``; facets ``x``, ``y``, ``ends``."""
    size = [1.0, 1.0, LENGTH] if cell in ("hexahedron", "tetrahedron") else [1.0, LENGTH]
    along = len(size) - 1
    groups = {"xy"[axis]: (axis, 0.0) for axis in range(along)}
    groups["ends"] = lambda x: np.isclose(x[along] * (LENGTH - x[along]), 0.0)
    return box(
        size,
        [2] * along + [8],
        cell,
        joints={"joint": (along, 1.5)} if joint else {},
        groups=groups,
        cells={"low": (0.0, 1.5), "high": (1.5, LENGTH)},
        comm=comm,
    )


def model_of(jointed, loads, *, plane="strain", **options):
    axes = "xyz"[: jointed.mesh.geometry.dim]
    supports = [dj.Fixed(group=a, components=a) for a in axes[:-1]]
    return dj.Model(
        jointed,
        material=CONCRETE,
        joints=LAW if jointed.joint_names else None,
        supports=[*supports, dj.Fixed(group="ends", components=axes[-1])],
        loads=loads,
        body=dj.Body(plane=plane),
        **options,
    )


def free_strain(change, jointed, plane):
    """Strain along the bar if it is free, and the modulus along it."""
    flat = jointed.mesh.geometry.dim == 2 and plane == "strain"
    nu = CONCRETE.poisson if flat else 0.0
    return (1.0 + nu) * ALPHA * change, CONCRETE.young / (1.0 - nu**2)


@pytest.mark.parametrize(("cell", "plane"), KINDS)
def test_joint_opens_as_the_blocks_shrink(comm, cell, plane):
    jointed = bar(comm, cell)
    cold = dj.Temperature(value=4.0, reference=12.0, expansion=ALPHA)
    model = model_of(jointed, [cold], plane=plane)
    state = dj.Simulation(model).statics()
    opening = -free_strain(-8.0, jointed, plane)[0] * LENGTH
    np.testing.assert_allclose(state.joints.state.gap[:, 0], opening, rtol=1e-10)
    np.testing.assert_allclose(state.joints.state.gap[:, 1:], 0.0, atol=1e-10 * opening)
    assert not state.joints.traction.any()


@pytest.mark.parametrize(("cell", "plane"), KINDS)
@pytest.mark.parametrize("joint", [False, True])
def test_warm_bar_between_walls(comm, cell, plane, joint):
    jointed = bar(comm, cell, joint=joint)
    warm = dj.Temperature(value=lambda x: 20.0 + 0.0 * x[0], reference=12.0, expansion=ALPHA)
    model = model_of(jointed, [warm], plane=plane)
    state = dj.Simulation(model).statics()
    strain, modulus = free_strain(8.0, jointed, plane)
    stress = -strain / (1.0 / modulus + (1.0 / (K_N * LENGTH) if joint else 0.0))
    if joint:
        np.testing.assert_allclose(state.joints.traction[:, 0], stress, rtol=1e-9)
    if model.gdim == 3:
        recovery = SurfaceStress(model, NodeNumbering(model.V))
        found = recovery(state.displacement, 0.0)
        expected = np.tile([0.0, 0.0, stress, 0.0, 0.0, 0.0], (len(found), 1))
        np.testing.assert_allclose(found, expected, rtol=0, atol=-1e-9 * stress)
    # The two ends push against each other; one of them is found as half of the absolute forces.
    force = np.abs(state.reaction.getArray().reshape(-1, model.gdim)[:, -1]).sum()
    assert 0.5 * comm.allreduce(force) == pytest.approx(-stress, rel=1e-9)


def by_block(jointed):
    """A load for each block."""
    given = {"value": 9.0, "expansion": ALPHA}
    low = dj.Temperature(reference=12.0, cells="low", **given)
    return [low, dj.Temperature(reference=16.0, cells="high", **given)]


def by_references(jointed):
    """One load with a reference for each block."""
    return [dj.Temperature(value=9.0, reference={"low": 12.0, "high": 16.0}, expansion=ALPHA)]


def by_field(jointed):
    """A DOLFINx function of degree 0 on the mesh."""
    field = fem.Function(fem.functionspace(jointed.mesh, ("DG", 0)))
    field.x.array[:] = 5.0
    field.x.array[jointed.cells("low")] = 9.0
    return [dj.Temperature(value=field, reference=12.0, expansion=ALPHA)]


@pytest.mark.parametrize("loads", [by_block, by_references, by_field])
def test_each_block_has_a_temperature(comm, loads):
    """The lower block, 1.5 m, is cooled by 3 K from its reference, the upper one by 7 K."""
    jointed = bar(comm)
    model = model_of(jointed, loads(jointed))
    state = dj.Simulation(model).statics()
    # Sideways the blocks shrink differently, which an open joint does not mind.
    opening = ALPHA * (3.0 * 1.5 + 7.0 * 2.5)
    np.testing.assert_allclose(state.joints.state.gap[:, 0], opening, rtol=1e-10)
    # Vertices on the joint are double, so that no vertex takes the mean of both blocks.
    found = SurfaceStress(model, NodeNumbering(model.V))(state.displacement, 0.0)
    assert np.abs(found).max(initial=0.0) < 1e-9 * CONCRETE.young * ALPHA * 7.0


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_gradient_through_the_thickness_bends_without_stress(comm, cell):
    """K u = F and no stress, in a body that nothing holds."""
    slope = 6.0  # K/m
    load = dj.Temperature(value=lambda x: slope * x[0] + 3.0, reference=3.0, expansion=ALPHA)
    jointed = bar(comm, cell, joint=False)
    model = dj.Model(jointed, material=CONCRETE, loads=[load], body=dj.Body(degree=2))
    u = model.stiffness.createVecRight()
    x, y, z = model.V.tabulate_dof_coordinates()[: u.getLocalSize() // 3].T
    bent = np.stack([(x**2 - y**2 - z**2) / 2.0, x * y, x * z], axis=1)
    u.setArray(ALPHA * slope * bent.ravel())
    ((force, _),) = load.patterns(model)
    missing = u.duplicate()
    model.stiffness.mult(u, missing)
    missing.axpy(-1.0, force)
    assert missing.norm() < 1e-10 * force.norm()
    found = SurfaceStress(model, NodeNumbering(model.V))(u, 0.0)
    assert np.abs(found).max(initial=0.0) < 1e-9 * CONCRETE.young * ALPHA * slope


def test_seasons(comm):
    """A mean below the reference and a swing of 10 K: open in winter, pressed in summer."""
    jointed = bar(comm)
    mean = dj.Temperature(value=11.0, reference=12.0, expansion=ALPHA)
    swing = dj.Temperature(
        value=10.0, reference=0.0, expansion=ALPHA, factor=lambda t: math.cos(2.0 * math.pi * t)
    )
    model = model_of(jointed, [mean, swing])
    simulation, envelopes = dj.Simulation(model), StressEnvelopes(model, NodeNumbering(model.V))
    for time in (0.0, 0.5, 1.0):
        state = simulation.quasi_statics([time])
        change = -1.0 + 10.0 * math.cos(2.0 * math.pi * time)
        if change < 0.0:
            np.testing.assert_allclose(
                state.joints.state.gap[:, 0], -ALPHA * change * LENGTH, rtol=1e-9
            )
        else:
            stress = -ALPHA * change / (1.0 / CONCRETE.young + 1.0 / (K_N * LENGTH))
            np.testing.assert_allclose(state.joints.traction[:, 0], stress, rtol=1e-9)
        envelopes.see(state.displacement, time)
    by_name = dict(zip(ENVELOPE_NAMES, envelopes.state_dict().mine.T, strict=True))
    np.testing.assert_allclose(by_name["principal_min"], stress, rtol=1e-9)
    np.testing.assert_allclose(by_name["principal_max"], 0.0, atol=-1e-9 * stress)


def test_energies_balance_while_the_body_cools(comm):
    """From 8 K above the reference to 8 K below it, in 10 ms; the joint opens."""
    fall = dj.Temperature(
        value=20.0, reference=12.0, expansion=ALPHA, factor=lambda t: 1.0 - t / 0.005
    )
    simulation = dj.Simulation(model_of(bar(comm), [fall]))
    closed = simulation.statics().joints.state.gap[:, 0]
    outcome = simulation.dynamics(dt=2e-4, steps=50)
    assert outcome.imbalance < 1e-12
    opened = outcome.state.joints.state.gap[:, 0]
    assert comm.allreduce(int((closed > 0.0).sum())) == 0
    assert comm.allreduce(int((opened > 0.0).sum())) > 0


@pytest.mark.filterwarnings(
    "ignore:The estimated error of a single step"
)  # relative to a motion of rounding
def test_envelopes_of_a_run(comm, new_path):
    """Of a warm bar that nothing moves: its static stress, none sideways."""
    warm = dj.Temperature(value=20.0, reference=12.0, expansion=ALPHA)
    path = new_path("warm.h5")
    monitor = dj.ResultsMonitor(path, points={"end": (0, 0, 4)}, envelopes=True)
    simulation = dj.Simulation(model_of(bar(comm), [warm]), monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=2e-4, steps=2)
    stress = -8.0 * ALPHA / (1.0 / CONCRETE.young + 1.0 / (K_N * LENGTH))
    if comm.rank == 0:
        with dj.Results(path) as results:
            for name, expected in (("min", stress), ("max", 0.0)):
                found = results.series("envelopes", f"principal_{name}", -1)
                np.testing.assert_allclose(found, expected, rtol=0, atol=-1e-8 * stress)


def test_refusals(comm):
    """One sentence each, on all ranks."""
    good = {"value": 4.0, "reference": 12.0, "expansion": ALPHA}
    jointed = bar(comm, joint=False)
    x = ufl.SpatialCoordinate(bar(comm, joint=False).mesh)
    for wrong, message in (
        ({"value": lambda x: x}, "it must be a number or a scalar UFL expression"),
        ({"value": x[0]}, "value is defined on another mesh than jointed.mesh"),
        ({"value": lambda x: 1.0 / (x[0] - x[0])}, "value is not finite in all of its cells"),
        ({"reference": {"low": 9.0}}, r"20 cells have no reference or several; .* \(low\) must"),
    ):
        with pytest.raises(ValueError, match=message):
            model_of(jointed, [dj.Temperature(**{**good, **wrong})]).system()
    with pytest.raises(dj.MeshError, match="middle"):
        model_of(jointed, [dj.Temperature(**good, cells="middle")]).system()
    with pytest.raises(ValueError, match=r"A Temperature was given to a stage. Give it to Model"):
        dj.Simulation(model_of(jointed, [])).dynamics(
            dt=1e-3, steps=1, loads=[dj.Temperature(**good)]
        )
