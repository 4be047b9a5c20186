# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shaken blocks whose joints stick, slide, open and close, recorded for gradients."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from boxes import COMM, box

import dolfinx_joints as dj

LAW = dj.FrictionNoTension(normal_stiffness=5e9, shear_stiffness=3e9, friction_coefficient=0.5)
CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
GAPS = {"middle": "j", "corner": ("j", (0.0, 1.0))}
POINTS = {"top": (0.0, 2.0)}


def motion(time):
    """Ground acceleration that makes the upper block slide, rock and lift off, [m/s^2]."""
    return np.array(
        [8.0 * np.sin(30.0 * time), 3.0 * np.sin(21.0 * time), 12.0 * np.sin(40.0 * time)]
    )


def blocks(law=LAW, comm=COMM, **options):
    """Return a model of two blocks of 2 x 1 m on each other (collective)."""
    mesh = box(
        (2.0, 2.0),
        (2, 4),
        joints={"j": (1, 1.0)},
        groups={"base": (1, 0.0), "left": (0, 0.0), "right": (0, 2.0)},
        comm=comm,
    )
    given = {"material": CONCRETE, "joints": law, "supports": [dj.Fixed(group="base")]}
    given |= {
        "loads": [dj.Gravity()],
        "damping": dj.stiffness_proportional(ratio=0.02, frequency=20.0),
    }
    return dj.Model(mesh, **(given | options))


def shaken(scheme=None, steps=60, dt=2e-3, **options):
    """Return a function that runs statics and motion of a model with a tape."""

    def run(model, tape):
        simulation = dj.Simulation(model, monitors=[tape])
        simulation.statics()
        return simulation.dynamics(dt=dt, steps=steps, motion=motion, scheme=scheme, **options)

    return run


def recorded(run, model, **options):
    """Return the tape of a run."""
    tape = dj.Tape(POINTS, gaps=GAPS, **options)
    run(model, tape)
    return tape


def integral(name, component):
    """Return the quantity J = sum of squares of an observed component over all steps."""

    def derivative(history):
        weights = np.zeros_like(history.values[name])
        weights[:, component] = 2.0 * history.values[name][:, component]
        return {name: weights}

    return dj.Quantity(
        value=lambda h: float(np.sum(h.values[name][:, component] ** 2)), derivative=derivative
    )
