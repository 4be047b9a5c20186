# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The joint operator: gap = B u, force = B^T (w t); points, frames, quadrature rules, contact.

The operator does not contain friction, which is in the laws.
"""
