# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated parameters of materials, joint laws, their stiffness and damping.

What is taken must be of use: its matrices are finite, its reports can be printed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from generated_input import answer, cheap
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, numbers, passed_on, shared

import dolfinx_joints as dj

ELASTIC = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
ANGLE, STIFFNESS = numbers(0.0, 30.0, 45.0), numbers(1e9, 1e11)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)


def threes(*typical: float) -> Any:
    """Three numbers, in a list or a tuple."""
    three = st.tuples(*[numbers(*typical)] * 3)
    return three | three.map(list) | st.just(typical[:1] * 3) | st.just(np.full(3, typical[0]))


@shared(cheap(), 4)
@given(arguments({"young": STIFFNESS, "poisson": numbers(0.2), "density": numbers(2400.0, 0.0)}))
def test_elastic(given: dict[str, Any]) -> None:
    made = answer("Elastic", passed_on(lambda: dj.Elastic(**given)))
    if made is not None:
        assert not np.isnan(made.stiffness_matrix()).any()


@shared(cheap(), 4)
@given(
    arguments(
        {
            "young": threes(25e9, 20e9),
            "poisson": threes(0.2, 0.1),
            "shear": threes(1e10, 8e9),
            "density": numbers(2400.0),
        },
        {"axes": st.sampled_from([np.eye(3), [[0, 1, 0], [1, 0, 0], [0, 0, 2]]])},
    )
)
def test_orthotropic(given: dict[str, Any]) -> None:
    made = answer("Orthotropic", passed_on(lambda: dj.Orthotropic(**given)))
    if made is not None:
        assert np.isfinite(made.stiffness_matrix()).all()


@shared(cheap(), 4)
@given(
    arguments(
        {"elastic": st.just(ELASTIC), "cohesion": numbers(1e6), "friction_angle_deg": ANGLE},
        {
            "dilatancy_angle_deg": st.none() | numbers(0.0, 10.0),
            "fit": st.sampled_from(["compression", "extension", "plane strain"]),
        },
    )
)
def test_drucker_prager(given: dict[str, Any]) -> None:
    made = answer("DruckerPrager", passed_on(lambda: dj.DruckerPrager(**given)))
    if made is not None:
        assert np.isfinite([made.slope, made.dilatancy, made.strength]).all()


SHEAR = {"shear_stiffness": numbers(0.0, 4e10)}
LAWS: dict[str, tuple[Any, Any, Any]] = {
    "FrictionNoTension": (
        dj.FrictionNoTension,
        {"normal_stiffness": STIFFNESS, **SHEAR, "friction_angle_deg": ANGLE},
        {},
    ),
    "KeyedJoint": (dj.KeyedJoint, {"normal_stiffness": STIFFNESS, **SHEAR}, {}),
    "frictionless": (dj.frictionless, {"normal_stiffness": STIFFNESS}, {}),
    "RigidJoint": (dj.RigidJoint, {"friction_angle_deg": ANGLE}, {"stiffness_ratio": numbers(2.0)}),
    "ViscousJoint": (
        dj.ViscousJoint,
        {"law": st.just(LAW)},
        {"normal_viscosity": numbers(1e6), "shear_viscosity": numbers(1e6)},
    ),
    "MohrCoulombJoint": (
        dj.MohrCoulombJoint,
        {"normal_stiffness": STIFFNESS, **SHEAR, "friction_angle_deg": ANGLE},
        {
            "cohesion": numbers(1e6),
            "tensile_strength": numbers(0.0, 1e5),
            "dilatancy_angle_deg": numbers(0.0, 5.0),
        },
    ),
}


@pytest.mark.parametrize("name", LAWS)
@shared(cheap(), len(LAWS))
@given(data=st.data())
def test_joint_laws(name: str, data: Any) -> None:
    kind, needed, optional = LAWS[name]
    given = data.draw(arguments(needed, optional))
    made = answer(name, passed_on(lambda: kind(**given)))
    if made is not None:
        assert not np.isnan(made.closed_stiffness()).any()


BODY = {
    "young": numbers(25e9),
    "poisson": numbers(0.2),
    "block_size": numbers(10.0),
    "pressure": numbers(0.0, 1e6),
}
SEEN = {"friction_angle_deg": st.none() | ANGLE, "element_size": st.none() | numbers(2.0)}


@shared(cheap(), 4)
@given(arguments(BODY, {**SEEN, "added_compliance": numbers(0.01), "overlap": numbers(1e-4)}))
def test_propose_stiffness(given: dict[str, Any]) -> None:
    made = answer("propose_stiffness", passed_on(lambda: dj.propose_stiffness(**given)))
    if made is not None:
        assert made.report()


@shared(cheap(), 4)
@given(arguments({"normal_stiffness": STIFFNESS, "shear_stiffness": STIFFNESS, **BODY}, SEEN))
def test_stiffness_proposal(given: dict[str, Any]) -> None:
    made = answer("StiffnessProposal", passed_on(lambda: dj.StiffnessProposal(**given)))
    if made is not None:
        assert made.report()


RATIO, FREQUENCY = numbers(0.0, 0.02, 0.05), numbers(1.0, 5.0)
DAMPING: dict[str, tuple[Any, Any, Any]] = {
    "Rayleigh": (
        dj.Rayleigh,
        {},
        {"mass_factor": numbers(0.1), "stiffness_factor": numbers(1e-3)},
    ),
    "stiffness_proportional": (
        dj.stiffness_proportional,
        {"ratio": RATIO, "frequency": FREQUENCY},
        {},
    ),
    "mass_proportional": (dj.mass_proportional, {"ratio": RATIO, "frequency": FREQUENCY}, {}),
    "rayleigh": (
        dj.rayleigh,
        {
            "ratio": RATIO | st.tuples(RATIO, RATIO),
            "frequencies": st.tuples(FREQUENCY, FREQUENCY) | st.just([1.0, 5.0]),
        },
        {},
    ),
}


@pytest.mark.parametrize("name", DAMPING)
@shared(cheap(), len(DAMPING))
@given(data=st.data(), at=FREQUENCY | JUNK)
def test_damping(name: str, data: Any, at: Any) -> None:
    kind, needed, optional = DAMPING[name]
    given = data.draw(arguments(needed, optional))
    made = answer(name, passed_on(lambda: kind(**given)))
    if made is not None:
        assert np.isfinite([made.mass_factor, made.stiffness_factor]).all()
        answer("Rayleigh.ratio", passed_on(lambda: made.ratio(at)))
