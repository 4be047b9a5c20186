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
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.report import panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MANY = 10  # columns, beyond which a table is small in print
_SHORT = 15  # rows, up to which a printed table is on one page
Cell = Any  # a number, a text, None, or HTML


class Html(str):
    """Text that is already HTML and is not escaped again."""

    __slots__ = ()


@dataclass(frozen=True)
class Section:
    """Section of a report: a heading with an anchor, and pieces of HTML.

    A section without pieces is left out, and the report states what is ``missing`` in the files.
    """

    name: str
    title: str
    pieces: Sequence[Html]
    missing: str = ""


@dataclass
class Drawings:
    """Pictures, and data drawn by the scripts of the page.

    Attributes:
        folder: Folder of the pictures, for links to them.
        printed: True if the page is printed: pictures replace what scripts draw.
        plots: Data and layout for plotly, by the id of the HTML element.
        scene: Data of the 3-D view, one entry per run.
    """

    folder: Path
    printed: bool = False
    plots: dict[str, dict[str, Any]] = field(default_factory=dict)
    scene: list[dict[str, Any]] = field(default_factory=list)

    def plot(self, name: str, spec: dict[str, Any], caption: str) -> Html:
        """Return an interactive plot with a link to its picture, or the picture if printed."""
        png = self.save(name, panels.picture(spec), 150 if self.printed else 90)
        if self.printed:
            return figure([self.picture(png, caption)], caption)
        self.plots[name] = spec
        height = spec["layout"]["height"]
        link = f'<a href="{text(f"{self.folder.name}/{png.name}")}">{text(png.name)}</a>'
        return Html(
            f'<figure><div class="plot" id="{text(name)}" style="height:{height}px" role="img" '
            f'aria-label="{text(caption)}"></div><figcaption>{text(caption)} Picture: {link}.'
            "</figcaption></figure>"
        )

    def save(self, name: str, drawn: Figure, dpi: int = 130) -> Path:
        """Write a picture to the folder; return its path."""
        from dolfinx_joints.postprocessing import plots

        self.folder.mkdir(parents=True, exist_ok=True)
        return plots.save(drawn, self.folder / f"{name}.png", dpi=dpi)

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
    kind = "short" if len(rows) <= _SHORT else ""
    start = _scrolling(caption, f"{kind} many" if len(head) > _MANY else kind)
    return Html(
        f"{start}<table><caption>{text(caption)}</caption>"
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def reference(caption: str) -> str:
    """Return a text that the page replaces by the number of the table or figure."""
    return f"⟦{caption}⟧"


def numbered(html: str) -> str:
    """Return HTML with numbered tables and figures, and their numbers instead of references."""
    counts: Counter[str] = Counter()
    links: dict[str, str] = {}

    def number(match: re.Match[str]) -> str:
        tag, caption = match.groups()
        kind = "Table" if tag == "caption" else "Figure"
        counts[kind] += 1
        anchor = f"{kind.lower()}-{counts[kind]}"
        links.setdefault(caption, f'<a href="#{anchor}">{kind} {counts[kind]}</a>')
        return f'<{tag} id="{anchor}"><b>{kind} {counts[kind]}.</b> {caption}<'

    html = re.sub("<(caption|figcaption)>([^<]*)<", number, html)
    return re.sub("⟦(.*?)⟧", lambda match: links.get(match[1], match[0]), html)


def page(
    title: str,
    facts: Mapping[str, str | None],
    top: Sequence[Html],
    sections: Sequence[Section],
    drawings: Drawings,
) -> str:
    """Return the whole page, HTML that needs no other file and no network.

    The title has those ``facts`` that are given. The pieces in ``top`` follow; the table of
    contents is below them, in print above them.
    """
    style = files("dolfinx_joints.report").joinpath("report.css").read_text("utf-8")
    given = "".join(f"<dt>{k}</dt><dd>{text(v)}</dd>" for k, v in facts.items() if v)
    contents = "".join(f'<li><a href="#{text(s.name)}">{text(s.title)}</a></li>' for s in sections)
    nav = f'<nav id="contents" aria-label="Contents"><h2>Contents</h2><ol>{contents}</ol></nav>'
    order = [nav, *top] if drawings.printed else [*top, nav]
    body = "".join(
        f'<section id="{text(s.name)}"><h2>{text(s.title)}</h2>{"".join(s.pieces)}</section>\n'
        for s in sections
    )
    main = (
        f"<main>\n<header><h1>{text(title)}</h1>{f'<dl>{given}</dl>' if given else ''}</header>\n"
        f"{''.join(order)}\n{body}</main>\n"
    )
    policy, scripts = ("", "") if drawings.printed else _scripts(drawings)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        f'{policy}<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
        f"<title>{text(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n"
        '<a class="skip" href="#contents">Skip to the contents</a>\n'
        f"{numbered(main)}{scripts}</body>\n</html>\n"
    )


def _scripts(drawings: Drawings) -> tuple[str, str]:
    """Return the content security policy of the page, and its scripts with their data."""
    script = files("dolfinx_joints.report").joinpath("report.js").read_text("utf-8")
    data = {"plots": drawings.plots, "scene": drawings.scene}
    packed, hashes = _plotly() if drawings.plots or drawings.scene else ("", [])
    policy = (
        f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
        f"script-src {' '.join([_hash(script), *hashes])}"
    )
    return (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}"/>\n',
        f'<script type="application/json" id="data">{_json(data)}</script>\n'
        f'<script type="application/octet-stream" id="plotly">{packed}</script>\n'
        f"<script>{script}</script>\n",
    )


def _scrolling(label: str, kind: str = "") -> str:
    """Return the start tag of an element that scrolls if it is wider than the page."""
    label = text(label)
    return f'<div class="scroll {kind}" tabindex="0" role="region" aria-label="{label}">'


def _row(row: Sequence[Cell], kinds: Sequence[str]) -> str:
    if len(row) == 1:
        span = f'scope="colgroup" class="group" colspan="{len(kinds)}"'
        return f'<tr class="group"><th {span}>{text(row[0])}</th></tr>'
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
