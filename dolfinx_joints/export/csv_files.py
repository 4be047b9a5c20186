# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Export of tables to CSV files, with units in the headers.

Numbers are written with all digits, so that reading restores the same values.
"""

from __future__ import annotations

import csv
from pathlib import Path

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.parameters import cell
from dolfinx_joints.export.tables import Table, tables_of
from dolfinx_joints.export.vtk_files import check_free
from dolfinx_joints.results.reader import Results


@checked
def write_csv(results: Results, folder: str | Path, *, overwrite: bool = False) -> list[Path]:
    """Write the tables of a results file as CSV files.

    - ``stages.csv``: one row per static stage: displacements of the points relative to the
      unloaded body, reactions, recorded extreme stresses, energies and jumps;
    - ``stage_joints.csv``: one row per static stage and joint: `measures.StageJoint`, and energies
      of `measures.StageEnergy`;
    - ``histories.csv``: one row per step: displacements and raw accelerations of the points
      (relative to the ground unless called "absolute"), ground motion, joint shares, reactions;
    - ``peaks.csv``: largest displacement and acceleration of each point, largest opening and slip
      and smallest safety of each joint, with times and places;
    - ``energy.csv``: one row per step: the terms of the energy ledger;
    - ``joints.csv``: one row per joint: `measures.joint_measures` and
      `resultants.resultant_measures`;
    - ``joint_extremes.csv``: one row per joint and step: `measures.joint_extremes`;
    - ``resultants.csv``: one row per joint and record: `resultants.joint_resultants`;
    - ``blocks.csv``: one row per block and record, if recorded;
    - ``sliding.csv``: one row per sliding block and record: `sliding.BlockSliding`;
    - ``envelopes.csv``: one row per vertex, if recorded;
    - ``modes.csv``: one row per mode, for a file of modes.

    The normal force of a joint is positive in compression. Other forces are global components on
    the + side of the joint. If the flatness is below 0.95, normal and shear force are not
    meaningful, because the joint has no distinct normal.

    Args:
        results: The run.
        folder: Folder of the files; created if it is missing.
        overwrite: True to replace existing files.

    Returns:
        Paths of the files.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> monitor = dj.ResultsMonitor("blocks.h5", points={"top": (0.5, 0.5, 2.0)})
        >>> state = dj.Simulation(model, monitors=[monitor]).statics(name="weight")
        >>> [path.name for path in dj.write_csv(dj.Results("blocks.h5"), "tables")]
        ['stages.csv', 'stage_joints.csv']
    """
    folder, tables = Path(folder), tables_of(results)
    if not tables:
        raise ResultsError(f"{results.path} has no records, so there are no tables to write.")
    paths = {name: folder / f"{name}.csv" for name in tables}
    check_free(paths.values(), overwrite=overwrite)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in paths.items():
            _write(tables[name], path)
    except OSError as error:
        raise ResultsError(f"The tables cannot be written to {folder}: {error.strerror}.") from None
    return list(paths.values())


def _write(table: Table, path: Path) -> None:
    """Write a table; if this fails, no incomplete file remains."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(map(cell, row) for row in (table.header, *table.rows))
