# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces, extremes, surfaces and maps of the joints of a run."""
