# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""An elastic bar strikes a rigid wall: contact traction, energy and rebound.

        | wall     gap   bar, E, rho, L       <- v
        |/        <--->  ____________________
        |/              |____________________|
        |/
        x = 0

The tip stops when it strikes, at gap / v. From there a wave of stress rho c v, with
c = sqrt(E / rho), runs to the free end and comes back as release: the traction is constant for
2 L / c, then the whole bar leaves with v. Statement and numbers of `BarOnWall` by d'Alembert.

The jump at the front of the wave is more than any mesh resolves. What a row of elements makes of it
decays behind the front: the traction is therefore judged by its standard deviation over the contact
less a tenth of its duration at either end. What is left of the front's oscillation in the bar after
the rebound is energy that the centre of mass lacks: up to one percent of its velocity.

Tip nodes with mass make the traction ring between nothing and twice its value; without (mass
redistribution) the same steps are smooth.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx.mesh import (
    CellType,
    create_box,
    locate_entities,
    locate_entities_boundary,
)

from benchmarks.shared.problems import bar_matrices
from dolfinx_joints import (
    Body,
    Elastic,
    EnergyConsistent,
    Fixed,
    GeneralizedAlpha,
    HilberHughesTaylor,
    ImplicitContact,
    Joints,
    MatrixSystem,
    Model,
    Newmark,
    StepControl,
    frictionless,
    split_mesh,
)
from dolfinx_joints.laws.law import DISCRETE_GRADIENT
from dolfinx_joints.model.mass_redistribution import redistribute
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.substeps import Stepper


@dataclass(frozen=True, kw_only=True)
class BarOnWall:
    """The exact solution."""

    length: float = 0.2
    young: float = 2e11
    density: float = 8000.0
    velocity: float = 100.0
    gap: float = 2e-3

    @property
    def wave_speed(self):
        return math.sqrt(self.young / self.density)

    @property
    def begin(self):
        """First contact [s]."""
        return self.gap / self.velocity

    @property
    def end(self):
        """The release wave is back at the wall [s]."""
        return self.begin + 2.0 * self.length / self.wave_speed

    @property
    def pressure(self):
        """During the contact [Pa]; times the duration it is 2 rho L v, the change of momentum."""
        return self.density * self.wave_speed * self.velocity


BAR = BarOnWall()


class Run(NamedTuple):
    """Contact pressures, relative to the exact one, at times, and what became of the bar."""

    time: np.ndarray
    pressure: np.ndarray
    rebound: float
    energy_error: float

    @property
    def deviation(self):
        """Standard deviation over the contact less a tenth at either end, of the exact value."""
        margin = 0.1 * (BAR.end - BAR.begin)
        inside = (self.time > BAR.begin + margin) & (self.time < BAR.end - margin)
        assert inside.sum() > 50
        return float(np.std(self.pressure[inside]))


def march(system, velocity, *, courant, size, scheme):
    """Steps of courant * size / c until 20 microseconds after the rebound."""
    solver = make_solver(system)
    state = initial_state(solver, velocity=velocity)
    ledger = EnergyLedger(system)
    ledger.start(state)
    stepper = Stepper(scheme, solver, ledger, StepControl())
    dt = courant * size / BAR.wave_speed
    total = system.contact.integral(np.ones(len(system.contact.operator.areas)))
    times, pressures = [], []
    for _ in range(round((BAR.end + 2e-5) / dt)):
        for after, report, row in stepper.substeps(state, dt):
            state = after
            ledger.record(row)
            # Schemes that answer for a whole step give its mean traction.
            times.append(
                state.time - (0.5 * report.dt if scheme.rule == DISCRETE_GRADIENT else 0.0)
            )
            force = -system.contact.integral(state.joints.traction[:, 0])
            pressures.append(force / total / BAR.pressure)
    momentum = state.momentum.getArray(readonly=True).reshape(-1, system.components)[:, 0].sum()
    momentum = sum(system.mass.comm.tompi4py().allgather(float(momentum)))
    return Run(
        np.array(times),
        np.array(pressures),
        momentum / (BAR.density * BAR.length * total) / BAR.velocity,
        ledger.relative_error,
    )


def plain(cells, *, courant, stiffness=1e4, scheme=None, massless=True):
    """The bar as matrices of linear elements, of unit section; k_n = stiffness * E / h."""
    h = BAR.length / cells
    mass, bulk = bar_matrices(BAR, cells)
    gap = np.zeros((3, cells + 1))
    gap[0, 0] = 1.0
    system = MatrixSystem.from_arrays(
        mass=mass,
        stiffness=bulk,
        gap=gap,
        law=frictionless(normal_stiffness=stiffness * BAR.young / h),
        initial_gap=BAR.gap,
    )
    if massless:
        system = redistribute(system, np.linspace(0.0, BAR.length, cells + 1)[:, None])
    velocity = system.mass.createVecRight()
    velocity.set(-BAR.velocity)
    return march(system, velocity, courant=courant, size=h, scheme=scheme or EnergyConsistent())


def solid(comm, cells, *, courant, cell=CellType.hexahedron, degree=1, across=1):
    """The bar as a thin solid; the wall is two more cells, all of whose nodes are held."""
    h = BAR.length / cells
    width = across * h
    corners = [[-2.0 * h, 0.0, 0.0], [BAR.length, width, width]]
    mesh = create_box(comm, corners, [cells + 2, across, across], cell)
    mesh.topology.create_connectivity(2, 3)
    back = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[0], -2.0 * h))
    tip = locate_entities(mesh, 2, lambda x: np.isclose(x[0], 0.0, atol=1e-6 * h))
    model = Model(
        split_mesh(mesh, joints={"joint": tip}, groups={"back": back}),
        material=Elastic(young=BAR.young, poisson=0.0, density=BAR.density),
        joints=Joints(
            frictionless(normal_stiffness=1e4 * BAR.young / h), initial_gaps={"joint": BAR.gap}
        ),
        supports=[Fixed(group="back"), Fixed(group="joint-")],
        body=Body(degree=degree, redistribute_mass=True),
    )
    x = model.V.tabulate_dof_coordinates()[: model.V.dofmap.index_map.size_local]
    system = model.system()
    velocity = system.mass.createVecRight()
    velocity.set(0.0)
    nodal = velocity.getArray().reshape(-1, 3)
    nodal[x[:, 0] > 1e-6 * h, 0] = -BAR.velocity
    nodal[model.nodes("joint+"), 0] = -BAR.velocity
    return march(system, velocity, courant=courant, size=h, scheme=EnergyConsistent())


def test_exact_solution_has_the_stated_values():
    # c = 5000 m/s; 2 mm at 100 m/s; 2 * 0.2 / 5000 s; 8000 * 5000 * 100 Pa.
    assert pytest.approx(2e-5, rel=1e-14) == BAR.begin
    assert pytest.approx(1e-4, rel=1e-14) == BAR.end
    assert pytest.approx(4e9, rel=1e-14) == BAR.pressure
    impulse = BAR.pressure * (BAR.end - BAR.begin)
    assert impulse == pytest.approx(2.0 * BAR.density * BAR.length * BAR.velocity, rel=1e-14)


@pytest.mark.parametrize("stiffness", [pytest.param(1e2, marks=pytest.mark.slow), 1e4, 1e6])
@pytest.mark.parametrize("courant", [0.5, 1.0])
def test_smooth_traction_without_loss_of_energy(courant, stiffness):
    """However stiff the joint; 200 elements."""
    run = plain(200, courant=courant, stiffness=stiffness)
    print(
        f"\nCourant {courant}, k_n h/E {stiffness:g}: traction deviates by {run.deviation:.1e}, "
        f"energy error {run.energy_error:.1e}, rebound {run.rebound:.4f}"
    )
    assert run.deviation < 2e-3
    assert run.energy_error < 1e-10
    assert run.rebound == pytest.approx(1.0, abs=0.01)
    before = run.pressure[run.time < BAR.begin - 1e-6]
    after = run.pressure[run.time > BAR.end + 5e-6]
    assert np.all(before == 0.0)
    assert np.all(after == 0.0)


SCHEMES = [
    (EnergyConsistent(), 0.5),
    (Newmark(), 1.5),
    pytest.param(ImplicitContact(), 0.3, marks=pytest.mark.slow),
    pytest.param(HilberHughesTaylor(alpha=0.1), 1.0, marks=pytest.mark.slow),
    pytest.param(GeneralizedAlpha(spectral_radius=0.8), 1.0, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("scheme", "ringing"), SCHEMES)
def test_all_schemes_ring_with_mass_at_the_tip_and_none_without(scheme, ringing):
    """100 elements, steps of half the Courant number, k_n h / E = 1e4.

    The deviations with mass, of which ``ringing`` is a lower bound, are 0.7 (energy-consistent),
    0.4 (implicit contact), 2.7 (Newmark), 1.9 (HHT) and 2.0 (generalized-alpha); without all of
    them have what the front of the wave leaves, 0.0035.
    """
    with_mass = plain(100, courant=0.5, scheme=scheme, massless=False)
    run = plain(100, courant=0.5, scheme=scheme)
    print(f"\n{scheme}: {with_mass.deviation:.1e} with mass, {run.deviation:.1e} without")
    assert with_mass.deviation > ringing
    assert run.deviation < 0.005
    assert run.rebound == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("cells", [pytest.param(25, marks=pytest.mark.mpi), 100])
def test_a_solid_of_hexahedra_is_the_plain_bar(comm, cells):
    """Without lateral contraction its sections stay plane: the same tractions to rounding.

    Rounding is amplified by the stiffness of the joint, 1e4 times that of an element.
    """
    expected = plain(cells, courant=1.0)
    run = solid(comm, cells, courant=1.0)
    np.testing.assert_allclose(run.pressure, expected.pressure, rtol=0, atol=1e-7)
    assert run.rebound == pytest.approx(expected.rebound, abs=1e-7)
    assert run.energy_error < 1e-10


@pytest.mark.parametrize(
    ("cell", "degree", "cells", "deviation"),
    [
        (CellType.tetrahedron, 1, 60, 0.02),
        (CellType.hexahedron, 2, 50, 0.005),
        (CellType.tetrahedron, 2, 40, 0.02),
    ],
    ids=["tet1", "hex2", "tet2"],
)
def test_other_cells(comm, cell, degree, cells, deviation):
    """Bounds a third or more above what is found, more on coarse meshes, 0.002 to 0.015."""
    run = solid(comm, cells, courant=0.5, cell=cell, degree=degree, across=3 - degree)
    assert run.deviation < deviation
    assert run.energy_error < 1e-10
    assert run.rebound == pytest.approx(1.0, abs=0.02)
