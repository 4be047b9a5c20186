# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a Gmsh file or a DOLFINx mesh to a split mesh with named groups.

It knows no unknowns; `NodeNumbering` takes the nodes of any function space.
"""
