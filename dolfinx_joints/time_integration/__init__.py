# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time schemes as data, substeps and the energy ledger.

They know no files.
"""
