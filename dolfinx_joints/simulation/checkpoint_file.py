# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoint files: a tree of names, numbers and arrays, written whole or not at all."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import CheckpointError
from dolfinx_joints.common.hdf5 import (
    attribute,
    check_seal,
    damage_reported,
    seal,
    set_texts,
)
from dolfinx_joints.common.parameters import check_file

FORMAT = "dolfinx_joints checkpoint"
VERSION = 1

Tree = dict[str, Any]


def write_checkpoint(path: Path, tree: Mapping[str, Any]) -> None:
    """Replace a checkpoint at once: whoever is killed on the way leaves the old one.

    Args:
        path: The file; ``PATH.part`` beside it is written first.
        tree: Names to arrays, to what JSON can hold, or to further trees.
    """
    part = path.with_name(path.name + ".part")
    try:
        content = _image(tree)
        with part.open("wb") as file:
            file.write(content)
            file.write(seal(content))
        _to_disk(part)
        part.replace(path)
        _to_disk(path.parent)
    except OSError as error:
        part.unlink(missing_ok=True)
        kept = "; the one before it is kept" if path.exists() else ""
        raise CheckpointError(f"The checkpoint {path} cannot be written: {error}{kept}.") from error


def _image(tree: Mapping[str, Any]) -> memoryview:
    """An HDF5 file of a tree, made in memory: HDF5 does not take a full disk well."""
    image, facts = io.BytesIO(), json.dumps(_without_arrays(tree))
    with h5py.File(image, "w", libver="latest") as file:
        set_texts(file, format=FORMAT)
        file.attrs["version"] = VERSION
        file.create_dataset("facts", data=np.frombuffer(facts.encode(), dtype=np.uint8))
        for name, array in _arrays(tree):
            file.create_dataset(f"arrays/{name}", data=array)
    return image.getbuffer()


def read_checkpoint(path: Path, names: Iterable[str] = ()) -> Tree:
    """The tree that was written.

    Args:
        path: The file.
        names: Names that the tree must have.
    """
    check_file(path, f"There is no checkpoint {path}.", CheckpointError)
    with damage_reported(path, CheckpointError, "is no checkpoint, or a damaged one"):
        check_seal(path)
        with h5py.File(path, "r") as file:
            version = attribute(file, "version")
            if attribute(file, "format") != FORMAT:
                raise CheckpointError(f"{path} is HDF5 but not a file of {FORMAT!r}.")
            if version != VERSION:
                raise CheckpointError(
                    f"{path} has version {version} of the layout, this program reads version "
                    f"{VERSION}."
                )
            tree: Tree = json.loads(bytes(file["facts"][()]).decode())
            _add_arrays(tree, file.get("arrays", {}))
            for name in names:
                tree[name]
            return tree


def _add_arrays(tree: Tree, group: Mapping[str, Any]) -> None:
    """Put the arrays of a group into the tree."""
    for name, item in group.items():
        if isinstance(item, h5py.Dataset):
            tree[name] = item[()]
        else:
            _add_arrays(tree[name], item)


def _arrays(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Paths and values of the arrays of a tree."""
    for name, value in tree.items():
        if isinstance(value, np.ndarray):
            yield above + name, value
        elif isinstance(value, Mapping):
            yield from _arrays(value, f"{above}{name}/")


def _without_arrays(tree: Mapping[str, Any]) -> Tree:
    """The tree without its arrays."""
    return {
        name: _without_arrays(value) if isinstance(value, Mapping) else value
        for name, value in tree.items()
        if not isinstance(value, np.ndarray)
    }


def _to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
