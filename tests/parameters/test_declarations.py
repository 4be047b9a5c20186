# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""All declared parameters: bad values, derived from each declaration, raise; good ones build."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import is_dataclass
from importlib import import_module
from os import PathLike
from pkgutil import walk_packages
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import annotated_types as at
import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("hypothesis")

from hypothesis import given, settings
from hypothesis import strategies as st

import dolfinx_joints
from dolfinx_joints.common.declared import CHECKED, REQUIRED, Declaration, declarations

for module in walk_packages(dolfinx_joints.__path__, "dolfinx_joints."):
    if not module.name.endswith("__main__"):
        import_module(module.name)

TINY = 1e-9


SHAPES = (Literal, Sequence, tuple, Callable, PathLike)
KNOWN = (float, int, bool, str, *SHAPES)


def kinds_of(each: Declaration) -> list[Any]:
    """Alternatives of a declaration, None aside."""
    kinds = get_args(each.kind) if get_origin(each.kind) not in SHAPES else (each.kind,)
    return [kind for kind in kinds or (each.kind,) if kind is not NoneType]


def limits(each: Declaration, step: float) -> Iterator[float]:
    """Numbers on the wrong side of each bound, ``step`` beyond those that may be reached."""
    for bound in each.bounds:
        if isinstance(bound, at.Gt | at.Lt):
            yield bound.gt if isinstance(bound, at.Gt) else bound.lt
        elif isinstance(bound, at.Ge | at.Le):
            yield bound.ge - step if isinstance(bound, at.Ge) else bound.le + step


def bad_values(each: Declaration) -> list[Any]:
    """Values of a wrong kind, and numbers that are none or out of range."""
    kinds = kinds_of(each)
    if len(kinds) > 1:
        return [object()]
    kind, origin = kinds[0], get_origin(kinds[0]) or kinds[0]
    bad: list[Any] = [object(), *([] if each.optional else [None])]
    if kind is float:
        return [*bad, "1.0", True, 1j, math.nan, math.inf, *limits(each, TINY)]
    if kind is int:
        return [*bad, "1", 1.5, True, *map(round, limits(each, 1))]
    if origin in (Sequence, tuple) and set(get_args(kind)) <= {float, int, Ellipsis}:
        count = len(get_args(kind)) if origin is tuple and Ellipsis not in get_args(kind) else 3
        wrong = [math.nan, *limits(each, TINY)]
        return [*bad, "text", 1.0, *([value] * count for value in wrong)]
    return [*bad, "no such" if origin is Literal else 1.5]


def good_values(each: Declaration) -> st.SearchStrategy[Any]:
    """A strategy for what a declaration allows."""
    found = st.one_of(
        *(
            good_values_of(kind, each.bounds)
            for kind in kinds_of(each)
            if (get_origin(kind) or kind) in KNOWN
        )
    )
    return st.none() | found if each.optional else found


def good_values_of(kind: Any, bounds: tuple[Any, ...]) -> st.SearchStrategy[Any]:
    """Values of one kind within bounds."""
    kind = getattr(kind, "__value__", kind)  # of an alias that a ``type`` statement made
    lows = [b.gt if isinstance(b, at.Gt) else b.ge for b in bounds if isinstance(b, at.Gt | at.Ge)]
    highs = [b.lt if isinstance(b, at.Lt) else b.le for b in bounds if isinstance(b, at.Lt | at.Le)]
    low, high = max(lows, default=-1e9), min(highs, default=1e9)
    numbers = st.floats(
        low,
        high,
        exclude_min=any(isinstance(b, at.Gt) for b in bounds),
        exclude_max=any(isinstance(b, at.Lt) for b in bounds),
        allow_subnormal=False,
    )
    if kind is float:
        return numbers
    if kind is int:
        return st.integers(math.ceil(low), math.floor(high))
    simple = {bool: st.booleans(), str: st.just("name"), PathLike: st.just("file")}
    origin = get_origin(kind) or kind
    if origin in simple:
        return simple[origin]
    if origin is Literal:
        return st.sampled_from(get_args(kind))
    if origin is Callable:
        return st.just(abs)
    if origin is tuple and Ellipsis not in get_args(kind):
        return st.tuples(*(good_values_of(part, bounds) for part in get_args(kind)))
    least = next((b.min_length for b in bounds if isinstance(b, at.MinLen)), 0)
    most = next((b.max_length for b in bounds if isinstance(b, at.MaxLen)), least + 2)
    parts = get_args(get_args(kind)[0]) or get_args(kind)[:1]
    inner = numbers if float in parts else st.integers(1, 9) if int in parts else st.just("name")
    return st.lists(inner, min_size=least, max_size=most)


def a_good_value(each: Declaration) -> Any:
    """One of the good values."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # for interactive use, says hypothesis
        return good_values(each).example()


def arguments(of: Any, values: dict[str, Any]) -> dict[str, Any]:
    """Arguments that reach the checks: those declared, others None."""
    needed = [
        name
        for name, p in inspect.signature(of).parameters.items()
        if p.default is REQUIRED and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    return dict.fromkeys(needed) | values


CASES = [(of, each) for of in CHECKED for each in declarations(of)]
NAMES = [f"{of.__qualname__}.{each.name}" for of, each in CASES]


@pytest.mark.parametrize(("of", "each"), CASES, ids=NAMES)
def test_bad_values_raise_and_good_ones_do_not(of, each):
    @settings(max_examples=5, deadline=None, database=None, derandomize=True)
    @given(good_values(each))
    def accepted(value):
        each.check(value, of.__name__)

    accepted()
    for value in bad_values(each):
        with pytest.raises(ValueError, match=each.name) as error:
            each.check(value, of.__name__)
        assert str(error.value).endswith(f"it must be {each.allowed}.")


def complete(of: Any) -> bool:
    """Whether a dataclass is built from declared parameters alone."""
    names = {each.name for each in declarations(of)}
    return is_dataclass(of) and set(arguments(of, {})) <= names


@pytest.mark.parametrize("of", [of for of in CHECKED if complete(of)], ids=lambda of: of.__name__)
def test_declared_classes_build_or_say_what_contradicts(of):
    made = st.fixed_dictionaries({each.name: good_values(each) for each in declarations(of)})

    @settings(
        max_examples=20,
        deadline=None,
        database=None,
        derandomize=True,
    )
    @given(made)
    def builds(values):
        message = ""
        try:
            with np.errstate(all="ignore"):
                of(**values)
        except ValueError as error:
            message = str(error)
        own = [f"it must be {each.allowed}." for each in declarations(of)]
        assert not message.endswith(tuple(own))

    builds()


@pytest.mark.parametrize(("of", "each"), CASES, ids=NAMES)
def test_checks_run_before_anything_else(of, each):
    earlier = {}
    for other in declarations(of):
        if other.name == each.name:
            break
        if other.default is REQUIRED:
            earlier[other.name] = a_good_value(other)
    with pytest.raises(ValueError, match=f"^{of.__name__}: {each.name} is "):
        of(**arguments(of, {**earlier, each.name: object()}))
