# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Objects whose representation is a short table, in text and in notebooks."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from dolfinx_joints.common.parameters import printable

_MOST_NAMES = 12
Rows = Iterable[tuple[str, object]]


class Summarised(ABC):
    """Object whose representation is its name and a row per fact.

    The summary needs no collective operation, so a single rank can show the object.
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


def names(items: Iterable[Any]) -> str:
    """Return names in a line, at most the first `_MOST_NAMES`."""
    texts = [str(name) for name in items]
    others = f" and {len(texts) - _MOST_NAMES} more" if len(texts) > _MOST_NAMES else ""
    return ", ".join(texts[:_MOST_NAMES]) + others


def number(count: int) -> str:
    """Return a whole number as text with narrow spaces between thousands."""
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
