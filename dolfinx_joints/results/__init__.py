# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files: written step by step, read while they grow and after a run was killed.

They know HDF5, names, units and shapes, but neither a mesh nor a model, and work without DOLFINx.
"""
