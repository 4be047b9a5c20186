# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint in series with an elastic bar, pushed, opened and closed again, and bent.

    axis                  u_top(t) downwards
     ^   top  ________    rollers along all faces that are named below
     |       |        |
     |       |        |   L = 2 m, cross-section S x S (S x 1 in 2-D), S = 0.5 m
     |  joint|========|   k_n, initial gap g_0
     |  left |        | right           in 3-D also front and back
     |  base |________|

Exact: sigma = -<u_top - g_0> / (1/k_n + L/m), the same at every point, and no shear. The modulus m
depends on what the sides may do (E Young's modulus, nu Poisson's ratio, M the oedometric modulus):

                             free sides       held sides
    3-D                      E                M = E (1 - nu) / ((1 + nu) (1 - 2 nu))
    plane strain             E / (1 - nu^2)   M
    plane stress             E                E / (1 - nu^2)

The stress is uniform and the displacement linear, so every element holds it exactly and what is
left is rounding. A traction is k_n times the difference of two displacements of the size u_top:
rounding of u_top, eps = 2.2e-16, makes eps k_n u_top / sigma = eps (1 + k_n L/m) of the traction,
whatever the element. Largest relative errors of all elements of `RULES`, h the cell size:

    k_n h/E      1e-4   1e-2   1e0    1e2    1e4    1e6    1e8    1e10
    traction    1e-14  1e-14  1e-14  2e-13  2e-11  2e-9   2e-7   2e-5
    force       9e-11  8e-13  2e-14  3e-14  3e-12  3e-10  2e-8   3e-6

Forces of the supports also lose something with soft joints, where the bar moves nearly rigidly.

Bending: the base is clamped, nu = 0, and the top carries sigma(x) = -p + b (x - S/2), statically
determined. With the initial gap g_0(x), negative (the faces overlap), the jump is
sigma/k_n - g_0(x) if both are linear in x: the upper block turns as a rigid body.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from boxes import box, largest

import dolfinx_joints as dj

LENGTH, SIDE, YOUNG = 2.0, 0.5, 30e9  # m, m, Pa
PUSH = 1e-3  # m of shortening at time 1
ELEMENTS = [("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 1), ("tetrahedron", 2)]
CELLS = 4  # along the bar
POISSON = 0.3
EPS = np.finfo(float).eps
# Cell, degree of the displacement, rule on the joint, plane.
RULES = [
    ("hexahedron", 1, "nodal", "strain"),
    ("hexahedron", 1, "gauss", "strain"),
    ("hexahedron", 2, "nodal", "strain"),
    ("tetrahedron", 1, "nodal", "strain"),
    ("tetrahedron", 2, "auto", "strain"),
    ("tetrahedron", 2, "gauss", "strain"),
    *(
        (cell, degree, rule, plane)
        for cell in ("triangle", "quadrilateral")
        for degree, rule in ((1, "nodal"), (1, "gauss"), (2, "nodal"), (2, "gauss"))
        for plane in ("strain", "stress")
    ),
]


class SeriesBar:
    """The exact solution.

    Args:
        modulus: Stress over strain along the axis [Pa].
        k_n: Joint stiffness [Pa/m].
        gap: Initial gap [m].
    """

    def __init__(self, modulus, k_n, gap=0.0):
        self.compliance, self.gap = 1.0 / k_n + LENGTH / modulus, gap

    def stress(self, time):
        """Stress [Pa], at a time that gives the push ``PUSH * time``."""
        return -max(PUSH * time - self.gap, 0.0) / self.compliance


def modulus(dim, plane, held):
    """The table above [Pa]."""
    oedometric = YOUNG * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON))
    plate = YOUNG / (1 - POISSON**2)
    if dim == 3:
        return oedometric if held else YOUNG
    return {"strain": (plate, oedometric), "stress": (YOUNG, plate)}[plane][held]


def bar(cell):
    """The bar in 2-D or 3-D with a group for every face."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    sides = ("left", "right", "front", "back")[: 2 * dim - 2]
    groups = {name: (i // 2, (i % 2) * SIDE) for i, name in enumerate(sides)}
    return box(
        [SIDE] * (dim - 1) + [LENGTH],
        [2] * (dim - 1) + [CELLS],
        cell,
        joints={"joint_1": (dim - 1, LENGTH / 2)},
        groups=groups | {"base": (dim - 1, 0.0), "top": (dim - 1, LENGTH)},
    )


def friction(k_n):
    return dj.FrictionNoTension(
        normal_stiffness=k_n, shear_stiffness=0.4 * k_n, friction_angle_deg=30.0
    )


def pushed(cell, degree, rule, plane, *, k_n, held, gap=0.0):
    """The bar on rollers, with its exact solution."""
    jointed = bar(cell)
    dim = jointed.mesh.topology.dim
    axis = "xyz"[dim - 1]
    rollers = [("left", "x"), ("front", "y"), ("right", "x"), ("back", "y")]
    rollers = [r for r in rollers[: None if held else 2] if dim == 3 or r[1] == "x"]
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=POISSON, density=0.0),
        joints=dj.Joints(friction(k_n), initial_gaps={"joint_1": gap}, quadrature=rule),
        supports=[
            dj.Fixed(group="base", components=axis),
            dj.Prescribed(group="top", component=axis, value=lambda time: -PUSH * time),
            *(dj.Fixed(group=name, components=normal) for name, normal in rollers),
        ],
        body=dj.Body(degree=degree, plane=plane),
    )
    size = gap if isinstance(gap, float) else float(gap(np.zeros((1, 3)))[0])
    return dj.Simulation(model), SeriesBar(modulus(dim, plane, held), k_n, size)


def errors(run, state, expected, scale):
    """Of tractions, and of the force on the top, relative to a stress [Pa]."""
    traction = largest(state.joints.traction - np.array([expected, 0.0, 0.0])) / scale
    axis = run.model.gdim - 1
    force = run.model.resultant(state.reaction, "top")[axis]
    return traction, abs(force / SIDE**axis - expected) / scale


def rounding(k_n):
    """Relative errors of tractions and forces that rounding may leave, see the top of the file."""
    stiff = EPS * (1.0 + k_n * LENGTH / YOUNG)
    soft = EPS * YOUNG / (k_n * LENGTH / CELLS)
    return 5e-13 + 5.0 * stiff, 5e-13 + stiff + 1e3 * soft


@pytest.mark.mpi
@pytest.mark.parametrize("as_field", [False, True], ids=["number", "field"])
@pytest.mark.parametrize(("cell", "degree"), ELEMENTS)
def test_stress_with_an_initial_gap(cell, degree, as_field):
    """Pushed until it touches, beyond, back until it opens, and pulled."""
    gap = (lambda x: np.full(len(x), 4e-4)) if as_field else 4e-4
    run, exact = pushed(cell, degree, "auto", "strain", k_n=1e11, held=True, gap=gap)
    for time in (0.3, 0.5, 1.0, 0.7, 0.2, -0.5):
        expected = exact.stress(time)
        assert (expected < 0.0) == (PUSH * time > 4e-4)
        state = run.quasi_statics([time])
        assert max(errors(run, state, expected, abs(exact.stress(1.0)))) < 1e-10
    # Pulled by 0.5 mm: the halves bear no stress, the gap is 0.4 + 0.5 mm.
    assert largest(state.joints.state.gap[:, 0] - 9e-4) < 1e-10 * 9e-4


@pytest.mark.parametrize("held", [False, True], ids=["free", "held"])
@pytest.mark.parametrize(("cell", "degree", "rule", "plane"), RULES)
def test_modulus(cell, degree, rule, plane, held):
    """Closed, opened and closed again, for every element, rule and state of the sides."""
    gap = 4e-4
    run, exact = pushed(cell, degree, rule, plane, k_n=1e11, held=held, gap=gap)
    for time in (1.0, 0.2, 0.8):
        state = run.quasi_statics([time])
        assert max(errors(run, state, exact.stress(time), abs(exact.stress(1.0)))) < 1e-10


@pytest.mark.parametrize("power", range(-4, 11, 2))
@pytest.mark.parametrize(
    ("cell", "degree", "rule"),
    [
        ("hexahedron", 1, "nodal"),
        ("tetrahedron", 1, "gauss"),
        ("tetrahedron", 2, "auto"),
        ("triangle", 2, "gauss"),
        ("quadrilateral", 1, "nodal"),
    ],
)
def test_any_joint_stiffness(cell, degree, rule, power):
    """1e-10 or better from k_n h/E = 1e-2 to 1e4; beyond, what rounding leaves (see above)."""
    ratio = 10.0**power
    k_n = ratio * YOUNG / (LENGTH / CELLS)
    run, exact = pushed(cell, degree, rule, "strain", k_n=k_n, held=True)
    expected = exact.stress(1.0)
    traction, force = errors(run, run.quasi_statics([1.0]), expected, abs(expected))
    of_traction, of_force = rounding(k_n)
    assert traction < of_traction
    assert force < of_force
    if -2 <= power <= 4:
        assert max(traction, force) < 1e-10


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("cell", "rule"),
    [
        ("hexahedron", "nodal"),
        ("hexahedron", "gauss"),
        ("tetrahedron", "auto"),
        ("tetrahedron", "gauss"),
        ("triangle", "nodal"),
        ("quadrilateral", "nodal"),
        ("quadrilateral", "gauss"),
    ],
)
def test_bending_and_a_wedge(cell, rule):
    """A wedge driven into the joint turns the upper block and leaves the stress as it is.

    u_axis = (-p + b x') z / E and u_x = -b z^2 / (2 E), x' = x - S/2, hold below the joint:
    complete quadratics, which elements of degree 2 hold exactly.
    """
    jointed, k_n = bar(cell), 1e11
    pressure, slope = 1e6, 3e6  # Pa, Pa/m: closed, as slope times S/2 is 0.75 MPa
    axis = jointed.mesh.topology.dim - 1

    def stress(x):
        return -pressure + slope * (x - SIDE / 2)

    def wedge(points):
        return -1e-5 - 4e-5 * points[:, 0]

    here = ufl.SpatialCoordinate(jointed.mesh)
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=0.0),
        joints=dj.Joints(friction(k_n), initial_gaps={"joint_1": wedge}, quadrature=rule),
        supports=[dj.Fixed(group="base")],
        loads=[dj.FormLoad(form=lambda v: stress(here[0]) * v[axis] * jointed.ds("top"))],
        body=dj.Body(degree=2),
    )
    state = dj.Simulation(model).statics()
    x = model.operator.points[:, 0]
    exact = np.column_stack([stress(x), np.zeros((len(x), 2))])
    assert largest(state.joints.traction - exact) < 1e-10 * pressure
    assert largest(state.joints.state.gap[:, 0] - stress(x) / k_n) < 1e-10 * pressure / k_n
    u = model.function(state.displacement).x.array.reshape(-1, axis + 1)
    x, z = model.V.tabulate_dof_coordinates()[:, [0, axis]].T
    below = z < LENGTH / 2 - 1e-9
    along = stress(x) * z / YOUNG
    assert largest((u[:, axis] - along)[below]) < 1e-10 * largest(along)
    turned = -slope * z**2 / (2 * YOUNG)
    assert largest((u[:, 0] - turned)[below]) < 1e-10 * largest(along)
    above = z > LENGTH / 2 + 1e-9
    jump = stress(x) / k_n - wedge(np.column_stack([x]))
    assert largest((u[:, axis] - along - jump)[above]) < 1e-10 * largest(jump)


def test_numbers_by_hand():
    """1 mm on 1/k_n + L/E = 1e-11 + 2/30e9 = 7.6667e-11 m/Pa: 13.0435 MPa; with 0.4 mm, 7.82609.

    nu = 0.3: M = 30 x 0.7/(1.3 x 0.4) = 40.3846 GPa, E/(1 - nu^2) = 30/0.91 = 32.9670 GPa.
    """
    assert SeriesBar(YOUNG, 1e11).stress(1.0) == pytest.approx(-13.0435e6, rel=1e-5)
    assert SeriesBar(YOUNG, 1e11, 4e-4).stress(1.0) == pytest.approx(-7.82609e6, rel=1e-5)
    assert modulus(3, "strain", True) == pytest.approx(40.3846e9, rel=1e-5)
    assert modulus(2, "stress", True) == pytest.approx(32.9670e9, rel=1e-5)
