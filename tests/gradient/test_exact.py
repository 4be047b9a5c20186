# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients with closed forms: weight on a joint, and the residual slip of a sliding block."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import COMM
from recorded_blocks import blocks, recorded

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY


@pytest.mark.mpi
def test_weight_on_a_joint():
    """Compare with the mean gap -W / (k_n A); its derivative by k_n is W / (k_n^2 A)."""
    model = blocks(material=dj.Elastic(young=24e9, poisson=0.0, density=2400.0))
    tape = recorded(lambda m, t: dj.Simulation(m, monitors=[t]).statics(), model)
    gradient = dj.gradient_of(tape, dj.Quantity.at_end("middle", 0))
    pressure = 2400.0 * STANDARD_GRAVITY * 1.0
    assert gradient.value == pytest.approx(-pressure / 5e9, rel=1e-10)
    expected = {"normal_stiffness": pressure / 5e9**2, "initial_gap": 0.0}
    for name, value in expected.items():
        of_joint = gradient.by_joint[name]["j"]
        assert of_joint == pytest.approx(value, rel=1e-8, abs=1e-10)
        of_points = float(COMM.allreduce(gradient.by_point[name].sum()))
        assert of_points == pytest.approx(of_joint, rel=1e-9, abs=1e-12)
    assert gradient.by_load["Gravity"] == pytest.approx(gradient.value, rel=1e-9)


@pytest.mark.parametrize("scheme", [dj.EnergyConsistent(), dj.Newmark()])
def test_residual_slip_of_a_sliding_block(scheme):
    """Compare with a rigid block on a base that has the acceleration a for a time T.

    Newmark (1965): residual slip s = a T^2 / 2 (a / (mu g) - 1); ds/dmu = -(a T)^2 / (2 mu^2 g).
    The block is flat and damped, and steps are short: it is nearly rigid.
    """
    mu, pulse, duration = 0.5, 8.0, 0.1

    def push(time):
        return (pulse if time < duration - 1e-9 else 0.0, 0.0, 0.0)

    def run(model, tape):
        simulation = dj.Simulation(model, monitors=[tape])
        simulation.statics()
        simulation.dynamics(dt=1e-3, steps=300, motion=push, scheme=scheme)

    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_coefficient=mu)
    model = blocks(law, damping=dj.stiffness_proportional(ratio=0.2, frequency=100.0))
    tape = recorded(run, model)
    quantity = dj.Quantity.at_end("middle", 1)
    gradient = dj.gradient_of(tape, quantity)
    slip = 0.5 * pulse * duration**2 * (pulse / (mu * STANDARD_GRAVITY) - 1.0)
    slope = -0.5 * (pulse * duration / mu) ** 2 / STANDARD_GRAVITY
    assert abs(gradient.value) == pytest.approx(slip, rel=0.03)
    of_joint = gradient.by_joint["friction_coefficient"]["j"] * np.sign(gradient.value)
    assert of_joint == pytest.approx(slope, rel=0.03)
