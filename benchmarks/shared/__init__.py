# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shared code of the benchmarks: scenes, problems with known motions, clocks."""
