# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The discretised bulk: space, forms of K and M, nonlinear cells, supports and damping.

Loads are not part of this subpackage.
"""
