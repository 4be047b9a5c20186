# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cases of the validation atlas, their results, and their pages.

A case is a module with a docstring (title, set-up), `SOURCE` and ``run(quick) -> Outcome``. Each
row of its outcome has our number, the source's number, and a tolerance with its reason.
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
    """Error for a case that cannot run here; the message states what is missing."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Comparison of our number with the source's.

    `differs` and `cause` state a known deviation larger than the tolerance. Such a row fails if its
    deviation differs from the stated one by more than the tolerance.

    Attributes:
        quantity: Compared quantity, with its unit.
        ours: The number computed here.
        theirs: The number of the source.
        tolerance: Estimated error of ours and of the printed number, relative to `theirs`.
        reason: Origin of the tolerance, for example from `estimate`.
        scale: Reference of the deviation if `theirs` is zero, and only then.
        differs: Known deviation that exceeds the tolerance.
        cause: Cause of this deviation.

    Raises:
        ValueError: A scale is given although `theirs` is not zero, or missing although it is.
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
        """Check that the reference of the deviation is not zero."""
        if (self.scale is None) == (self.theirs == 0.0):
            raise ValueError(
                f"{self.quantity}: the deviation is relative to the number of the source, "
                f"{self.theirs:g}, or to a scale if that number is zero; scale is {self.scale}."
            )

    @property
    def deviation(self) -> float:
        """Ours minus theirs, relative to theirs, or to `scale` if theirs is zero."""
        return (self.ours - self.theirs) / (abs(self.theirs) if self.scale is None else self.scale)

    @property
    def holds(self) -> bool:
        """True if the deviation is within the tolerance of zero or of `differs`; False for NaN."""
        return bool(abs(self.deviation - (self.differs or 0.0)) <= self.tolerance)


# Smaller parts of an estimate are not listed if there are larger ones.
SMALL = 1e-5


def estimate(theirs: float = 1.0, *, digits: int | None = None, **errors: float) -> dict[str, Any]:
    """Return ``tolerance`` and ``reason`` of a row: the sum of the estimated errors.

    Args:
        theirs: The number of the source.
        digits: Number of digits printed in the source; its error is half a unit of the last one.
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
    """Outcome of a case.

    Attributes:
        rows: Compared numbers.
        figure: Picture of the case.
    """

    rows: Sequence[Row]
    figure: Figure


def curve(
    quantity: str, ours: ArrayLike, theirs: ArrayLike, *, tolerance: float, reason: str
) -> Row:
    """Return the row of a curve: the largest difference over the largest value of theirs.

    Args:
        quantity: Name of the curve.
        ours: Our values, real or complex.
        theirs: The source's values at the same places.
        tolerance: Largest relative difference allowed.
        reason: Origin of the tolerance.
    """
    computed, exact = np.asarray(ours), np.asarray(theirs)
    scale = float(np.abs(exact).max())
    largest = float(np.abs(computed - exact).max()) / scale
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
    """Result of a case.

    Attributes:
        name: Name of the case.
        module: Module of the case.
        outcome: Outcome of the case, None if it was left out.
        seconds: Processor time of this process and its child processes [s].
        missing: Reason why it was left out.
    """

    name: str
    module: ModuleType
    outcome: Outcome | None
    seconds: float
    missing: str = ""

    @property
    def title(self) -> str:
        """Title of the case, the first line of its docstring."""
        return title_of(self.module)

    @property
    def wrong(self) -> list[Row]:
        """Rows whose deviation is too large."""
        return [row for row in self.outcome.rows if not row.holds] if self.outcome else []


def names() -> list[str]:
    """Return the names of all cases in the order of the atlas."""
    return [name for group in GROUPS.values() for name in group]


def module_of(name: str) -> ModuleType:
    """Return the module of a case."""
    group = next(group for group, members in GROUPS.items() if name in members)
    return import_module(f"validation.{group}.{name}")


def title_of(module: ModuleType) -> str:
    """Return the first line of a case's docstring."""
    return (inspect.getdoc(module) or "").splitlines()[0].rstrip(".")


def refines(name: str) -> bool:
    """Return True if a case can run on finer cells or in shorter steps."""
    return "fine" in inspect.signature(module_of(name).run).parameters


def run_case(name: str, *, quick: bool = False, fine: bool = False) -> Result:
    """Run a case.

    Args:
        name: One of `names`.
        quick: Make a shorter run with the same rows.
        fine: Use finer cells or shorter steps, if the case `refines`.
    """
    module = module_of(name)
    run: Callable[..., Outcome] = module.run
    began = processor_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the page of the case states the relevant ones
            outcome = run(quick, fine=True) if fine else run(quick)
    except LeftOutError as missing:
        return Result(name=name, module=module, outcome=None, seconds=0.0, missing=str(missing))
    seconds = processor_time() - began
    return Result(name=name, module=module, outcome=outcome, seconds=seconds)


def processor_time() -> float:
    """Return the processor time of this process and its completed child processes [s]."""
    return sum(os.times()[:4])


def table(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table."""
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
    """Return a relative number in percent, or as a power of ten if it is very small."""
    return f"{100 * value:.2g} %" if abs(value) >= 5e-6 or value == 0.0 else f"{value:.0e}"


def write_page(result: Result, out: Path) -> None:
    """Write the page of a case and its figure to a folder."""
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
    """Return a Markdown table of all cases, with the worst row relative to its tolerance."""
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
    """Return a figure with a row of axes; it needs no display.

    Args:
        columns: Number of axes.
        width: Width of the figure [inch].
        height: Height of the figure [inch].
    """
    figure = Figure(figsize=(width * (1.0 if columns == 1 else 0.75 * columns), height))
    axes = figure.subplots(1, columns)
    for ax in np.atleast_1d(axes):
        ax.grid(alpha=0.3)
    return figure, axes
