# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stages, the only loop over steps, and restart.

Monitors watch it.
"""
