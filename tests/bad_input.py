# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""How bad input of a public door is written down: the door, and one row for each kind of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


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
