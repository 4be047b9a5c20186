# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Foundations: massless rock, a joint between dam and rock, supports that become dashpots."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from whole_vectors import relative_difference

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.postprocessing import measures

pytestmark = pytest.mark.mpi

LOWER, UPPER = 2.0, 4.0  # heights [m]
AXIAL = (dj.Fixed(group="base"), dj.Fixed(group="sides", components="xy"))
BAR = dj.Elastic(young=25e9, poisson=0.0, density=2400.0)
MASSLESS = dj.Elastic(young=25e9, poisson=0.0, density=0.0)
STIFF = dj.FrictionNoTension(normal_stiffness=1e14, shear_stiffness=1e14, friction_angle_deg=45.0)


@pytest.fixture
def column(blocks_file, read):
    """1 m x 1 m x 6 m with the joint z = 2 m, or without."""

    def make(order=1, joints=None):
        heights = {"lower_height": LOWER, "upper_height": UPPER}
        return read(blocks_file(angle=0.0, size=0.5, order=order, **heights), joints=joints)

    return make


def test_modes_of_a_bar_on_massless_rock(column):
    # A bar on a spring E / LOWER: E k sin(k UPPER) = (E / LOWER) cos(k UPPER), omega = k c.
    materials = {"lower": MASSLESS, "upper": BAR}
    model = dj.Model(column(order=2, joints=[]), material=materials, supports=AXIAL)
    found = dj.modes(model.system(), 3).frequencies
    speed = math.sqrt(BAR.young / BAR.density)
    for i, f in enumerate(found):
        low, high = i * math.pi, (i + 0.5) * math.pi
        for _ in range(60):  # x tan(x) rises from 0 to infinity there
            middle = 0.5 * (low + high)
            below = middle * math.tan(middle) < UPPER / LOWER
            low, high = (middle, high) if below else (low, middle)
        assert f == pytest.approx(low / UPPER * speed / (2 * math.pi), rel=2e-4 * (1 + i) ** 4)


# What ranks can change is the same for all of them.
MANY = MPI.COMM_WORLD.size > 1


@pytest.mark.parametrize(
    "scheme",
    [dj.EnergyConsistent(), dj.Newmark()][: 1 if MANY else 2],
    ids=lambda s: type(s).__name__,
)
@pytest.mark.parametrize(
    "case", ["redistributed"] if MANY else ["tied", "joint", "redistributed", "rigid"]
)
def test_stiff_block_on_massless_rock(column, case, scheme):
    """A mass on a spring, shaken by a constant acceleration: u = (m a / k) (1 - cos(omega t)).

    m = rho UPPER, k = E / LOWER per area; the block's own compliance is 2e-4 of the rock's. Weight
    keeps the joint closed, which is free of stress where only the rock is.
    """
    soft = dj.Elastic(young=1e9, poisson=0.0, density=0.0)
    block = dj.Elastic(young=1e13, poisson=0.0, density=2400.0)
    joints = {"tied": None, "rigid": dj.RigidJoint(friction_angle_deg=45.0)}.get(case, STIFF)
    model = dj.Model(
        column(joints=[] if case == "tied" else None),
        material={"lower": soft, "upper": block},
        joints=joints,
        supports=AXIAL,
        loads=[dj.Gravity()],
        body=dj.Body(redistribute_mass=case == "redistributed"),
    )
    omega = math.sqrt(1e9 / LOWER / (2400.0 * UPPER))
    simulation = dj.Simulation(model)
    static = simulation.statics()
    weight = 2400.0 * UPPER * STANDARD_GRAVITY
    assert model.resultant(static.reaction, "base")[2] == pytest.approx(weight, rel=1e-8)
    before = static.displacement.copy()
    a, steps = 3.0, 150
    dt = 1.5 * math.pi / omega / steps
    outcome = simulation.dynamics(
        dt=dt, steps=steps, motion=lambda t: (0.0, 0.0, -a), scheme=scheme
    )
    assert outcome.imbalance < 1e-9
    moved = outcome.state.displacement.copy()
    moved.axpy(-1.0, before)
    top = moved.getArray(readonly=True).reshape(-1, 3)[model.nodes("top"), 2]
    assert np.allclose(top, a / omega**2, rtol=1e-3)  # cos(3 pi / 2) = 0


def test_mass_in_one_direction_is_refused(column):
    """Rock with an extra mass along (1, 0, 1) alone, pushed across it by a sudden load."""

    def moved(u, v):
        along = ufl.as_vector([1.0, 0.0, 1.0])
        return 1e3 * ufl.inner(u, along) * ufl.inner(v, along) * ufl.dx

    model = dj.Model(
        column(joints=[]),
        material=MASSLESS,
        supports=[dj.Fixed(group="base", components="z")],
        loads=[dj.Traction(group="top", value=(1e5, 0.0, -1e5))],
        body=dj.Body(extra_mass=moved),
    )
    with pytest.raises(dj.JointsError, match="singular. Check for parts of the body that have"):
        dj.Simulation(model).dynamics(dt=0.01, steps=1)


def test_massless_rock_that_is_damped_goes_on(dam):
    """Stopped half-way and continued, or in one go: the same motion."""
    materials = {"rock": dj.Elastic(young=20e9, poisson=0.25, density=0.0), "dam": CONCRETE}
    model = dj.Model(
        dam([]),
        material=materials,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        damping=dj.rayleigh(ratio=0.05, frequencies=(5.0, 25.0)),
    )
    simulation = dj.Simulation(model)
    simulation.statics()

    def motion(t):
        return (30.0 * math.sin(40.0 * t), 0.0, 0.0)

    whole = simulation.dynamics(dt=0.005, steps=40, motion=motion)
    half = simulation.dynamics(dt=0.005, steps=20, motion=motion)
    rest = simulation.dynamics(dt=0.005, steps=20, motion=motion, start=half.state)
    assert max(run.imbalance for run in (whole, half, rest)) < 1e-9
    assert relative_difference(rest.state.displacement, whole.state.displacement) < 1e-9


def test_start_out_of_balance_is_refused(column):
    """Sudden pressure on rock without mass would swing there for ever."""
    materials = {"lower": MASSLESS, "upper": BAR}
    side = dj.Traction(group="sides", value=(0.0, 0.0, -1e5))
    model = dj.Model(
        column(joints=[]), material=materials, supports=[dj.Fixed(group="base")], loads=[side]
    )
    simulation = dj.Simulation(model)
    with pytest.raises(dj.JointsError, match=r"without mass is not in balance .* with statics\(\)"):
        simulation.dynamics(dt=0.01, steps=1)
    simulation.statics()
    assert simulation.dynamics(dt=0.01, steps=1).imbalance < 1e-9


def test_all_massless_is_refused(column):
    model = dj.Model(column(joints=[]), material=MASSLESS, supports=AXIAL)
    with pytest.raises(dj.JointsError, match="has no mass: all densities are zero"):
        dj.Simulation(model).dynamics(dt=0.01, steps=1)


def _dam_on_rock(out):
    """A trapezoid 4 m high on a block 12 m x 4 m."""
    import gmsh

    from dolfinx_joints.geometry.meshing.gmsh_model import gmsh_session

    with gmsh_session():
        geo = gmsh.model.geo
        corners = [(0, 0), (12, 0), (12, 4), (8, 4), (4, 4), (0, 4), (6, 8), (4, 8)]
        p = [geo.addPoint(x, y, 0, 1.0) for x, y in corners]
        ends = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (3, 6), (6, 7), (7, 4)]
        lines = [geo.addLine(p[a], p[b]) for a, b in ends]
        base, right, _, foot, _, left, back, crest, face = lines
        rock = geo.addPlaneSurface([geo.addCurveLoop(lines[:6])])
        dam = geo.addPlaneSurface([geo.addCurveLoop([-foot, back, crest, face])])
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        groups = [("rock", 2, rock), ("dam", 2, dam), ("base", 1, base), ("left", 1, left)]
        groups += [("joint_perimetral", 1, foot), ("right", 1, right), ("crest", 1, crest)]
        for group, dim, tag in groups:
            gmsh.model.addPhysicalGroup(dim, [tag], name=group)
        gmsh.write(str(out))


@pytest.fixture
def dam(mesh_file, read):
    """A dam on a block of rock in 2-D."""
    return lambda joints=None: read(mesh_file(_dam_on_rock), joints=joints)


ROCK = dj.Elastic(young=20e9, poisson=0.25, density=2600.0)
CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
SIDES = ("base", "left", "right")
DASHPOTS = [dj.ViscousBoundary(group=group) for group in SIDES]


@pytest.mark.parametrize("rock", [0.0] if MANY else [0.0, 2600.0])
def test_perimetral_joint_that_holds_is_no_joint(dam, comm, rock):
    """Rigid, pressed by a weight of the dam, without slip at 80 degrees: as if tied.

    Rigid joints have no compliance, so the two differ by rounding, at any time.
    """
    materials = {
        "rock": dj.Elastic(young=20e9, poisson=0.25, density=rock),
        "dam": CONCRETE,
    }
    ends = []
    for joints in (None, []):
        model = dj.Model(
            dam(joints),
            material=materials,
            joints=dj.RigidJoint(friction_angle_deg=80.0) if joints is None else None,
            supports=[dj.Fixed(group="base")],
            loads=[dj.Gravity()],
        )
        simulation = dj.Simulation(model)
        static = simulation.statics()
        outcome = simulation.dynamics(dt=0.002, steps=25, motion=lambda t: (40.0 * t, 0.0, 0.0))
        assert outcome.imbalance < 1e-9
        if joints is None:
            counts = model.contact.counts(outcome.state.joints.status)
            assert (counts.open, counts.slip) == (0, 0)
        nodes = model.nodes("crest")
        x = model.V.tabulate_dof_coordinates()[nodes, 0]
        u = [
            s.displacement.getArray(readonly=True).reshape(-1, 2)[nodes]
            for s in (static, outcome.state)
        ]
        gathered = comm.allgather(np.column_stack([x, *u]))
        rows = np.unique(np.round(np.concatenate(gathered), 15), axis=0)
        ends.append(rows[np.argsort(rows[:, 0])])
    scale = np.abs(ends[1][:, 1:]).max()
    np.testing.assert_allclose(ends[0][:, 1:], ends[1][:, 1:], atol=1e-7 * scale, rtol=0)


def on_rock(dam, supports, **options):
    """The dam on its joint under its weight."""
    given = {"material": {"rock": ROCK, "dam": CONCRETE}, "joints": STIFF, "loads": [dj.Gravity()]}
    return dj.Model(dam(), supports=supports, **given, **options)


def swapped(dam, **options):
    """A dam at rest on rock held by Fixed, its supports then changed for dashpots."""
    held = [dj.Fixed(group="base"), dj.Fixed(group="left", components="x")]
    static = dj.Simulation(on_rock(dam, held)).statics()
    simulation = dj.Simulation(on_rock(dam, DASHPOTS, **options))
    simulation.static = static
    return simulation, static


def test_dam_stays_at_rest_when_dashpots_take_over(dam):
    simulation, static = swapped(dam)
    outcome = simulation.dynamics(dt=0.005, steps=20)
    assert relative_difference(outcome.state.displacement, static.displacement) < 1e-10


def test_dashpots_are_held_in_statics(dam, new_path):
    """One model: what holds the rock under the weight is what carries it on the dashpots."""
    model = on_rock(dam, DASHPOTS)
    path = new_path("run.h5")
    monitor = dj.ResultsMonitor(path, points={"crest": (0.0, 4.0)})
    static = dj.Simulation(model, monitors=[monitor]).statics()
    simulation = dj.Simulation(model)
    simulation.static = static
    with dj.Results(path) as results:
        reaction = measures.static_stages(results)[0].reaction
    assert set(reaction) == set(SIDES)
    held = model.resultant(static.reaction, SIDES[0])
    np.testing.assert_allclose(reaction[SIDES[0]], held, atol=1e-12 * np.abs(held).max())
    clamped = dj.Simulation(on_rock(dam, [dj.Fixed(group=group) for group in SIDES])).statics()
    assert relative_difference(clamped.displacement, static.displacement) < 1e-10

    keep = dj.Checkpoints(new_path("run.checkpoint"), every=5)
    outcome = simulation.dynamics(dt=0.005, steps=5, checkpoint=keep)
    assert relative_difference(outcome.state.displacement, static.displacement) < 1e-10
    again = dj.Simulation(model).dynamics(dt=0.005, steps=5, checkpoint=replace(keep, resume=True))
    assert relative_difference(again.state.displacement, static.displacement) < 1e-10


def test_energies_of_a_dam_shaken_by_waves(dam):
    """Joint, dashpots, Rayleigh damping and the free field: every line, to rounding."""
    damping = dj.rayleigh(ratio=0.05, frequencies=(5.0, 25.0))
    simulation, _ = swapped(dam, damping=damping)
    motion = dj.synthetic_motion(duration=0.5, peaks_g=(0.8, 0.0, 0.5), band=(4.0, 15.0))
    wave = dj.incident_wave(motion)
    waves = dj.FreeField(groups=SIDES, incident=wave, surface=4.0, highest_frequency=50.0)
    outcome = simulation.dynamics(dt=0.005, steps=100, loads=[waves])
    assert outcome.imbalance < 1e-9
    assert outcome.energy_error < 1e-9
    assert outcome.energy.input_by_load["FreeField"] > 0.0
    assert outcome.energy.viscous > 0.0


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("space", [False, True])
def test_dashpots_of_two_materials(blocks_file, two_rectangles_file, read, space, plane):
    """Velocity u on an area A: u.C u = A (rho c_p u_n^2 + rho c_s u_t^2), of the cells there.

    In plane stress c_p is that of a plate, (E / (rho (1 - nu^2)))^.5. Sides hang on both blocks.
    """
    file = blocks_file(angle=0.0) if space else two_rectangles_file(angle=0.0)
    supports = [dj.ViscousBoundary(group=group) for group in ("base", "top", "sides")]
    materials = {"lower": ROCK, "upper": CONCRETE}
    model = dj.Model(
        read(file, joints=[]), material=materials, supports=supports, body=dj.Body(plane=plane)
    )
    gdim = model.gdim

    def of(solid):
        e, nu, rho = solid.young, solid.poisson, solid.density
        modulus = e * (1 - nu) / (1 + nu) / (1 - 2 * nu)
        if plane == "stress" and not space:
            modulus = e / (1 - nu**2)
        return math.sqrt(rho * modulus), math.sqrt(rho * e / 2 / (1 + nu))

    (p_low, s_low), (p_up, s_up) = of(ROCK), of(CONCRETE)
    sides = 4.0 if space else 2.0  # each block has so many of 1 m^2
    normal = 2.0  # of them face any horizontal direction
    vertical = p_low + p_up + sides * (s_low + s_up)
    across = s_low + s_up + normal * (p_low + p_up) + (sides - normal) * (s_low + s_up)
    for axis in range(gdim):
        u = model.mass.createVecRight()
        u.setArray(np.tile(np.eye(gdim)[axis], u.getLocalSize() // gdim))
        force = u.duplicate()
        model.system().damping_force(u, force)
        expected = vertical if axis == gdim - 1 else across
        assert force.dot(u) == pytest.approx(expected, rel=1e-12)


def test_incident_wave_is_half_the_velocity():
    """Of a motion linear between samples: the trapezoidal sums at the samples, parabolas between.

    a = 2 t for a second, then back to zero in half of one: v = t^2, and 1.5 in the end.
    """
    from dolfinx_joints import Motion

    a = np.zeros((4, 3))
    a[:, 0] = [0.0, 1.0, 2.0, 0.0]
    wave = dj.incident_wave(Motion(acceleration=a, dt=0.5))
    for t, v in [(-1.0, 0.0), (0.0, 0.0), (0.3, 0.09), (0.5, 0.25), (1.0, 1.0), (9.0, 1.5)]:
        np.testing.assert_allclose(wave(t), [0.5 * v, 0.0, 0.0], atol=1e-15)


def test_what_is_refused(dam):
    jointed, materials = dam(joints=[]), {"rock": ROCK, "dam": CONCRETE}

    def load(model, **options):
        wave = {"groups": ["base"], "incident": lambda t: (0.0, 0.0), "surface": 4.0}
        return dj.FreeField(**(wave | options)).patterns(model)

    def model(*groups, material=materials):
        supports = [dj.ViscousBoundary(group=group) for group in groups]
        return dj.Model(jointed, material=material, supports=supports)

    with pytest.raises(ValueError, match="on base, base have common facets; a facet"):
        model("base", "base")
    lifts = dj.Orthotropic(young=(25e9,) * 3, poisson=(0.2,) * 3, shear=(9e9,) * 3, density=2400.0)
    for material in (lifts, {"rock": lifts, "dam": CONCRETE}):
        with pytest.raises(ValueError, match="on base have orthotropic cells behind them, which"):
            model("base", material=material)
    assert np.isfinite(model("base", material={"rock": ROCK, "dam": lifts}).system().damping.norm())
    with pytest.raises(ValueError, match="'base' has no viscous boundary; add ViscousBoundary"):
        load(model("left"))
    with pytest.raises(ValueError, match="surface is 3 m; .* from 0 to 4 m"):
        load(model("base", "left"), groups=["base", "left"], surface=3.0)
    with pytest.raises(ValueError, match="densities 2600 and 2400 .* They must form horizontal"):
        load(model("base", "crest"), groups=["base", "crest"], surface=8.0)
    still = {"rock": dj.Elastic(young=20e9, poisson=0.25, density=0.0), "dam": CONCRETE}
    with pytest.raises(ValueError, match="along base must have mass everywhere"):
        load(model("base", material=still))
    with pytest.raises(ValueError, match="must name some of 'xy'"):
        load(model("base"), components="z")
    with pytest.raises(ValueError, match="surface is 4 m; .*above the base, 5 m"):
        load(model("base"), base=5.0)
    with pytest.raises(ValueError, match="FreeField: groups is .*; it must name facet groups"):
        load(model("base"), groups=["base", "base"])
    with pytest.raises(ValueError, match=r"incident\(0\) is .*; it must be at least 2 fin"):
        load(model("base"), incident=lambda t: 0.0)
    wave = dj.FreeField(groups=["base"], incident=lambda t: (0.0, 0.0), surface=4.0)
    with pytest.raises(ValueError, match="Both motion and a FreeField are given"):
        dj.Simulation(model("base")).dynamics(
            dt=0.01, steps=1, loads=[wave], motion=lambda t: (0.0, 0.0, 0.0)
        )
