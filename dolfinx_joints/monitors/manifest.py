# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Provenance of a results file: versions, parameters, mesh, options and settings of a run."""

from __future__ import annotations

import hashlib
import platform
import re
import socket
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl

from dolfinx_joints import __version__
from dolfinx_joints.common.arrays import Floats, Ints, blocks_in
from dolfinx_joints.common.mpi import across, blocks_of, handing_out, sorted_rows
from dolfinx_joints.loads.load import always, load_names
from dolfinx_joints.results.layout import JUMP
from dolfinx_joints.results.resolved import Resolved, of_step
from dolfinx_joints.simulation.outcome import jump_text

if TYPE_CHECKING:
    from dolfinx_joints.model.model import Model
    from dolfinx_joints.simulation.record import StageRecord

# Packages whose version is read from their installed distribution.
_PACKAGES = ("numpy", "scipy", "h5py", "numba", "petsc4py", "slepc4py", "mpi4py")

_LONGEST = 1000  # Largest number of characters of a parameter.


def manifest(
    model: Model,
    settings: Mapping[str, Any],
    mesh_sha256: str,
    stages: Sequence[StageRecord],
    resolved: Resolved,
) -> dict[str, Any]:
    """Return JSON values that describe a model, its static stages and settings of the run.

    ``settings`` contains for example the time step, ``mesh_sha256`` is the result of `mesh_hash`,
    and ``resolved`` contains the highest frequencies that mesh and joints resolve.
    """
    from petsc4py import PETSc

    laws = {} if model.contact is None else model.contact.laws
    if "time step" in settings:
        resolved = resolved._replace(step=of_step(settings["time step"]))
    return {
        "versions": versions(),
        "host": socket.gethostname(),
        "system": platform.platform(),
        "command": sys.argv[:50],
        "mesh_sha256": mesh_sha256,
        "body": _body(model),
        "material": {name or "all": as_json(m) for name, m in model.body.materials.items()},
        "joint_laws": {name: as_json(law) for name, law in laws.items()},
        "loads": [as_json(load) for load in model.loads],
        "added_mass": [as_json(added) for added in model.added_mass],
        **({} if model.reservoir is None else {"reservoir": as_json(model.reservoir)}),
        "supports": [as_json(support) for support in model.supports],
        "static_stages": {stage.name: _acting(model, stage) for stage in stages},
        "damping": as_json(model.damping),
        "resolved_hz": resolved.as_json(),
        "settings": {name: as_json(value) for name, value in settings.items()},
        "petsc_options": dict(PETSc.Options().getAll()),
    }


def _body(model: Model) -> dict[str, Any]:
    """Return the degree of the elements, and in 2-D whether the model is in plane strain."""
    degree = {"degree": model.V.ufl_element().degree}
    if model.gdim == 3:
        return degree
    return degree | {"plane": "stress" if model.body.strained_axes == 2 else "strain"}


def _acting(model: Model, stage: StageRecord) -> str:
    """Return the loads of a static stage, its inactive joints, absent blocks and jumps, as text."""
    all_loads = load_names(model.loads)
    text = ", ".join(all_loads[i] for i in stage.loads) or "no loads"
    for kind, names in (("inactive", stage.state.inactive), ("absent", stage.state.absent)):
        text += f"; {kind}: {', '.join(names)}" if names else ""
    return "; ".join([text, *(JUMP + jump_text(jump) for jump in stage.state.jumps)])


def versions() -> dict[str, str]:
    """Return the versions of the packages used for computing, by name."""
    from mpi4py import MPI

    import dolfinx
    import h5py
    from petsc4py import PETSc

    numbers = {
        "dolfinx_joints": __version__,
        "python": sys.version.split()[0],
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
        "hdf5": h5py.version.hdf5_version,
        "mpi": MPI.Get_library_version().split(",")[0].strip("\0 \n"),
    }
    if "gmsh" in sys.modules:
        numbers["gmsh"] = sys.modules["gmsh"].__version__
    for package in _PACKAGES:
        try:
            numbers[package] = version(package)
        except PackageNotFoundError:
            numbers[package] = "unknown"
    return numbers


def mesh_hash(comm: Any, nodes: Floats, surface: Ints) -> str:
    """Return the SHA-256 of nodes and boundary facets; it is valid on rank 0 only (collective).

    Each rank passes its part: nodes in the order of the input mesh, shape (n, 3), [m], and vertices
    of facets in any order, shape (num_facets, 2 to 4).
    """
    blocks = blocks_of(comm, len(nodes))
    facets = sorted_rows(comm, blocks, np.sort(surface, axis=1))
    parts = [across(comm, nodes, blocks), across(comm, facets)]
    digest = hashlib.sha256()
    with handing_out(comm, parts):
        for part in parts if comm.rank == 0 else ():
            for block in blocks_in(part):
                digest.update(np.ascontiguousarray(block).tobytes())
    return digest.hexdigest()


def as_json(value: Any) -> Any:
    """Return a value for JSON: numbers and texts unchanged, other objects as their repr."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return as_json(value.item())
    text = repr(value).replace(repr(always), "constant")
    for part in getattr(value, "__dict__", {}).values():
        if isinstance(part, ufl.core.expr.Expr):  # The repr of an expression is too long.
            text = text.replace(repr(part), repr(str(part)))
    # Strip memory addresses, which change from run to run, from the repr.
    return re.sub(r" at 0x[0-9a-f]+", "", text)[:_LONGEST]
