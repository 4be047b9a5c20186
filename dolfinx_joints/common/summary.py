# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Objects that show themselves as a short table, in text and in notebooks."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from dolfinx_joints.common.parameters import printable

_MOST_NAMES = 12
Rows = Iterable[tuple[str, object]]


class Summarised(ABC):
    """An object whose representation is its name and a row per fact.

    Nothing is computed for it that several ranks would have to compute together: any rank may show
    an object by itself.
    """

    @abstractmethod
    def _summary(self) -> Rows:
        """Return facts by name; rows without a value are left out."""

    def _shown(self) -> list[tuple[str, str]]:
        rows = [(name, value) for name, value in self._summary() if value not in ("", None)]
        return [(printable(name), printable(str(value))) for name, value in rows]

    def __repr__(self) -> str:
        rows = self._shown()
        width = max((len(name) for name, _ in rows), default=0)
        lines = [f"  {name:<{width}}  {value}" for name, value in rows]
        return "\n".join([type(self).__name__, *lines])

    def _repr_html_(self) -> str:
        cells = "".join(
            f'<tr><th style="text-align: left">{html.escape(name)}</th>'
            f'<td style="text-align: left">{html.escape(value)}</td></tr>'
            for name, value in self._shown()
        )
        return f"<b>{html.escape(type(self).__name__)}</b><table>{cells}</table>"


def names(every: Iterable[Any]) -> str:
    """Names in a line, of many the first."""
    known = [str(name) for name in every]
    more = f" and {len(known) - _MOST_NAMES} more" if len(known) > _MOST_NAMES else ""
    return ", ".join(known[:_MOST_NAMES]) + more


def number(count: int) -> str:
    """A whole number with narrow spaces between thousands."""
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
