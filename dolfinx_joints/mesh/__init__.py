# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes with named groups, from Gmsh files, XDMF files, arrays or DOLFINx meshes.

This subpackage does not depend on unknowns; `NodeNumbering` works with any function space.
"""
