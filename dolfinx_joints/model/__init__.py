# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Algebraic system of bulk, joints, supports and loads, and its natural modes.

The package contains no time stepping and no files.
"""
