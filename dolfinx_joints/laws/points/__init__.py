# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled answers of laws at one point, at its gap or on the compliance of the structure."""
