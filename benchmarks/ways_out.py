# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView and tables of a jointed arch dam: seconds to write them, and their size.

Writes 20 states in VTKHDF (displacement, stress and principal stresses, joints) and with DOLFINx's
VTXWriter (displacement), and then takes the results file to pandas, xarray, PyVista and VTKHDF.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from dolfinx.io import VTXWriter

import dolfinx_joints as dj
from dolfinx_joints import export
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest
from dolfinx_joints.simulation.monitor import Monitor

EVERY, STATES = 5, 20


class Timed(dj.FieldMonitor):
    """The monitor, and the seconds of its records."""

    seconds = 0.0

    def record(self, record: Any) -> None:
        """Append a time."""
        start = perf_counter()
        super().record(record)
        self.seconds += perf_counter() - start


class Vtx(Monitor):
    """DOLFINx's writer of a folder, and the seconds of its records."""

    def __init__(self, path: Path) -> None:
        """Take the folder."""
        self.path, self.seconds = path, 0.0

    def start(self, model: Any, stage: str, steps: int, first: Any) -> None:
        """Open it and write the first time."""
        self._u = model.function(first.displacement)
        self._writer = VTXWriter(model.jointed.mesh.comm, self.path, [self._u])
        self.record(first)

    def record(self, record: Any) -> None:
        """Append a time."""
        if record.step % EVERY:
            return
        start = perf_counter()
        self._u.x.array[:] = record.displacement.getArray(readonly=True)
        self._writer.write(record.time)
        self.seconds += perf_counter() - start

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close it."""
        self._writer.close()


def megabytes(*paths: Path) -> float:
    """Size of files and folders."""
    files = [f for p in paths for f in (p.rglob("*") if p.is_dir() else [p]) if f.is_file()]
    return sum(file.stat().st_size for file in files) / 1e6


def run(folder: Path, size: float, order: int) -> tuple[dj.Results, Timed, Vtx]:
    """Shake the dam while both write."""
    msh = ambiesta(folder / "dam.msh", size=size, order=order, active_height=1.0)
    model = dj.Model(
        dj.read_msh(msh, MPI.COMM_SELF),
        material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
        joints=dj.FrictionNoTension(
            normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0
        ),
        supports=[dj.Fixed(group="base"), dj.Fixed(group="abutments")],
        loads=[dj.Gravity()],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
    )
    points = {"crest": dj.Probe(mid_crest(), group="joint_6+")}
    vtk, vtx = Timed(folder / "fields.vtkhdf", every=EVERY), Vtx(folder / "fields.bp")
    monitors = [dj.ResultsMonitor(folder / "dam.h5", points=points, every=EVERY), vtk, vtx]
    simulation = dj.Simulation(model, monitors=monitors)
    simulation.statics()
    motion = dj.synthetic_motion(duration=4.0)
    simulation.dynamics(dt=1e-3, steps=EVERY * (STATES - 1), motion=motion)
    print(f"dam of degree {order}, {model.num_dofs} dofs, {STATES} states")
    return dj.Results(folder / "dam.h5"), vtk, vtx


def main() -> None:
    """Print the table."""
    parser = Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh of degree 1")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results, vtk, vtx = run(folder, *((8.0, 1) if options.quick else (4.0, 2)))
        written = [folder / "fields.vtkhdf", folder / "fields_joints.vtkhdf"]
        print(f"FieldMonitor        {vtk.seconds:8.3f} s {megabytes(*written):9.1f} MB")
        print(f"VTXWriter           {vtx.seconds:8.3f} s {megabytes(vtx.path):9.1f} MB")
        ways: dict[str, Callable[[], Any]] = {
            "to_pandas histories": lambda: export.to_pandas(results),
            "to_pandas resultants": lambda: export.to_pandas(results, "resultants"),
            "to_xarray states": lambda: export.to_xarray(results, "states"),
            "to_pyvista": lambda: export.to_pyvista(results),
            "write_vtk": lambda: export.write_vtk(results, folder / "later"),
        }
        for way, call in ways.items():
            start = perf_counter()
            call()
            print(f"{way:20}{perf_counter() - start:8.3f} s")
        results.close()


if __name__ == "__main__":
    main()
