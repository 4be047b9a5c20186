# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tools of the models: plane meshes, extrusion, elevations of arch dams, Gmsh and STEP files."""
