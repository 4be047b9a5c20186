# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models: closed forms, resultants, materials, user-defined forms, refusals."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")


import ufl
from dolfinx import fem
from whole_vectors import relative_difference

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.loads.load import load_names

pytestmark = pytest.mark.mpi

E, RHO, LENGTH, AREA = 20e9, 2400.0, 2.0, 1.0
BAR = dj.Elastic(young=E, poisson=0.0, density=RHO)
CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=RHO)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)
BASE = dj.Fixed(group="base")


@pytest.fixture
def bar(blocks_file, read):
    """A body of 1 m x 1 m x 2 m without joints, made of ``lower`` and ``upper``."""
    return read(blocks_file(angle=0.0), joints=[])


@pytest.fixture
def blocks(blocks_file, read):
    """The same body with the joint z = 1 m."""
    return read(blocks_file(angle=0.0))


def integral(model, form):
    return model.jointed.mesh.comm.allreduce(fem.assemble_scalar(fem.form(form)))


def mean(model, u, group, axis):
    """Mean displacement of a group along an axis; a line of the field over the area."""
    ds = model.jointed.ds(group)
    one = fem.Constant(model.jointed.mesh, 1.0)
    return integral(model, model.function(u)[axis] * ds) / integral(model, one * ds)


def resultant(model, vector):
    """Sum of nodal forces per axis."""
    local = vector.getArray(readonly=True).reshape(-1, model.gdim).sum(axis=0)
    return np.sum(model.jointed.mesh.comm.allgather(local), axis=0)


def pattern_resultant(model, load):
    ((vector, factor),) = load.patterns(model)
    return factor(0.0) * resultant(model, vector)


def error_on_all_ranks(comm, kind, call):
    """The text of an error that every rank raises alike."""
    with pytest.raises(kind) as failure:
        call()
    texts = comm.allgather(str(failure.value))
    assert len(set(texts)) == 1
    return texts[0]


# Closed forms. With Poisson's ratio zero the bar is one-dimensional.


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_confined_plane_column(plane, two_rectangles_file, read):
    # Sides held horizontally: plane strain has the oedometric modulus
    # E (1 - nu) / ((1 + nu)(1 - 2 nu)), plane stress E / (1 - nu^2).
    nu = 0.3
    stiffness = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) if plane == "strain" else E / (1 - nu**2)
    push = -1e6
    model = dj.Model(
        read(two_rectangles_file(cell="quad", angle=0.0), joints=[]),
        material=dj.Elastic(young=E, poisson=nu, density=RHO),
        supports=[dj.Fixed(group="base", components="y"), dj.Fixed(group="sides", components="x")],
        loads=[dj.Traction(group="top", value=(0, push))],
        body=dj.Body(plane=plane),
    )
    static = dj.Simulation(model).statics()
    top = mean(model, static.displacement, "top", 1)
    assert top == pytest.approx(push * LENGTH / stiffness, rel=1e-12)


def test_springs_under_a_bar(bar):
    # Normal springs in series with the bar, p (1/k_n + L/E); a shear traction on the base itself
    # moves the body as a whole, t/k_t.
    k_n, k_t, push, shear = 5e9, 2e9, -1e6, 4e5
    model = dj.Model(
        bar,
        material=BAR,
        supports=[dj.Spring(group="base", normal_stiffness=k_n, tangential_stiffness=k_t)],
        loads=[
            dj.Traction(group="top", value=(0, 0, push)),
            dj.Traction(group="base", value=(shear, 0, 0)),
        ],
    )
    u = dj.Simulation(model).statics().displacement
    top = mean(model, u, "top", 2)
    assert top == pytest.approx(push * (1 / k_n + LENGTH / E), rel=1e-11)
    for group in ("top", "base"):
        assert mean(model, u, group, 0) == pytest.approx(shear / k_t, rel=1e-9)


def test_prescribed_motion_and_its_reaction(bar):
    # The top is pulled by d(t) = 1 mm t: reaction E A d / L.
    model = dj.Model(
        bar,
        material=BAR,
        supports=[BASE, dj.Prescribed(group="top", component="z", value=lambda t: 1e-3 * t)],
    )
    simulation = dj.Simulation(model)
    for time in (0.5, 2.0):
        static = simulation.quasi_statics([time])
        assert mean(model, static.displacement, "top", 2) == pytest.approx(1e-3 * time, rel=1e-12)
        held = np.zeros(model.mass.createVecRight().getLocalSize())
        top = fem.locate_dofs_topological(model.V, 2, bar.facets("top"))
        owned = top[top < model.V.dofmap.index_map.size_local]
        held[3 * owned + 2] = 1.0
        local = float(held @ static.reaction.getArray(readonly=True))
        force = bar.mesh.comm.allreduce(local)
        assert force == pytest.approx(E * AREA * 1e-3 * time / LENGTH, rel=1e-11)
        assert np.abs(resultant(model, static.reaction)).max() <= 1e-9 * force


def test_quasi_statics_follow_the_factors_of_loads(bar):
    load = dj.Traction(group="top", value=(0, 0, 1e6), factor=lambda t: t**2)
    model = dj.Model(bar, material=BAR, supports=[BASE], loads=[load])
    static = dj.Simulation(model).quasi_statics([1.0, 2.0, 3.0])
    # u = p L / E
    assert mean(model, static.displacement, "top", 2) == pytest.approx(9e6 * LENGTH / E, rel=1e-12)
    assert resultant(model, static.reaction) == pytest.approx([0, 0, -9e6 * AREA], abs=1e-3)
    assert [report.counts for report in static.reports] == [None] * 3
    assert static.joints is None


# Loads and matrices.


def test_every_load_has_a_name_of_its_own():
    # Numbered, two on "face" would be Traction_face_1 and 2; the third is called the first already.
    loads = [dj.Traction(group=group, value=(0, 0, 1.0)) for group in ("face", "face", "face_1")]
    assert load_names(loads) == ["Traction_face_2", "Traction_face_3", "Traction_face_1"]


def test_resultants(blocks_file, read):
    # Forces by hand: area times traction; on the faces of the inclined joint p n / cos 20.
    jointed = read(blocks_file(angle=20.0))
    model = dj.Model(jointed, material=CONCRETE, joints=LAW)
    top = pattern_resultant(model, dj.Traction(group="top", value=(1e3, -2e3, 3e3)))
    assert top == pytest.approx([1e3, -2e3, 3e3], rel=1e-12)
    assert pattern_resultant(model, dj.Pressure(group="top", value=5e4)) == pytest.approx(
        [0, 0, -5e4], abs=1e-6
    )
    closed = pattern_resultant(model, dj.Pressure(group="sides", value=5e4))
    assert np.abs(closed).max() <= 1e-6
    rise = np.tan(np.radians(20.0))
    for side, sign in (("joint_1-", 1.0), ("joint_1+", -1.0)):
        force = pattern_resultant(model, dj.Pressure(group=side, value=5e4))
        assert force == pytest.approx(sign * 5e4 * np.array([rise, 0, -1]), abs=1e-6)
    body = dj.FormLoad(form=lambda v: ufl.inner(ufl.as_vector((0.0, 7.0, 0.0)), v) * ufl.dx)
    assert pattern_resultant(model, body) == pytest.approx([0, 14.0, 0], abs=1e-10)
    push = pattern_resultant(model, dj.Gravity(acceleration=(1.0, 2.0, 3.0)))
    assert push == pytest.approx(2 * RHO * np.array([1, 2, 3]), rel=1e-12)


def total_mass(model, axis=0):
    unit = np.eye(model.gdim)[axis]
    return resultant(model, model.inertia_pattern(unit))[axis]


def test_materials_by_group(bar):
    # Two bars of 1 m in series, p (1/E1 + 1/E2); masses 1 m^3 each.
    stiff = dj.Elastic(young=3 * E, poisson=0.0, density=2 * RHO)
    model = dj.Model(
        bar,
        material={"lower": BAR, "upper": stiff},
        supports=[BASE],
        loads=[dj.Traction(group="top", value=(0, 0, 1e6))],
    )
    top = mean(model, dj.Simulation(model).statics().displacement, "top", 2)
    assert top == pytest.approx(1e6 * (1 / E + 1 / (3 * E)), rel=1e-12)
    assert total_mass(model) == pytest.approx(3 * RHO, rel=1e-12)


def test_extra_forms(bar):
    # A spring k per area on the top beside the bar, (E/L + k) u = p; a mass m per area on it.
    k, m = 4e9, 500.0
    top = bar.ds("top")
    model = dj.Model(
        bar,
        material=BAR,
        supports=[BASE],
        loads=[dj.Traction(group="top", value=(0, 0, 1e6))],
        body=dj.Body(
            extra_stiffness=lambda u, v: k * ufl.inner(u, v) * top,
            extra_mass=lambda u, v: m * ufl.inner(u, v) * top,
        ),
    )
    u = dj.Simulation(model).statics().displacement
    assert mean(model, u, "top", 2) == pytest.approx(1e6 / (E / LENGTH + k), rel=1e-11)
    assert total_mass(model) == pytest.approx(RHO * AREA * LENGTH + m * AREA, rel=1e-12)


def _pair(V):
    return ufl.TrialFunction(V), ufl.TestFunction(V)


@pytest.mark.parametrize("spring", [False, True])
@pytest.mark.parametrize("dashpot", [False, True])
def test_damping_force(bar, spring, dashpot):
    # C v = a M v + b K v + c v on the top, K of the body alone, from products with matrices that
    # are not C. The dashpots leave most nodes alone, so that most of their rows are empty.
    c, beta, alpha = 3e5, 1e-3, 0.7
    supports = [dj.Spring(group="base", normal_stiffness=1e10)] if spring else [BASE]
    model = dj.Model(
        bar,
        material=BAR,
        supports=supports,
        damping=dj.Rayleigh(stiffness_factor=beta, mass_factor=alpha),
        body=dj.Body(
            extra_stiffness=lambda u, v: 4e9 * ufl.inner(u, v) * bar.ds("top"),
            extra_damping=(lambda u, v: c * ufl.inner(u, v) * bar.ds("top")) if dashpot else None,
        ),
    )
    system = model.system()
    v = model.mass.createVecRight()
    v.setArray(np.random.default_rng(bar.mesh.comm.rank).standard_normal(v.getLocalSize()))
    on_top = model._matrix(ufl.inner(*_pair(model.V)) * bar.ds("top"))
    expected, term = v.duplicate(), v.duplicate()
    dj.Model(bar, material=BAR, supports=[BASE]).stiffness.mult(v, expected)
    expected.scale(beta)
    for factor, matrix in ((alpha, model.mass), (c * dashpot, on_top)):
        matrix.mult(v, term)
        expected.axpy(factor, term)
    system.damping.mult(v, term)
    for found in (system.damping_force(v, v.duplicate()), term):
        assert relative_difference(found, expected) <= 1e-13


def test_ground_motion_is_asked_once_per_time(bar):
    # However many loads, axes and works of a step need it: ground motions may be costly.
    asked = []

    def motion(time):
        asked.append(time)
        return np.array([np.sin(time), 0.0, time])

    loads = [dj.Gravity(), dj.BaseMotion(acceleration=motion)]
    system = dj.Model(bar, material=BAR, supports=[BASE], loads=loads).system()
    x = system.mass.createVecRight()
    x.set(1e-3)
    for start, end in ((0.0, 0.1), (0.1, 0.2)):
        system.load(end, x.duplicate())
        works = system.work_of_loads(x, start, end)
    assert sorted(asked) == [0.0, 0.1, 0.2]
    # The body's mass of 2400 kg/m^3 * 2 m^3 moves against the mean acceleration of the step.
    mean = 0.5 * (np.sin(0.1) + np.sin(0.2)) + 0.15
    assert works["BaseMotion"] == pytest.approx(-4800.0 * mean * 1e-3, rel=1e-12)
    assert works["Gravity"] == pytest.approx(-4800.0 * STANDARD_GRAVITY * 1e-3, rel=1e-12)


def test_joints_are_not_damped(blocks):
    # C = b K of the bulk alone: a block that moves as a whole meets no damping.
    model = dj.Model(
        blocks, material=CONCRETE, joints=LAW, damping=dj.Rayleigh(stiffness_factor=1e-3)
    )
    moved = fem.Function(model.V)
    moved.interpolate(lambda x: np.ones_like(x), blocks.cells("upper"))
    u = model.mass.createVecRight()
    u.setArray(moved.x.array[: u.getLocalSize()])
    force = u.duplicate()
    model.system().damping.mult(u, force)
    assert force.norm() <= 1e-14 * model.system().damping.norm() * u.norm()


def test_function_works_in_a_form(blocks):
    # The integral of div u of a body stretched by 1e-4 along z: 1e-4 times the volume of 2 m^3.
    model = dj.Model(blocks, material=CONCRETE, joints=LAW)
    field = fem.Function(model.V)
    field.interpolate(lambda x: np.array([0 * x[0], 0 * x[0], 1e-4 * x[2]]))
    field.x.scatter_forward()
    u = model.mass.createVecRight()
    u.setArray(field.x.array[: u.getLocalSize()])
    back = model.function(u, name="stretch")
    assert isinstance(back, fem.Function)
    assert back.name == "stretch"
    np.testing.assert_array_equal(back.x.array, field.x.array)  # ghosts as well
    assert integral(model, ufl.div(back) * ufl.dx) == pytest.approx(2e-4, rel=1e-12)
    # sigma_zz = (lambda + 2 mu) 1e-4 with lambda = E nu/((1+nu)(1-2nu)), mu = E/(2(1+nu)).
    nu, young = CONCRETE.poisson, CONCRETE.young
    modulus = young * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    stress = integral(model, model.body.stress(back)[2, 2] * ufl.dx)
    assert stress == pytest.approx(modulus * 2e-4, rel=1e-12)


def test_dofs_are_doubled_at_the_joint_only(blocks, bar):
    # 3 x 3 x 5 nodes, 9 of them on the joint.
    assert dj.Model(bar, material=BAR).num_dofs == 3 * 45
    assert dj.Model(blocks, material=BAR, joints=LAW).num_dofs == 3 * 54


def test_two_laws_and_an_initial_gap(wall_file, read, comm):
    # Gaps at zero displacement: what was given, on the joints that it was given for.
    soft = dj.FrictionNoTension(normal_stiffness=1e9, shear_stiffness=1e8, friction_angle_deg=20.0)
    model = dj.Model(
        read(wall_file()),
        material=CONCRETE,
        joints=dj.Joints(
            {"joint_1": LAW, "joint_2": soft, "joint_3": LAW},
            initial_gaps={"joint_1": 1e-3, "joint_2": lambda x: 1e-4 * (x[:, 2] - 1.0)},
        ),
        supports=[BASE],
    )
    u = model.mass.createVecRight()
    u.set(0.0)
    state = model.contact.at_rest(u)
    joint, z = model.operator.joint, model.operator.points[:, 2]
    expected = np.select([joint == 0, joint == 1], [np.full(len(z), 1e-3), 1e-4 * (z - 1.0)], 0.0)
    np.testing.assert_allclose(state.gap[:, 0], expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(state.gap[:, 1:], 0.0)
    stiffness = model.contact.closed_tangent()
    np.testing.assert_array_equal(stiffness[joint == 1, 0, 0], 1e9)
    np.testing.assert_array_equal(stiffness[joint != 1, 0, 0], 1e11)
    np.testing.assert_array_equal(stiffness[joint == 1, 1, 1], 1e8)
    counts = model.contact.counts(model.contact.trial(u, state).status)
    # joint_1 is open; joint_2 too but for its 2 lowest of 8 points, at z = 0; joint_3 is closed.
    assert (counts.open, counts.stick, counts.slip) == (8 + 6, 2 + 8, 0)


# Refusals, the same on every rank.


def test_missing_group_lists_the_groups(comm, bar):
    for call in (
        lambda: dj.Model(bar, material=BAR, supports=[dj.Fixed(group="bottom")]),
        lambda: dj.Model(
            bar, material=BAR, supports=[dj.Spring(group="bottom", normal_stiffness=1.0)]
        ),
        lambda: dj.Model(
            bar, material=BAR, supports=[dj.Prescribed(group="bottom", component="x", value=float)]
        ),
        lambda: dj.Model(
            bar, material=BAR, loads=[dj.Pressure(group="bottom", value=1.0)]
        ).system(),
        lambda: dj.Model(
            bar, material=BAR, loads=[dj.Traction(group="bottom", value=(0, 0, 1))]
        ).system(),
    ):
        text = error_on_all_ranks(comm, dj.MeshError, call)
        assert text.startswith("The mesh has no facet group 'bottom'; its facet groups are: base, ")
        assert "top" in text
    text = error_on_all_ranks(comm, dj.MeshError, lambda: dj.Model(bar, material={"rock": BAR}))
    assert text == "The mesh has no cell group 'rock'; its cell groups are: lower, upper."


def test_missing_and_unknown_joints(comm, blocks_file, wall_file, read):
    path = blocks_file(angle=0.0)
    jointed, wall = read(path), read(wall_file())
    text = error_on_all_ranks(comm, dj.MeshError, lambda: dj.Model(jointed, material=BAR))
    assert text.startswith("The mesh has joints (joint_1) but no law was given")
    text = error_on_all_ranks(
        comm,
        dj.MeshError,
        lambda: dj.Model(wall, material=BAR, joints={"joint_1": LAW, "joint_3": LAW}),
    )
    assert text == "The joint 'joint_2' has no law."
    for options in (
        {"joints": {"joint_1": LAW, "seam": LAW}},
        {"joints": dj.Joints(LAW, initial_gaps={"seam": 1e-3})},
    ):
        text = error_on_all_ranks(
            comm, dj.MeshError, lambda options=options: dj.Model(jointed, material=BAR, **options)
        )
        assert text == "There is no joint 'seam'; the joints are: joint_1."
    text = error_on_all_ranks(
        comm,
        dj.MeshError,
        lambda: dj.Model(read(path, joints=[]), material=BAR, joints={"joint_1": LAW}),
    )
    assert text == "The mesh has no joints, but laws were given for joint_1."
    text = error_on_all_ranks(
        comm, dj.MeshError, lambda: dj.Model(read(path, joints=[]), material=BAR, joints=LAW)
    )
    assert text.startswith(
        f"The mesh has no joints, but Model was given the law {type(LAW).__name__}."
    )
    text = error_on_all_ranks(comm, dj.MeshError, lambda: read(path, joints=["seam"]))
    assert text.startswith("The mesh has no joint 'seam'")
    assert "its surface groups are: base, joint_1, sides, top." in text
    text = error_on_all_ranks(comm, dj.MeshError, lambda: read(path.with_name("none.msh")))
    assert text.endswith("none.msh' does not exist.")


def test_materials_must_cover_the_mesh_once(comm, bar):
    text = error_on_all_ranks(comm, ValueError, lambda: dj.Model(bar, material={"lower": BAR}))
    assert "cells have no material or more than one" in text
    assert "the groups lower must cover the mesh without overlap." in text
    # Half of the cells of 2 x 2 x 4 are in the upper block.
    assert text.startswith("8 cells ")


def test_options_out_of_range(comm, bar, blocks):
    base = {"material": BAR, "supports": [BASE]}
    text = error_on_all_ranks(comm, ValueError, lambda: dj.Model(bar, material={}))
    assert text == "material is an empty mapping; give one material per cell group."
    short = dj.Model(bar, **base, loads=[dj.Traction(group="top", value=(0.0, 1.0))])
    text = error_on_all_ranks(comm, ValueError, short.system)
    assert text.startswith("Traction on 'top': value is (0.0, 1.0); it must be 3 finite numbers")
    text = error_on_all_ranks(
        comm,
        ValueError,
        lambda: dj.Model(blocks, joints=dj.Joints(LAW, quadrature="lobatto"), **base),
    )
    assert text.startswith("quadrature is 'lobatto'; it must be one of auto, nodal, gauss")
