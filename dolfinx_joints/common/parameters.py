# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of values that annotations cannot declare; each error is one sentence."""

from __future__ import annotations

import math
import operator
import re
import stat
from collections.abc import Callable, Collection, Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats

# Control characters, writing directions and surrogates; texts that a spreadsheet reads as formulas.
_CONTROL = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
_FORMULA = re.compile(r"\s*[=+@-](?!(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$|inf$|$)", re.I)
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")

PLAIN_NAMES = "visible characters and spaces between them, without '/', not only dots"

LONGEST_SHOWN = 80  # characters of a value in a message


def printable(text: str) -> str:
    """Return a text for a terminal, with control characters replaced by spaces."""
    return _CONTROL.sub(" ", text)


def cell(value: Any) -> Any:
    """Return a value for a CSV file; quote a text that a spreadsheet would read as a formula."""
    text = printable(value) if isinstance(value, str) else ""
    return f"'{text}" if _FORMULA.match(text) else text or value


def shown(value: Any, say: Callable[[Any], str] = repr) -> str:
    """Return a value as text for a message, one line of at most `LONGEST_SHOWN` characters.

    Args:
        value: Any object, even if its conversion to text fails.
        say: Function that converts the value to text.
    """
    try:
        text = say(value)
    except Exception:  # user-defined classes may raise anything, and an int of 5000 digits fails
        text = f"a value of type {type(value).__name__}"
    text = _ADDRESS.sub("", text)  # addresses differ between ranks
    text = "".join(c if c.isprintable() else " " for c in " ".join(text.split()))
    cut = LONGEST_SHOWN // 2
    return text if len(text) <= LONGEST_SHOWN else f"{text[:cut]}...{text[-cut + 3 :]}"


def check_number(
    name: str, value: Any, valid: Callable[[float], bool], allowed: str, *, unit: str = ""
) -> None:
    """Raise a ValueError unless a value is a finite number in its range."""
    number = real(value)
    if not (math.isfinite(number) and valid(number)):
        given = shown(value) if math.isnan(number) else f"{shown(value, str)} {unit}".rstrip()
        raise ValueError(f"{name} is {given}; it must be {allowed}.")


def real(value: Any) -> float:
    """Return a value as a float, NaN if it is not a number; bool is not a number here."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    return float(value)


def check_kind_of(name: str, value: Any, good: bool, wanted: str) -> None:
    """Raise a ValueError that states the value and what is wanted, unless ``good`` is true."""
    if not good:
        raise ValueError(f"{name} is {shown(value)}; it must be {wanted}.")


def check_named(name: str, value: Any, wanted: str) -> None:
    """Raise a ValueError unless a value is a mapping whose keys are texts."""
    named = isinstance(value, Mapping) and all(isinstance(key, str) for key in value)
    check_kind_of(name, value, named, wanted)


def offers(value: Any, *methods: str) -> bool:
    """Return True if an object has these methods; return False for a class."""
    return not isinstance(value, type) and all(
        callable(getattr(value, name, None)) for name in methods
    )


def check_choice(name: str, value: Any, choices: Collection[str]) -> None:
    """Raise a ValueError unless a value is one of the choices."""
    good = isinstance(value, str) and value in choices
    check_kind_of(name, value, good, f"one of {', '.join(choices)}")


def is_plain_name(text: str) -> bool:
    """Return True if a name is one of the `PLAIN_NAMES`, which can be part of a path in a file."""
    inner = text.strip(". ") and text == text.strip() and "/" not in text
    return bool(inner) and text.isprintable()


def check_file(path: Path, missing: str, error: type[Exception] = ValueError) -> None:
    """Check that a file exists and can be read.

    Args:
        path: The file.
        missing: Message of the error for a file that does not exist.
        error: Type of the error.
    """
    try:
        exists = stat.S_ISREG(path.stat().st_mode)
        if exists:
            with path.open("rb") as file:
                file.read(1)
    except (FileNotFoundError, NotADirectoryError):
        exists = False
    except OSError as failure:
        raise error(f"{path} cannot be read: {failure.strerror}.") from None
    if not exists:
        raise error(missing)


def check_vector(name: str, value: Any, sizes: Collection[int]) -> Floats:
    """Return a vector of finite numbers, of one of the ``sizes``, or raise a ValueError."""
    vector = numbers_of(value)
    counts = " or ".join(str(size) for size in sizes)
    if vector is None or vector.ndim != 1 or len(vector) not in sizes or not finite(vector):
        raise ValueError(f"{name} is {shown(value)}; it must be {counts} finite numbers.")
    return vector


def number_at(name: str, function: Callable[[float], Any], time: float, *, unit: str = "") -> float:
    """Return a function's finite value at a time [s], or raise a ValueError with its name."""
    value = function(time)
    if isinstance(value, float) and math.isfinite(value):  # fast path: called for every load
        return float(value)
    number = numbers_of(value)
    if number is None or number.shape != () or not finite(number):
        given = shown(value) if number is None else f"{shown(value, str)} {unit}".rstrip()
        raise ValueError(f"{name} at t = {time:g} s is {given}; it must be a finite number.")
    return float(number)


def check_each(
    name: str, given: Any, count: int, *, negative: bool = True, one: bool = True
) -> Floats:
    """Return a function's values at points, one finite number each, shape (count,).

    ``given`` is the function's result; with ``one`` it may be a single number for all points. A
    ValueError is raised for anything else.
    """
    values = numbers_of(given)
    fits = values is not None and values.shape in (((), (count,)) if one else ((count,),))
    if values is None or not (fits and finite(values) and (negative or (values >= 0.0).all())):
        returned = shown(given) if values is None else f"an array of shape {values.shape}"
        if fits and values is not None and values.size:
            returned += f" from {values.min():g} to {values.max():g}"
        wanted = "one finite number" if negative else "one finite number of zero or more"
        raise ValueError(
            f"{name} is {returned}; it must be {wanted} for each of the {count} points."
        )
    return np.broadcast_to(values, count).astype(np.float64)


def finite(values: Floats) -> bool:
    """Return True if all numbers are finite."""
    return bool(np.isfinite(values).all())


def numbers_of(value: Any) -> Floats | None:
    """Return real numbers as an array of any shape, None for anything else.

    Truth values, texts and complex numbers are not real numbers here.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":
            kinds = {type(item) for item in array.ravel()}
            if not all(issubclass(k, Real) and not issubclass(k, bool) for k in kinds):
                return None
        elif array.dtype.kind not in "iuf":
            return None
        return array.astype(np.float64)
    except Exception:  # user-defined sequences may raise anything
        return None


def whole_number(value: Any) -> int | None:
    """Return a value as an int, None if it is not a whole number; bool is not one here."""
    try:
        return None if isinstance(value, bool | np.bool_) else operator.index(value)
    except TypeError:
        return None


def check_count(name: str, value: Any, least: int, allowed: str) -> int:
    """Return a value as an int of at least ``least``, or raise a ValueError."""
    whole = whole_number(value)
    if whole is None or whole < least:
        raise ValueError(f"{name} is {shown(value)}; {allowed}.")
    return whole
