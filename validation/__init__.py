# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation atlas: comparisons with exact solutions, published numbers and other programs."""
