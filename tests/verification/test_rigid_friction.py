# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction work of rigid joints converges, to what is known or to the limit of stiff joints."""

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from benchmarks.rigid_friction import rigid, run, stiff, thrown_error
from benchmarks.shared.problems import blocks


def test_masses_that_strike_without_rebound():
    """Against their exact motion (`benchmarks.rigid_friction.Thrown`).

    The height of contact is off by up to half the way of a step, which is of first order; impulses
    and what they do are of second order.
    """
    errors = np.array([thrown_error(steps) for steps in (200, 400, 800, 1600)])
    displacement, friction, lost, ledger = errors.T
    assert ledger.max() < 1e-13
    assert np.all(displacement < 2.0 / np.array([200, 400, 800, 1600]))
    assert friction[0] < 1e-4
    assert friction[0] / friction[-1] > 8**1.8
    assert lost[0] < 1e-3
    assert lost[0] / lost[-1] > 8**1.8


def test_blocks_without_rebound():
    """To their own limit, in first order: 0.14 and 0.05 % of friction work, 0.8 and 0.4 % of u."""
    problem = blocks(end=2e-3, law=rigid(0), massless=False)
    a, b, c = (run(problem, dt) for dt in (1e-5, 5e-6, 2.5e-6))
    limit = 2.0 * c.displacement - b.displacement
    off = [np.linalg.norm(x.displacement - limit) / np.linalg.norm(limit) for x in (a, b, c)]
    assert off[0] < 1e-2
    assert off[1] / off[0] < 0.55
    assert off[2] / off[1] < 0.55
    assert b.friction == pytest.approx(2.0 * c.friction - b.friction, rel=2e-3)
    assert c.lost > 0.0
    assert max(x.ledger for x in (a, b, c)) < 1e-12


def test_points_that_touch_as_a_step_ends():
    """After 25 steps of 0.2 m/s through a gap of 0.1 mm, to rounding, as in steps a bit longer."""
    problem = blocks(end=2e-3, law=rigid(1), massless=False)
    touching, longer = run(problem, 2e-5), run(problem, 2.0000001e-5)
    assert touching.friction == pytest.approx(longer.friction, rel=1e-3)
    assert touching.ledger < 1e-12


def test_blocks_without_mass_at_the_joint():
    """Rigid in second order to the limit of joints ever stiffer; restitution does not matter."""
    problem = blocks(end=2e-3, law=rigid(1), massless=True)
    a, b, c = (run(problem, dt) for dt in (2e-5, 1e-5, 5e-6))
    change = [np.linalg.norm(x.displacement - y.displacement) for x, y in ((a, b), (b, c))]
    size = np.linalg.norm(c.displacement)
    assert change[1] < change[0] / 3.5
    assert change[1] < 1e-4 * size
    assert b.friction == pytest.approx(c.friction, rel=1e-3)
    stiffer = run(blocks(end=2e-3, law=stiff(1e13), massless=True), 2.5e-6)
    assert stiffer.friction == pytest.approx(c.friction, rel=1e-2)
    assert np.linalg.norm(stiffer.displacement - c.displacement) < 1e-3 * size
