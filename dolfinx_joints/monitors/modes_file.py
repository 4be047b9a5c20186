# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural modes as a results file."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.mpi import across, handing_out
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

    Read the arrays with ``Results(path).static("modes/shape")`` and so on, or write them as a table
    with ``dolfinx-joints csv``. ``metadata`` is further information that can be stored as JSON.

    Raises:
        ResultsError: The file exists, or cannot be written.
    """
    check_storable("metadata", metadata or {})
    unknowns = {shape.getSize() for shape in modes.shapes}
    if unknowns != {model.num_dofs}:
        raise ValueError(
            f"The modes have {max(unknowns, default=0)} unknowns, the model has {model.num_dofs}: "
            "they belong to another model."
        )
    nodes, comm = NodeNumbering(model.V), model.jointed.mesh.comm
    surface, cells = across(comm, boundary_facets(model, nodes)), body_cells(model, nodes)
    positions = nodes.across(nodes.positions)
    shapes = [nodes.across(nodes.dealt(shape)) for shape in modes.shapes]
    facts = {"stage": "modes", "modes": len(shapes), "dofs": model.num_dofs, **(metadata or {})}
    with handing_out(comm, positions, surface, cells, shapes):
        if comm.rank > 0:
            return
        with ResultsWriter(Path(path), facts, overwrite=overwrite) as writer:
            declare_body(writer, positions, surface, {}, cells)
            text = "natural frequencies, all joints closed and sticking"
            writer.static("modes/frequency", modes.frequencies, "Hz", text)
            text = "mode shapes at the nodes, of unit modal mass"
            writer.static_rows("modes/shape", shapes, "kg^-1/2", text)
            text = "participation factors per axis"
            writer.static("modes/participation", modes.participation, "kg^1/2", text)
            text = "effective modal masses per axis"
            writer.static("modes/effective_mass", modes.effective_mass, "kg", text)
            text = "effective modal masses per axis, fractions of the moving mass"
            writer.static("modes/effective_share", modes.effective_share, "-", text)
            writer.start()
            writer.finish("complete", {})
