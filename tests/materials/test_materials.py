# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Orthotropic bodies against their tensor of stiffness, turned by hand; any number of ranks."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx import mesh as dmesh

import dolfinx_joints as dj
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.body_cells import CellOrder
from dolfinx_joints.monitors.cell_fields import CellFields
from dolfinx_joints.monitors.surface_stress import SurfaceStress

pytestmark = pytest.mark.mpi

# Axis 3 is the one across the lifts.
YOUNG, POISSON, SHEAR = (30e9, 26e9, 18e9), (0.2, 0.25, 0.22), (11e9, 7e9, 8e9)
TURN = np.linalg.qr(np.array([[1.0, 0.4, -0.3], [0.2, 1.0, 0.5], [-0.6, 0.1, 1.0]]))[0].T
ANGLE = math.radians(25.0)
IN_PLANE = np.array(
    [[math.cos(ANGLE), math.sin(ANGLE), 0], [-math.sin(ANGLE), math.cos(ANGLE), 0], [0, 0, 1]]
)
CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def lifts(**changes):
    return dj.Orthotropic(
        **{"young": YOUNG, "poisson": POISSON, "shear": SHEAR, "density": 2400.0, **changes}
    )


def turned_tensor(frame):
    """C_ijkl in x, y, z: the compliance written out, inverted, each index turned by the frame."""
    e1, e2, e3 = YOUNG
    nu12, nu13, nu23 = POISSON
    normal = np.array(
        [
            [1 / e1, -nu12 / e1, -nu13 / e1],
            [-nu12 / e1, 1 / e2, -nu23 / e2],
            [-nu13 / e1, -nu23 / e2, 1 / e3],
        ]
    )
    local = np.zeros((3, 3, 3, 3))
    for i, row in enumerate(np.linalg.inv(normal)):
        for j, value in enumerate(row):
            local[i, i, j, j] = value
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), SHEAR, strict=True):
        for a, b in ((i, j), (j, i)):
            local[a, b, i, j] = local[a, b, j, i] = value
    return np.einsum("ai,bj,ck,dl,abcd->ijkl", frame, frame, frame, frame, local)


def body(comm, kind, material, *, plane="strain", degree=1, **options):
    """A unit square or cube in a few cells, halves ``low`` and ``high`` along its last axis."""
    cell = getattr(dmesh.CellType, kind)
    if kind in ("hexahedron", "tetrahedron"):
        mesh = dmesh.create_unit_cube(comm, 2, 2, 2, cell)
    else:
        mesh = dmesh.create_unit_square(comm, 2, 2, cell)
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    planes = {"xyz"[i]: lambda x, i=i: np.isclose(x[i], 0.0) for i in range(dim)}
    planes["top"] = lambda x: np.isclose(x[dim - 1], 1.0)
    jointed = dj.split_mesh(
        mesh,
        groups={n: dmesh.locate_entities_boundary(mesh, dim - 1, at) for n, at in planes.items()},
        cell_groups={
            "low": dmesh.locate_entities(mesh, dim, lambda x: x[dim - 1] <= 0.5 + 1e-9),
            "high": dmesh.locate_entities(mesh, dim, lambda x: x[dim - 1] >= 0.5 - 1e-9),
        },
    )
    supports = [dj.Fixed(group="xyz"[i], components="xyz"[i]) for i in range(dim)]
    options["body"] = dj.Body(plane=plane, degree=degree)
    return dj.Model(jointed, material=material, supports=supports, **options)


def displacement(model, gradient):
    u, size = model.stiffness.createVecRight(), model.gdim
    x = model.V.tabulate_dof_coordinates()[: u.getLocalSize() // size, :size]
    u.setArray((x @ gradient.T).ravel())
    return u


def measured(model):
    """Stiffness between unit strains: v.K u of linear u and v on a body of unit volume."""
    size = model.gdim
    pairs = PAIRS if size == 3 else ((0, 0), (1, 1), (0, 1))
    fields = []
    for i, j in pairs:
        gradient = np.zeros((size, size))
        gradient[i, j] = 1.0  # a shear strain is the angle
        fields.append(displacement(model, gradient))
    forces = []
    for field in fields:
        forces.append(field.duplicate())
        model.stiffness.mult(field, forces[-1])
    return np.array([[field.dot(force) for force in forces] for field in fields])


def components(tensor):
    return np.array([[tensor[i, j, k, m] for k, m in PAIRS] for i, j in PAIRS])


@pytest.mark.parametrize("kind", ["hexahedron", "tetrahedron"])
def test_linear_displacements_measure_the_turned_tensor(comm, kind):
    wanted = components(turned_tensor(TURN))
    model = body(comm, kind, lifts(axes=2.5 * TURN))  # of any length
    np.testing.assert_allclose(measured(model), wanted, atol=1e-12 * wanted.max())


def test_forces_of_a_linear_displacement_vanish_inside(comm):
    # The patch test: constant stress needs no forces at inner nodes.
    model = body(comm, "hexahedron", lifts(axes=TURN), degree=2)
    u = displacement(model, np.array([[1.0, 2.0, -1.0], [0.5, -2.0, 0.3], [0.7, -0.2, 3.0]]))
    force = u.duplicate()
    model.stiffness.mult(u, force)
    x = model.V.tabulate_dof_coordinates()[: u.getLocalSize() // 3]
    inside = np.all((x > 1e-9) & (x < 1 - 1e-9), axis=1)
    values = force.getArray().reshape(-1, 3)
    largest = max(comm.allgather(np.abs(values).max(initial=0.0)))
    assert np.abs(values[inside]).max(initial=0.0) < 1e-13 * largest


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_plane_bodies_take_their_part_of_the_tensor(comm, plane):
    # Plane strain: rows and columns of the plane. Plane stress: those of the compliance, inverted.
    whole = components(turned_tensor(IN_PLANE))
    rows = np.ix_((0, 1, 5), (0, 1, 5))
    wanted = whole[rows]
    if plane == "stress":
        wanted = np.linalg.inv(np.linalg.inv(whole)[rows])
    model = body(comm, "quadrilateral", lifts(axes=IN_PLANE), plane=plane)
    np.testing.assert_allclose(measured(model), wanted, atol=1e-12 * wanted.max())


@pytest.mark.parametrize(("kind", "plane"), [("tetrahedron", "strain"), ("triangle", "stress")])
def test_equal_constants_make_an_isotropic_body(comm, kind, plane):
    young, nu = CONCRETE.young, CONCRETE.poisson
    same = dj.Orthotropic(
        young=[young] * 3,
        poisson=[nu] * 3,
        shear=[CONCRETE.shear_modulus] * 3,
        density=2400.0,
        axes=TURN if kind == "tetrahedron" else IN_PLANE,
    )
    plain = body(comm, kind, CONCRETE, plane=plane).stiffness.convert("aij")
    difference = body(comm, kind, same, plane=plane).stiffness.convert("aij")
    difference.axpy(-1.0, plain)
    assert difference.norm() < 1e-13 * plain.norm()


@pytest.mark.parametrize(
    ("kind", "plane"),
    [("hexahedron", "strain"), ("quadrilateral", "strain"), ("triangle", "stress")],
)
def test_two_layers_in_series(comm, kind, plane):
    # Traction p along the last axis; the layers' other strains are left free in space and held out
    # of the plane in plane strain. Poisson's ratios along the layers are zero, so that they do not
    # push at each other: shortening p/2 (1/E_low + 1/E_high), E each along the load.
    low = lifts(poisson=(0.0, 0.0, 0.0))
    high = dj.Elastic(young=25e9, poisson=0.0, density=2400.0)
    axis = 2 if kind == "hexahedron" else 1
    load = dj.Traction(group="top", value=(0.0,) * axis + (1e6,))
    model = body(comm, kind, {"low": low, "high": high}, plane=plane, loads=[load])
    u = dj.Simulation(model).statics().displacement.getArray(readonly=True).reshape(-1, axis + 1)
    top = u[model.nodes("top"), axis]
    wanted = 0.5e6 * (1.0 / YOUNG[axis] + 1.0 / high.young)
    np.testing.assert_allclose(top, wanted, rtol=1e-10)


def test_recovered_stresses_are_orthotropic(comm):
    model = body(comm, "hexahedron", {"low": lifts(axes=TURN), "high": lifts(axes=TURN)})
    gradient = 1e-4 * np.array([[1.0, 2.0, -1.0], [0.5, -2.0, 0.3], [0.7, -0.2, 3.0]])
    wanted = np.einsum("ijkl,kl->ij", turned_tensor(TURN), 0.5 * (gradient + gradient.T))
    found = SurfaceStress(model, NodeNumbering(model.V))(displacement(model, gradient), 0.0)
    six = wanted[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found, np.tile(six, (len(found), 1)), rtol=1e-10)


@pytest.mark.parametrize("by_group", [False, True])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_stresses_of_cells_of_a_plane_body(comm, plane, by_group):
    lift = lifts(axes=IN_PLANE)
    material = {"low": lift, "high": lift} if by_group else lift
    model = body(comm, "quadrilateral", material, plane=plane)
    gradient = 1e-4 * np.array([[1.0, 2.0], [0.5, -2.0]])
    tensor, strain = turned_tensor(IN_PLANE), np.zeros((3, 3))
    strain[:2, :2] = 0.5 * (gradient + gradient.T)
    if plane == "stress":
        strain[2, 2] = -np.tensordot(tensor[2, 2], strain) / tensor[2, 2, 2, 2]
    xx, yy, zz, xy = np.tensordot(tensor, strain)[[0, 1, 2, 0], [0, 1, 2, 1]]
    assert (abs(zz) > 0.05 * abs(yy)) == (plane == "strain")
    found = CellFields(model, CellOrder(model))(displacement(model, gradient), None, 0.0)
    cells = found["stress [Pa]"]
    wanted = np.tile([xx, yy, zz, xy, 0.0, 0.0], (len(cells), 1))
    np.testing.assert_allclose(cells, wanted, rtol=1e-10, atol=1e-9 * abs(yy))


def test_temperatures_act_on_isotropic_cells_only(comm):
    parts = {"low": lifts(), "high": CONCRETE}
    warm = {"value": 10.0, "reference": 0.0, "expansion": 1e-5}
    free = body(comm, "hexahedron", parts, loads=[dj.Temperature(**warm, cells="high")])
    assert np.isfinite(free.system().patterns[0][0].norm())
    for cells in (None, "low"):
        with pytest.raises(ValueError, match="Temperature acts on cells of Orthotropic; it may"):
            body(comm, "hexahedron", parts, loads=[dj.Temperature(**warm, cells=cells)])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"poisson": (0.2, 1.4, 0.2)}, "not positive definite"),  # above sqrt(30/18)
        ({"poisson": (0.7, 0.7, 0.7)}, "not positive definite"),
        ({"axes": ((1, 0, 0), (1, 1, 0), (0, 0, 1))}, "must be three orthogonal vectors"),
        ({"axes": ((1, 0), (0, 1))}, "must be three orthogonal vectors"),
        ({"axes": "xyz"}, "must be three orthogonal vectors"),
    ],
)
def test_parameters_that_make_no_material(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        lifts(**changes)


def test_inclined_axes_are_refused_in_a_plane_body(comm):
    with pytest.raises(ValueError, match=r"inclined to the plane .* must be \(0, 0, 1\)"):
        body(comm, "quadrilateral", lifts(axes=TURN))


def test_what_is_no_material_is_refused(comm):
    for wrong in (3.0, None, {"low": CONCRETE, "high": "rock"}):
        with pytest.raises(
            ValueError, match="it must be an Elastic, an Orthotropic or a nonlinear"
        ):
            body(comm, "triangle", wrong)
