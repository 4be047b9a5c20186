# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints as Functions: sums over them by forms, files for ParaView, coefficients of a model.

Expected: what the joint operator and the resultants of results files say of the same state.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem
from dolfinx.io import VTKFile, VTXWriter

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=15.0)
PUSH = {"x": 3e-4, "z": -1e-4}  # of the top [m]: part of the joint slides


def blocks(jointed, joints=LAW, **parameters):
    """Two blocks, the upper one moved along their inclined joint."""
    up = "xyz"[jointed.mesh.geometry.dim - 1]
    push = {"x": PUSH["x"], up: PUSH["z"]}
    pushed = [
        dj.Prescribed(group="top", component=axis, value=lambda _, u=u: u)
        for axis, u in push.items()
    ]
    return dj.Model(
        jointed,
        material=CONCRETE,
        joints=joints,
        supports=[dj.Fixed(group="base"), *pushed],
        loads=[dj.Gravity()],
        **parameters,
    )


def total(model, form):
    value = fem.assemble_scalar(model.jointed.form(form))
    return model.jointed.mesh.comm.allreduce(value)


@pytest.fixture(params=["hex", "tet2 gauss", "tet2 auto", "quad2", "tri gauss"])
def model(request, blocks_file, two_rectangles_file, read):
    """Two blocks of several cells, with rules at nodes and inside of facets."""
    file, kind, order, rule = {
        "hex": (blocks_file, "hex", 1, "nodal"),
        "tet2 gauss": (blocks_file, "tet", 2, "gauss"),
        "tet2 auto": (blocks_file, "tet", 2, "auto"),
        "quad2": (two_rectangles_file, "quad", 2, "nodal"),
        "tri gauss": (two_rectangles_file, "tri", 1, "gauss"),
    }[request.param]
    return blocks(read(file(cell=kind, order=order)), dj.Joints(LAW, quadrature=rule))


def test_forms_are_the_sums_over_points(model):
    """Force, work and integrals of a static state; the Functions and those for ParaView."""
    state = dj.Simulation(model).statics(steps=2)
    operator, contact, joints = model.operator, model.contact, state.joints
    assert contact.counts(joints.status).slip > 0
    functions = dj.JointFunctions(model, "joint_1")
    fields = functions.fields
    functions.update(state)
    dS, gap, t = functions.dS, functions.gap("-"), functions.traction_vector("-")
    force = [-total(model, t[i] * dS) for i in range(model.gdim)]
    expected = dj.JointForces(model)(joints)["joint_1"].force[: model.gdim]
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-13 * np.abs(expected).max())

    u = model.function(state.displacement)
    nodal = state.displacement.duplicate()
    work = operator.force(joints.traction, nodal).dot(state.displacement)
    assert total(model, ufl.inner(t, ufl.jump(u)) * dS) == pytest.approx(work, rel=1e-12)

    slid = joints.state.gap[:, 1:] - joints.state.elastic_slip
    along = np.einsum("ni,ni->n", joints.traction[:, 1:], slid)
    density = np.einsum("ni,ni->n", joints.traction, joints.state.gap)
    for form, values in (
        (ufl.inner(functions.traction("-"), gap), density),
        (ufl.inner(functions.traction("-"), functions.slip("-")), along),
        (functions.status("-") * gap[0], joints.status * joints.state.gap[:, 0]),
    ):
        assert total(model, form * dS) == pytest.approx(contact.integral(values), rel=1e-12)
    assert contact.integral(along) > 0.0

    if model.operator.quadrature == "auto":
        return  # seven points and six coefficients: the fit of least squares
    for name, field in fields.items():
        at_points = getattr(functions, name)
        left, whole = (
            total(model, ufl.inner(f, f) * dS)
            for f in (field("-") - at_points("-"), at_points("-"))
        )
        assert left <= 1e-24 * whole, name


def test_functions_follow_a_run(blocks_file, read):
    """Updated to the end of dynamic steps; of another state they are another's."""
    model = blocks(read(blocks_file()))
    simulation = dj.Simulation(model)
    functions, forces = dj.JointFunctions(model), dj.JointForces(model)
    static = simulation.statics(steps=2)
    end = simulation.dynamics(dt=1e-4, steps=3, motion=lambda t: (5.0, 0.0, 0.0)).state
    pressed = []
    for state in static, end:
        functions.update(state)
        force = -total(model, functions.traction_vector("-")[2] * functions.dS)
        assert force == pytest.approx(forces(state.joints)["joint_1"].force[2], rel=1e-13)
        pressed.append(force)
    assert abs(pressed[1] / pressed[0] - 1.0) > 1e-6


def test_paraview_shows_the_points(comm, blocks_file, read, new_path):
    """Written and read: with a rule at nodes, those of the file are the joint points."""
    pyvista = pytest.importorskip("pyvista")
    model = blocks(read(blocks_file()), dj.Joints(LAW, quadrature="nodal"))
    functions = dj.JointFunctions(model)
    fields = list(functions.fields.values())
    path, bp = new_path("joint.pvd"), new_path("joint.bp")
    state = dj.Simulation(model).statics(steps=2)
    with VTKFile(comm, path, "w") as file, VTXWriter(comm, bp, fields) as vtx:
        for time in 0.0, 1.0:
            file.write_function(fields, time)
            vtx.write(time)
            functions.update(state)
    joints, operator = state.joints, model.operator
    axes, slip = operator.frames, joints.state.gap.copy()
    slip[:, 1:] -= joints.state.elastic_slip
    slip[:, 0] = 0.0
    known = {
        "points": operator.points,
        "gap": joints.state.gap,
        "traction": joints.traction,
        "traction_vector": np.einsum("nki,nk->ni", axes, joints.traction),
        "slip": slip,
        "status": joints.status,
    }
    known = {name: operator.gather(values) for name, values in known.items()}

    def look():
        reader = pyvista.get_reader(str(path))
        assert reader.time_values == [0.0, 1.0]
        reader.set_active_time_value(0.0)
        assert np.all(reader.read()[0].point_data["traction"] == 0.0)
        reader.set_active_time_value(1.0)
        read_back = reader.read()[0]
        points = known.pop("points")
        apart = np.linalg.norm(read_back.points[:, None] - points, axis=2)
        here = apart.argmin(axis=1)
        assert apart.min(axis=1).max() < 1e-14
        assert sorted(set(here)) == list(range(len(points)))
        for name, values in known.items():
            found = read_back.point_data[name]
            np.testing.assert_allclose(
                found, values[here], rtol=1e-13, atol=1e-13 * abs(values).max()
            )
        assert sum(file.stat().st_size for file in bp.iterdir()) > 0

    on_root(comm, look)


def test_coefficients_of_a_model_live_on_joints(comm, blocks_file, read):
    """k = k0 (1 + x) on the joint, |jump| = 1 m: energy k0 (1 + 1/2) A / 2, force k0 1.5 A.

    The joint has an area of 1 m^2 / cos(20 degrees), its points a mean x of 1/2 m.
    """
    jointed = read(blocks_file())
    k = fem.Function(fem.functionspace(jointed.surface("joint_1").mesh, ("Lagrange", 1)))
    k.interpolate(lambda x: 1e9 * (1.0 + x[0]))
    whole = 1.5e9 / np.cos(np.deg2rad(20.0))
    dS = jointed.dS("joint_1")

    def bilinear(u, v):
        return k("-") * ufl.inner(ufl.jump(u), ufl.jump(v)) * dS

    plain = blocks(jointed)
    model = blocks(jointed, body=dj.Body(extra_stiffness=bilinear, extra_damping=bilinear))
    u = fem.Function(model.V)
    u.interpolate(lambda x: np.array([[0.0], [0.0], [1.0]]) + 0.0 * x, jointed.cells("upper"))
    u.x.scatter_forward()
    vector = model.mass.createVecRight()
    vector.setArray(u.x.petsc_vec.getArray(readonly=True))
    product = vector.duplicate()
    for matrix in (model.stiffness, model.dashpots):
        matrix.mult(vector, product)
        assert product.dot(vector) == pytest.approx(whole, rel=1e-12)
    plain.stiffness.mult(vector, product)
    assert abs(product.dot(vector)) < 1e-9 * whole
    load = dj.FormLoad(form=lambda v: k("-") * ufl.jump(v)[2] * dS)
    ((pattern, _),) = load.patterns(model)
    assert pattern.dot(vector) == pytest.approx(whole, rel=1e-12)


def test_needs_joints(blocks_file, read):
    model = dj.Model(read(blocks_file(), joints=[]), material=CONCRETE)
    with pytest.raises(
        dj.MeshError, match="The model has no joint with a law, so there are no functions"
    ):
        dj.JointFunctions(model)
    model = blocks(read(blocks_file()))
    with pytest.raises(ValueError, match="state is .*; it must be a StaticState, DynamicState"):
        dj.JointFunctions(model).update(model)
