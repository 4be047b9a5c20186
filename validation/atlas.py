# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a case of the atlas gives, and the pages made of it.

A case is a module with a docstring (title, set-up), `SOURCE` and ``run(quick) -> Outcome``. Each
row of its outcome has a number of ours, one of theirs, and a tolerance with the reason for it.
"""

from __future__ import annotations

import inspect
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

GROUPS: dict[str, tuple[str, ...]] = {
    "exact": ("rigid_dam", "joint_waves", "slipping_joint", "layered_column", "long_dam"),
    "published": (
        "grouted_blocks",
        "impounded_dam",
        "gravity_dams",
        "slipping_crack",
        "tilted_arch",
        "bar_on_wall",
        "released_mass",
        "inclined_slider",
        "pressed_plate",
    ),
    "peers": ("opensees_blocks",),
}


class LeftOutError(Exception):
    """A case cannot run here; the message says what is missing."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A number of ours beside that of others.

    Attributes:
        quantity: What is compared, with its unit.
        ours: The number computed here.
        theirs: The number of the source.
        tolerance: Largest deviation allowed.
        reason: Where the tolerance comes from.
        scale: What the deviation is relative to; the size of `theirs` unless given.
    """

    quantity: str
    ours: float
    theirs: float
    tolerance: float
    reason: str
    scale: float | None = None

    @property
    def deviation(self) -> float:
        """Ours less theirs, relative to `scale`."""
        return (self.ours - self.theirs) / (abs(self.theirs) if self.scale is None else self.scale)

    @property
    def holds(self) -> bool:
        """Whether the deviation is allowed; one that is not a number is not."""
        return bool(abs(self.deviation) <= self.tolerance)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a case found.

    Attributes:
        rows: Its numbers.
        figure: Its picture.
    """

    rows: Sequence[Row]
    figure: Figure


def curve(
    quantity: str, ours: ArrayLike, theirs: ArrayLike, *, tolerance: float, reason: str
) -> Row:
    """The row of a curve: its largest difference over the largest value of theirs.

    Args:
        quantity: What the curve is.
        ours: Values, real or complex.
        theirs: Values at the same places.
        tolerance: Largest difference allowed, relative.
        reason: Where it comes from.
    """
    found, exact = np.asarray(ours), np.asarray(theirs)
    scale = float(np.abs(exact).max())
    largest = float(np.abs(found - exact).max()) / scale
    return Row(
        quantity=f"{quantity}, largest difference / largest value",
        ours=largest,
        theirs=0.0,
        tolerance=tolerance,
        reason=reason,
        scale=1.0,
    )


@dataclass(frozen=True, kw_only=True)
class Result:
    """A case that has run.

    Attributes:
        name: Of the case.
        module: The case.
        outcome: What it found; None where it was left out.
        seconds: Processor time of this process and those it started [s].
        missing: Why it was left out.
    """

    name: str
    module: ModuleType
    outcome: Outcome | None
    seconds: float
    missing: str = ""

    @property
    def title(self) -> str:
        """First line of the case's docstring."""
        return title_of(self.module)

    @property
    def wrong(self) -> list[Row]:
        """Rows that deviate by more than is allowed."""
        return [row for row in self.outcome.rows if not row.holds] if self.outcome else []


def names() -> list[str]:
    """Names of all cases in the order of the atlas."""
    return [name for group in GROUPS.values() for name in group]


def module_of(name: str) -> ModuleType:
    """The module of a case."""
    group = next(group for group, members in GROUPS.items() if name in members)
    return import_module(f"validation.{group}.{name}")


def title_of(module: ModuleType) -> str:
    """First line of a case's docstring."""
    return (inspect.getdoc(module) or "").splitlines()[0].rstrip(".")


def run_case(name: str, *, quick: bool = False) -> Result:
    """Run a case.

    Args:
        name: One of `names`.
        quick: A shorter run with the same rows.
    """
    module = module_of(name)
    run: Callable[..., Outcome] = module.run
    began = processor_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what matters of them is on the page
            outcome = run(quick)
    except LeftOutError as missing:
        return Result(name=name, module=module, outcome=None, seconds=0.0, missing=str(missing))
    seconds = processor_time() - began
    return Result(name=name, module=module, outcome=outcome, seconds=seconds)


def processor_time() -> float:
    """Of this process and of those it started and waited for [s]."""
    return sum(os.times()[:4])


def table(rows: Sequence[Row]) -> str:
    """Rows as a Markdown table."""
    lines = [
        "| quantity | ours | theirs | deviation | tolerance | reason |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        mark = "" if row.holds else " **too large**"
        numbers = f"{row.ours:.5g} | {row.theirs:.5g} | {share(row.deviation)}{mark}"
        lines.append(f"| {row.quantity} | {numbers} | {share(row.tolerance)} | {row.reason} |")
    return "\n".join(lines)


def share(value: float) -> str:
    """A relative number in percent, or as a power of ten where it is very small."""
    return f"{100 * value:.2g} %" if abs(value) >= 5e-6 or value == 0.0 else f"{value:.0e}"


def write_page(result: Result, out: Path) -> None:
    """Write the page of a case and its figure into a folder."""
    if result.outcome is None:
        return
    _, _, text = (inspect.getdoc(result.module) or "").partition("\n")
    figure = result.outcome.figure
    figure.set_layout_engine("constrained")
    figure.savefig(out / f"{result.name}.png", dpi=120)
    parts = [
        f"# {result.title}",
        text.strip(),
        f"Source: {result.module.SOURCE}",
        table(result.outcome.rows),
        f"![{result.title}]({result.name}.png)",
        f"`make validate CASES={result.name}`, {result.seconds:.0f} s of a processor.",
    ]
    (out / f"{result.name}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def summary(results: Sequence[Result]) -> str:
    """All cases as a Markdown table: the row nearest to its tolerance, and the time."""
    lines = [
        "| case | against | numbers | nearest to its tolerance | deviation | tolerance | [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for result in results:
        first = f"| [{result.title}]({result.name}.md) | {result.module.SOURCE} | "
        if result.outcome is None:
            lines.append(f"{first}left out: {result.missing} | | | | |")
            continue
        rows = result.outcome.rows
        worst = max(
            rows, key=lambda row: np.nan_to_num(abs(row.deviation), nan=1e9) / row.tolerance
        )
        lines.append(
            f"{first}{len(rows)} | {worst.quantity} | {share(worst.deviation)} "
            f"| {share(worst.tolerance)} | {result.seconds:.0f} |"
        )
    return "\n".join(lines)


def new_figure(columns: int = 1, *, width: float = 6.4, height: float = 3.8) -> tuple[Figure, Any]:
    """A figure with a row of axes, which needs no display.

    Args:
        columns: Number of axes.
        width: [inch].
        height: [inch].
    """
    figure = Figure(figsize=(width * (1.0 if columns == 1 else 0.75 * columns), height))
    axes = figure.subplots(1, columns)
    for ax in np.atleast_1d(axes):
        ax.grid(alpha=0.3)
    return figure, axes
