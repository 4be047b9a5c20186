# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions: read records, process them, match them to spectra. Works without DOLFINx."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["spectra"])
