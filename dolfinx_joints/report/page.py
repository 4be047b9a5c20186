# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""HTML of a report: escaped text, tables, figures, and the whole page.

:func:`text` escapes all text. As a second protection, the page's content security policy allows no
network request and only the scripts whose hashes it lists.
"""

from __future__ import annotations

import base64
import functools
import gzip
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.postprocessing.palette import RUNS

Cell = Any  # a number, a text, None, or HTML
Curve = tuple[str, ArrayLike, ArrayLike]  # name, abscissas, ordinates

_STYLES: tuple[dict[str, Any], ...] = (
    {"width": 2.2},
    {"width": 1.2},
    {"width": 1.4, "dash": "dash"},
    {"width": 1.4, "dash": "dot"},
    {"width": 1.4, "dash": "dashdot"},
    {"width": 1.4},
    {"width": 1.4, "dash": "dash"},
    {"width": 1.4, "dash": "dot"},
)
_SHOWN = 2  # number of runs that are visible at first


class Html(str):
    """Text that is already HTML and is not escaped again."""

    __slots__ = ()


@dataclass(frozen=True)
class Section:
    """Section of a report: a heading with an anchor, and pieces of HTML."""

    name: str
    title: str
    pieces: Sequence[Html]


@dataclass
class Drawings:
    """Data drawn by the scripts of the page.

    Attributes:
        plots: Data and layout for plotly, by the id of the HTML element.
        scene: Data of the 3-D view, one entry per run.
        folder: Folder of the pictures, for links to them.
    """

    folder: Path
    plots: dict[str, dict[str, Any]] = field(default_factory=dict)
    scene: list[dict[str, Any]] = field(default_factory=list)

    def plot(
        self, name: str, spec: dict[str, Any], caption: str, pictures: Sequence[Path] = ()
    ) -> Html:
        """Return an interactive plot, with links to pictures of it."""
        self.plots[name] = spec
        height = spec["layout"]["height"]
        links = [
            f'<a href="{text(f"{self.folder.name}/{p.name}")}">{text(p.name)}</a>' for p in pictures
        ]
        note = f" Pictures: {', '.join(links)}." if links else ""
        return Html(
            f'<figure><div class="plot" id="{text(name)}" style="height:{height}px" role="img" '
            f'aria-label="{text(caption)}"></div><figcaption>{text(caption)}{note}</figcaption>'
            "</figure>"
        )

    def picture(self, png: Path, alt: str) -> Html:
        """Return a picture embedded in the page."""
        data = base64.b64encode(png.read_bytes()).decode()
        return Html(f'<img src="data:image/png;base64,{data}" alt="{text(alt)}"/>')


def text(value: Cell) -> Html:
    """Return a value as HTML: text escaped, numbers with four digits, None as a dash."""
    if isinstance(value, Html):
        return value
    return Html(escape(plain(value), quote=True))


def plain(value: Cell) -> str:
    """Return a value as text without mark-up."""
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    if isinstance(value, float | np.floating):
        if not np.isfinite(value):
            return "–" if np.isnan(value) else str(float(value))
        return _figures(float(value) + 0.0, ".4g")  # adding 0.0 turns -0.0 into 0.0
    if isinstance(value, list | tuple):
        return ", ".join(plain(item) for item in value)
    return str(value)


def _figures(value: float, form: str) -> str:
    return f"{value:{form}}".replace("e+", "e").replace("-", "\N{MINUS SIGN}")


def valued(value: float, where: str) -> Html:
    """Return a number with four digits, and place or time in small print below it."""
    return Html(f'{text(_figures(value, "#.4g"))} <span class="where">{text(where)}</span>')


def paragraph(content: Cell, kind: str = "") -> Html:
    """Return a paragraph."""
    return Html(f"<p{_class(kind)}>{text(content)}</p>")


def bullets(items: Sequence[Cell]) -> Html:
    """Return a bullet list."""
    return Html(f"<ul>{''.join(f'<li>{text(item)}</li>' for item in items)}</ul>")


def heading(content: Cell) -> Html:
    """Return a heading within a section."""
    return Html(f"<h3>{text(content)}</h3>")


def figure(pictures: Sequence[Html], caption: str, *, wide: bool = False) -> Html:
    """Return pictures side by side above a caption; wide ones scroll in narrow windows."""
    shown = "".join(pictures)
    kind = _scrolling(caption, "wide") if wide else '<div class="maps">'
    return Html(f"<figure>{kind}{shown}</div><figcaption>{text(caption)}</figcaption></figure>")


def details(title: str, pieces: Sequence[Html], *, opened: bool = False) -> Html:
    """Return a block that the reader can unfold; its plots are drawn when it is unfolded."""
    state = ' open=""' if opened else ""
    return Html(f"<details{state}><summary>{text(title)}</summary>{''.join(pieces)}</details>")


def table(caption: str, head: Sequence[Cell], rows: Sequence[Sequence[Cell]]) -> Html:
    """Return a table with row names in the first column and right-aligned columns of numbers.

    A row with a single cell is the heading of the following rows.
    """
    whole = [row for row in rows if len(row) > 1]
    numeric = [all(row[i] is None or _is_number(row[i]) for row in whole) for i in range(len(head))]
    kinds = ["number" if whole and flag else "" for flag in numeric]
    top = "".join(
        f'<th scope="col"{_class(kind)}>{text(cell)}</th>'
        for cell, kind in zip(head, kinds, strict=True)
    )
    body = "".join(_row(row, kinds) for row in rows)
    return Html(
        f"{_scrolling(caption)}<table><caption>{text(caption)}</caption>"
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def floats(values: ArrayLike) -> dict[str, str]:
    """Return an array for the page's script, in single precision."""
    return {"f4": base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()}


def integers(values: ArrayLike) -> dict[str, str]:
    """Return an array of integers for the page's script."""
    return {"i4": base64.b64encode(np.ascontiguousarray(values, dtype="<i4").tobytes()).decode()}


def panels(
    curves: Sequence[Sequence[Curve]],
    ordinates: Sequence[str],
    abscissa: str,
    *,
    limit: float | None = None,
    logarithmic: bool = False,
    shown: int = _SHOWN,
    shaded: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """Return stacked panels with a common abscissa; a curve's name determines its colour.

    ``ordinates`` and ``abscissa`` are axis titles with units, ``limit`` is the end of the abscissa,
    ``shown`` is the number of names visible at first, ``shaded`` is a range of the abscissa.
    """
    names = list(dict.fromkeys(name for panel in curves for name, _, _ in panel))
    count = len(curves)
    height = 1.0 / count
    layout: dict[str, Any] = {
        "height": 90 + 220 * count,
        "margin": {"l": 70, "r": 45, "t": 40, "b": 55},
        "modebar": {"orientation": "v"},
        "paper_bgcolor": "#fff",
        "plot_bgcolor": "#fff",
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0},
        "xaxis": {
            "title": {"text": abscissa},
            "anchor": "y" if count == 1 else f"y{count}",
            **_axis(),
        },
    }
    if limit is not None:
        layout["xaxis"]["range"] = [0.0, limit]
    if logarithmic:
        layout["xaxis"]["type"] = "log"
    if shaded is not None:
        where = {"x0": shaded[0], "x1": shaded[1], "y0": 0.0, "y1": 1.0, "yref": "paper"}
        style = {"fillcolor": "#ececec", "line": {"width": 0}, "layer": "below"}
        layout["shapes"] = [{"type": "rect", "xref": "x", **where, **style}]
    data = []
    for row, (panel, ordinate) in enumerate(zip(curves, ordinates, strict=True)):
        number = "" if row == 0 else str(row + 1)
        top = 1.0 - row * height
        layout[f"yaxis{number}"] = {
            "title": {"text": ordinate},
            "domain": [top - 0.9 * height, top],
            **_axis(),
        }
        for name, x, y in panel:
            place = names.index(name)
            data.append(_trace(name, x, y, place, f"y{number}", first=row == 0, shown=shown))
    return {"data": data, "layout": layout}


def page(title: str, top: Sequence[Html], sections: Sequence[Section], drawings: Drawings) -> str:
    """Return the whole page, HTML that needs no other file and no network.

    The pieces in ``top`` are above the table of contents.
    """
    data = {"plots": drawings.plots, "scene": drawings.scene}
    root = files("dolfinx_joints.report")
    script, style = (root.joinpath(f"report.{kind}").read_text("utf-8") for kind in ("js", "css"))
    packed, hashes = _plotly() if drawings.plots or drawings.scene else ("", [])
    hashes = [_hash(script), *hashes]
    policy = (
        f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
        f"script-src {' '.join(hashes)}"
    )
    contents = "".join(f'<li><a href="#{text(s.name)}">{text(s.title)}</a></li>' for s in sections)
    body = "".join(
        f'<section id="{text(s.name)}"><h2>{text(s.title)}</h2>{"".join(s.pieces)}</section>\n'
        for s in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}"/>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
        f"<title>{text(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n"
        '<a class="skip" href="#contents">Skip to the contents</a>\n'
        f"<main>\n<h1>{text(title)}</h1>\n{''.join(top)}\n"
        f'<nav id="contents" aria-label="Contents"><h2>Contents</h2><ol>{contents}</ol></nav>\n'
        f"{body}</main>\n"
        f'<script type="application/json" id="data">{_json(data)}</script>\n'
        f'<script type="application/octet-stream" id="plotly">{packed}</script>\n'
        f"<script>{script}</script>\n</body>\n</html>\n"
    )


def _scrolling(label: str, kind: str = "") -> str:
    """Return the start tag of an element that scrolls if it is wider than the page."""
    label = text(label)
    return f'<div class="scroll {kind}" tabindex="0" role="region" aria-label="{label}">'


def _row(row: Sequence[Cell], kinds: Sequence[str]) -> str:
    if len(row) == 1:
        span = f'scope="colgroup" class="group" colspan="{len(kinds)}"'
        return f"<tr><th {span}>{text(row[0])}</th></tr>"
    cells = "".join(
        f"<td{_class(kind or 'text')}>{text(cell)}</td>"
        for cell, kind in zip(row[1:], kinds[1:], strict=True)
    )
    return f'<tr><th scope="row"{_class(kinds[0])}>{text(row[0])}</th>{cells}</tr>'


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, int | float | np.number) and not isinstance(cell, bool)


def _class(name: str) -> str:
    return f' class="{name}"' if name else ""


def _json(data: Mapping[str, Any]) -> str:
    """Return JSON with ``<`` escaped, so that no text in it can end the script element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


@functools.cache
def _plotly() -> tuple[str, list[str]]:
    """Return plotly's script, compressed, and its hash for the content security policy."""
    from plotly.offline import get_plotlyjs

    source: str = get_plotlyjs()
    packed = gzip.compress(source.encode(), compresslevel=5, mtime=0)
    return base64.b64encode(packed).decode(), [_hash(source)]


def _hash(script: str) -> str:
    """Return the hash of a script for the content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _trace(
    name: str, x: ArrayLike, y: ArrayLike, place: int, axis: str, *, first: bool, shown: int
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": escape(name, quote=False),
        "legendgroup": name,
        "showlegend": first,
        "visible": True if place < shown else "legendonly",
        "x": floats(np.asarray(x)),
        "y": floats(np.asarray(y)),
        "xaxis": "x",
        "yaxis": axis,
        "line": {"color": RUNS[place % len(RUNS)], **_STYLES[place % len(_STYLES)]},
        "hovertemplate": "%{y:.4g}",
    }


def _axis() -> dict[str, Any]:
    return {
        "gridcolor": "#e3e3e3",
        "zerolinecolor": "#999",
        "linecolor": "#999",
        "ticks": "outside",
        "exponentformat": "power",
        "automargin": True,
    }
