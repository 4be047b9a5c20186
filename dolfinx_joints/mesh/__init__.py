# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes with named groups, from Gmsh files, XDMF files, arrays or DOLFINx meshes.

This subpackage does not use the unknowns of a model; `NodeNumbering` accepts any function space.
"""
