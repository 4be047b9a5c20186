# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The atlas of validation: comparisons with numbers that others published, see `atlas`."""
