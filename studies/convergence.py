# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors by mesh and time step of mid-crest peaks and the largest opening.

    ./with-dolfinx python3 -m studies.convergence --record DIRECTORY
    ./with-dolfinx python3 -m studies.convergence --quick

Each mesh is run at the paper's step, each step on the default mesh, without and with joints. Meshes
are refined in elevation, with one layer of quadratic cells through the thickness. If three
successive values converge at a steady rate, the limit is extrapolated (Richardson) and the observed
order is printed. Otherwise their scatter is the error.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints import JointsError
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.study import Study, Table
from studies.ambiesta import ALL_STEPS, TIME_STEP, Case, Which, parameters, study_row

RATIO = 2.0**0.5  # of successive cell sizes; time steps are halved
COARSENINGS = (2, 1, 0, -1, -2)
HALVINGS = (-1, 0, 1, 2)
QUANTITIES = {
    "mid-crest/x/peak_strong": "largest mid-crest displacement x [mm]",
    "mid-crest/y/peak_strong": "largest mid-crest displacement y [mm]",
    "joints/opening_max": "largest opening [mm]",
}
ORDERS = (0.5, 6.0)  # observed orders outside this range are not steady convergence


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Limit, order and errors from a sequence of increasingly fine runs.

    Attributes:
        limit: Extrapolated value, or the finest one.
        order: Observed order, NaN if the sequence is not in the asymptotic range.
        error: Error of each value: its distance from the limit. Without a limit, its distance from
            the finest value, but at least the scatter, which is the range of the last three.
    """

    limit: float
    order: float
    error: NDArray[np.float64]


def extrapolated(values: NDArray[np.float64], ratio: float) -> Estimate:
    """Extrapolate from the last three values by Richardson's method, or return their scatter.

    Args:
        values: Values of the runs, coarsest first, shape (n,), n >= 3.
        ratio: Ratio of successive cell sizes or steps, above 1.

    Raises:
        ValueError: There are fewer than three values.
    """
    if len(values) < 3:
        raise ValueError(f"Extrapolation needs three values or more, got {len(values)}.")
    first, second = np.diff(values[-3:])
    rate = first / second if second else np.nan
    order = float(np.log(rate) / np.log(ratio)) if rate > 0.0 else np.nan
    if ORDERS[0] <= order <= ORDERS[1]:
        limit = float(values[-1] + second / (ratio**order - 1.0))
        return Estimate(limit=limit, order=order, error=np.abs(values - limit))
    error = np.maximum(np.abs(values - values[-1]), float(np.ptp(values[-3:])))
    return Estimate(limit=float(values[-1]), order=np.nan, error=error)


def grid(base: Case) -> dict[str, tuple[Case, Which]]:
    """Return cases by name: all meshes at the base's step, all steps on the base's mesh."""
    cases = [replace(base, size=round(base.size * RATIO**k, 3)) for k in COARSENINGS]
    for k in HALVINGS:
        steps, step = round(base.steps * 2.0**k), base.time_step / 2.0**k
        cases.append(replace(base, time_step=step, steps=steps))
    kinds: tuple[Which, ...] = ("linear", "joints")
    return {
        f"size={case.size:g}m_step={1e3 * case.time_step:.4g}ms_{kind}": (case, kind)
        for kind in kinds
        for case in cases
    }


def sequence(table: Table, base: Case, refined: str, kind: str) -> NDArray[np.int64]:
    """Return the rows that differ only in cell size or only in time step, coarsest first."""
    other = {"size": "time_step", "time_step": "size"}[refined]
    chosen = (table["run_as"] == kind) & np.isclose(table[other], getattr(base, other))
    rows = np.flatnonzero(chosen)
    return rows[np.argsort(-table[refined][rows])]


@dataclass(frozen=True, kw_only=True)
class Line:
    """Sequence of runs with the extrapolation of a quantity."""

    refined: str
    kind: str
    quantity: str
    rows: NDArray[np.int64]
    estimate: Estimate


def lines(table: Table, base: Case) -> list[Line]:
    """Return all sequences in the table."""
    return [
        Line(
            refined=refined,
            kind=kind,
            quantity=name,
            rows=(rows := sequence(table, base, refined, kind)),
            estimate=extrapolated(table[name][rows], ratio),
        )
        for refined, ratio in (("size", RATIO), ("time_step", 2.0))
        for kind in ("linear", "joints")
        for name in QUANTITIES
        if kind == "joints" or not name.startswith("joints/")
    ]


def print_lines(table: Table, base: Case) -> None:
    """Print values, limits, orders and errors."""
    for line in lines(table, base):
        unit, factor = ("m", 1.0) if line.refined == "size" else ("ms", 1e3)
        pairs = zip(table[line.quantity][line.rows], table[line.refined][line.rows], strict=True)
        values = ", ".join(f"{1e3 * v:.4f} at {factor * h:.4g} {unit}" for v, h in pairs)
        estimate = line.estimate
        how = f"limit {1e3 * estimate.limit:.4f}, order {estimate.order:.2f}, error of the finest"
        if np.isnan(estimate.order):
            how = "no steady order, scatter of the last three"
        share = 100 * estimate.error[-1] / abs(estimate.limit)
        print(f"{QUANTITIES[line.quantity]}, {line.kind}: {values}; {how} {share:.2g} %")


def main(arguments: list[str] | None = None) -> None:
    """Run the cases and extrapolate."""
    parser = Parser(description="Errors of mesh and time step.")
    parser.add_argument("--record", help="folder with three AT2 files (default: synthetic motion)")
    parser.add_argument(
        "--out", type=Path, default=Path("output/convergence"), help="output folder"
    )
    parser.add_argument("--quick", action="store_true", help="coarse meshes and two seconds")
    parser.add_argument("--workers", type=at_least(1), default=2, help="parallel runs (default 2)")
    options = parser.parse_args(arguments)
    size, steps = (11.0, 410) if options.quick else (5.5, ALL_STEPS)
    base = Case(size=size, steps=steps, time_step=TIME_STEP, record_folder=options.record)
    cases: dict[str, dict[str, Any]] = {
        name: parameters(case, kind, keep=False) for name, (case, kind) in grid(base).items()
    }
    study = Study(options.out, study_row, cases)
    tally = study.run(workers=options.workers, retry_failed=True)
    print(tally)
    if tally.failed:
        raise JointsError(f"Runs in {study.path} have failed; error estimates need all runs.")
    table = study.table()
    print_lines(table, base)


if __name__ == "__main__":
    try:
        main()
    except (JointsError, ValueError) as error:
        print(f"studies.convergence: {error}", file=sys.stderr)
        raise SystemExit(2) from None
