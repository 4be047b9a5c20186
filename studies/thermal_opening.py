# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint opening in winter followed by an earthquake: the 1992 paper's dam, with an empty basin.

    ./with-dolfinx python3 -m studies.thermal_opening                      # synthetic motion
    ./with-dolfinx python3 -m studies.thermal_opening --record DIRECTORY   # three AT2 files
    ./with-dolfinx python3 -m studies.thermal_opening --quick              # two seconds

The blocks carry their weight alone and the joints are grouted at the closure temperature. Then the
whole dam cools, and the ground shakes. The earthquake is also run without cooling. The program
prints the largest opening of each joint before and after cooling, and during and after the shaking.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import check_number
from dolfinx_joints.postprocessing import measures, plots
from studies.ambiesta import ALL_STEPS, Case, Finished, build, make_mesh, simulate
from studies.figures import shown_joint

EXPANSION = 1e-5  # of concrete, 1/K
CLOSURE = 10.0  # degrees C; only differences from it matter
TAIL = 1.0  # s at the end over which openings are averaged
STAGES = ("grouted", "cold", "shaking", "after")
QUICK = {"size": 10.0, "steps": 410}


@dataclass(frozen=True, kw_only=True)
class Openings:
    """Largest opening of the points of each joint.

    Attributes:
        joints: Names of the joints.
        values: Shape (joints, 4): grouted under self weight, after cooling, at any time of the
            shaking, and in the mean of its last second [m].
    """

    joints: tuple[str, ...]
    values: NDArray[np.float64]


def run(case: Case, cooling: float, folder: Path) -> Finished:
    """Cool the dam after grouting, then run the earthquake (collective).

    Args:
        case: The case, with ``self_weight="grouted"``.
        cooling: Decrease of the temperature [K].
        folder: Output folder.
    """
    cold = dj.Temperature(value=CLOSURE - cooling, reference=CLOSURE, expansion=EXPANSION)
    mesh = make_mesh(case, folder)
    model = build(case, "joints", mesh, loads=[cold] if cooling else [])
    return simulate(case, "joints", model, folder)


def openings(results: dj.Results, warm: dj.Results) -> Openings:
    """Return the openings from results files whose first states are the dam at rest.

    Args:
        results: A run.
        warm: The run without cooling.
    """
    names = tuple(results.joints)
    rows = []
    for name in names:
        time, opening, _ = measures.joint_history(results, name)
        before = measures.joint_history(warm, name)[1][0].max()
        late = opening[time >= time[-1] - TAIL].mean(axis=0)
        rows.append([before, opening[0].max(), opening.max(), late.max()])
    return Openings(joints=names, values=np.array(rows))


def print_table(title: str, table: Openings) -> None:
    """Print the openings of all joints in mm."""
    print(f"{title}\nlargest opening [mm]" + "".join(f"{stage:>10}" for stage in STAGES))
    for name, row in zip(table.joints, 1e3 * table.values, strict=True):
        print(f"{name:<20}" + "".join(f"{value:10.2f}" for value in row))
    most = 1e3 * table.values.max(axis=0)
    print(f"{'all':<20}" + "".join(f"{value:10.2f}" for value in most) + "\n", flush=True)


def draw(cold: dj.Results, warm: dj.Results, cooling: float, path: Path) -> Path:
    """Draw openings by joint and stage, and histories of the middle joint with and without cold."""
    from matplotlib import pyplot as plt

    figure, (bar_axes, time_axes) = plt.subplots(1, 2, figsize=(10.0, 3.8), layout="constrained")
    table = openings(cold, warm)
    place = np.arange(len(table.joints))
    for k, (stage, color) in enumerate(zip(STAGES[1:], ("C0", "C3", "C7"), strict=True)):
        heights = 1e3 * table.values[:, k + 1]
        bar_axes.bar(place + 0.27 * (k - 1), heights, 0.27, label=stage, color=color)
    bar_axes.set_xticks(place, [name.removeprefix("joint_") for name in table.joints])
    bar_axes.set(xlabel="joint", ylabel="largest opening [mm]")
    bar_axes.set_title(f"cooled by {cooling:g} K", loc="left")
    bar_axes.legend(frameon=False)
    name = shown_joint(cold)
    runs = ((cold, f"cooled by {cooling:g} K", "C0"), (warm, "not cooled", "C1"))
    for results, label, color in runs:
        time, opening, _ = measures.joint_history(results, name)
        time_axes.plot(time, 1e3 * opening.max(axis=1), color=color, lw=0.8, label=label)
    time_axes.set(xlabel="time [s]", ylabel="largest opening [mm]")
    time_axes.set_title(name.replace("_", " "), loc="left")
    time_axes.legend(frameon=False)
    return plots.save(figure, path)


def main(arguments: list[str] | None = None) -> None:
    """Run both cases, print and draw the openings."""
    parser = Parser(description="Thermal opening of the joints, then earthquake.")
    parser.add_argument("--record", help="folder with three AT2 files (default: synthetic motion)")
    parser.add_argument("--out", type=Path, default=Path("output/thermal_opening"))
    parser.add_argument("--cooling", type=float, default=8.0, help="temperature decrease [K]")
    parser.add_argument("--size", type=float, default=8.0, help="cell size [m]")
    parser.add_argument(
        "--steps", type=at_least(1), default=ALL_STEPS, help="time steps of 0.00488 s"
    )
    parser.add_argument(
        "--active-height", type=float, default=0.75, help="relative height of the joints' top"
    )
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and two seconds")
    options = parser.parse_args(arguments)
    check_number("cooling", options.cooling, lambda v: v > 0, "positive", unit="K")
    case = Case(
        size=options.size,
        steps=options.steps,
        record_folder=options.record,
        active_height=options.active_height,
        self_weight="grouted",
    )
    case = replace(case, **QUICK) if options.quick else case
    cold = run(case, options.cooling, options.out / "cold")
    warm = run(case, 0.0, options.out / "warm")
    on_root(MPI.COMM_WORLD, lambda: show(cold, warm, options))


def show(cold: Finished, warm: Finished, options: Any) -> None:
    """Print the tables and draw the figure."""
    with dj.Results(cold.results) as one, dj.Results(warm.results) as other:
        print_table(f"cooled by {options.cooling:g} K after grouting", openings(one, other))
        print_table("not cooled", openings(other, other))
        picture = draw(one, other, options.cooling, options.out / "thermal_opening.png")
    print(f"{cold.report}\n{picture}")


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    try:
        main()
    except (dj.JointsError, ValueError) as error:
        if MPI.COMM_WORLD.rank == 0:
            print(f"studies.thermal_opening: {error}", file=sys.stderr)
        raise SystemExit(2) from None
