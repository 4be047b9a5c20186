# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of A x + B^T (w t(B x)) = b for statics and for each time step."""
