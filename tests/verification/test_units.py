# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results do not depend on the units of length, time and mass, whatever a model has in it.

         ____ ____     two columns of 2 m on a slab, joint_1 under them, joint_2 between them,
        |    |    |    with an initial gap; on "top" a push, on "face" water, springs on "end"
        |____|____|
        |_________|    base: clamped, prescribed, or on dashpots

Expected: numbers in millimetres and milliseconds, or in kilometres, hours and tonnes, are those in
metres, seconds and kilograms times the scale of their unit. Only an absolute number in the code
can make another difference than rounding.

Tolerance: 1e-9 of the largest value of a quantity in the run.
"""

from dataclasses import dataclass

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows

import dolfinx_joints as dj

pytestmark = [
    pytest.mark.mpi,
    pytest.mark.filterwarnings("ignore:The energy error is"),
    pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning"),
]


@dataclass(frozen=True)
class Units:
    """How many units make a metre, a second and a kilogram."""

    length: float = 1.0
    time: float = 1.0
    mass: float = 1.0

    def __call__(self, value, *, m=0, s=0, kg=0):
        """A value in SI, of unit m^m s^s kg^kg, in these units."""
        return value * self.length**m * self.time**s * self.mass**kg

    def pressure(self, value):
        """Pa."""
        return self(value, m=-1, s=-2, kg=1)

    def stiffness(self, value):
        """Pa/m."""
        return self(value, m=-2, s=-2, kg=1)

    def density(self, value):
        """kg/m^3."""
        return self(value, m=-3, kg=1)

    def acceleration(self, value):
        """m/s^2."""
        return self(value, m=1, s=-2)


SI = Units()
OTHER = {
    "mm-ms": Units(length=1e3, time=1e3),
    "km-h-t": Units(length=1e-3, time=1.0 / 3600.0, mass=1e-3),
}


def mesh(units):
    """The slab and the columns, 4 by 4 cells of 0.5 m by 0.75 m."""
    number = np.arange(25).reshape(5, 5)  # x, height
    corners = [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]]
    cells = np.stack(corners, axis=-1).reshape(-1, 4)
    x, z = np.meshgrid(0.5 * np.arange(5.0), 0.75 * np.arange(5.0), indexing="ij")

    def edges(row):
        return np.column_stack([row[:-1], row[1:]])

    return dj.mesh_from_arrays(
        MPI.COMM_WORLD,
        cell="quadrilateral",
        x=units(np.column_stack([x.ravel(), z.ravel()]), m=1),
        cells=cells,
        facet_groups={
            "base": edges(number[:, 0]),
            "top": edges(number[:, -1]),
            "face": edges(number[0]),
            "end": edges(number[-1]),
            "joint_1": edges(number[:, 1]),
            "joint_2": edges(number[2, 1:]),
        },
    )


def friction(u):
    """Joints that press, slide and open."""
    return dj.FrictionNoTension(
        normal_stiffness=u.stiffness(4e9),
        shear_stiffness=u.stiffness(2e9),
        friction_angle_deg=30.0,
    )


def bonded(u, **more):
    """Joints with a bond that breaks."""
    return dj.MohrCoulombJoint(
        normal_stiffness=u.stiffness(4e9),
        shear_stiffness=u.stiffness(2e9),
        friction_angle_deg=30.0,
        cohesion=u.pressure(6e4),
        tensile_strength=u.pressure(3e4),
        **more,
    )


def dashpots(u):
    """Joints with a bond and dashpots."""
    viscosity = u(1e6, m=-2, s=-1, kg=1)
    return dj.ViscousJoint(law=bonded(u), normal_viscosity=viscosity, shear_viscosity=viscosity)


def push(u):
    """A push on the top that comes and goes within 20 ms."""

    def factor(time):
        return float(np.sin(np.pi * min(time / u(0.02, s=1), 1.0)))

    return dj.Traction(group="top", value=u.pressure(np.array([2e5, 1e5])), factor=factor)


def clamped(u):
    """A base at rest, springs beside it."""
    stiffness = u.stiffness(3e8)
    return [
        dj.Fixed(group="base"),
        dj.Spring(group="end", normal_stiffness=stiffness, tangential_stiffness=stiffness),
    ]


def moved(u):
    """A base that starts with its largest velocity, as in a laboratory."""

    def shift(time):
        return u(1e-3, m=1) * float(np.sin(300.0 * time / u(1.0, s=1)))

    return [
        dj.Prescribed(group="base", component="x", value=shift),
        dj.Fixed(group="base", components="y"),
    ]


def floating(u):
    """A base on dashpots, and springs that hold it in statics."""
    stiffness = u.stiffness(1e9)
    spring = dj.Spring(group="base", normal_stiffness=stiffness, tangential_stiffness=stiffness)
    return [dj.ViscousBoundary(group="base"), spring]


def still_water(u):
    """A lake that stands against the face and enters the joint where it opens."""
    water = {"level": u(2.8, m=1), "density": u.density(1000.0)}
    water["gravity"] = u.acceleration(9.81)
    return [
        dj.HydrostaticPressure(group="face", **water),
        dj.JointWater(joint="joint_1", reached_from="face", aperture=u(1e-6, m=1), **water),
    ]


def wave(u):
    """A wave that rises through the dashpots of the base."""

    def velocity(time):
        t = time / u(1.0, s=1)
        return u(0.3, m=1, s=-1) * np.array([np.sin(300.0 * t), 0.0, np.sin(200.0 * t)])

    highest = u(100.0, s=-1)
    surface = u(0.1, m=1)
    return [
        dj.FreeField(groups=["base"], incident=velocity, surface=surface, highest_frequency=highest)
    ]


SCENES = {
    "friction": (friction, clamped, lambda u: [push(u)], {}),
    "friction monolithic": (friction, clamped, lambda u: [push(u)], {"solver": "monolithic"}),
    "cohesion": (bonded, clamped, lambda u: [push(u)], {}),
    "dilatancy": (lambda u: bonded(u, dilatancy_angle_deg=10.0), clamped, lambda u: [push(u)], {}),
    "dashpots": (dashpots, floating, lambda u: [push(u)], {}),
    "prescribed": (friction, moved, lambda u: [], {}),
    "water": (friction, clamped, still_water, {}),
    "free field": (friction, floating, wave, {}),
}


def in_si(record, u):
    """Quantities of a step by name, in SI."""
    e = record.energy
    energies = (e.kinetic, e.strain, e.joint, e.input, e.viscous, e.friction)
    return {
        "displacement": record.displacement.array / u(1.0, m=1),
        "velocity": record.velocity.array / u(1.0, m=1, s=-1),
        "gap": record.joints.state.gap / u(1.0, m=1),
        "traction": record.joints.traction / u.pressure(1.0),
        "energy": np.array(energies) / u(1.0, m=1, s=-2, kg=1),
        "status": np.array(record.joints.status, dtype=float),
    }


def run(scene, units):
    """Self weight, then ten steps of 2 ms, shaken; quantities of each step by name."""
    law, supports, loads, options = SCENES[scene]
    mass = dj.ReservoirMass(
        group="face",
        level=units(2.8, m=1),
        density=units.density(1000.0),
        frequency=units(5.0, s=-1),
        sound_speed=units(1440.0, m=1, s=-1),
    )
    model = dj.Model(
        mesh(units),
        material=dj.Elastic(young=units.pressure(2e9), poisson=0.2, density=units.density(2400.0)),
        joints=dj.Joints(law(units), initial_gaps={"joint_2": units(2e-6, m=1)}),
        supports=supports(units),
        damping=dj.Rayleigh(mass_factor=units(1.0, s=-1), stiffness_factor=units(1e-4, s=1)),
        water=[mass] if scene == "water" else [],
        loads=[dj.Gravity(acceleration=units.acceleration(np.array([0.0, -9.81]))), *loads(units)],
    )
    seen = Rows(lambda record: in_si(record, units))
    newton = dj.SolverOptions(relative_tolerance=1e-14)
    simulation = dj.Simulation(model, options=newton, monitors=[seen], **options)
    simulation.statics()

    def ground(time):
        t = time / units(1.0, s=1)
        return units.acceleration(np.array([8.0 * np.sin(200.0 * t), 12.0 * np.sin(300.0 * t)]))

    motion = None if scene in ("prescribed", "free field") else ground
    simulation.dynamics(dt=units(2e-3, s=1), steps=10, motion=motion)
    return seen.rows


@pytest.mark.parametrize("scene", SCENES)
def test_results_do_not_depend_on_units(scene):
    expected = run(scene, SI)
    seen = {int(i) for row in expected for i in row["status"]}
    assert set().union(*MPI.COMM_WORLD.allgather(seen)) == {0, 1, 2}  # open, stick, slip
    for name, units in OTHER.items():
        found = run(scene, units)
        for quantity in expected[0]:
            one, other = (np.array([row[quantity] for row in rows]) for rows in (expected, found))
            largest = [np.abs(each).max(initial=1e-300) for each in (one - other, one)]
            off, scale = np.max(MPI.COMM_WORLD.allgather(largest), axis=0)
            assert off / scale < 1e-9, (name, quantity, off / scale)
