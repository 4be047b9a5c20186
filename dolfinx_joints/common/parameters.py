# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values checked where a declaration does not reach: each error is one sentence."""

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

# Escapes, directions of writing, parts of characters; beginnings of formulas that are no numbers.
_CONTROL = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
_FORMULA = re.compile(r"\s*[=+@-](?!(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$|inf$|$)", re.I)
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")

PLAIN_NAMES = "visible characters and spaces between them, without '/', not dots alone"

# Of a value in a message.
LONGEST_SHOWN = 80


def printable(text: str) -> str:
    """Return a text from a file for a terminal: control characters become spaces."""
    return _CONTROL.sub(" ", text)


def cell(value: Any) -> Any:
    """Return a value for a CSV file: no text begins as a formula of a spreadsheet."""
    text = printable(value) if isinstance(value, str) else ""
    return f"'{text}" if _FORMULA.match(text) else text or value


def shown(value: Any, say: Callable[[Any], str] = repr) -> str:
    """A value for a message: one line, not longer than a reader wants.

    Args:
        value: Anything, also what cannot be printed.
        say: How it is printed where it can be.
    """
    try:
        text = say(value)
    except Exception:  # what a class that is user-defined may do, or an int of 5000 digits
        text = f"a value of type {type(value).__name__}"
    text = _ADDRESS.sub("", text)  # other on every rank
    text = "".join(c if c.isprintable() else " " for c in " ".join(text.split()))
    cut = LONGEST_SHOWN // 2
    return text if len(text) <= LONGEST_SHOWN else f"{text[:cut]}...{text[-cut + 3 :]}"


def check_number(
    name: str, value: Any, valid: Callable[[float], bool], allowed: str, *, unit: str = ""
) -> None:
    """Check that a value is a finite number in its range.

    Raises:
        ValueError: It is not.
    """
    number = real(value)
    if not (math.isfinite(number) and valid(number)):
        given = shown(value) if math.isnan(number) else f"{shown(value, str)} {unit}".rstrip()
        raise ValueError(f"{name} is {given}; it must be {allowed}.")


def real(value: Any) -> float:
    """A value as a number, NaN if it is none, as truth values and texts."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    return float(value)


def check_kind_of(name: str, value: Any, good: bool, wanted: str) -> None:
    """Check that a value is what it should be.

    Raises:
        ValueError: ``good`` is false.
    """
    if not good:
        raise ValueError(f"{name} is {shown(value)}; it must be {wanted}.")


def check_named(name: str, value: Any, wanted: str) -> None:
    """Check that a value is a mapping whose keys are names.

    Raises:
        ValueError: It is not.
    """
    named = isinstance(value, Mapping) and all(isinstance(each, str) for each in value)
    check_kind_of(name, value, named, wanted)


def offers(value: Any, *methods: str) -> bool:
    """Whether a value has some methods; a class in the place of an object has none."""
    return not isinstance(value, type) and all(
        callable(getattr(value, name, None)) for name in methods
    )


def check_choice(name: str, value: Any, known: Collection[str]) -> None:
    """Check that a value is one of the names of an option.

    Raises:
        ValueError: It is not.
    """
    good = isinstance(value, str) and value in known
    check_kind_of(name, value, good, f"one of {', '.join(known)}")


def is_plain_name(text: str) -> bool:
    """Whether a name is one of the `PLAIN_NAMES`, which can be a part of a path in a file."""
    inner = text.strip(". ") and text == text.strip() and "/" not in text
    return bool(inner) and text.isprintable()


def check_file(path: Path, missing: str, error: type[Exception] = ValueError) -> None:
    """Check that a file is there and can be read.

    Args:
        path: The file.
        missing: What is said where there is none.
        error: What is raised.
    """
    try:
        there = stat.S_ISREG(path.stat().st_mode)
        if there:
            with path.open("rb") as file:
                file.read(1)
    except (FileNotFoundError, NotADirectoryError):
        there = False
    except OSError as failure:
        raise error(f"{path} cannot be read: {failure.strerror}.") from None
    if not there:
        raise error(missing)


def check_vector(name: str, value: Any, sizes: Collection[int]) -> Floats:
    """Finite real numbers, as many as one of ``sizes`` says.

    Raises:
        ValueError: It is not.
    """
    vector = numbers_of(value)
    counts = " or ".join(str(size) for size in sizes)
    if vector is None or vector.ndim != 1 or len(vector) not in sizes or not finite(vector):
        raise ValueError(f"{name} is {shown(value)}; it must be {counts} finite numbers.")
    return vector


def number_at(name: str, function: Callable[[float], Any], time: float, *, unit: str = "") -> float:
    """The finite number that a function gives at a time [s], or a ValueError that has its name."""
    value = function(time)
    if isinstance(value, float) and math.isfinite(value):  # of each load in each step
        return float(value)
    number = numbers_of(value)
    if number is None or number.shape != () or not finite(number):
        given = shown(value) if number is None else f"{shown(value, str)} {unit}".rstrip()
        raise ValueError(f"{name} at t = {time:g} s is {given}; it must be a finite number.")
    return float(number)


def check_each(
    name: str, given: Any, count: int, *, negative: bool = True, one: bool = True
) -> Floats:
    """The values of a function of points, a finite number for each, shape (count,).

    ``given`` is what it has given, or where ``one`` number for all will do, this.

    Raises:
        ValueError: It is something else.
    """
    values = numbers_of(given)
    fits = values is not None and values.shape in (((), (count,)) if one else ((count,),))
    if values is None or not (fits and finite(values) and (negative or (values >= 0.0).all())):
        said = shown(given) if values is None else f"an array of shape {values.shape}"
        if fits and values is not None and values.size:
            said += f" from {values.min():g} to {values.max():g}"
        wanted = "one finite number" if negative else "one finite number of zero or more"
        raise ValueError(f"{name} gave {said}; for {count} points it must give {wanted} for each.")
    return np.broadcast_to(values, count).astype(np.float64)


def finite(values: Floats) -> bool:
    """Whether all numbers are finite."""
    return bool(np.isfinite(values).all())


def numbers_of(value: Any) -> Floats | None:
    """An array of any shape of what are real numbers throughout, None of anything else.

    Truth values, texts and complex numbers are none.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":
            kinds = {type(each) for each in array.ravel()}
            if not all(issubclass(k, Real) and not issubclass(k, bool) for k in kinds):
                return None
        elif array.dtype.kind not in "iuf":
            return None
        return array.astype(np.float64)
    except Exception:  # sequences that is user-defined may raise anything
        return None


def whole_number(value: Any) -> int | None:
    """Return a value as a whole number, None if it is none, as truth values."""
    try:
        return None if isinstance(value, bool | np.bool_) else operator.index(value)
    except TypeError:
        return None


def check_count(name: str, value: Any, least: int, allowed: str) -> int:
    """The value as a whole number of ``least`` or more.

    Raises:
        ValueError: It is none.
    """
    whole = whole_number(value)
    if whole is None or whole < least:
        raise ValueError(f"{name} is {shown(value)}; {allowed}.")
    return whole
