# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solver that is condensed onto the joints: compliance, residual and corrections of the joint
forces."""
