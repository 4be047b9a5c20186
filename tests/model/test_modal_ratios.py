# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of modes as a part of C: ratios, decay, energies, solvers and ranks.

With v1 = 2 x / dt - v0 the midpoint rule turns a mode's (q, v) in a step by

    [[1, -dt/2], [w^2 dt/2, 1 + z w dt]]^-1 [[1, dt/2], [-w^2 dt/2, 1 - z w dt]],

whose determinant, the decay of q^2 over two steps, is (1 - z w dt + (w dt/2)^2) over
(1 + z w dt + (w dt/2)^2): exp(-2 z w dt) but for (w dt)^2.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("slepc4py")

from mpi4py import MPI

import shaken_wall
from dolfinx.mesh import CellType, create_rectangle, locate_entities_boundary
from shaken_wall import BASE, CONCRETE, shaking

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi

RATIOS = (0.02, 0.07, 0.05, 0.04)
BEYOND = dj.Rayleigh(mass_factor=0.1, stiffness_factor=1e-5)


@pytest.fixture
def wall(comm, wall_file, read):
    """The jointed wall of 3 blocks, clamped at its base."""

    def make(damping=None, *, on=None, **options):
        jointed = read(wall_file()) if on is None else dj.read_msh(wall_file(), on)
        return shaken_wall.wall(jointed, damping=damping, **options)

    return make


class Amounts(Monitor):
    """phi.M u of some modes over the steps, on every rank."""

    def __init__(self, system, shapes):
        self._weighed, self.values = [system.mass * shape for shape in shapes], []

    def record(self, record):
        self.values.append([each.dot(record.displacement) for each in self._weighed])


def test_every_mode_has_its_ratio_as_asked(wall):
    """Of all of C, at joints, springs and with Rayleigh damping beside; further modes have that."""
    spring = dj.Spring(group="y_min", normal_stiffness=1e8)
    options = {"supports": [BASE, spring]}
    system = wall(dj.ModalRatios(ratio=RATIOS, modes=4, beyond=BEYOND), **options).system()
    rest = wall(BEYOND, **options).system()
    found = dj.modes(system, 7)
    np.testing.assert_allclose(dj.modal_damping(system, found).ratios[:4], RATIOS, rtol=1e-9)
    expected = dj.modal_damping(rest, found).ratios[4:]
    np.testing.assert_allclose(dj.modal_damping(system, found).ratios[4:], expected, rtol=1e-6)


def test_ratios_come_on_top_of_viscous_boundaries(comm):
    """They are those of the body; what waves take out through a boundary is added."""
    mesh = create_rectangle(comm, [[0.0, 0.0], [4.0, 8.0]], [4, 8], CellType.quadrilateral)
    places = {"base": lambda x: x[1] < 1e-9, "patch": lambda x: (x[0] < 1e-9) & (x[1] < 1.1)}
    groups = {name: locate_entities_boundary(mesh, 1, where) for name, where in places.items()}
    supports = [BASE, dj.ViscousBoundary(group="patch")]
    block = dj.split_mesh(mesh, groups=groups)

    def system_with(damping):
        return dj.Model(block, material=CONCRETE, supports=supports, damping=damping).system()

    alone = system_with(None)
    boundary = dj.modal_damping(alone, dj.modes(alone, 4)).ratios
    assert min(boundary) > 1e-3
    system = system_with(dj.ModalRatios(ratio=RATIOS, modes=4, beyond=BEYOND))
    found = dj.modal_damping(system, dj.modes(system, 4)).ratios
    np.testing.assert_allclose(found, boundary + RATIOS, rtol=1e-9)


@pytest.mark.parametrize("exact", [0, 4])
def test_free_decay_of_each_mode(wall, exact):
    """Without joints, at rest in the sum of four modes: by the rule's closed form, or exactly."""
    damping = dj.ModalRatios(ratio=RATIOS, modes=4)
    jointed = wall().jointed
    model = dj.Model(
        jointed,
        material=CONCRETE,
        supports=[BASE],
        damping=damping,
        body=dj.Body(extra_stiffness=lambda u, v: _tied(jointed, u, v)),
    )
    system = model.system()
    found = dj.modes(system, 4)
    start = system.mass.createVecRight()
    start.set(0.0)
    for shape in found.shapes:
        start.axpy(1e-3, shape)
    kept, dt = Amounts(system, found.shapes), 2.0**-10
    outcome = dj.Simulation(model, monitors=[kept]).dynamics(
        dt=dt,
        steps=40,
        start=dj.InitialFields(displacement=model.function(start)),
        scheme=dj.EnergyConsistent(exact_modes=exact),
    )
    assert outcome.energy_error < 1e-11
    values = np.array(kept.values)
    for i, (f, ratio) in enumerate(zip(found.frequencies, RATIOS, strict=True)):
        omega = 2.0 * np.pi * f
        if exact:
            root = -ratio * omega + 1j * omega * np.sqrt(1.0 - ratio**2)
            sum_of, product = 2.0 * np.exp(root * dt).real, np.exp(2.0 * root.real * dt)
        else:
            turn = np.linalg.solve(
                [[1.0, -dt / 2.0], [omega**2 * dt / 2.0, 1.0 + ratio * omega * dt]],
                [[1.0, dt / 2.0], [-(omega**2) * dt / 2.0, 1.0 - ratio * omega * dt]],
            )
            sum_of, product = np.trace(turn), np.linalg.det(turn)
            decay = -np.log(product) / (2.0 * dt)
            assert decay == pytest.approx(ratio * omega, rel=0.3 * (omega * dt) ** 2)
        q = values[1:, i]
        left = q[2:] - sum_of * q[1:-1] + product * q[:-2]
        assert np.abs(left).max() < 1e-8 * np.abs(q).max()


def _tied(jointed, u, v):
    import ufl

    return 1e12 * ufl.inner(ufl.jump(u), ufl.jump(v)) * jointed.dS()


CASES = {
    "condensed": ("condensed", dj.EnergyConsistent(), {}),
    "monolithic": ("monolithic", dj.EnergyConsistent(), {}),
    "exact modes": ("condensed", dj.EnergyConsistent(exact_modes=6), {}),
    "water": (
        "condensed",
        dj.EnergyConsistent(),
        {"water": dj.ReservoirWaves(group="y_min", level=19.0, length=40.0)},
    ),
    "moving support": (
        "condensed",
        dj.EnergyConsistent(),
        {
            "supports": [
                dj.Fixed(group="base", components="yz"),
                dj.Prescribed(
                    group="base", component="x", value=lambda t: 1e-3 * np.sin(20.0 * t) ** 2
                ),
            ]
        },
    ),
}


def run(model, solver="condensed", scheme=None, steps=40):
    simulation = dj.Simulation(model, solver=solver)
    simulation.statics()
    return simulation.dynamics(
        dt=4e-3, steps=steps, motion=shaking, scheme=scheme or dj.EnergyConsistent()
    )


@pytest.mark.parametrize("case", CASES)
def test_energies_balance_at_joints_that_slide_and_open(wall, case):
    solver, scheme, options = CASES[case]
    damping = dj.ModalRatios(ratio=RATIOS, modes=4, beyond=BEYOND)
    outcome = run(wall(damping, **options), solver, scheme)
    assert outcome.energy_error < 1e-11
    assert outcome.imbalance < 1e-10
    assert outcome.energy.friction > 0.0
    # The modes' part is most of it: with the rest alone far less is lost.
    alone = run(wall(BEYOND, **options), solver, scheme)
    lost, rest = (each.energy.viscous - each.energy.absorbed for each in (outcome, alone))
    assert lost > 3.0 * rest


def test_solvers_and_ranks_agree(comm, wall):
    damping = dj.ModalRatios(ratio=0.05, modes=4, beyond=BEYOND)
    expected = run(wall(damping, on=MPI.COMM_SELF))
    for solver in ("condensed", "monolithic"):
        found = run(wall(damping), solver)
        norms = (each.state.displacement.norm() for each in (found, expected))
        assert next(norms) == pytest.approx(next(norms), rel=1e-8)
        assert found.energy.viscous == pytest.approx(expected.energy.viscous, rel=1e-7)


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_errors(wall):
    with pytest.raises(ValueError, match="ratio has 2 values for 3 modes"):
        dj.ModalRatios(ratio=(0.05, 0.05), modes=3)
    damping = dj.ModalRatios(
        ratio=0.01, modes=2, beyond=dj.mass_proportional(ratio=0.05, frequency=20.0)
    )
    system = wall(damping).system()
    text = r"ratio of mode 1 is 0\.01, but the other damping .* gives 0\.13"
    with pytest.raises(ValueError, match=text):
        dj.modal_damping(system, dj.modes(system, 1))
