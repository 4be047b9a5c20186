#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature rules on joints, compared on two problems with exact solutions.

The inclined frictional crack tests whether tractions oscillate if the joint is stiff. The section
without tension tests contact that ends within a face. The problems are those of
``tests/verification``.

``--plot PATH`` writes the figure of the documentation, with the crack at the largest stiffness.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from benchmarks.shared.tables import table
from dolfinx_joints import JointsError
from dolfinx_joints.common.command_line import Parser
from tests.verification.inclined_crack import CrackResult, InclinedCrack, solve_crack
from tests.verification.no_tension_section import NoTensionSection, SectionState, move_force

CRACK = InclinedCrack()
REACH = 0.9 * CRACK.half_length  # the crack tips are left out
SECTION = NoTensionSection(rigidity=1e4)
EDGE_CASE = 0.49  # e/h of a force near the edge, with a contact of 0.03 h

CRACK_CELLS = ("quad", "tri", "hex", "tet")
CRACK_RULES = {1: ("nodal", "gauss", 4), 2: ("nodal", 2, "gauss", 6)}
OWN_DEFAULT = ("tet", 2)  # cell and order for which ``auto`` is a different rule
SECTION_RULES = {
    "hex": ("nodal", 2, 4, 6, 8, 10, 12),
    "tet": ("nodal", 2, 3, 5, 6, 8, 10, 12),
}

Row = dict[str, Any]


def crack_rows(*, quick: bool) -> tuple[list[Row], dict[tuple[str, int, str], CrackResult]]:
    """Return crack errors by cell, order, rule and stiffness, and the stiffest results."""
    size, growth = (0.2, 2.0) if quick else (0.1, 1.5)
    ratios = (1.0, 1e6) if quick else (1.0, 1e2, 1e4, 1e6)
    rows, kept = [], {}
    for cell, order in product(CRACK_CELLS, (1, 2)):
        solid = cell in ("hex", "tet")
        mesh = {"cell": cell, "order": order, "size": size}
        mesh["growth"] = 2.0 if solid and order == 2 else growth
        rules = (*CRACK_RULES[order], *["auto"] * ((cell, order) == OWN_DEFAULT))
        for rule, ratio in product(rules, ratios):
            stiffness = ratio * CRACK.young / size
            result = solve_crack(CRACK, quadrature=rule, normal_stiffness=stiffness, **mesh)
            traction, slip = CRACK.elastic(result.x, stiffness, stiffness)
            rows.append(
                {
                    "cell": cell,
                    "order": order,
                    "rule": rule,
                    "points_per_facet": len(result.x) / result.num_facets,
                    "stiffness": ratio,
                    "deviation": result.deviation(traction, REACH),
                    "oscillation": result.oscillation(traction, REACH),
                    "slip_error": result.slip_error(slip),
                    "iterations": result.iterations,
                }
            )
            if ratio == max(ratios):
                kept[cell, order, str(rule)] = result
    return rows, kept


def section_rows(*, quick: bool) -> list[Row]:
    """Return errors of the section by cell, order and rule.

    They are root mean squares over eccentricities for which the contact ends at many places within
    a cell, and the error of the edge stress for a force near the edge.
    """
    cells, count = (8, 6) if quick else (16, 16)
    shares = [*np.linspace(0.20, 0.42, count), 0.44, 0.46, 0.47, 0.48, 0.485, EDGE_CASE]
    eccentricities = [SECTION.height * share for share in shares]
    rows = []
    for cell, order in product(SECTION_RULES, (1, 2)):
        for rule in (*SECTION_RULES[cell], *["auto"] * ((cell, order) == OWN_DEFAULT)):
            force = move_force(
                SECTION,
                eccentricities,
                cells=cells,
                cell=cell,
                order=order,
                quadrature=rule,
            )
            states = reached(force)
            rows.append(
                {
                    "cell": cell,
                    "order": order,
                    "rule": rule,
                    "points_per_facet": states[0].num_points / states[0].num_facets,
                    **section_errors(states, eccentricities, count),
                }
            )
    return rows


def reached(force: Iterator[SectionState]) -> list[SectionState]:
    """Return the states with equilibrium, up to a force beyond the last point of the rule."""
    states = []
    with suppress(JointsError):
        for state in force:
            states.append(state)
    return states


def section_errors(states: list[SectionState], eccentricities: list[float], count: int) -> Row:
    """Return root mean squares over the first states, and the last error if it was reached."""
    exact = [SECTION.exact(e) for e in eccentricities]

    def relative(name: str) -> np.ndarray:
        pairs = zip(states, exact, strict=False)
        return np.array([getattr(a, name) / getattr(b, name) - 1.0 for a, b in pairs])

    means = {
        name: float(np.sqrt(np.mean(relative(name)[:count] ** 2)))
        for name in ("edge_stress", "contact_length", "rotation")
    }
    last = float(relative("edge_stress")[-1]) if len(states) == len(exact) else None
    return {**means, "edge_case": last}


RULE = (
    "| cell | order | rule | points per facet |",
    "| {cell} | {order} | {rule} | {points_per_facet:.2f} |",
)
SECTION_ERRORS = (
    f" edge stress | contact length | rotation | at {EDGE_CASE} |",
    " {edge_stress:.3%} | {contact_length:.3%} | {rotation:.3%} | {edge_case} |",
)


def print_crack(rows: list[Row]) -> None:
    """Print a line per rule, with all stiffnesses next to each other."""
    ratios = sorted({row["stiffness"] for row in rows})
    # Rows of a rule are consecutive, with the softest joint first.
    groups = [rows[i : i + len(ratios)] for i in range(0, len(rows), len(ratios))]
    heads, cells = RULE
    for k, ratio in enumerate(ratios):
        heads += f" k_n h/E = {ratio:.0e} |"
        cells += f" {{at[{k}][deviation]:.2%}} / {{at[{k}][oscillation]:.2%}} |"
    form = f"{heads} slip error |\n{cells} {{at[{len(ratios) - 1}][slip_error]:.2%}} |"
    print("Inclined crack: largest deviation / oscillation of the normal traction, |x| <= 0.9 b")
    print(table(form, [{**group[0], "at": group} for group in groups]))


def print_section(rows: list[Row]) -> None:
    """Print a line per rule."""
    print(
        "Section without tension: errors, root mean squares over e/h = 0.20 to 0.42, and that of\n"
        f"the edge stress at e/h = {EDGE_CASE} (none: no equilibrium, the force is beyond the last "
        "point)"
    )
    last = [f"{r['edge_case']:+.1%}" if r["edge_case"] is not None else "none" for r in rows]
    shown = [row | {"edge_case": text} for row, text in zip(rows, last, strict=True)]
    form = "\n".join(map("".join, zip(RULE, SECTION_ERRORS, strict=True)))
    print(table(form, shown))


def draw(path: Path, cracks: dict[tuple[str, int, str], CrackResult], sections: list[Row]) -> None:
    """Draw tractions along the crack, and errors of the section by number of points."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9.0, 6.6), layout="constrained")
    shown = (("hex", 1), ("tet", 1), ("tet", 2))
    titles = (
        "Crack, 8-node hexahedra",
        "Crack, 4-node tetrahedra",
        "Crack, 10-node tetrahedra",
    )
    for axis, (cell, order), title in zip(axes.flat, shown, titles, strict=False):
        for name, marker, colour in (("Gauss", "x", "tab:orange"), ("nodal", "o", "tab:blue")):
            result = cracks[cell, order, name.lower()]
            axis.plot(
                result.x / CRACK.half_length,
                result.normal_traction / CRACK.normal_traction,
                marker,
                color=colour,
                markersize=5,
                markerfacecolor="none",
                label=f"{name}: {len(result.x) / result.num_facets:.1f} points per facet",
            )
        axis.axhline(1.0, color="black", linewidth=1.0, label="exact", zorder=0)
        axis.set(
            title=f"{title}, $k_n h/E = 10^6$",
            xlabel="distance from the middle x/b [-]",
            xlim=(-1.05, 1.05),
        )
        axis.set(ylabel="normal traction / exact [-]", ylim=(0.0, 2.2))
        axis.set_xticks(np.linspace(-1.0, 1.0, 5))
        axis.legend(loc="upper center", fontsize=8, frameon=False)
    draw_section(axes[1, 1], sections)
    figure.savefig(path, dpi=150)


def draw_section(axis: Any, sections: list[Row]) -> None:
    """Draw errors of the section; those of Gauss rules do not depend on the order."""
    faces = (
        ("hex", "tab:green", "quadrilaterals", (4, 9)),
        ("tet", "tab:red", "triangles", (3, 6)),
    )
    for cell, colour, face, nodes in faces:
        rows = [r for r in sections if r["cell"] == cell]
        gauss = [r for r in rows if r["rule"] != "nodal" and r["order"] == 1]
        axis.plot(
            [r["points_per_facet"] for r in gauss],
            [100 * r["edge_stress"] for r in gauss],
            "x-",
            color=colour,
            linewidth=1.0,
            markersize=5,
            label=f"{face}, Gauss, degree 2 to 12",
        )
        for number, marker, row in zip(
            nodes, ("o", "s"), (r for r in rows if r["rule"] == "nodal"), strict=True
        ):
            axis.plot(
                row["points_per_facet"],
                100 * row["edge_stress"],
                marker,
                color=colour,
                markersize=6,
                label=f"{number}-node {face}, nodal",
            )
    axis.set(title="Section without tension", xlabel="joint points per facet [-]", xscale="log")
    axis.set(ylabel="r.m.s. error of the edge stress [%]", yscale="log", ylim=(2e-3, 50.0))
    ticks = (1, 2, 5, 10, 20, 50)
    axis.set_xticks(ticks, [str(t) for t in ticks])
    axis.minorticks_off()
    axis.legend(fontsize=8, frameon=False, loc="upper right")


def main() -> None:
    """Print the tables, or one JSON object as the last line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarse meshes, less than a minute")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    parser.add_argument("--plot", type=Path, help="write a figure to this file")
    options = parser.parse_args()
    cracks, kept = crack_rows(quick=options.quick)
    sections = section_rows(quick=options.quick)
    if MPI.COMM_WORLD.rank != 0:
        return
    print_crack(cracks)
    print()
    print_section(sections)
    if options.plot:
        draw(options.plot, kept, sections)
    if options.json:
        print(json.dumps({"crack": cracks, "section": sections}))


if __name__ == "__main__":
    main()
