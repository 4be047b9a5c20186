# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural modes as a results file."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.modes import Modes
from dolfinx_joints.monitors.body_cells import body_cells
from dolfinx_joints.monitors.probes import boundary_facets
from dolfinx_joints.results.layout import declare_body
from dolfinx_joints.results.writer import ResultsWriter, check_storable


@checked
def write_modes(
    modes: Modes,
    model: Model,
    path: str | PathLike[str],
    *,
    metadata: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write frequencies, shapes, participation factors and effective masses (collective).

    Read them with ``Results(path).static("modes/shape")`` and so on; ``dolfinx-joints csv`` writes
    their table.

    Metadata are further facts, anything JSON can hold.

    Raises:
        ResultsError: The file exists, or cannot be written.
    """
    check_storable("metadata", metadata or {})
    unknowns = {shape.getSize() for shape in modes.shapes}
    if unknowns != {model.num_dofs}:
        raise ValueError(
            f"The modes have {max(unknowns, default=0)} unknowns, the model has {model.num_dofs}: "
            "they are of another model."
        )
    nodes = NodeNumbering(model.V)
    surface, cells = boundary_facets(model, nodes), body_cells(model, nodes)
    shapes = [nodes.gather(shape) for shape in modes.shapes]
    facts = {"stage": "modes", "modes": len(shapes), "dofs": model.num_dofs, **(metadata or {})}

    def write() -> None:
        with ResultsWriter(Path(path), facts, overwrite=overwrite) as writer:
            declare_body(writer, nodes.positions, surface, {}, cells)
            text = "natural frequencies, all joints closed and sticking"
            writer.static("modes/frequency", modes.frequencies, "Hz", text)
            text = "mode shapes at the nodes, of unit modal mass"
            writer.static("modes/shape", np.array(shapes), "kg^-1/2", text)
            text = "participation factors per axis"
            writer.static("modes/participation", modes.participation, "kg^1/2", text)
            text = "effective modal masses per axis"
            writer.static("modes/effective_mass", modes.effective_mass, "kg", text)
            text = "effective modal masses per axis, shares of the mass"
            writer.static("modes/effective_share", modes.effective_share, "-", text)
            writer.start()
            writer.finish("complete", {})

    on_root(model.jointed.mesh.comm, write)
