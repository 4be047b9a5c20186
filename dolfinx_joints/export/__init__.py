# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results in the forms of other programs: CSV, pandas, xarray, PyVista, ParaView.

It reads results files and knows no DOLFINx; monitors write ParaView's files through it as well.
pandas, xarray and PyVista are imported when they are asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
