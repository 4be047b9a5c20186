# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solver condensed onto the joints: residual and corrections of the joint forces."""
