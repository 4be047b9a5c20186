# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gmsh models with named joints; each module is a script with one public function.

=====================  =========================================================
module                 model
=====================  =========================================================
``two_blocks``         two elastic blocks, one on top of the other
``jointed_wall``       a wall cut into equal blocks by vertical planes
``voussoir_arch``      a semicircular arch of voussoirs, plane or solid
``inclined_crack``     a large body with an inclined crack, plane or one cell thick
``ambiesta``           an arch dam with radial contraction joints
``sections_dam``       an arch dam from a table of horizontal sections, with a foundation
``wedge``              a box of rock with a wedge between planes of given dip and dip direction
``from_step``          the touching solids of a STEP file
``gravity_dam``        a monolith of a gravity dam with lift joints, plane or solid
=====================  =========================================================

Meshes are conforming by default. A joint is an ordinary interior surface; the physical groups
``joint_1``, ``joint_2``, ... contain its active part. `read_msh` duplicates the nodes across the
joints. With ``duplicated=True`` the file already has duplicated joint faces, the groups
``joint_1-`` and ``joint_1+``. This file imports nothing, so it needs neither Gmsh nor NumPy.
"""
