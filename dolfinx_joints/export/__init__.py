# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Export of results to CSV, pandas, xarray, PyVista and ParaView.

This package reads results files and does not need DOLFINx. Monitors use it to write ParaView files.
pandas, xarray and PyVista are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
