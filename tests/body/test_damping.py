# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rayleigh's factors from ratios, and damping ratios of modes, against closed forms."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("slepc4py")


import dolfinx_joints as dj

pytestmark = pytest.mark.mpi

BAR = dj.Elastic(young=25e9, poisson=0.0, density=2400.0)
AXIAL = (dj.Fixed(group="base"), dj.Fixed(group="sides", components="xy"))


@pytest.mark.parametrize("frequencies", [(3.0, 12.0), (12.0, 3.0)])
@pytest.mark.parametrize("ratio", [0.05, (0.05, 0.05), (0.03, 0.06), (0.06, 0.02)])
def test_two_ratios_at_two_frequencies(ratio, frequencies):
    found = dj.rayleigh(ratio=ratio, frequencies=frequencies)
    expected = ratio if isinstance(ratio, tuple) else (ratio, ratio)
    assert [found.ratio(f) for f in frequencies] == pytest.approx(expected, rel=1e-14)


def test_one_factor_alone_at_the_bounds():
    # Ratios in proportion to the frequencies need K alone, in inverse proportion M alone.
    by_k = dj.rayleigh(ratio=(0.02, 0.06), frequencies=(4.0, 12.0))
    k = dj.stiffness_proportional(ratio=0.02, frequency=4.0)
    assert by_k.stiffness_factor == pytest.approx(k.stiffness_factor, rel=1e-14)
    assert by_k.mass_factor == pytest.approx(0.0, abs=1e-14)
    by_m = dj.rayleigh(ratio=(0.06, 0.02), frequencies=(4.0, 12.0))
    m = dj.mass_proportional(ratio=0.06, frequency=4.0)
    assert by_m.mass_factor == pytest.approx(m.mass_factor, rel=1e-14)
    assert by_m.stiffness_factor == pytest.approx(0.0, abs=1e-16)
    none = dj.rayleigh(ratio=0.0, frequencies=(4.0, 12.0))
    assert none == dj.Rayleigh()


@pytest.mark.parametrize(
    ("ratio", "frequencies", "words"),
    [
        ((0.06, 0.01), (4.0, 12.0), r"negative factor of K; .* between 0.3333 and 3 for these"),
        ((0.01, 0.04), (4.0, 12.0), r"negative factor of M; .* between 0.3333 and 3 for these"),
        (0.05, (4.0, 4.0), "Both frequencies are 4.0 Hz; they must differ"),
    ],
)
def test_ratios_that_are_refused(ratio, frequencies, words):
    with pytest.raises(ValueError, match=words):
        dj.rayleigh(ratio=ratio, frequencies=frequencies)


@pytest.fixture
def bar(blocks_file, read):
    """1 m x 1 m x 8 m, with the joint z = 4 m or without."""
    sizes = {"lower_height": 4.0, "upper_height": 4.0, "size": 1.0, "angle": 0.0}
    return lambda joints: read(blocks_file(order=2, **sizes), joints=joints)


def test_rayleigh_damping_does_not_couple(bar):
    damping = dj.rayleigh(ratio=(0.03, 0.05), frequencies=(60.0, 500.0))
    system = dj.Model(bar([]), material=BAR, supports=AXIAL, damping=damping).system()
    found = dj.modal_damping(system, dj.modes(system, 3))
    expected = [damping.ratio(f) for f in found.frequencies]
    np.testing.assert_allclose(found.ratios, expected, rtol=1e-8)
    assert found.coupling.max() < 1e-7
    assert "not classical" not in found.report()


def test_dashpot_on_the_end_of_a_bar(bar):
    """Modes sin((2 n - 1) pi z / 2 L), of mass rho A L / 2, and C = rho c A at the free end.

    ratio_n = (rho c A / (rho A L / 2)) / (2 omega_n) = 2 / ((2 n - 1) pi); one dashpot couples all.
    """
    supports = [*AXIAL, dj.ViscousBoundary(group="top")]
    system = dj.Model(bar([]), material=BAR, supports=supports).system()
    found = dj.modal_damping(system, dj.modes(system, 3))
    np.testing.assert_allclose(found.ratios, 2.0 / (np.pi * np.array([1, 3, 5])), rtol=2e-3)
    np.testing.assert_allclose(found.coupling + np.eye(3), 1.0, rtol=1e-6)
    lines = found.report().splitlines()
    assert lines[1].split()[0] == "1"
    assert lines[1].split()[2].startswith("63.")
    assert lines[-2] == "largest coupling by damping: 1, between modes 1 and 2"
    assert lines[-1] == "the damping is not classical: the modal damping ratios are approximate"


def test_two_masses_with_one_dashpot():
    """By hand: omega^2 = (3 -+ 5^.5) k / 2 m; the outer mass moves by g and 1/g of the inner's.

    g = (1 + 5^.5) / 2; a dashpot c on the outer mass damps c s / (2 m omega), where s is its share
    g^2 / (1 + g^2) of a mode, and 1 - s.
    """
    k, m, c, g = 400.0, 2.0, 0.3, (1.0 + math.sqrt(5.0)) / 2.0
    stiffness = k * np.array([[2.0, -1.0], [-1.0, 1.0]])
    system = dj.MatrixSystem.from_arrays(
        mass=m * np.eye(2), stiffness=stiffness, damping=np.diag([0.0, c])
    )
    found = dj.modal_damping(system, dj.modes(system, 2))
    omega = np.sqrt(0.5 * k / m * (3.0 + math.sqrt(5.0) * np.array([-1.0, 1.0])))
    share = g**2 / (1.0 + g**2)
    expected = c * np.array([share, 1.0 - share]) / (2.0 * m * omega)
    np.testing.assert_allclose(2.0 * np.pi * found.frequencies, omega, rtol=1e-9)
    np.testing.assert_allclose(found.ratios, expected, rtol=1e-9)
    np.testing.assert_allclose(found.coupling, [[0.0, 1.0], [1.0, 0.0]], atol=1e-9)


def test_without_damping(bar):
    system = dj.Model(bar([]), material=BAR, supports=AXIAL).system()
    found = dj.modal_damping(system, dj.modes(system, 2))  # nothing damps
    assert np.all(found.ratios == 0.0)
    assert np.all(found.coupling == 0.0)
    assert "coupling" not in found.report()
    assert len(found.report().splitlines()) == 3
