# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated arguments: good values, and what nobody should pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from datetime import date
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from generated_input import CAMPAIGN
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from hypothesis.strategies import SearchStrategy


class OwnError(Exception):
    """What a function of the user's own raises; it is passed on as it is."""


class _Unprintable:
    def __repr__(self) -> str:
        raise OwnError


class _ManyLines:
    def __repr__(self) -> str:
        return "line\nline\tline\x00" * 100


class _NoNumber(float):
    def __float__(self) -> float:
        raise OwnError


def shared(inputs: settings, doors: int) -> settings:
    """Inputs of a door that in ``make test`` shares them with others that are much alike.

    Args:
        inputs: What it would get alone, as in the campaign.
        doors: Number of the doors that share.
    """
    if settings().max_examples >= CAMPAIGN:
        return inputs
    return settings(max_examples=max(inputs.max_examples // doors, 1))


def returning(value: Any) -> Callable[..., Any]:
    """A function that gives the same whatever it gets."""

    def give(*_: Any, **__: Any) -> Any:
        return value

    return give


def raising(*_: Any, **__: Any) -> Any:
    """A function that fails."""
    raise OwnError


def passed_on(call: Callable[[], Any]) -> Callable[[], Any]:
    """A call that gives None where a function of the user's own has failed."""

    def called() -> Any:
        try:
            return call()
        except OwnError:
            return None

    return called


# Numbers at and beyond the ends of what computers and bodies know.
EXTREMES = (
    0, -0.0, 1, -1, 2**31, 2**63, -(2**63), 10**400, 10**5000, 0.5, 1.5, 1e-30, 1e30, 1e150, -1e150,
    1e300, 1.7e308, 5e-324, 1e-300, -1e300, math.nan, math.inf, -math.inf,
)  # fmt: skip

ODD = (
    None, True, False, 1j, complex(math.nan, 0.0), "", " ", "x", "1.0", "nan", "xyz", "xx", "base",
    "\x00", "a\nb", "\ud800", "x" * 5000, b"", b"x", bytearray(b"1"), [], (), {}, set(), [None],
    [[]], [1.0, [2.0]], [math.nan] * 3, [1, 2], [1, 2, 3], (1.0, 0.0), (1.0, 0.0, 0.0), ["base"],
    [1j, 0, 0], ["1", "2", "3"], [True, False, True], {"base": 1.0}, {1: 2}, {"": None}, object(),
    OwnError, math, Ellipsis, NotImplemented, range(3), slice(3), date(2020, 1, 1),
    Decimal("1.5"), Fraction(1, 3), Path("x"), Path("/"), iter(()), np.float32(1.5), np.int8(3),
    np.float64(math.nan), np.bool_(True), np.str_("x"), np.datetime64("NaT"), np.complex128(1j),
    np.array(1.0), np.array([]), np.zeros((0, 3)), np.ones(3), np.ones((3, 3)), np.eye(2),
    np.ones((2, 3, 4)), np.array([None, 1]), np.array(["a"]), np.array([1j]), np.arange(5000.0),
    np.ma.masked, np.array([math.inf, 0.0, 0.0]), memoryview(b"12"), _Unprintable(), _ManyLines(),
    _NoNumber(1.0), raising, returning(None),
)  # fmt: skip


def _one_of(values: Sequence[Any]) -> SearchStrategy[Any]:
    """One of some values, by number: Hypothesis prints what it draws from, and some cannot be."""
    return st.integers(0, len(values) - 1).map(values.__getitem__)


def _containers(inner: SearchStrategy[Any]) -> SearchStrategy[Any]:
    short = st.lists(inner, max_size=4)
    keys = st.text(max_size=3)
    return short | short.map(tuple) | st.dictionaries(keys, inner, max_size=2)


_ARRAYS = npst.arrays(
    st.sampled_from(["f8", "f4", "i8", "u1", "?", "c16", "U3"]),
    npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)
_SCALARS = st.one_of(
    _one_of(EXTREMES),
    _one_of(ODD),
    st.floats(),
    st.integers(),
    st.text(max_size=8),
    st.binary(max_size=8),
    st.complex_numbers(),
)

JUNK: SearchStrategy[Any] = st.one_of(
    _one_of(EXTREMES),
    _one_of(ODD),
    _SCALARS,
    st.recursive(_SCALARS, _containers, max_leaves=6),
    _ARRAYS,
    _SCALARS.map(returning),
)


def numbers(*typical: float) -> SearchStrategy[Any]:
    """Typical numbers of a parameter, now and then an extreme or any other one."""
    good = st.sampled_from([*typical, *map(np.float64, typical)])
    odd = _one_of(EXTREMES) | st.floats(min_value=0.0, allow_infinity=False)
    return st.integers(0, 7).flatmap(lambda roll: odd if roll == 0 else good)


@st.composite
def arguments(
    draw: Any,
    needed: dict[str, SearchStrategy[Any]],
    optional: dict[str, SearchStrategy[Any]] | None = None,
    junk: SearchStrategy[Any] = JUNK,
) -> dict[str, Any]:
    """Keyword arguments, up to two of them junk.

    Args:
        draw: From Hypothesis.
        needed: Good values of the parameters that must be given.
        optional: Those of the others, each left out in half of the cases.
        junk: What the others are drawn from.
    """
    optional = optional or {}
    names = [*needed, *(name for name in optional if draw(st.booleans()))]
    spoiled = []
    if names:
        count = draw(st.sampled_from([0, 0, 0, 1, 1, 1, 2]))
        spoiled = [draw(st.sampled_from(names)) for _ in range(count)]
    good = {**needed, **optional}
    return {name: draw(junk if name in spoiled else good[name]) for name in names}
