# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoint files: a tree of names, numbers and arrays, written completely or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Dealt
from dolfinx_joints.common.errors import CheckpointError
from dolfinx_joints.common.hdf5 import (
    attribute,
    check_seal,
    check_version,
    damage_reported,
    new_file,
    seal,
    set_texts,
)
from dolfinx_joints.common.mpi import equal_blocks
from dolfinx_joints.common.parameters import check_file
from dolfinx_joints.results.stream import write_whole

FORMAT = "dolfinx_joints checkpoint"
VERSION = 6

_MORE_BYTES = 1 << 12  # HDF5's metadata of an array.

Tree = dict[str, Any]


def write_checkpoint(path: Path, tree: Mapping[str, Any]) -> None:
    """Replace a checkpoint in one operation, so that a killed run leaves the old or new file.

    ``PATH.part`` is written first. A tree contains, by name, arrays (also distributed over ranks),
    values that can be stored as JSON, and subtrees.
    """
    part = path.with_name(path.name + ".part")
    try:
        _write_tree(part, tree)
        checksum = seal(part)
        with part.open("ab") as file:
            file.write(checksum)
        _to_disk(part)
        part.replace(path)
        _to_disk(path.parent)
    except OSError as error:
        part.unlink(missing_ok=True)
        kept = "; the previous checkpoint is kept" if path.exists() else ""
        raise CheckpointError(f"The checkpoint {path} cannot be written: {error}{kept}.") from error


def _write_tree(path: Path, tree: Mapping[str, Any]) -> None:
    """Write a tree as HDF5."""
    facts = np.frombuffer(json.dumps(_without_arrays(tree)).encode(), dtype=np.uint8)
    arrays = list(_arrays(tree))
    size = sum(int(np.prod(array.shape)) * array.dtype.itemsize for _, array in arrays)
    size += facts.nbytes + _MORE_BYTES * (1 + len(arrays))
    with new_file(path, size, libver="latest") as file:
        set_texts(file, format=FORMAT)
        file.attrs["version"] = VERSION
        file.create_dataset("facts", data=facts)
        for name, array in arrays:
            dataset = file.create_dataset(f"arrays/{name}", array.shape, array.dtype)
            if isinstance(array, Dealt):
                dataset.attrs["dealt"] = 1
            write_whole(dataset, array)


def read_checkpoint(
    path: Path, names: Iterable[str] = (), *, rank: int = 0, ranks: int = 1
) -> Tree:
    """Return the tree of a checkpoint, with the rows of ``rank`` for distributed arrays.

    The tree must contain ``names``. Only rank 0 checks that the file is complete.
    """
    check_file(path, f"There is no checkpoint {path}.", CheckpointError)
    with damage_reported(path, CheckpointError, "is not a checkpoint, or is damaged"):
        if rank == 0:
            check_seal(path)
        with h5py.File(path, "r") as file:
            version = attribute(file, "version")
            if attribute(file, "format") != FORMAT:
                raise CheckpointError(f"{path} is HDF5 but not a file of {FORMAT!r}.")
            check_version(version, VERSION)
            if version != VERSION:
                raise CheckpointError(
                    f"{path} has the layout version {version}; this program reads version "
                    f"{VERSION}."
                )
            tree: Tree = json.loads(bytes(file["facts"][()]).decode())
            _add_arrays(tree, file.get("arrays", {}), rank, ranks)
            for name in names:
                tree[name]
            return tree


def _add_arrays(tree: Tree, group: Mapping[str, Any], rank: int, ranks: int) -> None:
    """Insert the arrays of a group into the tree."""
    for name, item in group.items():
        if not isinstance(item, h5py.Dataset):
            _add_arrays(tree[name], item, rank, ranks)
        elif attribute(item, "dealt"):
            tree[name] = item[slice(*equal_blocks(len(item), ranks)[rank:][:2])]
        else:
            tree[name] = item[()]


def _arrays(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, NDArray[Any] | Dealt]]:
    """Yield paths and values of the arrays of a tree."""
    for name, value in tree.items():
        if isinstance(value, np.ndarray | Dealt):
            yield above + name, value
        elif isinstance(value, Mapping):
            yield from _arrays(value, f"{above}{name}/")


def _without_arrays(tree: Mapping[str, Any]) -> Tree:
    """Return the tree without its arrays."""
    return {
        name: _without_arrays(value) if isinstance(value, Mapping) else value
        for name, value in tree.items()
        if not isinstance(value, np.ndarray | Dealt)
    }


def _to_disk(path: Path) -> None:
    """Wait until a file, or the entries of a directory, are on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
