# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the joints of a run did: forces, extremes, surfaces, maps."""
