# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Free vibration of a bar from an initial velocity or displacement, in its first mode.

    |\ ____________________________ /|      E, rho, L = 8 m, A = 1 m^2, Poisson's ratio zero,
    |/|____________________________|\|      height held: N linear elements of length h

With u = sin(k x), k = pi / L, each element row gives, consistent mass,

    omega^2 = 6 E / (rho h^2) (1 - cos kh) / (2 + cos kh),

and the energy-consistent scheme turns (omega u, v) by theta = 2 atan(omega dt / 2) in each step:
u_n = a cos(n theta) from a displacement a sin(k x), u_n = v / omega sin(n theta) from a velocity
v sin(k x), to rounding. Kinetic energy of that velocity: rho A L v^2 (2 + cos kh) / 12.
"""

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")


import ufl
from boxes import Rows, box
from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints.mesh.dolfinx_versions import geometry_nodes

pytestmark = [
    pytest.mark.mpi,
    pytest.mark.filterwarnings("ignore:The estimated error of a single step"),
]

YOUNG, RHO, LENGTH, N = 24e9, 2400.0, 8.0, 8
H, K, DT, STEPS = LENGTH / N, math.pi / LENGTH, 1e-3, 7
OMEGA = math.sqrt(6.0 * YOUNG / (RHO * H**2) * (1.0 - math.cos(K * H)) / (2.0 + math.cos(K * H)))
ANGLE = 2.0 * math.atan(0.5 * OMEGA * DT)
SPEED, AMPLITUDE, STIFFNESS = 0.5, 1e-3, 1e11


def bar(*, joint: bool = False, **options: Any) -> dj.Model:
    """The bar, its right end free and a joint in its middle if asked for."""
    jointed = box(
        [LENGTH, 1.0],
        [N, 1],
        joints={"joint_1": (0, LENGTH / 2)} if joint else {},
        groups={"low": (1, 0.0), "high": (1, 1.0), "left": (0, 0.0), "right": (0, LENGTH)},
    )
    held = [dj.Fixed(group=side, components="y") for side in ("low", "high")]
    held.append(dj.Fixed(group="left"))
    return dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=RHO),
        joints=dj.frictionless(normal_stiffness=STIFFNESS) if joint else None,
        supports=held if joint else [*held, dj.Fixed(group="right")],
        **options,
    )


def kept():
    """A monitor of displacements, energies and settings."""
    return Rows(lambda record: (record.displacement.copy(), record.energy, record.settings))


def mode(x):
    """The first mode, as a function of the nodes."""
    return np.column_stack([np.sin(K * x[:, 0]), np.zeros(len(x))])


def as_function(model, factor):
    """The same as a DOLFINx function, of a space of its own."""
    u = fem.Function(fem.functionspace(model.jointed.mesh, ("Lagrange", 2, (2,))))
    u.interpolate(lambda x: factor * np.vstack([np.sin(K * x[0]), 0.0 * x[0]]))
    return u


def as_expression(model, factor):
    """The same in UFL."""
    return ufl.as_vector([factor * ufl.sin(K * ufl.SpatialCoordinate(model.jointed.mesh)[0]), 0])


GIVEN = {
    "a function": lambda model, factor: lambda x: factor * mode(x),
    "UFL": as_expression,
    "a Function": as_function,
}


@pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN)
def test_first_mode_from_a_velocity_and_from_a_displacement(given):
    model, seen = bar(), kept()
    run = dj.Simulation(model, monitors=[seen])
    expected = mode(model.V.tabulate_dof_coordinates()[: model.V.dofmap.index_map.size_local])
    run.dynamics(dt=DT, steps=STEPS, start=dj.InitialFields(velocity=given(model, SPEED)))
    for n, (u, _, _) in enumerate(seen.rows):
        wanted = SPEED / OMEGA * math.sin(n * ANGLE) * expected.ravel()
        assert np.abs(u.array - wanted).max(initial=0.0) < 1e-9 * SPEED / OMEGA
    kinetic = RHO * LENGTH * SPEED**2 * (2.0 + math.cos(K * H)) / 12.0
    _, energy, settings = seen.rows[0]
    assert energy.kinetic == pytest.approx(kinetic, rel=1e-12)
    assert energy.strain == 0.0
    assert settings["initial velocity"].startswith("up to 0.5 ")
    run.dynamics(dt=DT, steps=STEPS, start=dj.InitialFields(displacement=given(model, AMPLITUDE)))
    for n, (u, _, _) in enumerate(seen.rows):
        wanted = AMPLITUDE * math.cos(n * ANGLE) * expected.ravel()
        assert np.abs(u.array - wanted).max(initial=0.0) < 1e-9 * AMPLITUDE
    # omega^2 / 2 a^2 times what the kinetic energy has v^2 times.
    strain = kinetic * (OMEGA * AMPLITUDE / SPEED) ** 2
    energy = seen.rows[0][1]
    assert energy.strain == pytest.approx(strain, rel=1e-12)
    assert energy.kinetic == 0.0


def test_an_initial_displacement_comes_on_top_of_the_static_state():
    # The right half pressed on the left by p: gap -p / k. Moved by -a as a whole, the joint holds
    # k (p / k + a)^2 / 2; all else stays.
    pressure, moved = 1e6, 2e-5
    push = dj.Traction(group="right", value=(-pressure, 0.0))
    model, seen = bar(joint=True, loads=[push]), kept()
    run = dj.Simulation(model, monitors=[seen])
    static = run.statics()
    right = fem.Function(model.V)
    cells = np.arange(model.V.mesh.topology.index_map(2).size_local, dtype=np.int32)
    middle = model.V.mesh.geometry.x[geometry_nodes(model.V.mesh)[cells]].mean(axis=1)[:, 0]
    nodes = model.V.dofmap.list[cells[middle > LENGTH / 2]]
    right.x.array.reshape(-1, 2)[nodes.ravel(), 0] = -moved
    right.x.scatter_forward()
    run.dynamics(dt=1e-7, steps=1, start=dj.InitialFields(displacement=right))
    stored = 0.5 * STIFFNESS * (pressure / STIFFNESS + moved) ** 2
    apart, energy, _ = seen.rows[0]
    assert energy.joint == pytest.approx(stored, rel=1e-9)
    strain = 0.5 * pressure**2 / YOUNG * LENGTH
    assert energy.strain == pytest.approx(strain, rel=1e-9)
    apart.axpy(-1.0, static.displacement)
    # N / 2 + 1 pairs of nodes moved.
    assert apart.norm() == pytest.approx(math.sqrt(N + 2) * moved, rel=1e-9)


def test_a_run_with_other_initial_fields_is_not_resumed(new_path):
    model, file = bar(), new_path("run.ckpt")

    def run(steps=4, speed=SPEED, *, resume=False):
        kept = dj.Checkpoints(file, every=3, resume=resume)
        start = dj.InitialFields(
            velocity=lambda x: speed * mode(x), displacement=lambda x: 1e-3 * mode(x)
        )
        return dj.Simulation(model).dynamics(dt=DT, steps=steps, start=start, checkpoint=kept)

    whole = run()
    again = run(resume=True)
    apart = again.state.displacement.copy()
    apart.axpy(-1.0, whole.state.displacement)
    assert apart.norm() < 1e-12 * whole.state.displacement.norm()
    with pytest.raises(dj.CheckpointError, match="initial velocity: the numbers differ"):
        run(speed=0.5 * SPEED, resume=True)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"velocity": (1.0, 0.0)}, "differs by 1 m/s from the velocity of the supports"),
        ({"displacement": (1.0, 0.0)}, "displacements of the supports at t = 0 s differ"),
        ({"velocity": (1.0, 0.0, 0.0)}, "velocity is .* it must be 2 finite numbers"),
        ({"velocity": lambda x: x[:, 0]}, "velocity returned an array of shape"),
        ({"displacement": lambda x: np.nan * mode(x)}, "displacement returned an array of shape"),
        ({"velocity": ufl.as_vector([1.0, 0.0])}, "on the model's mesh"),
    ],
)
def test_fields_that_do_not_fit_are_refused(fields, text):
    with pytest.raises(ValueError, match=text):
        dj.Simulation(bar()).dynamics(dt=DT, steps=1, start=dj.InitialFields(**fields))
