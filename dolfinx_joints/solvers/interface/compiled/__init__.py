# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled parts of the iteration on the joint forces: products with S, GMRES, corrections."""
