# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frequencies of Koyna and Pine Flat: published values, convergence, tied joints, bodies in space.

Expected: what others computed (sources in `studies.gravity_dams`), Rayleigh's principle, limits.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("slepc4py")
pytest.importorskip("gmsh")

from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.geometry.gravity_dam import GravitySection
from studies import damping_ratios, gravity_dams
from studies.gravity_dams import (
    ABAQUS_KOYNA,
    ASSUMED,
    CHOPRA_PINE_FLAT,
    GORAI_KOYNA,
    INFLUENCES,
    PUBLISHED,
    SAMII_PINE_FLAT,
    WATERS,
    build,
    frequencies,
    waves,
    with_water,
)

pytestmark = pytest.mark.mpi


@pytest.mark.parametrize("name", PUBLISHED)
def test_published(name):
    # Elements that are not ours, reservoirs of compressible water, and for Pine Flat the formula
    # for all dams of its kind: 2 % is what they differ by.
    published = PUBLISHED[name]
    found = frequencies(published.dam, size=8.0, count=len(published.frequencies))
    np.testing.assert_allclose(found, published.frequencies, rtol=0.02)


@pytest.mark.parametrize("dam", [ABAQUS_KOYNA, CHOPRA_PINE_FLAT], ids=["koyna", "pine_flat"])
def test_convergence_from_above(dam):
    # Rayleigh: a stiffer set of shapes gives higher frequencies. Errors of linear cells fall with
    # the square of their size; quadratic cells of twice the size are nearer to the limit.
    linear = [frequencies(dam, size=size, order=1)[0] for size in (16.0, 8.0, 4.0)]
    quadratic = [frequencies(dam, size=size)[0] for size in (16.0, 8.0)]
    assert linear[0] > linear[1] > linear[2] > quadratic[0] > quadratic[1]
    errors = np.array(linear) - quadratic[1]
    assert 1.7 < np.log2(errors[1] / errors[2]) < 2.3


def test_tied_joints_are_no_joints():
    # The mesh has a row of nodes at the neck either way. A joint's compliance lowers the
    # frequency in proportion: ten times as stiff, a tenth of the difference.
    def first(stiffness):
        law = dj.FrictionNoTension(
            normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=45.0
        )
        model = build(replace(ABAQUS_KOYNA, joints={"neck": 66.5}), size=12.0, law=law)
        return dj.modes(model.system(), 1).frequencies[0]

    monolith = frequencies(ABAQUS_KOYNA, size=12.0)[0]
    soft, stiff = (1 - first(k) / monolith for k in (1e13, 1e14))
    assert 0 < stiff < 1e-5
    assert soft / stiff == pytest.approx(10.0, rel=0.01)


def test_constrained_sides_are_plane_strain():
    # Shapes that do not vary across the valley are among those of the body in space. On rectangles
    # all rules of quadrature integrate alike, so the two agree to rounding.
    wall = GravitySection(
        upstream=((0.0, 0.0), (60.0, 0.0)), downstream=((0.0, 20.0), (60.0, 20.0))
    )
    plane = replace(ABAQUS_KOYNA, section=wall, plane="strain")
    solid = replace(plane, width=12.0, constrained_sides=("front", "back"))
    found, expected = (frequencies(dam, size=15.0)[0] for dam in (solid, plane))
    assert found == pytest.approx(expected, rel=1e-9)


def test_unconstrained_sides_are_between():
    # Stiffer than plane stress, which lets the body thin everywhere as it wants, and softer than
    # plane strain, which constrains its sides.
    half = INFLUENCES["Pine Flat, empty"]["in space, sides unconstrained"]
    free = frequencies(half, size=15.0)[0]
    stress = frequencies(CHOPRA_PINE_FLAT, size=15.0)[0]
    strain = frequencies(replace(CHOPRA_PINE_FLAT, plane="strain"), size=15.0)[0]
    assert stress < free < strain


def test_water_lowers_frequencies():
    levels = [None, 60.0, 94.0, 105.0]
    found = [frequencies(replace(CHOPRA_PINE_FLAT, water=w), size=15.0)[0] for w in levels]
    assert found == sorted(found, reverse=True)
    # Measured on the dam itself 1/0.288 and 1/0.306 Hz: its modulus drops out of their ratio.
    assert found[3] / found[2] == pytest.approx(0.288 / 0.306, rel=0.01)


def test_kinds_of_water():
    # Westergaard's formula is heavier than incompressible water wherever a face moves more than its
    # neighbours below; below its own lowest frequency a reservoir with sound is heavier than one
    # without. Published with compressible water: 2.5267 Hz (Samii, Lotfi 2007).
    parabola, still, sound = (
        with_water(SAMII_PINE_FLAT, kind, {"size": 12.0, "order": 2}) for kind in WATERS
    )
    assert parabola < sound < still < frequencies(replace(SAMII_PINE_FLAT, water=None), size=12.0)
    assert sound == pytest.approx(2.5267, rel=0.02)


def test_what_may_stand_behind_the_period_of_koyna_with_water():
    # Published 1 / 0.393 Hz with compressible water. Plane stress and a wall at 103 m, the length
    # that is told of the reservoir, are needed both.
    cells = {"size": 8.0, "order": 2}
    found = {what: with_water(dam, "compressible", cells) * 0.393 for what, dam in ASSUMED.items()}
    alone = ("plane stress", "reservoir of 103 m up to a wall")
    assert found["plane strain, endless reservoir"] > 1.04
    assert all(1.015 < found[what] < 1.03 for what in alone)
    assert found["plane stress, wall at 103 m"] == pytest.approx(1.0, abs=2e-3)


def test_the_crest_resonates_where_the_added_mass_has_the_mode():
    # Two ways to compressible water: waves among the unknowns, thirty depths of them, and the mass
    # of an endless reservoir at its own frequency. Steps of 5 mHz.
    model = build(replace(GORAI_KOYNA, water=None), size=8.0, reservoir=waves(1.0))
    frequencies = np.arange(2.63, 2.70, 0.005)
    found = dj.frequency_response(
        model, frequencies, points={"crest": (0.0, 103.0)}, hysteretic_ratio=0.005
    )
    peak = frequencies[np.argmax(np.abs(found.acceleration("crest")[:, 0]))]
    expected = with_water(GORAI_KOYNA, "compressible", {"size": 8.0, "order": 2})
    assert peak == pytest.approx(expected, abs=0.006)


def test_damping_ratios_of_modes():
    # In proportion to the frequency, or to its inverse; printed with two digits.
    rows = [line.split() for line in damping_ratios.table(size=12.0).splitlines()[1:]]
    by_stiffness, by_mass, rayleigh, modal, beyond = np.array(rows, dtype=float)[:, 2:].T
    frequencies = np.array(rows, dtype=float)[:, 1]
    np.testing.assert_allclose(by_stiffness, 5.0 * frequencies / frequencies[0], atol=0.1)
    np.testing.assert_allclose(by_mass, 5.0 * frequencies[0] / frequencies, atol=0.01)
    assert rayleigh[0] == rayleigh[3] == 5.0
    np.testing.assert_array_equal(modal, [5.0] * 4 + [0.0] * 4)
    np.testing.assert_array_equal(beyond[:4], 5.0)
    np.testing.assert_allclose(beyond[4:], 5.0 * frequencies[4:] / frequencies[3], atol=0.1)


@pytest.mark.slow
def test_command(capsys):
    gravity_dams.main(["--quick"])
    printed = capsys.readouterr().out
    if MPI.COMM_WORLD.rank == 0:
        for name in PUBLISHED:
            assert printed.count(name) >= 3
        assert "plane strain" in printed
        for kind in WATERS:
            assert printed.count(kind) >= 4
