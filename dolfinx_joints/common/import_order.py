# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load order of the libraries in DOLFINx's wheels from PyPI."""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec


def load_in_order() -> None:
    """Load h5py, then MPI, before DOLFINx if DOLFINx is the wheel ``dolfinx-solver-real``.

    ``dolfinx.fem.petsc`` makes the symbols of the wheel's HDF5 global, and an h5py loaded later
    would use these symbols. mpi4py loads the MPI library that DOLFINx and petsc4py need.

    Raises:
        ImportError: ``dolfinx.fem.petsc`` was imported before h5py.
    """
    if find_spec("dolfinx_solver") is None:
        return
    if "dolfinx.fem.petsc" in sys.modules and "h5py" not in sys.modules:
        raise ImportError(
            "dolfinx.fem.petsc was imported before h5py. The wheel dolfinx-solver-real contains "
            "another HDF5 library, which h5py must not use; put 'import dolfinx_joints' (or "
            "'import h5py') above the imports from dolfinx."
        )
    importlib.import_module("h5py")
    importlib.import_module("dolfinx_solver")
