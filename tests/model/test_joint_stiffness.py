# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Proposed joint stiffnesses: numbers by hand, and their bounds against exact and computed modes.

Chain: a fixed-free bar of n equal blocks of length L, each with a joint in its middle,

    |--[ block | joint | block ]--[ block | joint | block ]-- ... free

A cell has the transfer matrix R(kL/2) S R(kL/2), R the rotation of (u, N/(E k)) and S the joint's
jump, half of its trace is cos kL - E k/(2 k_n) sin kL. Symmetric cells have the modes
sin((2 m - 1) pi j/(2 n)) at their ends, so the wave number k of mode m solves

    cos((2 m - 1) pi/(2 n)) = cos kL - E k/(2 k_n) sin kL,      omega = k sqrt(E/rho).
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from dolfinx_joints import FrictionNoTension
from dolfinx_joints.model.joint_stiffness import (
    LARGEST_RATIO,
    StiffnessProposal,
    propose_stiffness,
)

CONCRETE = {"young": 25.92e9, "poisson": 0.2}
DAM = {**CONCRETE, "block_size": 12.0, "pressure": 3e6}


def root(function, low, high):
    """Zero of a function that changes its sign once."""
    sign = function(low) > 0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (function(middle) > 0) == sign else (low, middle)
    return 0.5 * (low + high)


def chain_drop(count, ratio):
    """omega_joint/omega_tied of the first mode of a chain; ratio is E/(k_n L)."""
    level = math.cos(math.pi / (2 * count))
    tied = math.pi / (2 * count)
    kl = root(lambda x: math.cos(x) - 0.5 * ratio * x * math.sin(x) - level, 1e-9, 1.001 * tied)
    return kl / tied


# --- numbers by hand ------------------------------------------------------------------------------


def test_numbers_by_hand():
    # G = 25.92e9/2.4 = 10.8e9, M = 2 G 0.8/0.6 = 28.8e9 Pa; k_n = 28.8e9/(0.01 x 12) = 2.4e11,
    # above 3e6/1e-4 = 3e10; k_s = 2.4e11 x 10.8/28.8 = 9e10; overlap 3e6/2.4e11 = 12.5e-6 m.
    found = propose_stiffness(**DAM, friction_angle_deg=45.0, element_size=1.2)
    assert found.normal_stiffness == pytest.approx(2.4e11, rel=1e-14)
    assert found.shear_stiffness == pytest.approx(9e10, rel=1e-14)
    assert found.added_compliance == pytest.approx(0.01, rel=1e-14)
    assert found.overlap == pytest.approx(12.5e-6, rel=1e-14)
    assert found.elastic_slip == pytest.approx(3e6 / 9e10, rel=1e-14)
    assert found.frequency_shift == pytest.approx(0.005, rel=1e-14)
    assert found.stiffness_ratio == pytest.approx(2.4e11 * 1.2 / 25.92e9, rel=1e-14)
    assert found.governed_by == "the added compliance"


def test_overlap_governs_under_high_pressure():
    # 3e6/1e-6 = 3e12 Pa/m.
    found = propose_stiffness(**DAM, overlap=1e-6)
    assert found.normal_stiffness == pytest.approx(3e12, rel=1e-14)
    assert found.overlap == pytest.approx(1e-6, rel=1e-14)
    assert found.added_compliance < 0.01
    assert found.governed_by == "the overlap"


@pytest.mark.parametrize("poisson", [-0.5, 0.0, 0.2, 0.45])
@pytest.mark.parametrize("pressure", [0.0, 1e5, 1e8])
def test_bounds_are_kept_and_one_is_reached(poisson, pressure):
    found = propose_stiffness(
        young=1e9, poisson=poisson, block_size=2.0, pressure=pressure, overlap=1e-3
    )
    used = found.added_compliance / 0.01, found.overlap / 1e-3
    assert max(used) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("poisson", [-0.5, 0.0, 0.2, 0.45])
def test_moduli_bound_the_energy_of_every_stress(poisson):
    # The bound that the derivation rests on, sigma:S:sigma >= t_n^2/M + |t_s|^2/G, for random
    # stresses, and reached without strain along the plane: sigma_n (1, nu/(1-nu), nu/(1-nu)).
    found = propose_stiffness(young=1.0, poisson=poisson, block_size=1.0, pressure=0.0)
    oedometric, shear = 0.01 * found.normal_stiffness, 0.01 * found.shear_stiffness

    def excess(stress):
        trace = np.trace(stress)
        energy = (1 + poisson) * np.sum(stress * stress) - poisson * trace**2
        return energy - stress[0, 0] ** 2 / oedometric - np.sum(stress[0, 1:] ** 2) / shear

    rng = np.random.default_rng(1)
    for _ in range(200):
        a = rng.normal(size=(3, 3))
        assert excess(a + a.T) > -1e-12
    side = poisson / (1 - poisson)
    assert excess(np.diag([1.0, side, side])) == pytest.approx(0.0, abs=1e-14)


def test_law():
    found = propose_stiffness(**DAM)
    law = FrictionNoTension(
        normal_stiffness=found.normal_stiffness,
        shear_stiffness=found.shear_stiffness,
        friction_angle_deg=30.0,
    )
    assert found.law(30.0) == law
    assert propose_stiffness(**DAM, friction_angle_deg=30.0).law() == law
    with pytest.raises(ValueError, match="no friction angle"):
        found.law()


def test_report():
    text = propose_stiffness(**DAM, friction_angle_deg=45.0, element_size=1.2).report()
    assert text.splitlines() == [
        "k_n = 2.4e+11 Pa/m, k_s = 9e+10 Pa/m (the added compliance governs)",
        "closed joints 12 m apart add about 1 % to the compliance of the blocks",
        "the first frequency drops by at most about 0.5 %",
        "overlap 0.0125 mm at 3 MPa",
        "elastic slip up to 0.0333 mm before sliding",
        "k_n h/E = 11.1",
    ]
    plain = propose_stiffness(**DAM).report()
    assert "slip" not in plain
    assert "h/E" not in plain


def test_report_warns_of_lost_digits():
    # k_n h/E = 1e8 times 2.2e-16.
    usual = propose_stiffness(**DAM, element_size=1.0)
    stiff = replace(usual, normal_stiffness=1e8 * CONCRETE["young"], governed_by="")
    assert "relative rounding errors of 2e-08 or more" in stiff.report()
    assert "governs" not in stiff.report()
    assert "rounding" not in usual.report()
    assert usual.stiffness_ratio < LARGEST_RATIO < stiff.stiffness_ratio


def test_a_friction_angle_out_of_range():
    with pytest.raises(ValueError, match="friction_angle_deg is 90"):
        propose_stiffness(**{**DAM, "friction_angle_deg": 90.0})


# --- exact frequencies in one dimension -----------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 5, 40])
@pytest.mark.parametrize("added", [1e-3, 0.01, 0.1, 1.0])
def test_chain_of_bars(count, added):
    # nu = 0, so that M = E. Series in epsilon: epsilon/2 for any number of blocks (sums of sigma^2
    # over the middles of the blocks equal its integral), less a term of second order.
    found = propose_stiffness(
        young=1e9, poisson=0.0, block_size=1.0, pressure=0.0, added_compliance=added
    )
    drop = 1.0 - chain_drop(count, 1e9 / found.normal_stiffness)
    assert 0.0 < drop <= found.frequency_shift
    assert drop == pytest.approx(found.frequency_shift, rel=added)


def on_a_joint(added, share):
    """Proposals for a body of unit height on a joint, L the height and a share of it."""
    whole = propose_stiffness(
        young=1.0, poisson=0.0, block_size=1.0, pressure=0.0, added_compliance=added
    )
    return whole, replace(whole, block_size=share)


@pytest.mark.parametrize("added", [1e-3, 0.01, 0.1])
def test_column_on_a_joint_at_its_foot(added):
    # k H tan k H = k_n H/E, tied k H = pi/2. Not the height, a third of it is the block size.
    whole, third = on_a_joint(added, 1 / 3)
    kh = root(lambda x: x * math.sin(x) - whole.normal_stiffness * math.cos(x), 0.1, math.pi / 2)
    assert whole.frequency_shift < 1.0 - kh / (math.pi / 2) <= third.frequency_shift


@pytest.mark.parametrize("added", [1e-3, 0.01, 0.1])
def test_cantilever_on_a_joint_at_its_foot(added):
    # phi = a (cosh - cos) + b sinh + c sin of beta x; at the foot E phi'' = k_n phi', the other end
    # free; tied, beta = 1.8751. omega goes with beta^2.
    whole, fifth = on_a_joint(added, 1 / 5)

    def determinant(b):
        k, ch, sh = whole.normal_stiffness, math.cosh(b), math.sinh(b)
        co, si = math.cos(b), math.sin(b)
        return np.linalg.det([[2 * b, -k, -k], [ch + co, sh, -si], [sh - si, ch, -co]])

    drop = 1.0 - (root(determinant, 0.1, 1.8752) / 1.875104068711961) ** 2
    assert whole.frequency_shift < drop <= fifth.frequency_shift


# --- modes of bodies ------------------------------------------------------------------------------


@pytest.fixture
def frequencies(read):
    """``frequencies(path, groups, proposal)``: modes of a clamped body, its system; or tied."""
    pytest.importorskip("dolfinx")
    pytest.importorskip("slepc4py")
    from dolfinx_joints import Elastic, Fixed, Model, modes

    def make(path, groups, proposal=None):
        system = Model(
            read(path, joints=[] if proposal is None else None),
            material=Elastic(**CONCRETE, density=2400.0),
            joints=None if proposal is None else proposal.law(30.0),
            supports=[Fixed(group=name) for name in groups],
        ).system()
        found = modes(system, 2)
        return found.frequencies, system, found.shapes

    return make


WALL = {"length": 8.0, "thickness": 1.0, "height": 4.0, "divisions": (8, 1, 4)}
HELD = [["x_min", "x_max"], ["x_min"], ["base"]]
ADDED = [1.0, 0.1, 0.01]


def check_shift(frequencies, path, groups, block_size):
    """The measured drop of two modes stays within the bound; their drops."""
    tied, *_ = frequencies(path, groups)
    drops = []
    for added in ADDED:
        proposal = propose_stiffness(
            **CONCRETE, block_size=block_size, pressure=0.0, added_compliance=added
        )
        drop = 1.0 - frequencies(path, groups, proposal)[0] / tied
        assert np.all(drop > 0.0)
        assert np.all(drop <= proposal.frequency_shift)
        drops.append(drop / proposal.frequency_shift)
    return np.array(drops)


@pytest.mark.mpi
@pytest.mark.parametrize("held", HELD, ids=["beam", "cantilever", "wall"])
@pytest.mark.parametrize(("cell", "order"), [("hex", 1), ("tet", 2)])
def test_shift_of_a_jointed_wall(frequencies, wall_file, held, cell, order):
    # Four blocks of 2 m. Bending of beam and cantilever strains every joint.
    drops = check_shift(frequencies, wall_file(**WALL, cell=cell, order=order), held, 2.0)
    if held != ["base"]:
        assert drops.min() > 0.1


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), [(c, o) for c in ("hex", "tet") for o in (1, 2)])
def test_stiff_joints_tie_the_body(frequencies, wall_file, cell, order):
    # The drop is omega^2 times a multiple of 1/k: a tenth for joints ten times as stiff, but for
    # terms of higher order and of the corners of the joints, of 3 % at the first step. At the end
    # 1.6e-6 and 1.4e-5 are the most that was measured. The rule ``nodal``, without points at the
    # vertices of 6-node triangles, leaves 7e-4 and 6e-3 there at any stiffness.
    path = wall_file(**WALL, cell=cell, order=order)
    tied, *_ = frequencies(path, ["base"])
    drops = []
    for k in (1e12, 1e13, 1e14):
        own = StiffnessProposal(
            normal_stiffness=k, shear_stiffness=k, **CONCRETE, block_size=2.0, pressure=0.0
        )
        drops.append(1.0 - frequencies(path, ["base"], own)[0] / tied)
        assert np.all((drops[-1] > 0.0) & (drops[-1] <= own.frequency_shift))
    np.testing.assert_allclose(drops[0] / drops[1], 10.0, rtol=0.1)
    np.testing.assert_allclose(drops[1] / drops[2], 10.0, rtol=0.02)
    assert np.all(drops[2] < [2e-6, 2e-5])


def test_own_values_are_judged():
    # Added compliance of k_n = 1e11, k_s = 4e10 Pa/m, blocks of 12 m: 28.8e9/1.2e12 = 2.4 %,
    # 10.8e9/4.8e11 = 2.25 %.
    own = StiffnessProposal(normal_stiffness=1e11, shear_stiffness=4e10, **DAM)
    assert own.added_compliance == pytest.approx(0.024, rel=1e-12)
    assert own.frequency_shift == pytest.approx(0.012, rel=1e-12)
    assert replace(own, normal_stiffness=1e8).frequency_shift == 1.0  # 24 times as soft
