# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables as CSV files, units in the headers.

Numbers are written with all their digits: read back, they are the same.
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
    """Write what a results file holds as CSV files.

    - ``stages.csv``: a row per static stage, displacements of the points from the unloaded body,
      reactions, extremes of the stresses where they were recorded, energies and jumps;
    - ``stage_joints.csv``: a row per static stage and joint, `measures.StageJoint`, and energies
      of `measures.StageEnergy`;
    - ``histories.csv``: every step, displacements and raw accelerations of the points, relative to
      the ground unless they are called absolute, the ground's motion, shares of joint points,
      reactions;
    - ``peaks.csv``: the largest displacement and acceleration of each point, opening and slip of
      each joint, the smallest safety, with times and places;
    - ``energy.csv``: every step, the lines of the ledger;
    - ``joints.csv``: one row per joint, `measures.joint_measures` and
      `resultants.resultant_measures`;
    - ``joint_extremes.csv``: a row per joint and record of `measures.joint_extremes`: every step;
    - ``resultants.csv``: a row per joint and record of `resultants.joint_resultants`;
    - ``blocks.csv``: a row per block and record, where the run recorded them;
    - ``envelopes.csv``: a row per vertex, where the run recorded them;
    - ``modes.csv``: a row per mode, of a file of modes.

    The normal force of a joint is positive where it presses, other forces are global components
    on its + side. Where the flatness of a joint is below 0.95 its mean normal, and with it its
    normal and its shear force, say little.

    Args:
        results: The run.
        folder: Where to; made if it is missing.
        overwrite: Replace files of these names.

    Returns:
        The files written.
    """
    folder, tables = Path(folder), tables_of(results)
    if not tables:
        raise ResultsError(f"{results.path} holds no records, so there are no tables to write.")
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
    """Write a table whole or not at all."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(map(cell, row) for row in (table.header, *table.rows))
