# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Comparison with data that may not be redistributed: benchmark workshops, measured dams.

    ./with-dolfinx python3 -m validation.own_files FOLDER [--out DIRECTORY]

For users who have the files of a case, such as the ICOLD benchmark workshops, Pacoima or Morrow
Point. The folder contains a mesh, the loads and the published results. Rows, page and exit status
are those of the atlas. The page is written to the folder, or to the folder of ``--out``.

``case.json`` has SI units and angles in degrees. Omit entries that are not needed:

    {
      "title": "...", "source": "...",
      "mesh": "dam.msh",
      "materials": {"concrete": {"young": 24e9, "poisson": 0.2, "density": 2400.0}},
      "fixed": ["base"],
      "joints": {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 40.0},
      "gravity": true,
      "water": {"group": "upstream", "level": 100.0},
      "damping": {"ratio": 0.05, "frequencies": [2.0, 10.0]},
      "points": {"crest": [0.0, 0.0, 103.0]},
      "modes": {"file": "modes.csv", "tolerance": 0.02, "reason": "..."},
      "static": {"file": "static.csv", "tolerance": 0.05, "reason": "..."},
      "histories": {"file": "histories.csv", "tolerance": 0.1, "reason": "...",
                    "motion": "motion.csv", "dt": 0.005}
    }

- ``mesh``: Gmsh file with named groups; groups whose names begin with ``joint`` are joints.
- ``materials``: by cell group. ``water``: pressure on a face, and Westergaard's mass in dynamics.
- ``points``: coordinates [m]; the nearest node is used.
- ``modes.csv``: header ``frequency``, then the lowest frequencies in ascending order [Hz].
- ``static.csv``: header ``point,component,displacement``, then rows with x, y or z and [m].
- ``motion.csv``: header ``time,x,y,z``, in 2-D ``time,x,y``, then times [s] and ground
  accelerations [m/s^2] along the axes of the model.
- ``histories.csv``: header such as ``time,crest_x,crest_z``, then times [s] and displacements from
  the static state, relative to the ground [m].
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record
from validation.atlas import (
    Outcome,
    Result,
    Row,
    curve,
    new_figure,
    processor_time,
    table,
    write_page,
)

Floats = NDArray[np.float64]
NEEDED = {"title", "source", "mesh", "materials", "fixed"}
KNOWN = NEEDED | {"joints", "gravity", "water", "damping", "points", "modes", "static", "histories"}


class _Points(Monitor):
    """Monitor of nodal displacements from the static state in all steps."""

    def __init__(self, nodes: NDArray[np.int64]) -> None:
        self._nodes = nodes

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Store the static state."""
        self._dim, self.times, self.moved = model.gdim, [], []
        self._first = self._read(first)
        self.record(first)

    def record(self, record: Record) -> None:
        """Store the step."""
        self.times.append(record.time)
        self.moved.append(self._read(record) - self._first)

    def _read(self, record: Record) -> Floats:
        u = record.displacement.getArray(readonly=True).reshape(-1, self._dim)
        return np.asarray(u[self._nodes])


def read_case(folder: Path) -> dict[str, Any]:
    """Read the case of a folder.

    Raises:
        ValueError: An entry is missing or unknown.
    """
    path = folder / "case.json"
    case: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    for entries, fault in (
        (NEEDED - case.keys(), "lacks"),
        (case.keys() - KNOWN, "has unknown entries:"),
    ):
        if entries:
            raise ValueError(f"{path} {fault} {', '.join(sorted(entries))}.")
    return case


def columns(path: Path) -> dict[str, list[str]]:
    """Return the columns of a CSV file by the names in its header."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    if not rows:
        raise ValueError(f"{path} has no rows below its header.")
    return {name: [row[name] for row in rows] for name in rows[0]}


def build(folder: Path, case: Mapping[str, Any]) -> dj.Model:
    """Return the model of a case."""
    jointed = dj.read_msh(folder / case["mesh"], MPI.COMM_SELF)
    water, joints, damping = (case.get(name) for name in ("water", "joints", "damping"))
    return dj.Model(
        jointed,
        material={name: dj.Elastic(**values) for name, values in case["materials"].items()},
        joints=dj.FrictionNoTension(**joints) if joints else None,
        supports=[dj.Fixed(group=name) for name in case["fixed"]],
        loads=[
            *([dj.Gravity()] if case.get("gravity") else []),
            *([dj.HydrostaticPressure(**water)] if water else []),
        ],
        damping=dj.rayleigh(**damping) if damping else None,
        water=[dj.WestergaardMass(**water)] if water else [],
    )


def compare(folder: Path, case: Mapping[str, Any]) -> Outcome:
    """Run all comparisons of a case."""
    model = build(folder, case)
    places = model.V.tabulate_dof_coordinates()[:, : model.gdim]
    nodes = {
        name: int(((places - at) ** 2).sum(axis=1).argmin())
        for name, at in case.get("points", {}).items()
    }
    points = _Points(np.array(list(nodes.values()), dtype=np.int64))
    simulation = dj.Simulation(model, monitors=[points])
    figure, ax = new_figure()
    rows = modes(model, folder, case["modes"]) if "modes" in case else []
    state = simulation.statics()
    if "static" in case:
        u = state.displacement.getArray(readonly=True).reshape(-1, model.gdim)
        rows += statics(u, nodes, folder, case["static"])
    if "histories" in case:
        rows += histories(simulation, points, list(nodes), folder, case["histories"], ax)
    else:
        ax.barh([line.quantity for line in rows], [100.0 * line.deviation for line in rows])
        ax.set_xlabel("deviation [%]")
    return Outcome(rows=rows, figure=figure)


def row(quantity: str, ours: float, theirs: float, given: Mapping[str, Any]) -> Row:
    """Return a row with the tolerance of a part of the case."""
    limits = {"tolerance": given["tolerance"], "reason": given["reason"]}
    return Row(quantity=quantity, ours=float(ours), theirs=float(theirs), **limits)


def modes(model: dj.Model, folder: Path, given: Mapping[str, Any]) -> list[Row]:
    """Compare natural frequencies."""
    theirs = np.array(columns(folder / given["file"])["frequency"], float)
    ours = dj.modes(model.system(), len(theirs)).frequencies
    pairs = enumerate(zip(ours, theirs, strict=True), 1)
    return [row(f"mode {i} [Hz]", a, b, given) for i, (a, b) in pairs]


def statics(
    u: Floats, nodes: Mapping[str, int], folder: Path, given: Mapping[str, Any]
) -> list[Row]:
    """Compare static displacements."""
    table_columns = columns(folder / given["file"])
    lines = zip(
        *(table_columns[name] for name in ("point", "component", "displacement")), strict=True
    )
    return [
        row(f"{point}, {axis} [m]", u[nodes[point], "xyz".index(axis)], float(value), given)
        for point, axis, value in lines
    ]


def histories(
    simulation: dj.Simulation,
    points: _Points,
    names: list[str],
    folder: Path,
    given: Mapping[str, Any],
    ax: Any,
) -> list[Row]:
    """Compare and draw displacement histories and their peaks."""
    motion, theirs = (
        {name: np.array(v, float) for name, v in columns(folder / given[key]).items()}
        for key in ("motion", "file")
    )
    times = theirs.pop("time")
    axes = "xyz"[: simulation.model.gdim]

    def ground(t: float) -> Floats:
        return np.array([np.interp(t, motion["time"], motion[axis]) for axis in axes])

    simulation.dynamics(dt=given["dt"], steps=round(times[-1] / given["dt"]), motion=ground)
    moved, rows = np.array(points.moved), []
    for name, values in theirs.items():
        point, _, axis = name.rpartition("_")
        ours = moved[:, names.index(point), axes.index(axis)]
        ours = np.interp(times, points.times, ours)
        limits = {"tolerance": given["tolerance"], "reason": given["reason"]}
        rows.append(curve(name, ours, values, **limits))
        rows.append(row(f"{name}, peak [m]", np.abs(ours).max(), np.abs(values).max(), given))
        (line,) = ax.plot(times, ours, label=f"{name}, ours")
        ax.plot(times, values, ":", color=line.get_color(), label=f"{name}, theirs")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("displacement [m]")
    ax.legend()
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Compare a case; return 1 if a deviation exceeds its tolerance."""
    parser = Parser(description="Compare with the files of a user-defined case.")
    parser.add_argument("folder", type=Path, help="folder with case.json and the files it names")
    parser.add_argument("--out", type=Path, help="folder of the page (default: the case's folder)")
    options = parser.parse_args(arguments)
    try:
        case = read_case(options.folder)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    began = processor_time()
    outcome = compare(options.folder, case)
    page = ModuleType("page", case["title"] + "\n")
    page.__dict__["SOURCE"] = case["source"]
    seconds = processor_time() - began
    result = Result(name="page", module=page, outcome=outcome, seconds=seconds)
    out = options.out or options.folder
    out.mkdir(parents=True, exist_ok=True)
    write_page(result, out)
    print(table(outcome.rows))
    return int(bool(result.wrong))


if __name__ == "__main__":
    sys.exit(main())
