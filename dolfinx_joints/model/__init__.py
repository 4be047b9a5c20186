# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk, joints, supports and loads as one algebraic system, and its natural modes.

It knows no steps and no files.
"""
