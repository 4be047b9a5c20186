# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters checked where they enter, each refusal one sentence."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from numbers import Real
from typing import Any


def check_number(
    name: str, value: Any, valid: Callable[[float], bool], allowed: str, *, unit: str = ""
) -> None:
    """Refuse what is no finite real number, or not in its range.

    Args:
        name: What the value is.
        value: The value; a truth value is no number.
        valid: Whether a finite number is in the range.
        allowed: The range in words.
        unit: Unit of the value.

    Raises:
        ValueError: The value is refused.
    """
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not (is_number and math.isfinite(value) and valid(float(value))):
        shown = f"{value} {unit}".rstrip() if is_number else repr(value)
        raise ValueError(f"{name} is {shown}; it must be {allowed}.")


def check_kind_of(name: str, value: Any, good: bool, wanted: str) -> None:
    """Refuse a value that is not what it should be.

    Raises:
        ValueError: ``good`` is false.
    """
    if not good:
        raise ValueError(f"{name} is {value!r}; it must be {wanted}.")


def check_count(name: str, value: Any, least: int, allowed: str) -> None:
    """Refuse what is no whole number of at least ``least``.

    Raises:
        ValueError: The value is refused.
    """
    try:
        whole = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        whole = None
    if whole is None or whole < least:
        raise ValueError(f"{name} is {value!r}; {allowed}.")
