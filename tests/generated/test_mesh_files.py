# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh files and STEP files: junk and changed good files, on all ranks alike.

What is taken is a mesh of finite nodes with cells of positive size in its groups.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from bad_files import mesh_door
from generated_input import answer, costly
from hypothesis import given
from mutations import SEEDS, changed_bytes, changed_text, junk
from test_step import write_step
from test_gmsh_file import old_version

import dolfinx_joints as dj
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import on_root
from geometry import _base
from geometry.from_step import from_step

BOXES = {"rock": (0, 0, 0, 4000, 2000, 3000), "pier": (1000, 0, 3000, 2000, 2000, 5000)}


def as_text(source: Path, path: Path) -> None:
    """A mesh file of version 4.1 without binary numbers."""
    with _base.gmsh_session():
        gmsh.merge(str(source))
        gmsh.option.setNumber("Mesh.Binary", 0)
        gmsh.write(str(path))


@pytest.fixture(scope="module")
def good(
    comm: Any, new_path: Callable[[str], Path], blocks_file: Callable[..., Path]
) -> Callable[[str], bytes]:
    """What good files of each kind hold (collective)."""
    source, text = blocks_file(size=1.0), new_path("text.msh")
    on_root(comm, lambda: as_text(source, text))
    contents = {"binary": source.read_bytes(), "text": text.read_bytes()}
    for name, binary in (("2.2 text", 0), ("2.2 binary", 1)):
        old, lines = new_path("old.msh"), contents["text"].decode().split("\n")

        def write(old: Path = old, lines: list[str] = lines, binary: int = binary) -> None:
            old_version(old, lines, binary)

        on_root(comm, write)
        contents[name] = old.read_bytes()
    contents["one cell"] = str(mesh_door().good).encode()
    step = new_path("good.step")
    on_root(comm, lambda: write_step(step, BOXES) and None)
    contents["STEP"] = step.read_bytes()
    return lambda kind: contents[kind]


def put(comm: Any, path: Path, content: bytes) -> Path:
    """Write a file that all ranks see (collective)."""
    on_root(comm, lambda: path.write_bytes(content))
    return path


def check_mesh(comm: Any, door: str, path: Path) -> None:
    jointed = answer(door, lambda: dj.read_msh(path, comm), MeshError, comm)
    if jointed is not None:
        assert np.isfinite(jointed.mesh.geometry.x).all()
        assert jointed.mesh.topology.index_map(jointed.mesh.topology.dim).size_global > 0


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["binary", "text", "2.2 text", "2.2 binary", "one cell"])
@costly()
@given(seed=SEEDS)
def test_changed_meshes(
    comm: Any, new_path: Any, good: Callable[[str], bytes], kind: str, seed: int
) -> None:
    change = changed_bytes if kind in ("binary", "2.2 binary") else changed_text
    content = good(kind) if change is changed_bytes else good(kind).decode()
    path = put(comm, new_path("FILE.msh"), change(seed, content))
    check_mesh(comm, f"mesh, changed {kind}", path)


@pytest.mark.mpi
@costly()
@given(seed=SEEDS)
def test_junk_meshes(comm: Any, new_path: Any, good: Callable[[str], bytes], seed: int) -> None:
    path = put(comm, new_path("FILE.msh"), junk(seed, good("text")))
    check_mesh(comm, "mesh, junk", path)


def check_step(door: str, path: Path) -> None:
    # Gmsh may fail to mesh what the file holds, which is no fault of the file's form.
    out = path.with_suffix(".msh")
    made = answer(door, lambda: from_step(out, path, size=2.0, order=1), (ValueError, RuntimeError))
    if made is not None:
        assert made.stat().st_size > 0


@costly()
@given(seed=SEEDS)
def test_changed_step(new_path: Any, good: Callable[[str], bytes], seed: int) -> None:
    path = new_path("FILE.step")
    path.write_bytes(changed_text(seed, good("STEP").decode()))
    check_step("STEP, changed", path)


@costly()
@given(seed=SEEDS)
def test_junk_step(new_path: Any, good: Callable[[str], bytes], seed: int) -> None:
    path = new_path("FILE.step")
    path.write_bytes(junk(seed, good("STEP")))
    check_step("STEP, junk", path)
