# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cracks followed through peak load and falling branch: double cantilever, beam with a notch."""

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import box
from test_cohesive_joints import cantilever, cohesive

import dolfinx_joints as dj

YOUNG, ENERGY = 30e9, 100.0


def curve(model, values, quantity):
    """Return the load factors at values of a quantity; energies must balance to 1e-10."""
    simulation = dj.Simulation(model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # openings are large for the cells
        dj.controlled_statics(simulation, values, loads=model.loads, quantity=quantity)
    states = [stage.state for stage in simulation.stages]
    assert max(state.energy.relative_error for state in states) < 1e-10
    return np.array([state.load_factor for state in states])


def load_of_cantilever(cells, openings):
    """Return the loads P [N/m] of the double cantilever of `test_cohesive_joints`."""
    law = cohesive(
        normal_stiffness=3e12,
        shear_stiffness=1e12,
        tensile_strength=1.5e6,
        cohesion=5e6,
        fracture_energy=ENERGY,
        shear_fracture_energy=500.0,
    )
    arms = zip(("upper", "lower"), (1e5, -1e5), strict=True)
    loads = [dj.Traction(group=arm, value=(0.0, value)) for arm, value in arms]  # P = 10 kN/m
    model = cantilever(law, YOUNG, 0.1, [], loads=loads, cells=cells)
    mouth = dj.ControlledDisplacement(along=(0.0, 1.0), place="upper", relative_to="lower")
    return 1e4 * curve(model, openings, mouth)


def test_double_cantilever_beam():
    """Falling branch within 1 % of beams with G_I = P^2 a^2 / (E I), and G_I from its area.

    With d = 2 P a^3 / (3 E I), P = sqrt((2/3) G_I^(3/2) (E I)^(1/2) / d) while the crack grows. G_I
    is also the area under the curve less the elastic energy, divided by the change of a(P, d). The
    peak is below sqrt(G_I E I) / a, because the process zone is longer than the arms are high.
    """
    bending = YOUNG * 0.1**3 / 12.0
    openings = np.array([1.0, *np.arange(20.0, 81.0, 2.0)]) * 1e-4
    loads = load_of_cantilever(80, openings)
    lengths = (1.5 * bending * openings / loads) ** (1.0 / 3.0)
    peak = int(np.argmax(loads))
    sharp = np.sqrt(ENERGY * bending) / lengths[0]
    assert 0.9 * sharp < loads[peak] < sharp
    falling = slice(peak + 2, None)
    exact = np.sqrt(2.0 / 3.0 * ENERGY**1.5 * np.sqrt(bending) / openings[falling])
    np.testing.assert_allclose(loads[falling], exact, rtol=0.01)
    work = np.trapezoid(loads[falling], openings[falling])
    elastic = 0.5 * loads * openings
    released = work - (elastic[-1] - elastic[peak + 2])
    assert released / (lengths[-1] - lengths[peak + 2]) == pytest.approx(ENERGY, rel=0.01)
    # Cells of half the size change the peak by less than 1 %.
    coarse = load_of_cantilever(40, openings[openings < 6.1e-3])
    assert coarse.max() == pytest.approx(loads[peak], rel=0.01)


def notched_beam(half, down):
    """Return a beam of depth 1 m and span 4 m with a joint at midspan, cracked to mid-depth.

    The process zone, about 0.88 E G / f^2, has a length of 100 mm; the cells there have 12.5 mm.
    """
    strength = np.sqrt(0.88 * YOUNG * ENERGY / 0.1)
    law = cohesive(
        normal_stiffness=3e13,
        shear_stiffness=1e13,
        tensile_strength=strength,
        cohesion=4.0 * strength,
        fracture_energy=ENERGY,
        shear_fracture_energy=20.0 * ENERGY,
    )

    def graded(x):
        part = 0.5 * x[:, 0] - 1.0
        return np.column_stack([2.0 + 2.0 * part * (0.15 + 0.85 * part**2), x[:, 1:]])

    jointed = box(
        (4.0, 1.0),
        (half, down),
        joints={"joint": (0, 2.0)},
        groups={"top": lambda x: np.isclose(x[1], 1.0) & (np.abs(x[0] - 2.0) < 4.1 / half)},
        place=graded,
        comm=MPI.COMM_SELF,
    )
    ends = (0.0, "xy"), (4.0, "y")
    length = 2.0 * (graded(np.array([[2.0 + 4.0 / half, 1.0]]))[0, 0] - 2.0)
    crack = {"joint": lambda x: np.where(x[:, 1] < 0.5 - 1e-9, 1e-9, 0.0)}
    return dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=0.0),
        joints=dj.Joints(law, initial_gaps=crack),
        supports=[dj.Fixed(point=(x, 0.0), components=axes) for x, axes in ends],
        loads=[dj.Traction(group="top", value=(0.0, -1.0 / length))],  # 1 N per metre
        body=dj.Body(degree=2, plane="stress"),
    )


def test_load_against_mouth_opening_of_a_notched_beam():
    """Falling branch within 1.5 % of the curve of linear fracture mechanics for a span of 4 depths.

    With A = a/W and S = 3 P S / (2 W^2), per metre of width, Srawley (1976, Int. J. Fracture 12)
    has the stress intensity factor within 0.5 %, and Tada, Paris and Irwin (1973) have the mouth
    opening 4 S a V(A) / E within 1 %. The crack grows at a stress intensity of (E G_I)^(1/2).
    """
    mouths = np.array([0.2, 0.5, 1.4, 2.0, 2.4, 2.8, 3.2, 3.6, 4.0, 4.5]) * 1e-4
    model = notched_beam(40, 80)
    gap = dj.ControlledGap(joint="joint", point=(2.0, 0.0))
    loads = curve(model, mouths + 1e-9, gap)
    a = np.linspace(0.5, 0.9, 4001)
    shape = 1.99 - a * (1.0 - a) * (2.15 - 3.93 * a + 2.7 * a**2)
    shape *= 3.0 * np.sqrt(a) / (2.0 * (1.0 + 2.0 * a) * (1.0 - a) ** 1.5)
    load = np.sqrt(YOUNG * ENERGY) / (4.0 * shape)
    v = 0.76 - 2.28 * a + 3.87 * a**2 - 2.04 * a**3 + 0.66 / (1.0 - a) ** 2
    opening = 4.0 * (6.0 * load) * a / YOUNG * v
    np.testing.assert_allclose(loads[:2], mouths[:2] * load[0] / opening[0], rtol=0.01)
    falling = slice(4, None)
    np.testing.assert_allclose(
        loads[falling], np.interp(mouths[falling], opening, load), rtol=0.015
    )
    # The process zone, a fifth of the ligament, lowers the peak by about a tenth.
    assert 0.85 < loads.max() / load[0] < 0.95
