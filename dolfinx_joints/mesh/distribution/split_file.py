# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes in HDF5 files, from which each rank reads its share.

The file has one dataset per array of `PreparedMesh` and `JointPairs`, with the rows of all ranks.
The dataset ``facts`` has names, groups and the shape of the cells as JSON. HDF5 stores checksums of
the rows, and each rank verifies the checksums of its rows.
"""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.hdf5 import (
    attribute,
    check_superblock,
    check_version,
    damage_reported,
    set_texts,
)
from dolfinx_joints.common.mpi import blocks_of, equal_blocks, on_root, raised_together
from dolfinx_joints.common.parameters import check_file
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.distribution.shares import (
    MESH_ROWS,
    PreparedMesh,
    check_comm,
    create_jointed,
    share_of,
)
from dolfinx_joints.mesh.joint_pairs import PAIR_ROWS, JointPairs
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

FORMAT = "dolfinx_joints split mesh"
VERSION = 1

_PAIR_ROWS = tuple(name for name in PAIR_ROWS if name != "number")  # rows are sorted by it

_CHUNK = 1 << 20  # number of bytes per checksum


def write_split(path: str | Path, mesh: JointedMesh, *, overwrite: bool = False) -> None:
    """Write a split mesh to a file that any number of ranks can read (collective).

    Args:
        path: HDF5 file. ``PATH.part`` in the same folder is written first and then renamed.
        mesh: The mesh.
        overwrite: Replace an existing file.

    Raises:
        MeshError: The file exists already, or cannot be written.
    """
    comm, path = mesh.mesh.comm, Path(path)
    if on_root(comm, path.exists) and not overwrite:
        raise MeshError(f"{path} exists already; replace it by --force (overwrite=True).")
    share, part = share_of(mesh), path.with_name(f"{path.name}.part")
    arrays = _rows(share)
    blocks = {name: blocks_of(comm, len(rows)) for name, rows in arrays.items()}
    try:
        for rank in range(comm.size):  # one rank after the other
            with raised_together(comm):
                if rank == comm.rank:
                    with h5py.File(part, "r+" if rank else "w", libver="latest") as file:
                        if not rank:
                            _create(file, share, {name: ends[-1] for name, ends in blocks.items()})
                        for name, rows in arrays.items():
                            file[name][slice(*blocks[name][rank : rank + 2])] = rows
        on_root(comm, lambda: part.replace(path))
    except (OSError, RuntimeError) as error:
        if comm.rank == 0:
            with suppress(OSError):
                part.unlink()
        raise MeshError(f"{path} cannot be written: {' '.join(str(error).split())}.") from None


def _rows(share: PreparedMesh) -> dict[str, Any]:
    return {
        **{name: getattr(share, name) for name in MESH_ROWS},
        **{name: getattr(share.pairs, name) for name in _PAIR_ROWS},
    }


def _create(file: h5py.File, share: PreparedMesh, counts: dict[str, int]) -> None:
    """Write the data that are equal on all ranks, and create the datasets for the rows."""
    set_texts(file, format=FORMAT)
    file.attrs["version"] = VERSION
    pairs = share.pairs
    facts = {
        "cell": share.shape.name,
        "degree": share.shape.degree,
        "cell_groups": share.cell_groups,
        "facet_groups": share.facet_groups,
        "joints": pairs.names,
        "axes": [int(axis) for axis in pairs.axes],
        "gaps_in_geometry": bool(pairs.gaps_in_geometry),
        "bonded": pairs.bonded.tolist(),
    }
    file.create_dataset("facts", data=np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8))
    for name, rows in _rows(share).items():
        row, checked = rows.shape[1:], {}
        if counts[name]:
            chunk_rows = max(1, _CHUNK // (rows.itemsize * int(np.prod(row))))
            checked = {"chunks": (min(chunk_rows, counts[name]), *row), "fletcher32": True}
        file.create_dataset(name, (counts[name], *row), rows.dtype, **checked)


def read_split(path: str | Path, comm: Any) -> JointedMesh:
    """Read a split mesh, of which each rank stores only a part (collective).

    Args:
        path: File written by `write_split` or by the command ``dolfinx-joints split``.
        comm: MPI communicator of the mesh.

    Raises:
        MeshError: The file is missing, damaged or not a split mesh.
    """
    check_comm(comm)
    with raised_together(comm):
        share = _read(Path(path), comm.rank, comm.size)
    return create_jointed(comm, share)


def _read(path: Path, rank: int, ranks: int) -> PreparedMesh:
    check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
    check_superblock(path, MeshError)
    with damage_reported(path, MeshError, "is not a split mesh, or is damaged"):
        with h5py.File(path, "r") as file:
            if attribute(file, "format") != FORMAT:
                raise MeshError(f"{path} is an HDF5 file but not a {FORMAT!r} file.")
            check_version(version := attribute(file, "version"), VERSION)
            if version != VERSION:
                raise MeshError(
                    f"{path} has version {version} of the layout; this program reads only version "
                    f"{VERSION}."
                )
            facts = json.loads(bytes(file["facts"][()]).decode())
            counts = {name: len(file[name]) for name in (*MESH_ROWS, *_PAIR_ROWS)}
            rows = {
                name: file[name][slice(*equal_blocks(count, ranks)[rank : rank + 2])]
                for name, count in counts.items()
            }
        start, stop = equal_blocks(counts["joint"], ranks)[rank : rank + 2]
        pairs = JointPairs(
            names=tuple(facts["joints"]),
            count=counts["joint"],
            axes=tuple(facts["axes"]),
            number=np.arange(start, stop),
            gaps_in_geometry=facts["gaps_in_geometry"],
            bonded=np.array(facts["bonded"], dtype=np.int64),
            **{name: rows[name] for name in _PAIR_ROWS},
        )
        share = PreparedMesh(
            shape=CellShape(name=facts["cell"], degree=facts["degree"]),
            pairs=pairs,
            cell_groups={name: tuple(tags) for name, tags in facts["cell_groups"].items()},
            facet_groups={name: tuple(tags) for name, tags in facts["facet_groups"].items()},
            **{name: rows[name] for name in MESH_ROWS},
        )
        _check(share, counts)
    return share


def _check(share: PreparedMesh, counts: dict[str, int]) -> None:
    shape, pairs = share.shape, share.pairs
    facets, corners = shape.facet_vertices.shape
    rows = _rows(share)
    wanted = {
        "cells": (counts["cells"], shape.element().dim),
        "cell_values": (counts["cells"],),
        "facet_values": (counts["cells"], facets),
        "x": (counts["x"], shape.dim),
        "glued": (counts["x"],),
        "nodes": (counts["joint"], shape.facet_nodes.shape[1], shape.dim),
        **dict.fromkeys(("joint", "sign"), (counts["joint"],)),
        **dict.fromkeys(("minus", "plus"), (counts["joint"], 2)),
        **dict.fromkeys(("match", "minus_vertices", "plus_vertices"), (counts["joint"], corners)),
    }
    for name, needed in wanted.items():
        if (counts[name], *rows[name].shape[1:]) != needed or rows[name].dtype.kind not in "if":
            raise ValueError(f"{name} has the shape {(counts[name], *rows[name].shape[1:])}")
    limits = {
        **dict.fromkeys(("cells", "glued", "minus_vertices", "plus_vertices"), counts["x"]),
        **dict.fromkeys(("minus", "plus"), (counts["cells"], facets)),
        "match": corners,
        "joint": len(pairs.names),
    }
    for name, limit in limits.items():
        if np.any((rows[name] < 0) | (rows[name] >= limit)):
            raise ValueError(f"{name} has values out of range (0 <= value < {limit})")
