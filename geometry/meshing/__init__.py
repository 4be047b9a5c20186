# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shared by the models: plane meshes and their extrusion, arch dams in elevation, Gmsh, STEP."""
