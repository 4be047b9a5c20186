# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad parameters of every kind at every door: type and form of the refusal, and their page."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_input import Door
from bad_parameters import DOORS, page, refusal

import dolfinx_joints as dj
from dolfinx_joints.common.parameters import check_number


@pytest.mark.parametrize("door", DOORS, ids=[door.title for door in DOORS])
def test_refused_in_one_sentence_of_the_packages_own(door: Door) -> None:
    for row in door.rows:
        kind, sentence = refusal(row)
        assert kind is not None, f"{row.given} is taken without a word"
        assert issubclass(kind, door.error), (row.given, kind, sentence)
        assert sentence.endswith("."), (row.given, sentence)
        assert not sentence.endswith(".."), (row.given, sentence)
        assert sentence.isprintable(), (row.given, sentence)
        assert len(sentence) < 300, (row.given, sentence)


def test_no_row_stands_twice() -> None:
    assert len({door.title for door in DOORS}) == len(DOORS)
    for door in DOORS:
        given = [row.given for row in door.rows]
        assert len(set(given)) == len(given), door.title


def test_the_page_says_what_the_doors_say() -> None:
    written = Path(__file__).parents[1] / "docs" / "bad_parameters.md"
    assert written.read_text(encoding="utf-8") == page()


OTHERS = [Fraction(10**10, 3), 2**63, np.float32(1e9), np.int64(1e11), np.int8(3)]


@pytest.mark.parametrize("value", OTHERS, ids=lambda value: type(value).__name__)
def test_numbers_of_other_kinds_become_floats(value: Any) -> None:
    # In arrays they would be Python objects, compute in single precision, or wrap around.
    law = dj.KeyedJoint(normal_stiffness=value, shear_stiffness=0)
    assert type(law.normal_stiffness) is float
    assert law.normal_stiffness == float(value)
    assert type(law.shear_stiffness) is int
    assert type(dj.Motion(acceleration=np.zeros((2, 3)), dt=value).dt) is float
    factors = dj.stiffness_proportional(ratio=0.05, frequency=value)
    assert factors == dj.stiffness_proportional(ratio=0.05, frequency=float(value))


def test_a_function_names_the_kind_of_a_number() -> None:
    with pytest.raises(ValueError, match=r"^gap is 1 of type numpy\.int8; give it as a float, 1"):
        check_number("gap", np.int8(1), lambda value: value > 0, "positive")
