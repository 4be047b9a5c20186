# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady, seasonal and transient temperature fields, and thermal loads."""
