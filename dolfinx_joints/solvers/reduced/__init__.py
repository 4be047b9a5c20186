# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Few shapes of a body that it moves in, and what steps in them miss."""
