# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers in figures and reports, converted to SI by the unit in their labels."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from itertools import pairwise
from typing import Any

import numpy as np

from dolfinx_joints.common.constants import STANDARD_GRAVITY

UNITS = {
    "-": 1.0,
    "%": 0.01,
    "s": 1.0,
    "Hz": 1.0,
    "m": 1.0,
    "mm": 1e-3,
    "$10^{-3}$ m": 1e-3,
    "mm s": 1e-3,
    "$10^{-3}$ m s": 1e-3,
    "m/s": 1.0,
    "m/s^2": 1.0,
    "m/s²": 1.0,
    "g": STANDARD_GRAVITY,
    "Pa": 1.0,
    "MPa": 1e6,
    "N": 1.0,
    "MN": 1e6,
    "N m": 1.0,
    "J": 1.0,
    "kJ": 1e3,
    "MJ": 1e6,
    "GJ": 1e9,
}


def si(label: str, values: Any) -> np.ndarray:
    """Convert values of an axis, column or row to SI by the unit in brackets in its label."""
    return UNITS[re.findall(r"\[(.*?)\]", label)[-1]] * np.asarray(values, dtype=float)


def lines(ax: Any, below: Any = None) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return x and y of the lines of matplotlib's axes, in SI, in the order drawn.

    The lowest of stacked axes, ``below``, has the label of x.
    """
    x, y = (below or ax).get_xlabel(), ax.get_ylabel()
    return [(si(x, line.get_xdata()), si(y, line.get_ydata())) for line in ax.get_lines()]


def low_passed(values: np.ndarray, dt: float, band: float) -> np.ndarray:
    """Filter a signal by 1 / (1 + (f / band)^8), mirrored at its first and last value."""
    mirrored = np.concatenate([values, values[-2:0:-1]])
    frequency = np.fft.rfftfreq(len(mirrored), dt)
    spectrum = np.fft.rfft(mirrored) / (1.0 + (frequency / band) ** 8)
    return np.fft.irfft(spectrum, len(mirrored))[: len(values)]


def equal_means(time: np.ndarray, means: np.ndarray) -> tuple[float, np.ndarray]:
    """Convert means over steps that end at ``time`` to means over equal steps.

    The number of equal steps is the duration divided by the shortest step.
    """
    count = round(np.ptp(time) / np.diff(time).min())
    equal = np.linspace(time[0], time[-1], count + 1)
    shares = np.clip(equal[1:, None], time[:-1], time[1:]) - np.clip(
        equal[:-1, None], time[:-1], time[1:]
    )
    dt = np.ptp(time) / count
    return dt, shares @ means / dt


def number(cell: str) -> float:
    """Return the number at the start of a report's cell; NaN for a dash."""
    first = cell.replace("\N{NARROW NO-BREAK SPACE}", "").replace("\N{MINUS SIGN}", "-").split()[0]
    return np.nan if first == "–" else float(first)


class Tables(HTMLParser):
    """Tables of a page, each a list of rows of texts; the first row is the head."""

    def __init__(self, html: str = "") -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self._inside = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self._inside = True

    def handle_endtag(self, tag: str) -> None:
        self._inside = self._inside and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.tables[-1][-1][-1] += data

    def having(self, *words: str) -> Tables:
        """Return the tables whose heads contain all the words."""
        chosen = Tables()
        heads = ((table, " ".join(table[0])) for table in self.tables)
        chosen.tables = [table for table, head in heads if all(word in head for word in words)]
        return chosen

    def under(self, name: str) -> Tables:
        """Return the tables, reduced to the rows below the one-cell row ``name``.

        The rows end at the next row of one cell.
        """
        chosen = Tables()
        for top, *body in self.tables:
            titles = [*(i for i, line in enumerate(body) if len(line) == 1), len(body)]
            for start, end in pairwise(titles):
                if body[start] == [name]:
                    chosen.tables.append([top, *body[start + 1 : end]])
        return chosen

    def value(self, row: str, *words: str) -> float:
        """Return the number in SI of a row, in the one column whose head has all the words.

        The unit is in the column's head, in the row's name, or in the head of the first column.
        """
        matches = [
            (next((t for t in (head, line[0], top[0]) if "[" in t), "[-]"), line[column])
            for top, *body in self.tables
            for column, head in enumerate(top[1:], 1)
            for line in body
            if line[0] == row and len(line) == len(top) and all(word in head for word in words)
        ]
        assert len(matches) == 1, (row, words, matches)
        ((label, cell),) = matches
        return float(si(label, number(cell)))


def captions(html: str) -> list[str]:
    """Return the captions of the figures of a page, whose numbers follow each other."""
    found = re.findall(
        r'<figcaption id="figure-(\d+)"><b>Figure (\d+)\.</b> (.*?)</figcaption>', html
    )
    assert [(n, m) for n, m, _ in found] == [(str(n), str(n)) for n in range(1, len(found) + 1)]
    assert html.count("<figcaption") == len(found)
    return [text for *_, text in found]


def curves(html: str, plot: str) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """Return x and y in SI of a page's curves, by name and panel, numbered from 0 at the top."""
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', html)
    assert text is not None
    spec = json.loads(text[1])["plots"][plot]
    xy = {}
    for trace in spec["data"]:
        panel = trace["yaxis"].removeprefix("y")
        titles = (spec["layout"][a]["title"]["text"] for a in ("xaxis", f"yaxis{panel}"))
        arrays = (np.frombuffer(base64.b64decode(trace[k]["f4"]), dtype="<f4") for k in "xy")
        titled = ((t if "[" in t else f"{t} [-]", a) for t, a in zip(titles, arrays, strict=True))
        xy[trace["name"], int(panel or 1) - 1] = tuple(si(t, a) for t, a in titled)
    return xy
