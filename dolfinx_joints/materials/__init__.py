# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of the bulk: from strain and state to stress, tangent and new state.

The materials do not use the mesh.
"""
