# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Order in which the libraries of DOLFINx's wheels from PyPI have to be loaded."""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec


def load_in_order() -> None:
    """Load h5py, then MPI, before DOLFINx where this is the wheel ``dolfinx-solver-real``.

    ``dolfinx.fem.petsc`` makes the symbols of the wheel's HDF5 global, which h5py's own library
    would then use. MPI's library, which DOLFINx and petsc4py look for, is loaded by mpi4py.

    Raises:
        ImportError: ``dolfinx.fem.petsc`` was imported before h5py.
    """
    if find_spec("dolfinx_solver") is None:
        return
    if "dolfinx.fem.petsc" in sys.modules and "h5py" not in sys.modules:
        raise ImportError(
            "dolfinx.fem.petsc was imported before h5py, which cannot work with the DOLFINx of "
            "the wheel dolfinx-solver-real, for it brings another HDF5; put 'import "
            "dolfinx_joints' (or 'import h5py') above the imports from dolfinx."
        )
    importlib.import_module("h5py")
    importlib.import_module("dolfinx_solver")
