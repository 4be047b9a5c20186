# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of users in UFL and NumPy, from the page on extensions, against exact solutions.

- Hooke's law by the path of nonlinear cells equals the linear body.
- Masonry without tension, bent about a neutral axis at x0: pressure E kappa (x0 - x), the force
  E kappa x0^2 / 2 acts at x0 / 3 from the pressed edge.
- Damage with a crack band: the work per area of a crack is G_f; up to the strain k it is
  h f_t (f_t / (2 E) + s (1 - exp(-(k - f_t / E) / s))) with s = G_f / (h f_t) - f_t / (2 E),
  of which h f_t k exp(...) / 2 is still stored.
- Creep: strain p (1 / E + (1 - exp(-t / T)) / E_1) under the stress p, and the Kelvin element has
  lost p^2 (1 - exp(-2 t / T)) / (2 E_1).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from boxes import box
from test_extend import run_listings

import dolfinx_joints as dj
from dolfinx_joints.materials.bulk_law import BulkState
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = [
    pytest.mark.mpi,
    pytest.mark.filterwarnings("ignore:Loads are applied suddenly"),
    pytest.mark.filterwarnings("ignore:The estimated error of a single step"),
]

CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=35.0)
NEWTON = dj.SolverOptions(relative_tolerance=1e-13)


@pytest.fixture(scope="module")
def page():
    return run_listings()


def hooke_in_numpy(elastic):
    c = elastic.stiffness_matrix()

    def respond(strain, internal, dt):
        stress = strain @ c
        return stress, np.tile(c, (len(strain), 1, 1)), 0.5 * np.sum(stress * strain, axis=1)

    return dj.NumpyMaterial(respond, elastic=elastic)


def tower(comm, kind, material, cells=2, **options):
    """Return two blocks of unit width and height, one on the other, with a joint."""
    dim = 3 if kind in ("hexahedron", "tetrahedron") else 2
    jointed = box(
        [1.0] * (dim - 1) + [2.0],
        [cells] * (dim - 1) + [2 * cells],
        kind,
        joints={"joint": (dim - 1, 1.0)},
        groups={"base": (dim - 1, 0.0), "top": (dim - 1, 2.0)},
        cells={"low": (0.0, 1.0), "high": (1.0, 2.0)},
        comm=comm,
    )
    loads = [dj.Gravity(), *options.pop("loads", ())]
    supports = [dj.Fixed(group="base")]
    return dj.Model(
        jointed, material=material, joints=LAW, supports=supports, loads=loads, **options
    )


def shaking(dim):
    def motion(t):
        return (20.0 * math.sin(60.0 * t), *[0.0] * (dim - 2), 15.0 * math.sin(90.0 * t))

    return motion


def shaken(model, steps=8, scheme=None, monitors=(), **options):
    simulation = dj.Simulation(model, options=NEWTON, solver="monolithic", monitors=monitors)
    simulation.statics()
    motion = shaking(model.gdim)
    return simulation.dynamics(dt=2e-3, steps=steps, motion=motion, scheme=scheme, **options)


@pytest.mark.parametrize("scheme", [None, dj.Newmark()], ids=["default", "Newmark"])
@pytest.mark.parametrize("kind", ["quadrilateral", "tetrahedron"])
def test_hooke_equals_the_linear_body(comm, page, kind, scheme):
    in_ufl = dj.UflMaterial(energy=lambda e: page.hooke(CONCRETE, e), elastic=CONCRETE)
    damping = dj.Rayleigh(mass_factor=1.0, stiffness_factor=1e-5)
    linear, *others = (
        shaken(tower(comm, kind, material, damping=damping), scheme=scheme)
        for material in (
            CONCRETE,
            in_ufl,
            hooke_in_numpy(CONCRETE),
            {"low": in_ufl, "high": CONCRETE},
        )
    )
    assert linear.energy.joint > 0.0
    for other in others:
        change = other.state.displacement - linear.state.displacement
        assert change.norm() < 1e-10 * linear.state.displacement.norm()
        for name in ("kinetic", "strain", "joint", "friction", "input"):
            value = getattr(linear.energy, name)
            assert getattr(other.energy, name) == pytest.approx(value, rel=1e-9, abs=1e-12)
        assert other.energy.plastic == 0.0
        assert other.imbalance < 1e-10


def column(comm, material, cells, neutral):
    """Bend a column of 1 x 2 m between smooth plates; the upper turns about a neutral axis.

    Return the model, the state, and the resultants at the top: pressure and its moment.
    """
    groups = {"base": (1, 0.0), "top": (1, 2.0)}
    jointed = box([1.0, 2.0], [cells, 4], groups=groups, comm=comm)
    turn = dj.Prescribed(
        group="top", component="y", value=lambda x, t: 2.0 * TURN * (x[:, 0] - neutral) * t
    )
    supports = [dj.Fixed(group="base", components="y"), dj.Fixed(point=(0, 0), components="x")]
    model = dj.Model(jointed, material=material, supports=[*supports, turn], body=dj.Body(degree=2))
    state = dj.Simulation(model, options=NEWTON).quasi_statics([1.0])
    return model, state, *-sum_over(comm, model, state)


def sum_over(comm, model, state):
    """Return the sum of the reactions at the top along y, and their moment about x = 0."""
    owned = model.V.dofmap.index_map.size_local
    x = model.V.tabulate_dof_coordinates()[:owned, 0]
    nodes = model.nodes("top")
    force = state.reaction.getArray(readonly=True)[: 2 * owned].reshape(-1, 2)[nodes, 1]
    return comm.allreduce(np.array([force.sum(), force @ x[nodes]]))


TURN = 0.5e-3  # rotation of the column per height [1/m]


def force_and_moment(young, neutral, in_tension):
    """Return the integrals of the pressure over a section of 1 m, and of x times the pressure."""
    x0, r = neutral, in_tension
    force = 0.5 * (x0**2 - r * (1.0 - x0) ** 2)
    moment = x0**3 / 6.0 - r * ((1.0 - x0**3) / 3.0 - 0.5 * x0 * (1.0 - x0**2))
    return young * TURN * force, young * TURN * moment


@pytest.mark.parametrize(("law", "in_tension"), [("UFL", 1e-3), ("NumPy", 0.0)])
def test_bent_column_without_tension(comm, page, law, in_tension):
    """Compare with the quadratic solution, whose kink is between cells: equal to rounding."""
    young, neutral = 5e9, 0.5
    made = page.no_tension if law == "UFL" else page.no_tension_in_space
    model, state, force, moment = column(comm, made(young, 1800.0), 4, neutral)
    np.testing.assert_allclose([force, moment], force_and_moment(young, neutral, in_tension), 1e-9)
    if law == "NumPy":
        assert moment / force == pytest.approx(neutral / 3.0, rel=1e-9)
    strain, stress = state.joints.state.bulk.strain[:, 1], state.joints.bulk.stress
    wanted = young * np.where(strain <= 0.0, strain, in_tension * strain)
    np.testing.assert_allclose(stress[:, 1], wanted, rtol=0.0, atol=1e-9 * young * TURN)
    assert np.abs(stress[:, [0, 2, 3, 4, 5]]).max(initial=0.0) < 1e-9 * young * TURN
    # Energy E e^2 / 2 of the strain turn times distance from the neutral axis, 2 m high.
    energy = model.bulk.operator.integral(state.joints.state.bulk.energy)
    exact = young * TURN**2 * (neutral**3 + in_tension * (1.0 - neutral) ** 3) / 3.0
    assert energy == pytest.approx(exact, rel=1e-9)


def test_kink_in_the_cells_converges(comm, page):
    """Halve the cells at several neutral axes: the error of the force falls by four."""
    errors = []
    places = np.array([0.32, 0.45, 0.63])
    for cells in (4, 8):
        law = page.no_tension(5e9, 1800.0, in_tension=1e-2)
        forces = [column(comm, law, cells, at)[2] for at in places]
        exact = [force_and_moment(5e9, at, 1e-2)[0] for at in places]
        errors.append(np.sqrt(np.mean((np.array(forces) / exact - 1.0) ** 2)))
    assert errors[0] > 3.0 * errors[1]
    assert errors[1] < 2e-3


@pytest.mark.parametrize("joint", ["UFL", "NumPy"])
@pytest.mark.parametrize("scheme", [None, dj.Newmark()], ids=["default", "Newmark"])
def test_energy_without_tension_balances(comm, page, joint, scheme):
    made = page.no_tension if joint == "UFL" else page.no_tension_in_space
    model = tower(comm, "quadrilateral", made(2e9, 1800.0))
    outcome = shaken(model, steps=15, scheme=scheme)
    assert outcome.imbalance < 1e-10
    assert outcome.energy.plastic == 0.0
    cracked = outcome.state.joints.state.bulk.strain[:, 1].max(initial=-1.0)
    assert comm.allreduce(cracked, MPI.MAX) > 1e-6
    if scheme is None:
        assert outcome.energy.bulk_numerical == 0.0
    else:
        assert outcome.energy.bulk_numerical != 0.0


STRENGTH, FRACTURE = 2e6, 100.0


def cracked_bar(comm, page, cells, steps, opening=2e-4):
    """Pull a bar of 0.2 m whose middle layer of cells, with the size h, can break; nu = 0.

    Return the simulation, h, and the last strain of the layer.
    """
    elastic = dj.Elastic(young=25e9, poisson=0.0, density=2400.0)
    size = 0.2 / cells
    middle = cells // 2 * size
    jointed = box(
        [size, 0.2],
        [1, cells],
        groups={"base": (1, 0.0), "top": (1, 0.2)},
        cells={"low": (0, middle), "crack": (middle, middle + size), "high": (middle + size, 0.2)},
        comm=comm,
    )
    law = page.damage(elastic, STRENGTH, FRACTURE)
    pull = dj.Prescribed(group="top", component="y", value=lambda t: opening * t)
    supports = [
        dj.Fixed(group="base", components="y"),
        dj.Fixed(point=(0, 0), components="x"),
        pull,
    ]
    material = {"low": elastic, "crack": law, "high": elastic}
    model = dj.Model(jointed, material=material, supports=supports)
    simulation = dj.Simulation(model, options=NEWTON)
    # The first time ends near the strength; then the steps grow with the opening.
    simulation.quasi_statics([0.08, *np.linspace(0.08, 1.0, steps + 1)[1:]])
    strain = simulation.static.joints.state.bulk.strain[:, 1].max(initial=0.0)
    return simulation, size, comm.allreduce(strain, MPI.MAX)


def lost_until(size, strain):
    """Return the energy lost per area until a strain of the crack band [J/m^2]."""
    first = STRENGTH / 25e9
    softening = FRACTURE / (size * STRENGTH) - 0.5 * first
    intact = math.exp((first - strain) / softening)
    work = STRENGTH * (0.5 * first + softening * (1.0 - intact))
    return size * (work - 0.5 * STRENGTH * intact * strain)


@pytest.mark.parametrize("cells", [5, 9])
def test_a_crack_releases_its_fracture_energy_in_any_mesh(comm, page, cells):
    errors = []
    for steps in (40, 80):
        simulation, size, strain = cracked_bar(comm, page, cells, steps)
        energy = simulation.static.energy
        assert energy.relative_error < 1e-10
        wanted = lost_until(size, strain)
        assert wanted > 0.9 * FRACTURE
        errors.append(energy.plastic / size / wanted - 1.0)
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.6)  # trapezoids: order 2
    assert abs(errors[1]) < 3e-3
    kappa = simulation.model.bulk.variable("kappa [-]", simulation.static.joints.state)
    assert comm.allreduce(kappa.x.array.max(initial=0.0), MPI.MAX) == pytest.approx(
        strain, rel=1e-6
    )


STRESS, SOFTER, TIME = 2e6, 10e9, 3e6


def creeping(comm, page, steps):
    """Press a cube for 5e6 s; return its first and last shortening [m] and the energy lost [J]."""
    jointed = box(
        [1.0] * 3,
        [1, 1, 2],
        groups={f"{a}-": (i, 0.0) for i, a in enumerate("xyz")} | {"top": (2, 1.0)},
        comm=comm,
    )
    plates = [dj.Fixed(group=f"{a}-", components=a) for a in "xyz"]
    model = dj.Model(
        jointed,
        material=page.kelvin(CONCRETE, SOFTER, TIME),
        supports=plates,
        loads=[dj.Pressure(group="top", value=STRESS)],
    )
    simulation = dj.Simulation(model, options=NEWTON)
    first = simulation.statics()
    times = np.linspace(0.0, 5e6, steps + 1)[1:]
    simulation.quasi_statics(times[:2])
    state = simulation.quasi_statics(times[2:])  # continues at the time of the last state
    with pytest.raises(ValueError, match=r"the time decreases by 4e\+06 s"):
        simulation.quasi_statics([1e6])
    shortening = [-at(comm, result, "top", model) for result in (first, state)]
    assert state.energy.relative_error < 1e-10
    return *shortening, state.energy.plastic


def at(comm, state, group, model):
    nodes = model.nodes(group)
    values = state.displacement.getArray(readonly=True).reshape(-1, model.gdim)[nodes, -1]
    return comm.allreduce(values.min(initial=0.0), MPI.MIN)


def test_creep_of_a_kelvin_element(comm, page):
    errors = []
    for steps in (5, 10):
        first, last, lost = creeping(comm, page, steps)
        assert first == pytest.approx(STRESS / CONCRETE.young, rel=1e-10)
        decay = math.exp(-5e6 / TIME)
        wanted = STRESS * (1.0 / CONCRETE.young + (1.0 - decay) / SOFTER)
        dissipated = 0.5 * STRESS**2 * (1.0 - decay**2) / SOFTER
        errors.append([last / wanted - 1.0, lost / dissipated - 1.0])
    ratios = np.array(errors[0]) / errors[1]
    np.testing.assert_allclose(ratios, 4.0, atol=0.3)  # trapezoidal rule: order 2
    assert np.abs(errors[1]).max() < 2e-2


def test_results_do_not_depend_on_the_ranks(comm, page):
    ends = []
    for ranks in (comm, MPI.COMM_SELF):
        low = page.damage(CONCRETE, 2e5, 50.0)
        model = tower(ranks, "tetrahedron", {"low": low, "high": page.kelvin(CONCRETE, 1e10, 1e-2)})
        outcome = shaken(model)
        assert outcome.imbalance < 1e-10
        ends.append((outcome.energy.plastic, outcome.state.displacement.norm()))
    assert ends[0][0] > 0.0
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-8)


def test_restart_restores_the_variables(comm, page, new_path):
    """Continue after 4 of 8 steps, on the same ranks and on one: as without the interruption."""
    path = new_path("run.ckpt")

    def model(ranks):
        low = page.damage(CONCRETE, 2e5, 50.0)
        return tower(ranks, "tetrahedron", {"low": low, "high": page.kelvin(CONCRETE, 1e10, 1e-2)})

    whole = shaken(model(comm), monitors=[Stop(0)])
    with pytest.raises(KeyboardInterrupt):
        shaken(model(comm), monitors=[Stop(5)], checkpoint=dj.Checkpoints(path, every=4))
    kept = {"monitors": [Stop(0)], "checkpoint": dj.Checkpoints(path, every=100, resume=True)}
    ends = [shaken(model(comm), **kept)]
    if comm.rank == 0:
        ends.append(shaken(model(MPI.COMM_SELF), **kept))
    comm.barrier()
    for end in ends:
        assert end.energy.plastic == pytest.approx(whole.energy.plastic, rel=1e-8)
        assert end.energy.stored == pytest.approx(whole.energy.stored, rel=1e-9)
        norm = whole.state.displacement.norm()
        assert end.state.displacement.norm() == pytest.approx(norm, rel=1e-9)


def test_states_of_other_materials_are_refused(comm, page):
    """Continue at rest, and compute a factor of safety, with materials of other variables."""
    damping = dj.Rayleigh(mass_factor=20.0, stiffness_factor=1e-3)
    damaged = tower(comm, "quadrilateral", page.damage(CONCRETE, 2e5, 50.0), damping=damping)
    simulation = dj.Simulation(damaged, options=NEWTON)
    simulation.statics()
    state = simulation.dynamics(dt=2e-3, steps=2, motion=shaking(2)).state
    sentence = "The state is of another mesh or of laws with other variables"
    for material in (CONCRETE, page.kelvin(CONCRETE, 1e10, 1.0)):
        other = dj.Model(
            damaged.jointed,
            material=material,
            joints=LAW,
            supports=[dj.Fixed(group="base")],
            loads=[dj.Gravity()],
        )
        with pytest.raises(ValueError, match=sentence):
            dj.to_rest(simulation, state, dt=2e-3, model=other)
        with pytest.raises(ValueError, match=sentence):
            dj.factor_of_safety(dj.Simulation(other), start=simulation.static)


def test_variables_cannot_have_the_name_of_a_field(comm, new_path):
    constant = {"stress [Pa]": (0.0, lambda e, k, dt: k)}
    law = dj.UflMaterial(energy=lambda e, k: HOOKE(e), internal=constant, elastic=CONCRETE)
    model = tower(comm, "quadrilateral", law)
    simulation = dj.Simulation(model, monitors=[dj.FieldMonitor(new_path("fields.vtkhdf"))])
    with pytest.raises(ValueError, match=r"variable 'stress \[Pa\]' has the name of another field"):
        simulation.statics()


class Stop(Monitor):
    """Stops a run after a step, never if zero."""

    def __init__(self, step):
        self._step = step

    def record(self, record):
        if record.step == self._step:
            raise KeyboardInterrupt


@pytest.mark.parametrize("rule", ["backward_euler", "discrete_gradient"])
def test_functions_may_reuse_or_change_arrays(rule):
    """Return the same arrays at each call, and overwrite the arguments: the response is equal."""
    c, buffers = CONCRETE.stiffness_matrix(), [np.zeros(s) for s in ((9, 6), (9, 6, 6), (9,))]

    def respond(strain, internal, dt):
        size = np.einsum("ni,ij,nj->n", strain, c, strain)
        stress = (1.0 + 1e-3 * size)[:, None] * (strain @ c)
        tangent = (1.0 + 1e-3 * size)[:, None, None] * c
        tangent += 2e-3 * np.einsum("ni,nj->nij", strain @ c, strain @ c)
        return stress, tangent, 0.5 * size + 0.25e-3 * size**2

    def reusing(strain, internal, dt):
        answers = respond(strain, internal, dt)
        if len(strain) != 9:
            return answers
        for buffer, answer in zip(buffers, answers, strict=True):
            buffer[:] = answer
        strain[:] = 1.0
        return tuple(buffers)

    answers = []
    for function in (respond, reusing):
        law = dj.NumpyMaterial(function, elastic=CONCRETE)
        start = BulkState.elastic(np.zeros((9, 6)), c, np.zeros((9, 0)))
        state = law.backward_euler(random_strains(9, 1e-4, 0), start).state
        answers.append(getattr(law, rule)(random_strains(9, 2e-4, 1), state))
    first, second = answers
    for name in ("stress", "tangent", "dissipation", "numerical"):
        np.testing.assert_array_equal(getattr(second, name), getattr(first, name))
    for name in ("strain", "stress", "energy"):
        np.testing.assert_array_equal(getattr(second.state, name), getattr(first.state, name))


def random_strains(count, size, seed):
    return size * np.random.default_rng(seed).normal(size=(count, 6))


@pytest.mark.parametrize("rule", ["backward_euler", "discrete_gradient"])
@pytest.mark.parametrize("name", ["no_tension", "no_tension_in_space", "damage", "kelvin"])
def test_tangents_are_derivatives(page, name, rule):
    """Central differences of the stress; the default rule's work is stored or lost."""
    law = {
        "no_tension": lambda: page.no_tension(25e9, 1800.0),
        "no_tension_in_space": lambda: page.no_tension_in_space(25e9, 1800.0),
        "damage": lambda: page.damage(CONCRETE, 2e6, 100.0),
        "kelvin": lambda: page.kelvin(CONCRETE, 1e10, 2.0),
    }[name]()
    before, strain, h = random_strains(40, 1e-4, 0), random_strains(40, 2e-4, 1), 1e-9
    internal = law.initial_variables(np.full(40, 0.1))
    start = BulkState.elastic(0.0 * before, np.zeros((6, 6)), internal)
    state = law.backward_euler(before, start, 1.0).state
    ask = getattr(law, rule)
    answer = ask(strain, state, 1.0)
    for j in range(6):
        change = h * np.eye(6)[j]
        slope = ask(strain + change, state, 1.0).stress - ask(strain - change, state, 1.0).stress
        np.testing.assert_allclose(answer.tangent[:, :, j], slope / (2 * h), atol=2e-5 * 25e9)
    work = np.sum(answer.stress * (strain - state.strain), axis=1)
    stored = answer.state.energy - state.energy
    if rule == "discrete_gradient":
        np.testing.assert_allclose(
            work, stored + answer.dissipation, atol=1e-13 * np.abs(work).max()
        )
        if name.startswith("no_tension"):
            assert not answer.dissipation.any()


HOOKE = lambda e: 1e9 * ufl.inner(e, e)  # noqa: E731


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({}, "energy and stress are missing"),
        ({"energy": lambda e: e}, r"energy has shape \(3, 3\); it must be a UFL scalar"),
        ({"energy": 3.0}, "energy"),
        ({"energy": lambda e: 1 / 0}, "energy fails, division by zero"),
        ({"stress": lambda e: ufl.tr(e)}, r"stress has shape \(\); it must be a UFL expression of"),
        (
            {"stress": lambda e: 1e9 * ufl.as_matrix([[e[0, 0], e[0, 1]], [e[1, 0], e[1, 1]]])},
            r"stress has shape \(2, 2\); it must be a UFL expression of shape \(3, 3\)",
        ),
        (
            {"stress": lambda e: 1e9 * ufl.as_matrix([[e[0, 0], e[0, 1], 0]] + [[0, 0, 0]] * 2)},
            "stress is not symmetric",
        ),
        ({"energy": lambda e: 1e6 * ufl.tr(e) + HOOKE(e)}, "stress at zero strain is 1e.06 Pa"),
        ({"energy": lambda e: 5.0 + HOOKE(e)}, "energy at zero strain is 5 Pa; it must be zero"),
        ({"energy": lambda e: -HOOKE(e)}, "tangent at zero strain has the eigenvalue -2e.09 Pa"),
        ({"energy": lambda e: 1e9 * ufl.inner(e, e) ** 0.5}, "is NaN or infinite at zero strain"),
        ({"energy": HOOKE, "elastic": 3.0}, "elastic is 3.0; it must be an Elastic or an Ortho"),
        (
            {"energy": lambda e, k: HOOKE(e), "internal": {"k": (0.0, lambda e, k, dt: k / dt)}},
            "internal is NaN or infinite at zero strain.*division by dt = 0",
        ),
        ({"energy": HOOKE, "internal": [1]}, r"internal is \[1\]; it must be {\"name\""),
        (
            {"energy": lambda e, k: HOOKE(e), "internal": {"k": 1.0}},
            "internal is {'k': 1.0}; it must",
        ),
        (
            {"energy": HOOKE, "internal": {"k": ([], lambda *a: a[1])}},
            "the initial value of 'k' is",
        ),
        ({"energy": HOOKE, "internal": {3: (0.0, lambda *a: a[1])}}, "internal is {3"),
        ({"energy": HOOKE, "internal": {"a/b": (0.0, lambda *a: a[1])}}, "internal is {'a/b'"),
        (
            {"energy": lambda e, k: HOOKE(e), "internal": {"k": (math.nan, lambda e, k, dt: k)}},
            "the initial value of 'k' is nan; it must be a number",
        ),
        (
            {"energy": lambda e, k: HOOKE(e), "internal": {"k": (0.0, lambda e, k, dt: e)}},
            r"the update of k has shape \(3, 3\); it must be a UFL scalar",
        ),
        (
            {"energy": lambda e, k: HOOKE(e), "internal": {"k": (lambda h: 1.0, lambda *a: a[1])}},
            "a function of n cell sizes",
        ),
    ],
)
def test_wrong_ufl_is_refused(given, sentence):
    with pytest.raises(ValueError, match=sentence):
        dj.UflMaterial(**{"elastic": CONCRETE, **given})


def test_relaxed_stress_is_not_refused_as_asymmetric():
    """Relax to rounding error by an update with rounding errors that are not symmetric."""
    turn = ufl.as_matrix(np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0].tolist())
    turned = lambda a: turn.T * (turn * a * turn.T) * turn  # noqa: E731
    flow = lambda e, p, dt: turned(p + dt / (1.0 + dt) * (e - p))  # noqa: E731
    law = dj.UflMaterial(
        stress=lambda e, p: 25e9 * (e - p),
        internal={"p": (np.zeros((3, 3)), flow)},
        elastic=CONCRETE,
    )
    strain, internal = random_strains(50, 1e-4, 0), np.zeros((50, 9))
    for _ in range(20):
        answer = law.function(strain, internal, 10.0)
        internal = answer.internal
    assert np.abs(answer.stress).max() < 1e-6


def test_ufl_diff_in_functions_of_users():
    """Compare a stress by ufl.diff with the default one, with ufl.diff in an update as well."""
    shear, lame = CONCRETE.shear_modulus, CONCRETE.first_lame("strain")
    psi = lambda e, k: (1.0 - k) * (0.5 * lame * ufl.tr(e) ** 2 + shear * ufl.inner(e, e))  # noqa: E731
    grown = lambda e, k, dt: ufl.max_value(k, -1e-6 * ufl.diff(psi(e, k), k))  # noqa: E731
    materials = [
        dj.UflMaterial(energy=psi, elastic=CONCRETE, internal={"d": (0.0, grown)}, **stress)
        for stress in ({}, {"stress": lambda e, k: ufl.diff(psi(e, k), e)})
    ]
    strain = random_strains(5, 1e-4, 3)
    answers = [law.function(strain, np.zeros((5, 1)), 0.0) for law in materials]
    for derived, given in zip(*answers, strict=True):
        np.testing.assert_allclose(given, derived, rtol=1e-12, atol=1e-3)


def test_coefficients_of_a_mesh_are_refused(comm):
    from dolfinx import fem, mesh

    modulus = fem.Constant(mesh.create_unit_interval(comm, 2 * comm.size), 1e9)
    with pytest.raises(ValueError, match="depends on strain and internal variables only"):
        dj.UflMaterial(energy=lambda e: modulus * ufl.tr(e) ** 2, elastic=CONCRETE)


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (lambda e: 3.0, r"returned 3.0; it must return \(stress, tangent"),
        (
            lambda e: (e[:, :3], np.zeros((len(e), 6, 6))),
            r"stress is float64 of shape \(2, 3\); for 2 points",
        ),
        (lambda e: (e, None), r"tangent is None; for 2 points it must be an array of float64"),
        (
            lambda e: (e * np.nan, np.zeros((len(e), 6, 6))),
            "stress is NaN or infinite at zero strain",
        ),
        (
            lambda e: (e, np.tile(np.eye(6), (len(e), 1, 1)), [0.0]),
            r"energy is \[0.0\]; for 2 points",
        ),
        (
            lambda e: (e, np.tile(np.eye(6), (len(e), 1, 1)), np.sum(e**2, axis=1)),
            "stress is not the derivative of energy: .* d energy / dx is .* but stress : e is ",
        ),
        (
            lambda e: (e, np.tile(np.diag([1.0] * 3 + [2.0] * 3), (len(e), 1, 1))),
            "tangent is not the derivative of stress: ",
        ),
        (
            lambda e: (e.astype("f4"), np.tile(np.eye(6), (len(e), 1, 1))),
            r"float32 of shape \(2, 6\); for 2 points it must be an array of float64",
        ),
    ],
)
def test_wrong_functions_are_refused(answer, sentence):
    with pytest.raises(ValueError, match=sentence):
        dj.NumpyMaterial(lambda strain, internal, dt: answer(strain), elastic=CONCRETE)


def test_faults_in_a_run_are_named(comm, page):
    """NaN beyond a strain names the material; times that decrease and plane stress are refused."""

    def respond(strain, internal, dt):
        stress, tangent, _ = hooke_in_numpy(CONCRETE).function(strain, internal, dt)
        return np.where(np.abs(strain) > 1e-5, math.nan, stress), tangent

    def respond_with_energy(strain, internal, dt):
        answer = hooke_in_numpy(CONCRETE).function(strain, internal, dt)
        return *answer[:2], np.where(np.abs(strain).max(axis=1) > 1e-5, math.nan, answer[2])

    push = [dj.Pressure(group="top", value=25e6)]
    for function in (respond, respond_with_energy):
        law = dj.NumpyMaterial(function, elastic=CONCRETE)
        model = tower(comm, "quadrilateral", law, loads=push)
        with pytest.raises(dj.ConvergenceError, match="law NumpyMaterial returned NaN or infinity"):
            dj.Simulation(model).statics()
    with pytest.raises(ValueError, match="UflMaterial: the time decreases by 1 s"):
        dj.Simulation(tower(comm, "quadrilateral", page.no_tension(1e9, 1800.0))).quasi_statics(
            [1, 0]
        )
    with pytest.raises(ValueError, match=r"Nonlinear materials need plane='strain'"):
        tower(comm, "quadrilateral", page.no_tension(1e9, 1e3), body=dj.Body(plane="stress"))
    with pytest.raises(
        ValueError, match="There is no scalar internal variable 'x'; there are: none"
    ):
        model.bulk.variable("x", None)


@pytest.mark.parametrize("function", [lambda strain: strain, lambda strain, internal: strain])
def test_functions_of_other_arguments(function):
    with pytest.raises(ValueError, match="must be a function of strain, internal variables and"):
        dj.NumpyMaterial(function, elastic=CONCRETE)
