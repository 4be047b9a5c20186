# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Readers: Gmsh and XDMF files, arrays, and DOLFINx meshes with tags."""
