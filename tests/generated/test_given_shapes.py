# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated shapes of dams. Whatever is taken has finite points and is thick everywhere."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from generated_input import answer, cheap
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, numbers, passed_on, shared

from geometry.arch import ArchDam, mid_crest
from geometry.gravity_dam import PINE_FLAT_FACES, GravitySection, battered_section
from geometry.section_table import SectionTable

AMBIESTA = {field.name: getattr(ArchDam(), field.name) for field in fields(ArchDam)}
SHAPE = {name: numbers(value, 0.9 * value) for name, value in AMBIESTA.items()}


def check_arch(made: ArchDam | None) -> None:
    """The points of the faces are finite, and the crest is above the base."""
    if made is not None:
        s, zeta = np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 1.0, 5)[:, None]
        assert all(np.isfinite(made.point(s, ta, zeta)).all() for ta in (0.0, 1.0))
        assert mid_crest(made)[2] > 0.0


@shared(cheap(), 4)
@given(given=arguments({}, SHAPE))
def test_arch_dams(given: dict[str, Any]) -> None:
    check_arch(answer("ArchDam", passed_on(lambda: ArchDam(**given))))


@shared(cheap(), 4)
@given(
    length=numbers(145.0, 100.0) | JUNK,
    given=arguments({}, {name: each for name, each in SHAPE.items() if name != "crest_half_chord"}),
)
def test_arch_dams_of_crests(length: Any, given: dict[str, Any]) -> None:
    made = answer("ArchDam.of_crest", passed_on(lambda: ArchDam.of_crest(length, **given)))
    check_arch(made)
    if made is not None:
        assert np.isclose(made.crest_length, length, rtol=1e-9)


@shared(cheap(), 4)
@given(parameters=JUNK)
def test_crests_of_junk(parameters: Any) -> None:
    made = answer("mid_crest", passed_on(lambda: mid_crest(parameters)))
    assert (made is not None) == (parameters is None)


def check_section(made: GravitySection | None) -> None:
    """The section is thick from the base to the crest."""
    if made is not None:
        assert made.thickness(made.levels).min() > 0.0
        assert np.isfinite(made.area)
        assert made.area > 0.0


STEPS = st.lists(st.tuples(st.floats(0.1, 50.0), st.floats(-20.0, 20.0)), min_size=1, max_size=3)


@st.composite
def faces(draw: Any, start: float) -> Any:
    """A face that rises from 0 at x = start, now and then to 100 m."""
    rise = np.cumsum([(0.0, start), *draw(STEPS)], axis=0)
    if draw(st.booleans()):
        rise[:, 0] *= 100.0 / rise[-1, 0]
    return draw(st.sampled_from((tuple, list, np.array)))(rise.tolist())


@shared(cheap(), 4)
@given(given=arguments({"upstream": faces(0.0), "downstream": faces(50.0)}))
def test_gravity_sections(given: dict[str, Any]) -> None:
    check_section(answer("GravitySection", passed_on(lambda: GravitySection(**given))))


@shared(cheap(), 4)
@given(given=arguments({name: numbers(value) for name, value in PINE_FLAT_FACES.items()}))
def test_battered_sections(given: dict[str, Any]) -> None:
    check_section(answer("battered_section", passed_on(lambda: battered_section(**given))))


COLUMNS = {
    "elevation": [200.0, 215.0, 235.0],
    "extrados_radius": [60.0, 68.0, 80.0],
    "crown_thickness": [9.0, 7.5, 6.0],
    "left_angle": [15.0, 28.0, 38.0],
    "right_angle": [20.0, 33.0, 45.0],
    "left_thickness": [10.0, 8.0, 6.5],
    "right_thickness": [9.5, 8.0, 6.5],
}


@st.composite
def column(draw: Any, values: list[float]) -> Any:
    """The values of a column, or others, or another number of them."""
    if draw(st.integers(0, 9)) > 0:
        return np.array(values)
    of = numbers(*values)
    given = draw(st.tuples(*[of] * 3) | st.lists(of, max_size=4))
    return draw(st.sampled_from((list, np.array)))(given)


@shared(cheap(), 4)
@given(
    data=st.data(),
    left_out=st.sampled_from((*[None] * 8, *COLUMNS)),
    added=st.sampled_from((*[None] * 8, "colour", "", "elevation ")),
    whole=st.none() | st.none() | st.none() | JUNK,
)
def test_section_tables(data: st.DataObject, left_out: Any, added: Any, whole: Any) -> None:
    columns = data.draw(arguments({name: column(values) for name, values in COLUMNS.items()}))
    columns.pop(left_out, None)
    if added is not None:
        columns[added] = np.ones(3)
    given = columns if whole is None else whole
    made = answer("SectionTable", passed_on(lambda: SectionTable(given)))
    if made is not None:
        for side in (-1, 1):
            half = made.half(side)
            s, zeta = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 5)[:, None]
            assert (half.thickness(zeta, s) > 0.0).all()
            assert all(np.isfinite(half.point(s, ta, zeta)).all() for ta in (0.0, 1.0))
