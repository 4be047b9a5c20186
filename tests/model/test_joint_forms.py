# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""User-defined forms over joints in stiffness, damping, mass and load.

      | 1 | 2 | 3 | 4 |   The wall of four blocks laid on its side, gravity along -x: the blocks
      ////                stand on one another and press the joints closed, where a joint law is
                          linear and a form over dS with the rule of the operator is the same sum.

Patch test: u = a y, y the height over the clamped base, has a constant stress sigma_0. The loads
sigma_0 n on all other faces make it the solution; blocks tied by Nitsche's method must find it.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from dolfinx import fem
from grids import case
from shaken_wall import swaying

import dolfinx_joints as dj
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.modes import modes

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
YOUNG, POISSON = 24e9, 0.2
CONCRETE = dj.Elastic(young=YOUNG, poisson=POISSON, density=2400.0)
K_N, K_S = 1e11, 4e10  # of a joint [Pa/m]
KEYED = dj.KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S)
FRICTION = dj.FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0)
DT = 0.004


def layer(jointed, joints=None, normal=K_N, shear=K_S):
    """Springs or dashpots across joints at the points of the nodal rule."""
    # As constants, so that other values are not compiled anew.
    normal, shear = (fem.Constant(jointed.mesh, k) for k in (normal, shear))

    def form(u, v):
        n, dS = ufl.FacetNormal(jointed.mesh)("-"), jointed.dS(joints, quadrature="nodal")
        across = ufl.dot(ufl.jump(u), n) * ufl.dot(ufl.jump(v), n)
        return (normal * across + shear * (ufl.inner(ufl.jump(u), ufl.jump(v)) - across)) * dS

    return form


@pytest.fixture
def wall(wall_file, read):
    """The mesh of the wall, with ``joints=[]`` of a whole one."""
    return lambda on=None, **given: read(wall_file(), on, **given)


def laid(jointed, **changes):
    """The wall on its side."""
    given = {"loads": [dj.Gravity(acceleration=(-9.80665, 0.0, 0.0))]}
    return dj.Model(
        jointed, material=CONCRETE, supports=[dj.Fixed(group="x_min")], **{**given, **changes}
    )


def upright(jointed, **changes):
    return dj.Model(
        jointed,
        material=CONCRETE,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        **changes,
    )


def gently(time):
    """One that leaves the joints of the wall on its side closed, [m/s^2]."""
    return 0.05 * swaying(time)


def difference(one, two):
    """Of two displacements, relative to the largest."""
    change = one.copy()
    change.axpy(-1.0, two)
    return change.norm(3) / two.norm(3)


def integral(model, form):
    return COMM.allreduce(fem.assemble_scalar(fem.form(form)))


def run(model, *, motion=swaying, steps=6, solver="auto", scheme=None, **options):
    """Self weight and some steps: the static state and the outcome."""
    newton = dj.SolverOptions(**{"relative_tolerance": 1e-12, **options})
    simulation = dj.Simulation(model, solver=solver, options=newton)
    static = simulation.statics()
    return static, simulation.dynamics(dt=DT, steps=steps, motion=motion, scheme=scheme)


def agree(one, two, tolerance):
    """Static and last displacements of two runs."""
    assert difference(one[0].displacement, two[0].displacement) <= tolerance
    assert difference(one[1].state.displacement, two[1].state.displacement) <= tolerance


def test_springs_are_a_quadratic_potential(wall):
    """In the wall that stands, where joints open."""

    def energy(g):
        return 0.5 * (K_N * g[0] ** 2 + K_S * (g[1] ** 2 + g[2] ** 2))

    law = dj.PotentialJoint(energy, normal_stiffness=K_N, shear_stiffness=K_S)
    two = (
        upright(wall(), body=dj.Body(extra_stiffness=layer(wall()))),
        upright(wall(), joints=law),
    )
    agree(*(run(model) for model in two), tolerance=1e-11)


SOLVERS = [("dense", "direct"), ("compressed", "direct"), ("matrix-free", "iterative")]


@pytest.mark.parametrize("solver", ["forms", *SOLVERS])
def test_solvers_agree_where_springs_stand_beside_a_law(wall, solver):
    """K couples two of four blocks; nothing but joints holds three of them."""
    springs = dj.Body(extra_stiffness=layer(wall(), "joint_2", 1e10, 1e9))
    model = laid(wall(), joints=FRICTION, body=springs)
    expected = run(model, solver="monolithic")
    if solver == "forms":
        found = run(model, solver="forms")
    else:
        found = run(model, solver="condensed", compliance=solver[0], linear=solver[1])
    assert found[1].solver == (solver if solver == "forms" else "condensed")
    agree(found, expected, 1e-10)


def test_springs_alone_hold_blocks_for_the_condensed_solver(wall):
    """No block is loose then, and the friction between them may be little."""
    smooth = dj.FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=2.0)
    model = laid(wall(), joints=smooth, body=dj.Body(extra_stiffness=layer(wall(), None, 1e8, 1e8)))
    auto, held = (run(model, solver=solver) for solver in ("auto", "monolithic"))
    assert (auto[1].solver, held[1].solver) == ("condensed", "monolithic")
    agree(auto, held, 1e-10)


def test_dashpots_are_a_viscous_joint(wall):
    """Rayleigh damping leaves the springs across the joints out as it does those of a law."""
    c_n, c_s = 2e8, 1e8
    viscous = dj.ViscousJoint(law=KEYED, normal_viscosity=c_n, shear_viscosity=c_s)
    rayleigh = dj.Rayleigh(stiffness_factor=1e-3, mass_factor=0.5)
    expected = run(laid(wall(), joints=viscous, damping=rayleigh), motion=gently, steps=10)
    assert expected[1].state.joints.status.max(initial=1) == 1  # all of them stick
    dashpots = dj.Body(extra_damping=layer(wall(), None, c_n, c_s))
    beside = laid(wall(), joints=KEYED, body=dashpots, damping=rayleigh)
    beside = run(beside, motion=gently, steps=10)
    both = replace(dashpots, extra_stiffness=layer(wall()))
    springs = laid(wall(), body=both, damping=rayleigh)
    alone = run(springs, motion=gently, steps=10)
    agree(beside, expected, 1e-11)
    agree(alone, expected, 1e-11)
    plain = laid(wall(), joints=KEYED, damping=rayleigh)
    without = run(plain, motion=gently, steps=10)
    assert difference(without[1].state.displacement, expected[1].state.displacement) > 1e-4


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_a_pressure_over_a_joint_is_uplift(wall_file, read, cell):
    """+p jump(v).n pushes the faces apart: the work of p on an opening is positive."""
    jointed = read(wall_file(cell=cell))
    p, n, dS = 2e5, ufl.FacetNormal(jointed.mesh)("-"), jointed.dS("joint_2", quadrature="nodal")
    water = dj.FormLoad(form=lambda v: p * ufl.dot(ufl.jump(v), n) * dS)
    model = laid(jointed, joints=FRICTION)
    ((found, _),), ((expected, _),) = (
        load.patterns(model) for load in (water, dj.Uplift(joint="joint_2", pressure=p))
    )
    assert difference(found, expected) <= 1e-14


def stress(u):
    mu = YOUNG / (2.0 * (1.0 + POISSON))
    lame = 2.0 * mu * POISSON / (1.0 - 2.0 * POISSON)
    strain = ufl.sym(ufl.grad(u))
    return 2.0 * mu * strain + lame * ufl.tr(strain) * ufl.Identity(len(u))


def nitsche(jointed, *, penalty, sign):
    """Ties the sides of all joints; jump(.) = + less -, n from - to +."""

    penalty, sign = (fem.Constant(jointed.mesh, k) for k in (penalty, sign))

    def form(u, v):
        n, h = ufl.FacetNormal(jointed.mesh)("-"), ufl.avg(ufl.CellDiameter(jointed.mesh))
        across = ufl.inner(ufl.avg(stress(u)) * n, ufl.jump(v))
        turned = ufl.inner(ufl.avg(stress(v)) * n, ufl.jump(u))
        tie = penalty * YOUNG / h * ufl.inner(ufl.jump(u), ufl.jump(v))
        return (across + sign * turned + tie) * jointed.dS()

    return form


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("cell", ["tri", "quad", "tet"])
def test_patch_with_nitsches_method(two_rectangles_file, blocks_file, read, cell, symmetric):
    """The joint is inclined and carries all components of the traction."""
    file = two_rectangles_file if cell in ("tri", "quad") else blocks_file
    jointed = read(file(cell=cell))
    dim = jointed.mesh.geometry.dim
    a = 1e-4 * np.array([0.7, -0.4, 1.1])[-dim:]
    given = {"penalty": 20.0, "sign": 1.0} if symmetric else {"penalty": 1.0, "sign": -1.0}
    x, n = ufl.SpatialCoordinate(jointed.mesh), ufl.FacetNormal(jointed.mesh)
    sigma = stress(ufl.as_vector(a) * x[dim - 1])

    def load(v):
        return ufl.inner(sigma * n, v) * jointed.ds("top") + ufl.inner(sigma * n, v) * jointed.ds(
            "sides"
        )

    model = dj.Model(
        jointed,
        material=CONCRETE,
        supports=[dj.Fixed(group="base")],
        loads=[dj.FormLoad(form=load)],
        body=dj.Body(extra_stiffness=nitsche(jointed, **given), symmetric=symmetric),
    )
    u = model.function(dj.Simulation(model).statics().displacement)
    exact = fem.Function(model.V)
    exact.interpolate(lambda x: a[:, None] * x[dim - 1])
    largest = COMM.allreduce(np.abs(exact.x.array).max(initial=0.0), op=MPI.MAX)
    error = COMM.allreduce(np.abs(u.x.array - exact.x.array).max(initial=0.0), op=MPI.MAX)
    assert error <= 1e-12 * largest


def test_modes_of_tied_blocks_tend_to_those_of_the_whole(wall):
    """From below, and the error is as the compliance of the springs: 100 times less of it."""
    whole = modes(upright(wall(joints=[])).system(), 3).frequencies
    errors = []
    for k in (1e11, 1e13):
        tied = upright(wall(), body=dj.Body(extra_stiffness=layer(wall(), None, k, k)))
        errors.append(1.0 - modes(tied.system(), 3).frequencies / whole)
    assert np.all(errors[0] > 0.0)
    assert errors[0].max() < 1e-2
    assert errors[1] == pytest.approx(errors[0] / 100.0, rel=0.02)


def test_energies_of_springs_are_strain_energy(wall):
    """Of dashpots, viscous; the ledger adds up, and `joint` is the law's alone."""
    springs, dashpots = layer(wall(), "joint_2", 1e9, 1e9), layer(wall(), "joint_1", 1e6, 1e6)
    model = upright(
        wall(), joints=FRICTION, body=dj.Body(extra_stiffness=springs, extra_damping=dashpots)
    )
    _, outcome = run(model, steps=20)
    assert outcome.imbalance <= 1e-10
    assert outcome.energy.viscous > 1e-4 * outcome.energy.stored
    u = model.function(outcome.state.displacement)
    of_springs = integral(model, 0.5 * springs(u, u))
    of_body = integral(model, 0.5 * ufl.inner(stress(u), ufl.sym(ufl.grad(u))) * ufl.dx)
    assert of_springs > 1e-4 * of_body
    assert outcome.energy.strain == pytest.approx(of_springs + of_body, rel=1e-10)


def test_redistributed_mass_stays_in_its_block():
    """As without the springs, by which nodes beyond a crossing seem to lie behind a joint."""
    shape = CellShape(name="quadrilateral", degree=1)
    cells, x, joints, _ = case("T", shape)
    jointed = dj.mesh_from_arrays(
        COMM, cell=shape.name, x=x, cells=cells, facet_groups=dict(joints), joints=["a", "b"]
    )
    given = {"material": CONCRETE, "joints": FRICTION}
    found, expected = (
        dj.Model(jointed, **given, body=body).redistribution
        for body in (
            dj.Body(extra_stiffness=layer(jointed), redistribute_mass=True),
            dj.Body(redistribute_mass=True),
        )
    )
    assert found.massless == expected.massless > 0
    found.mass.axpy(-1.0, expected.mass)
    assert found.mass.norm() <= 1e-14 * expected.mass.norm()


def test_extra_mass_over_a_joint(wall):
    """m jump(u).jump(v): a motion in common does not feel it, opposite ones do."""
    m = 500.0
    dS = wall().dS("joint_2")
    model = upright(
        wall(),
        joints=FRICTION,
        body=dj.Body(extra_mass=lambda u, v: m * ufl.inner(ufl.jump(u), ufl.jump(v)) * dS),
    )
    moved = np.array([1.0, -2.0, 3.0])
    together = model.inertia_pattern(moved)
    assert difference(together, model.inertia_pattern(moved, body_only=True)) <= 1e-13
    u = model.mass.createVecRight()
    u.setRandom()
    added, given = u.duplicate(), model.function(u)
    model.mass.mult(u, added)
    expected = integral(model, m * ufl.inner(ufl.jump(given), ufl.jump(given)) * dS)
    of_body = u.duplicate()
    model.body_mass.mult(u, of_body)
    assert added.dot(u) - of_body.dot(u) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("solver", ["auto", "monolithic"])
def test_any_number_of_ranks(wall, solver):
    def found(comm):
        jointed = wall(comm)
        p, n = 1e5, ufl.FacetNormal(jointed.mesh)("-")
        load = dj.FormLoad(form=lambda v: p * ufl.dot(ufl.jump(v), n) * jointed.dS("joint_3"))
        model = upright(
            jointed,
            joints=FRICTION,
            body=dj.Body(
                extra_stiffness=layer(jointed, "joint_1", 1e9, 1e9),
                extra_damping=layer(jointed, "joint_2", 1e6, 1e6),
            ),
        )
        model.loads.append(load)
        _, outcome = run(model, solver=solver)
        return COMM.bcast(NodeNumbering(model.V).gather(outcome.state.displacement))

    together, alone = found(COMM), found(MPI.COMM_SELF)
    assert np.abs(together - alone).max() <= 1e-12 * np.abs(alone).max()


def test_joints_without_law_and_form_are_refused(wall):
    dS = wall().dS(["joint_1", "joint_3"])
    with pytest.raises(
        dj.MeshError, match=r"has joints \(joint_2\) but no law was given. Pass joints"
    ):
        upright(
            wall(),
            body=dj.Body(extra_stiffness=lambda u, v: ufl.inner(ufl.jump(u), ufl.jump(v)) * dS),
        )
    with pytest.raises(dj.MeshError, match=r"has joints \(joint_1, joint_2, joint_3\) but no law"):
        upright(
            wall(), body=dj.Body(extra_stiffness=lambda u, v: ufl.inner(u, v) * wall().ds("crest"))
        )
