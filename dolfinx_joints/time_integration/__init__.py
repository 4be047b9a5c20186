# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time schemes, division of steps into substeps, and the energy ledger; no files."""
