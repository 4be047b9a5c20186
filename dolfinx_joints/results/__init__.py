# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files: written step by step, readable during a run and after a run was killed.

This package handles HDF5, names, units and shapes. It needs neither a model nor DOLFINx.
"""
