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

    A deviation larger than the tolerance is stated by `differs` and `cause`. Such a row fails if
    its deviation is not the stated one, to the tolerance.

    Attributes:
        quantity: What is compared, with its unit.
        ours: The number computed here.
        theirs: The number of the source.
        tolerance: Estimated error of ours and of the printed number, relative to `theirs`.
        reason: Where the tolerance comes from, as from `estimate`.
        scale: What the deviation is relative to where `theirs` is zero, and only there.
        differs: Known deviation that exceeds the tolerance.
        cause: Of this deviation.

    Raises:
        ValueError: There is a scale beside a number other than zero, or none beside zero.
    """

    quantity: str
    ours: float
    theirs: float
    tolerance: float
    reason: str
    scale: float | None = None
    differs: float | None = None
    cause: str = "cause not known"

    def __post_init__(self) -> None:
        """Check what the deviation is relative to."""
        if (self.scale is None) == (self.theirs == 0.0):
            raise ValueError(
                f"{self.quantity}: the deviation is relative to the number of the source, "
                f"{self.theirs:g}, or to a scale if that number is zero; scale is {self.scale}."
            )

    @property
    def deviation(self) -> float:
        """Ours less theirs, relative to theirs, or to `scale` where theirs is zero."""
        return (self.ours - self.theirs) / (abs(self.theirs) if self.scale is None else self.scale)

    @property
    def holds(self) -> bool:
        """Whether the deviation is allowed or the stated one; one that is not a number is not."""
        return bool(abs(self.deviation - (self.differs or 0.0)) <= self.tolerance)


# Parts of an estimate that are not listed beside larger ones.
SMALL = 1e-5


def estimate(theirs: float = 1.0, *, digits: int | None = None, **errors: float) -> dict[str, Any]:
    """Return ``tolerance`` and ``reason`` of a row: the sum of the estimated errors.

    Args:
        theirs: The number of the source.
        digits: Number of digits printed in the source: half a unit of the last one is its error.
        errors: Relative errors of ours by name, such as ``cells`` and ``steps``.
    """
    if digits is not None:
        unit = 10.0 ** (np.floor(np.log10(abs(theirs))) + 1 - digits)
        errors[f"{digits} digits"] = 0.5 * float(unit) / abs(theirs)
    listed = {name: error for name, error in errors.items() if error >= SMALL} or errors
    reason = ", ".join(f"{name} {share(error)}" for name, error in listed.items())
    return {"tolerance": sum(errors.values()), "reason": reason}


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


def refines(name: str) -> bool:
    """Return whether a case can run on finer cells or in shorter steps."""
    return "fine" in inspect.signature(module_of(name).run).parameters


def run_case(name: str, *, quick: bool = False, fine: bool = False) -> Result:
    """Run a case.

    Args:
        name: One of `names`.
        quick: A shorter run with the same rows.
        fine: The run on finer cells or in shorter steps, of a case that `refines`.
    """
    module = module_of(name)
    run: Callable[..., Outcome] = module.run
    began = processor_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what matters of them is on the page
            outcome = run(quick, fine=True) if fine else run(quick)
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
        mark = "" if row.holds else " **too large**" if row.differs is None else " **changed**"
        numbers = f"{row.ours:.5g} | {row.theirs:.5g} | {share(row.deviation)}{mark}"
        reason = row.reason
        if row.differs is not None:
            reason += f"; **differs by {share(abs(row.differs))}**: {row.cause}"
        lines.append(f"| {row.quantity} | {numbers} | {share(row.tolerance)} | {reason} |")
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
    """All cases as a Markdown table: the row farthest beyond or nearest to its tolerance, time."""
    lines = [
        "| case | against | numbers | beyond tolerance | worst | deviation | tolerance | [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for result in results:
        first = f"| [{result.title}]({result.name}.md) | {result.module.SOURCE} | "
        if result.outcome is None:
            lines.append(f"{first}left out: {result.missing} | | | | | |")
            continue
        rows = result.outcome.rows
        worst = max(
            rows, key=lambda row: np.nan_to_num(abs(row.deviation), nan=1e9) / row.tolerance
        )
        beyond = sum(row.differs is not None for row in rows)
        lines.append(
            f"{first}{len(rows)} | {beyond} | {worst.quantity} | {share(worst.deviation)} "
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
