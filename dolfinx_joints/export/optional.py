# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Import of packages that only some exports need."""

from __future__ import annotations

import importlib
from typing import Any

_EXTRAS = {"pandas": "tables", "xarray": "tables", "pyvista": "views"}


def import_optional(package: str) -> Any:
    """Import an optional package.

    Raises:
        ImportError: The package is missing.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f"{package} is missing ({error}): pip install {package}, or install dolfinx_joints "
            f"with the extra {_EXTRAS[package]!r}."
        ) from error
