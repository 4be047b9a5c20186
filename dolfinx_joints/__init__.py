# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Seismic response of jointed structures on FEniCSx: friction no-tension joints in dams.

The public names are listed in ``__init__.pyi`` and imported on first use. ``import dolfinx_joints``
is therefore fast, and records, spectra, results and plots work without DOLFINx.
"""

import lazy_loader

from dolfinx_joints.common.import_order import load_in_order

load_in_order()

__version__ = "0.2.0"

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Import and return a public name."""
    from dolfinx_joints.common.errors import refuse_removed_name

    refuse_removed_name(name)
    return _public(name)
