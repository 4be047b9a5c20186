# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A comparison with numbers that may not be passed on: benchmark workshops, measured dams.

    ./with-dolfinx python3 -m validation.own_files FOLDER [--out DIRECTORY]

For those who have the files of a case, such as the ICOLD benchmark workshops, Pacoima or Morrow
Point: the folder holds a mesh, what acts and what others found. Rows, page and exit status are
those of the atlas; the page is written into the folder unless ``--out`` says where.

``case.json``, SI units, angles in degrees; what is not needed is left out:

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

- ``mesh``: Gmsh's format, groups named; groups whose name begins with ``joint`` are joints.
- ``materials``: by cell group. ``water``: pressure on a face, and Westergaard's mass when shaken.
- ``points``: the nearest node to each place is taken.
- ``modes.csv``: a line ``frequency``, then the lowest frequencies in their order [Hz].
- ``static.csv``: a line ``point,component,displacement``, then such lines, component x, y or z [m].
- ``motion.csv``: a line ``time,x,y,z``, then times [s] and ground accelerations [m/s^2]; the model
  moves along its axes. In the plane ``time,x,y``.
- ``histories.csv``: a line such as ``time,crest_x,crest_z``, then times [s] and displacements from
  the static state, relative to the ground [m].
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
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


class _Points(Monitor):
    """Displacements of nodes from the static state in all steps."""

    def __init__(self, nodes: NDArray[np.int64]) -> None:
        self._nodes = nodes

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Keep the static state."""
        self._dim, self.times, self.moved = model.gdim, [], []
        self._first = self._read(first)
        self.record(first)

    def record(self, record: Record) -> None:
        """Keep the step."""
        self.times.append(record.time)
        self.moved.append(self._read(record) - self._first)

    def _read(self, record: Record) -> Floats:
        u = record.displacement.getArray(readonly=True).reshape(-1, self._dim)
        return np.asarray(u[self._nodes])


def columns(path: Path) -> dict[str, list[str]]:
    """The columns of a CSV file by their names in its first line."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    if not rows:
        raise ValueError(f"{path} has no line below its names of columns.")
    return {name: [row[name] for row in rows] for name in rows[0]}


def build(folder: Path, case: Mapping[str, Any]) -> dj.Model:
    """The model that a case describes."""
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
        added_mass=[dj.WestergaardMass(**water)] if water else [],
    )


def compare(folder: Path) -> Outcome:
    """Run what a folder asks for."""
    case = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    model, rows = build(folder, case), []
    named = case.get("points", {})
    places = model.V.tabulate_dof_coordinates()[:, : model.gdim]
    nodes = {name: int(((places - at) ** 2).sum(axis=1).argmin()) for name, at in named.items()}
    simulation = dj.Simulation(
        model, monitors=[points := _Points(np.array([*nodes.values()], int))]
    )
    figure, ax = new_figure()

    def row(quantity: str, ours: float, theirs: float, given: Mapping[str, Any]) -> None:
        limits = {"tolerance": given["tolerance"], "reason": given["reason"]}
        rows.append(Row(quantity=quantity, ours=ours, theirs=theirs, **limits))

    if given := case.get("modes"):
        theirs = np.array(columns(folder / given["file"])["frequency"], float)
        for i, (a, b) in enumerate(
            zip(dj.modes(model.system(), len(theirs)).frequencies, theirs, strict=True), 1
        ):
            row(f"mode {i} [Hz]", float(a), float(b), given)
    state = simulation.statics() if model.loads else None
    if given := case.get("static"):
        found = columns(folder / given["file"])
        u = state.displacement.getArray(readonly=True).reshape(-1, model.gdim)  # type: ignore
        for point, axis, value in zip(
            *(found[k] for k in ("point", "component", "displacement")), strict=True
        ):
            row(
                f"{point}, {axis} [m]",
                float(u[nodes[point], "xyz".index(axis)]),
                float(value),
                given,
            )
    if given := case.get("histories"):
        motion = {name: np.array(v, float) for name, v in columns(folder / given["motion"]).items()}
        theirs = {name: np.array(v, float) for name, v in columns(folder / given["file"]).items()}
        times = theirs.pop("time")

        def ground(t: float) -> Floats:
            return np.array([np.interp(t, motion["time"], motion[c]) for c in "xyz"[: model.gdim]])

        simulation.dynamics(dt=given["dt"], steps=round(times[-1] / given["dt"]), motion=ground)
        moved = np.array(points.moved)
        for name, values in theirs.items():
            point, _, axis = name.rpartition("_")
            ours = moved[:, list(nodes).index(point), "xyz".index(axis)]
            ours = np.interp(times, points.times, ours)
            limits = {"tolerance": given["tolerance"], "reason": given["reason"]}
            rows.append(curve(name, ours, values, **limits))
            row(f"{name}, peak [m]", float(np.abs(ours).max()), float(np.abs(values).max()), given)
            (line,) = ax.plot(times, ours, label=f"{name}, ours")
            ax.plot(times, values, ":", color=line.get_color(), label=f"{name}, theirs")
        ax.set_xlabel("time [s]")
    else:
        ax.barh([each.quantity for each in rows], [100.0 * each.deviation for each in rows])
        ax.set_xlabel("deviation [%]")
    return Outcome(rows=rows, figure=figure)


def main(arguments: list[str] | None = None) -> int:
    """Compare; 1 if a deviation exceeds its tolerance."""
    parser = Parser(description="Compare with the files of a case of your own.")
    parser.add_argument("folder", type=Path, help="with case.json and the files it names")
    parser.add_argument("--out", type=Path, help="where the page goes, the folder unless given")
    options = parser.parse_args(arguments)
    if not (options.folder / "case.json").is_file():
        parser.error(f"{options.folder / 'case.json'} is not there")
    case = json.loads((options.folder / "case.json").read_text(encoding="utf-8"))
    began = processor_time()
    outcome = compare(options.folder)
    page = SimpleNamespace(__doc__=case["title"] + "\n", SOURCE=case["source"])
    seconds = processor_time() - began
    result = Result(name="page", module=page, outcome=outcome, seconds=seconds)  # type: ignore
    out = options.out or options.folder
    out.mkdir(parents=True, exist_ok=True)
    write_page(result, out)
    print(table(outcome.rows))
    return int(bool(result.wrong))


if __name__ == "__main__":
    sys.exit(main())
