# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drucker-Prager at a point, against the strength of Mohr-Coulomb and its own definition."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import DruckerPrager, Elastic
from dolfinx_joints.materials.bulk_law import BulkState, BulkStatus

ROCK = Elastic(young=1e9, poisson=0.2, density=2600.0)
C, PHI = 1e5, 30.0
MATRIX = ROCK.stiffness_matrix()
TRACE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
FITS = ("compression", "extension", "plane strain")
KINDS = [(fit, *angles) for fit in FITS for angles in ((30.0, 10.0), (30.0, 0.0), (30.0, None))]
KINDS += [("compression", 0.0, None)]


def law_of(fit="compression", friction=PHI, dilatancy=None, cohesion=C):
    return DruckerPrager(
        elastic=ROCK,
        cohesion=cohesion,
        friction_angle_deg=friction,
        dilatancy_angle_deg=dilatancy,
        fit=fit,
    )


def strains(count, size, seed=0):
    """Random strains, with as much change of volume as of shape."""
    rng = np.random.default_rng(seed)
    return size * (rng.normal(size=(count, 6)) + rng.normal(size=(count, 1)) * TRACE)


def at_rest(strain):
    return BulkState.elastic(strain, MATRIX, np.zeros((len(strain), 7)))


def plastic_strain(state):
    return state.internal[:, :6]


def stress_of(state):
    return (state.strain - plastic_strain(state)) @ MATRIX


def energy(state):
    return 0.5 * np.einsum("ni,ni->n", state.strain - plastic_strain(state), stress_of(state))


def test_strength_in_triaxial_tests_is_that_of_mohr_coulomb():
    # sigma_1 = N sigma_3 + 2 c sqrt(N), pressures, N = (1 + sin phi)/(1 - sin phi); in compression
    # one pressure is sigma_1, in extension two are.
    n = (1 + math.sin(math.radians(PHI))) / (1 - math.sin(math.radians(PHI)))
    for sideways in (0.0, 2e5, 3e6):
        largest = n * sideways + 2 * C * math.sqrt(n)
        for fit, pressures in (
            ("compression", [sideways, sideways, largest]),
            ("extension", [largest, largest, sideways]),
        ):
            stress = -np.array([[*pressures, 0.0, 0.0, 0.0]])
            assert abs(law_of(fit).yield_function(stress)[0]) < 1e-12 * largest


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("method", ["backward_euler", "discrete_gradient"])
def test_hydrostatic_tension_ends_at_the_apex(fit, method):
    # The apex of Mohr-Coulomb's pyramid, c cot(phi), which every fit shares.
    answer = getattr(law_of(fit, dilatancy=10.0), method)(
        1e-2 * TRACE[None], at_rest(np.zeros((1, 6)))
    )
    apex = C / math.tan(math.radians(PHI))
    assert answer.status[0] == BulkStatus.APEX
    np.testing.assert_allclose(answer.stress[0], apex * TRACE, rtol=1e-12)
    np.testing.assert_allclose(stress_of(answer.state)[0], apex * TRACE, rtol=1e-9)
    np.testing.assert_array_equal(answer.tangent, 0.0)


@pytest.mark.parametrize(("fit", "friction", "dilatancy"), KINDS)
@pytest.mark.parametrize("method", ["backward_euler", "discrete_gradient"])
def test_stresses_are_admissible_and_tangents_consistent(fit, friction, dilatancy, method):
    # Differences of the stress; all three statuses occur where there is an apex.
    law = law_of(fit, friction, dilatancy)
    state, strain, h = at_rest(strains(200, 1e-4)), strains(200, 1e-3, 1), 1e-8
    ask = getattr(law, method)
    answer = ask(strain, state)
    assert set(answer.status) >= ({1, 2} if friction else {1})
    for stress in (answer.stress, stress_of(answer.state)):
        assert law.yield_function(stress).max() < 1e-12 * np.abs(stress).max()
    for j in range(6):
        change = h * np.eye(6)[j]
        slope = (ask(strain + change, state).stress - ask(strain - change, state).stress) / (2 * h)
        np.testing.assert_allclose(answer.tangent[:, :, j], slope, atol=1e-7 * ROCK.young)
    # Stress and energy of the new state belong to its plastic strain.
    acting = stress_of(answer.state)
    size = np.abs(acting).max()
    np.testing.assert_allclose(answer.state.stress, acting, atol=1e-9 * size)
    np.testing.assert_allclose(answer.state.energy, energy(answer.state), rtol=1e-9)
    if method == "backward_euler":
        np.testing.assert_allclose(answer.stress, acting, atol=1e-9 * size)


def test_tangent_is_unsymmetric_without_associated_flow():
    state, strain = at_rest(np.zeros((50, 6))), strains(50, 1e-3)
    for dilatancy, symmetric in ((None, True), (5.0, False)):
        answer = law_of(dilatancy=dilatancy).backward_euler(strain, state)
        cone = answer.tangent[answer.status == BulkStatus.YIELD]
        skew = np.abs(cone - cone.transpose(0, 2, 1)).max(axis=(1, 2)) / ROCK.young
        assert np.all(skew < 1e-12) if symmetric else np.all(skew > 1e-2)


@pytest.mark.parametrize(("fit", "friction", "dilatancy"), KINDS)
def test_flow_follows_its_potential(fit, friction, dilatancy):
    # Of sqrt(J2) + beta I1: the trace of the plastic strain is 3 beta dg, the norm of its deviator
    # dg / sqrt(2); the deviator has the direction of that of the stress.
    law = law_of(fit, friction, dilatancy)
    answer = law.backward_euler(strains(200, 1e-3), at_rest(np.zeros((200, 6))))
    cone = answer.status == BulkStatus.YIELD
    grown = plastic_strain(answer.state)[cone]
    volume = grown[:, :3].sum(axis=1)
    shape = (grown - volume[:, None] / 3.0 * TRACE) * [1, 1, 1, 0.5, 0.5, 0.5]
    size = np.sqrt((shape**2) @ [1, 1, 1, 2, 2, 2])
    np.testing.assert_allclose(volume, 3.0 * math.sqrt(2.0) * law.dilatancy * size, atol=1e-15)
    stress = answer.stress[cone]
    deviator = stress - stress[:, :3].sum(axis=1)[:, None] / 3.0 * TRACE
    length = np.sqrt((deviator**2) @ [1, 1, 1, 2, 2, 2])
    np.testing.assert_allclose(shape / size[:, None], deviator / length[:, None], atol=1e-9)


def test_below_the_limit_nothing_but_elasticity():
    strain = strains(100, 1e-6)
    state = at_rest(np.zeros((100, 6)))
    for method, part in (("backward_euler", 1.0), ("discrete_gradient", 0.5)):
        answer = getattr(law_of(), method)(strain, state)
        np.testing.assert_array_equal(answer.status, BulkStatus.ELASTIC)
        np.testing.assert_array_equal(answer.stress, part * strain @ MATRIX)
        for zero in (plastic_strain(answer.state), answer.dissipation, answer.state.internal[:, 6]):
            np.testing.assert_array_equal(zero, 0.0)


@pytest.mark.parametrize(("fit", "friction", "dilatancy"), KINDS)
def test_a_long_path_never_gains_energy(fit, friction, dilatancy):
    # Work of the step's stress = change of stored energy + dissipation, and the latter is no gain.
    law, count = law_of(fit, friction, dilatancy), 20
    state = at_rest(np.zeros((count, 6)))
    yielded = 0
    for k in range(60):
        strain = state.strain + strains(count, 2e-4, seed=k)
        answer = law.discrete_gradient(strain, state)
        work = np.einsum("ni,ni->n", answer.stress, strain - state.strain)
        stored = energy(answer.state) - energy(state)
        np.testing.assert_allclose(work, stored + answer.dissipation, atol=1e-11 * C)
        assert answer.dissipation.min() >= 0.0
        assert np.all(answer.state.internal[:, 6] >= state.internal[:, 6])
        yielded += np.count_nonzero(answer.status)
        state = answer.state
    assert yielded > 100


@pytest.mark.parametrize(("fit", "friction", "dilatancy"), KINDS)
def test_flow_at_the_end_point_dissipates(fit, friction, dilatancy):
    # Second law: the stress on the limit times the plastic strain that it makes.
    law = law_of(fit, friction, dilatancy)
    state = at_rest(strains(300, 1e-4))
    answer = law.backward_euler(strains(300, 1e-3, 2), state)
    assert np.einsum("ni,ni->n", answer.stress, plastic_strain(answer.state)).min() >= 0.0


def test_a_trial_changes_nothing_and_no_number_stays_none():
    state = at_rest(strains(5, 1e-4))
    kept = {name: value.copy() for name, value in vars(state).items()}
    strain = strains(5, 1e-2, 3)
    strain[2, 1] = math.nan
    for method in ("backward_euler", "discrete_gradient"):
        answer = getattr(law_of(), method)(strain, state)
        assert np.isnan(answer.stress[2]).any()
        assert np.isfinite(np.delete(answer.stress, 2, axis=0)).all()
    for name, value in vars(state).items():
        np.testing.assert_array_equal(value, kept[name])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"elastic": 3.0}, "elastic is 3.0; it must be an Elastic"),
        ({"cohesion": 0.0, "friction_angle_deg": 0.0}, "cohesion is 0 Pa; it must be positive"),
        ({"dilatancy_angle_deg": 31.0}, "at most the friction angle, 30 degrees"),
    ],
)
def test_parameters_that_contradict_each_other(changes, sentence):
    given = {"elastic": ROCK, "cohesion": C, "friction_angle_deg": PHI, **changes}
    with pytest.raises(ValueError, match=sentence):
        DruckerPrager(**given)
