# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bodies of plastic cells against exact limit loads; any number of ranks.

Pressed between smooth plates with a pressure q on its sides, a block carries at most, by
Mohr-Coulomb,

    N q + 2 c sqrt(N),    N = (1 + sin phi)/(1 - sin phi),

which the cone fitted to compression tests gives in space, and the one fitted to plane strain as the
flow settles there. A tube of radii a < b without friction bursts at p = 2 c ln(b/a).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import box
from vtk_files import on_root, read_vtk

import dolfinx_joints as dj
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.body_cells import CellOrder
from dolfinx_joints.monitors.cell_fields import CellFields
from dolfinx_joints.monitors.surface_stress import SurfaceStress

pytestmark = pytest.mark.mpi

ELASTIC = dj.Elastic(young=1e9, poisson=0.3, density=2000.0)
C, PHI, SIDE = 1e6, 30.0, 0.5e6
N = (1 + math.sin(math.radians(PHI))) / (1 - math.sin(math.radians(PHI)))
LIMIT = N * SIDE + 2 * C * math.sqrt(N)
# The tangent is singular at the limit load: residuals of 1e-10 may leave 5e-9 of the stress.
NEWTON = dj.SolverOptions(relative_tolerance=1e-13)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=40.0)


def rock(**changes):
    given = {"elastic": ELASTIC, "cohesion": C, "friction_angle_deg": PHI, **changes}
    return dj.DruckerPrager(**given)


def block(comm, kind="hexahedron", *, joint=False, cells=2):
    """A unit square or cube; facets ``x-``, ``x+``, ...; halves ``low`` and ``high``."""
    dim = 3 if kind in ("hexahedron", "tetrahedron") else 2
    ends = {f"{'xyz'[i]}{'-+'[side]}": (i, side) for i in range(dim) for side in (0, 1)}
    return box(
        [1.0] * dim,
        [cells] * dim,
        kind,
        joints={"joint": (dim - 1, 0.5)} if joint else {},
        groups=ends,
        cells={"low": (0.0, 0.5), "high": (0.5, 1.0)},
        comm=comm,
    )


def pressed(jointed, material, **options):
    """On smooth plates at its lower faces, pushed from above, with pressure on its sides."""
    axes = "xyz"[: jointed.mesh.geometry.dim]
    plates = [dj.Fixed(group=f"{a}-", components=a) for a in axes]
    push = dj.Prescribed(group=f"{axes[-1]}+", component=axes[-1], value=lambda t: -t)
    sides = [dj.Pressure(group=f"{a}+", value=SIDE) for a in axes[:-1]]
    return dj.Model(jointed, material=material, supports=[*plates, push], loads=sides, **options)


def standing(jointed, material, *, pressure=2.9e6, **options):
    """On smooth plates, pressed from above by a pressure that swings by a part of itself."""
    axes = "xyz"[: jointed.mesh.geometry.dim]
    axis = axes[-1]
    load = dj.Pressure(
        group=f"{axis}+", value=pressure, factor=lambda t: 1.0 + 0.4 * math.sin(200.0 * t)
    )
    joints = LAW if jointed.joint_names else None
    plates = [dj.Fixed(group=f"{a}-", components=a) for a in axes]
    return dj.Model(
        jointed, material=material, joints=joints, supports=plates, loads=[load], **options
    )


@pytest.mark.parametrize("kind", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("dilatancy", [None, 10.0])
def test_triaxial_compression(comm, kind, dilatancy, new_path):
    # Whatever the dilatancy: both side pressures are given. The block shortens by 2 %, the limit
    # is met at some 0.5 %.
    model = pressed(block(comm, kind), rock(dilatancy_angle_deg=dilatancy))
    path = new_path("pressed.vtkhdf")
    simulation = dj.Simulation(model, monitors=[dj.FieldMonitor(path)], options=NEWTON)
    state = simulation.quasi_statics(np.linspace(0.0, 0.02, 6))
    assert -model.resultant(state.reaction, "z+")[2] == pytest.approx(LIMIT, rel=1e-10)
    assert model.bulk.yielding(state.joints) == model.bulk.operator.num_points
    # All stresses alike, and the plastic strain the same everywhere.
    wanted = [-SIDE, -SIDE, -LIMIT, 0.0, 0.0, 0.0]
    stress = state.joints.bulk.stress
    np.testing.assert_allclose(stress, np.tile(wanted, (len(stress), 1)), atol=1e-9 * LIMIT)
    cells = model.bulk.variable("accumulated plastic strain [-]", state.joints.state).x.array
    np.testing.assert_allclose(cells, cells[0], rtol=1e-8)
    assert cells[0] > 0.01

    def look():
        *_, (_, grid) = read_vtk(path.with_name(f"{path.stem}_stages.vtkhdf"))
        found = grid.cell_data["stress [Pa]"]
        np.testing.assert_allclose(found, np.tile(wanted, (len(found), 1)), atol=1e-9 * LIMIT)
        strains = grid.cell_data["accumulated plastic strain [-]"]
        np.testing.assert_allclose(strains, cells[0], rtol=1e-8)

    on_root(comm, look)


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_tension_without_change_of_volume(comm, steps):
    # sqrt(J2) = s / sqrt(3), I1 = s; the block is pulled by 1 %, the limit is met at some 0.15 %.
    # Points at the apex have no stiffness, with which iterates run away: they are no solution.
    material = rock(dilatancy_angle_deg=0.0)
    plates = [dj.Fixed(group=f"{a}-", components=a) for a in "xyz"]
    pull = dj.Prescribed(group="z+", component="z", value=lambda t: t)
    model = dj.Model(block(comm), material=material, supports=[*plates, pull])
    state = dj.Simulation(model).quasi_statics(np.linspace(0.0, 0.01, steps + 1))
    limit = material.strength / (1.0 / math.sqrt(3.0) + material.slope)
    assert model.resultant(state.reaction, "z+")[2] == pytest.approx(limit, rel=1e-8)
    # The rest of the 1 % is flow along z, half as much the other way across.
    flow = 0.01 - limit / ELASTIC.young
    plastic = state.joints.state.bulk.internal
    np.testing.assert_allclose(plastic[:, :3], [[-flow / 2, -flow / 2, flow]] * len(plastic), 1e-6)


@pytest.mark.parametrize(("kind", "degree"), [("quadrilateral", 1), ("triangle", 2)])
def test_plane_strain_compression(comm, kind, degree):
    # The stress out of the plane settles exponentially with the plastic flow.
    model = pressed(block(comm, kind), rock(fit="plane strain"), body=dj.Body(degree=degree))
    state = dj.Simulation(model, options=NEWTON).quasi_statics(np.linspace(0.0, 0.06, 13))
    assert -model.resultant(state.reaction, "y+")[1] == pytest.approx(LIMIT, rel=1e-10)


@pytest.mark.parametrize("kind", ["quadrilateral", "hexahedron"])
def test_pressure_beyond_the_limit_is_refused(comm, kind):
    """With a joint, by forces: 0.95 of the limit stands, and of more a load factor is told."""
    jointed = block(comm, kind, joint=True)
    axes = "xyz"[: jointed.mesh.geometry.dim]

    def statics(share):
        loads = [dj.Pressure(group=f"{a}+", value=SIDE) for a in axes[:-1]]
        loads.append(dj.Pressure(group=f"{axes[-1]}+", value=share * LIMIT))
        plates = [dj.Fixed(group=f"{a}-", components=a) for a in axes]
        rocks = rock(fit="plane strain") if len(axes) == 2 else rock()
        return dj.Simulation(
            dj.Model(jointed, material=rocks, joints=LAW, supports=plates, loads=loads)
        ).statics()

    statics(0.95)
    for share in (1.001, 1.05):  # the tangent of what flows is singular
        with pytest.raises(dj.ConvergenceError, match=r"load factor 0\.9"):
            statics(share)


def quarter_tube(comm, cells):
    """Radii 1 and 2 m, the right angle between planes of symmetry."""
    groups = {"inside": (0, 1.0), "flat": (1, 0.0), "upright": (1, math.pi / 2)}
    corners = [[1.0, 0.0], [2.0, math.pi / 2]]

    def bent(x):
        r, angle = x[:, 0], x[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.0 * r])

    return box(corners, [cells, 2 * cells], groups=groups, place=bent, comm=comm)


def test_bursting_tube(comm):
    # Upper bound theorem: finite elements carry the exact load, and little more.
    burst = 2.0 * C * math.log(2.0)
    model = dj.Model(
        quarter_tube(comm, 6),
        material=rock(friction_angle_deg=0.0, fit="plane strain"),
        body=dj.Body(degree=2),
        supports=[
            dj.Fixed(group="flat", components="y"),
            dj.Fixed(group="upright", components="x"),
        ],
        loads=[dj.Pressure(group="inside", value=burst, factor=lambda t: t)],
    )
    simulation = dj.Simulation(model)
    state = simulation.quasi_statics([0.5, 0.8, 0.9, 0.97, 0.995])
    stress = state.joints.bulk.stress
    # By Tresca the front has come to r with 1 - r^2/4 + 2 ln r = 0.995 2 ln 2, r = 1.88 m.
    assert model.bulk.yielding(state.joints) > 0.85 * model.bulk.operator.num_points
    # Nowhere is the difference of the principal stresses of the plane above 2 c.
    spread = np.hypot(stress[:, 0] - stress[:, 1], 2.0 * stress[:, 5])
    assert np.all(spread < 2.0 * C * (1 + 1e-9))
    with pytest.raises(dj.ConvergenceError, match="yielding points of the bulk"):
        simulation.quasi_statics([1.02])


@pytest.mark.parametrize("kind", ["hexahedron", "tetrahedron", "quadrilateral", "triangle"])
def test_below_the_limit_it_is_elastic(comm, kind):
    strong, plain = (
        standing(block(comm, kind), {"low": low, "high": ELASTIC})
        for low in (rock(cohesion=1e9), ELASTIC)
    )
    wanted, found = (dj.Simulation(model).statics().displacement for model in (plain, strong))
    found.axpy(-1.0, wanted)
    assert found.norm() < 1e-12 * wanted.norm()
    runs = [dj.Simulation(m).dynamics(dt=2e-4, steps=5).state.displacement for m in (plain, strong)]
    runs[1].axpy(-1.0, runs[0])
    assert runs[1].norm() < 1e-11 * runs[0].norm()


@pytest.mark.parametrize("kind", ["tetrahedron", "triangle"])
def test_cells_show_the_elastic_stress_below_the_limit(comm, kind):
    # The mean of a plastic cell is the value in its middle where the stress is constant in it.
    jointed = block(comm, kind)
    base, stresses = f"{'xyz'[jointed.mesh.geometry.dim - 1]}-", []
    for material in (rock(cohesion=1e9), ELASTIC):
        loads = [dj.Gravity(), dj.Pressure(group="x+", value=1e5)]
        model = dj.Model(jointed, material=material, supports=[dj.Fixed(group=base)], loads=loads)
        state = dj.Simulation(model).statics()
        fields = CellFields(model, CellOrder(model))
        own = fields(state.displacement, state.joints, 0.0)["stress [Pa]"]
        stresses.append(np.concatenate(comm.allgather(own)))
    size = np.abs(stresses[1]).max()
    assert np.abs(stresses[1][:, 3:]).max() > 0.1 * size
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=0.0, atol=1e-10 * size)


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("kind", ["quadrilateral", "hexahedron"])
def test_energy_balance_counts_plastic_work(comm, kind, joint, new_path):
    # Exact for the midpoint scheme at any step, whatever yields, opens and slides.
    fit = "compression" if kind == "hexahedron" else "plane strain"
    low = rock(dilatancy_angle_deg=10.0, fit=fit)
    jointed = block(comm, kind, joint=joint)
    model = standing(jointed, {"low": low, "high": ELASTIC})
    path = new_path("plastic.h5")
    monitor = dj.ResultsMonitor(path, points={"top": [0.5] * (model.gdim - 1) + [1.0]})
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics(steps=2)
    outcome = simulation.dynamics(dt=1e-3, steps=30, scheme=dj.EnergyConsistent())
    row = outcome.energy
    assert outcome.solver == "monolithic"
    assert outcome.imbalance < 1e-12
    assert row.plastic > 0.2 * row.stored
    assert row.stored + row.plastic + row.friction + row.numerical == pytest.approx(
        row.input + simulation_start(simulation, model), rel=1e-10
    )
    if comm.rank == 0:
        with dj.Results(path) as results:
            plastic = results.series("energy", "plastic")
        assert plastic[-1] == row.plastic
        assert np.all(np.diff(plastic) >= 0.0)


def test_groups_of_one_law_are_one_body(comm):
    # What belongs to no group's boundary: laws by group give what the law of the whole gives.
    jointed = block(comm, "quadrilateral")
    law = rock(dilatancy_angle_deg=10.0, fit="plane strain")
    found = []
    for material in (law, {"low": law, "high": law}):
        simulation = dj.Simulation(standing(jointed, material))
        simulation.statics(steps=2)
        outcome = simulation.dynamics(dt=1e-3, steps=4, scheme=dj.EnergyConsistent())
        assert "monolithic solver (nonlinear cells of DruckerPrager)" in simulation.report(outcome)
        found.append((outcome.energy.plastic, outcome.energy.stored))
    assert found[0][0] > 0.1 * found[0][1]
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def simulation_start(simulation, model):
    """Stored energy of the static state: half of the work of stresses on elastic strains."""
    static = simulation.static
    force = static.displacement.duplicate()
    model.stiffness.mult(static.displacement, force)
    strain = 0.5 * force.dot(static.displacement)
    strain += model.bulk.excess_energy(static.joints.state)
    if model.contact is None:
        return strain
    return strain + float(model.contact.stored_energy(static.joints.state).sum())


def test_stored_energy_is_that_of_the_elastic_strain(comm):
    # sigma : C^-1 sigma / 2 of the uniform stress on a block of 1 m3, by hand.
    model = pressed(block(comm), rock())
    simulation = dj.Simulation(model, options=NEWTON)
    simulation.quasi_statics(np.linspace(0.0, 0.02, 6))
    s, nu = np.array([-SIDE, -SIDE, -LIMIT]), ELASTIC.poisson
    wanted = ((1 + nu) * s @ s - nu * s.sum() ** 2) / (2 * ELASTIC.young)
    assert simulation_start(simulation, model) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("scheme", [dj.Newmark(), dj.GeneralizedAlpha(spectral_radius=0.9)])
def test_end_point_schemes_agree_as_steps_get_short(comm, scheme):
    found = []
    for chosen in (dj.EnergyConsistent(), scheme):
        material = rock(dilatancy_angle_deg=10.0, fit="plane strain")
        model = standing(block(comm, "quadrilateral"), material)
        simulation = dj.Simulation(model)
        simulation.statics(steps=2)
        found.append(simulation.dynamics(dt=1e-4, steps=100, scheme=chosen))
    exact, other = (outcome.state.displacement for outcome in found)
    plastic = [outcome.energy.plastic for outcome in found]
    assert plastic[0] > 0.2 * found[0].energy.stored
    assert plastic[1] == pytest.approx(plastic[0], rel=0.02)
    other.axpy(-1.0, exact)
    assert other.norm() < 0.02 * exact.norm()


def test_the_answer_does_not_depend_on_the_ranks(comm):
    # The same run by each rank alone.
    from mpi4py import MPI

    tops = []
    for each in (comm, MPI.COMM_SELF):
        model = standing(block(each, joint=True), {"low": rock(), "high": ELASTIC})
        simulation = dj.Simulation(model)
        simulation.statics()
        outcome = simulation.dynamics(dt=1e-3, steps=10)
        tops.append((outcome.energy.plastic, outcome.state.displacement.norm()))
    np.testing.assert_allclose(tops[0], tops[1], rtol=1e-8)


class HalfALaw:
    elastic = ELASTIC

    def backward_euler(self, strain, state):
        raise NotImplementedError


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_what_it_does_not_do_is_said(comm, new_path):
    jointed = block(comm, joint=True)
    model = standing(jointed, rock())
    with pytest.raises(
        dj.JointsError, match=r"condensed solver supports linear bodies only\..*DruckerPrager"
    ):
        dj.Simulation(model, solver="condensed").statics()
    rigid = dj.Model(jointed, material=rock(), joints=dj.RigidJoint(friction_angle_deg=30.0))
    with pytest.raises(dj.JointsError, match="which rigid joints need, supports linear"):
        dj.Simulation(rigid).statics()
    with pytest.raises(
        ValueError, match="ImplicitContact does not support nonlinear cells.* Use Energy"
    ):
        dj.Simulation(model).dynamics(dt=1e-3, steps=1, scheme=dj.ImplicitContact())
    with pytest.raises(
        dj.JointsError, match="with nonlinear cells cannot have inactive or grouted joints"
    ):
        dj.Simulation(model).statics(joints="inactive")
    with pytest.raises(ValueError, match="Stress envelopes need an elastic body"):
        SurfaceStress(model, NodeNumbering(model.V))
    with pytest.raises(ValueError, match=r"Nonlinear materials need plane='strain'"):
        standing(block(comm, "triangle"), rock(), body=dj.Body(plane="stress"))
    warm = dj.Temperature(value=10.0, reference=0.0, expansion=1e-5)
    with pytest.raises(ValueError, match="Temperature acts on cells of DruckerPrager"):
        dj.Model(block(comm), material=rock(), loads=[dj.Gravity(), warm])
    with pytest.raises(
        ValueError, match="must be an Elastic, an Orthotropic or a nonlinear material"
    ):
        dj.Model(block(comm), material=HalfALaw())
