# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""How bad input of a public door is written down: the door, and one row for each kind of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class Row(NamedTuple):
    """One bad input.

    Attributes:
        kind: what is wrong with it, as in "not a number".
        given: the input as the reader would write it in Python.
        call: hands it to the door.
    """

    kind: str
    given: str
    call: Callable[[], object]


class Door(NamedTuple):
    """A public class or function that takes parameters.

    Attributes:
        title: its name.
        error: type of the refusal.
        rows: bad inputs.
    """

    title: str
    error: type[Exception]
    rows: tuple[Row, ...]


# What is wrong with a number, a name, a function or a choice, whatever it stands for.
NO_NUMBER = {
    "text": "'1.0'",
    "nothing": "None",
    "not a number": "math.nan",
    "infinite": "math.inf",
    "of no size": "1e300",
    "complex": "1j",
    "truth value": "True",
    "list": "[1.0]",
}
NO_COUNT = {
    "text": "'1'",
    "nothing": "None",
    "not a number": "math.nan",
    "not whole": "1.5",
    "complex": "1j",
    "truth value": "True",
    "of no size": "10**400",
}
NO_NAME = {"number": "7", "nothing": "None", "list": "['base']"}
NO_VECTOR = {
    "text": "'down'",
    "number": "-9.81",
    "empty": "()",
    "too short": "(1.0,)",
    "too long": "(0, 0, 0, 1)",
    "not a number": "(0.0, 0.0, math.nan)",
    "infinite": "(0.0, 0.0, math.inf)",
    "complex": "(0.0, 0.0, 1j)",
    "nested": "[[0.0, 0.0, 1.0]]",
}
NO_FUNCTION = {"number": "2.0", "text": "'sin'", "list": "[0.0, 1.0]"}
NO_CHOICE = {"unknown": "'other'", "empty": "''", "number": "1", "nothing": "None", "list": "[]"}
NO_FLAG = {"text": "'yes'", "number": "1", "nothing": "None"}
NO_LIST = {"text": "'base'", "number": "1", "nothing": "None"}


def door(
    call: str,
    good: dict[str, str],
    bad: dict[str, dict[str, str]],
    names: Callable[[], dict[str, Any]],
    *,
    together: dict[str, str] | None = None,
    error: type[Exception] = ValueError,
    title: str = "",
) -> Door:
    """A door with a row for each bad argument, the others as they should be.

    Args:
        call: what is called, as in ``dj.Elastic``.
        good: arguments that are taken, in Python.
        bad: for each parameter what is wrong and a value of that kind, in Python.
        names: gives what the Python refers to.
        together: what is wrong with arguments that do not go together, and these arguments.
        error: type of the refusal.
        title: name of the door; what is called, without ``dj.``, unless given.
    """
    rows = [
        _row(call, good, kind, {name: value}, names)
        for name, values in bad.items()
        for kind, value in values.items()
    ]
    for kind, text in (together or {}).items():
        given = dict(part.split("=", 1) for part in text.split("; "))
        rows.append(_row(call, good, kind, given, names))
    return Door(title or call.removeprefix("dj."), error, tuple(rows))


def _row(
    call: str,
    good: dict[str, str],
    kind: str,
    given: dict[str, str],
    names: Callable[[], dict[str, Any]],
) -> Row:
    text = ", ".join(f"{name}={value}" for name, value in given.items())
    every = ", ".join(f"{name}={value}" for name, value in {**good, **given}.items())
    return Row(kind, text, lambda: eval(f"{call}({every})", names()))


def without(values: dict[str, str], *kinds: str, **more: str) -> dict[str, str]:
    """Kinds of bad values without some, and with others; ``_`` in their names is a blank."""
    left = {kind: value for kind, value in values.items() if kind not in kinds}
    return left | {kind.replace("_", " "): value for kind, value in more.items()}
