# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes of which each rank has a share: partition, DOLFINx mesh, files."""
