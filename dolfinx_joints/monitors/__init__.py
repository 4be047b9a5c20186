# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Observers of a run, which write files or show progress; they do not affect the solution."""
