# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""DOLFINx assembles with the facet permutations that are written into its topology.

``dS`` on joints depends on it. DOLFINx offers no function to set these codes, so this test fails
with a version in which writing them has no effect.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, GhostMode, create_box, create_rectangle

from dolfinx_joints.mesh.dolfinx_versions import facet_permutations


@pytest.mark.parametrize("kind", [CellType.triangle, CellType.tetrahedron, CellType.hexahedron])
def test_a_written_permutation_changes_what_is_assembled(kind):
    # On a facet inside the body u+ = u-, so that (u+ - u-)^2 vanishes at points that meet. With
    # the code of one side changed, u is evaluated at other points of that side.
    create, dim = (create_rectangle, 2) if kind == CellType.triangle else (create_box, 3)
    box = [np.zeros(dim), np.ones(dim)]
    mesh = create(MPI.COMM_SELF, box, [2] * dim, kind, ghost_mode=GhostMode.shared_facet)
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    u = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
    u.interpolate(lambda x: x[0] + 2.0 * x[1] + 4.0 * x[2])
    form = fem.form(ufl.jump(u) ** 2 * ufl.dS(metadata={"quadrature_degree": 3}))
    codes = facet_permutations(mesh)
    assert fem.assemble_scalar(form) < 1e-28
    links = mesh.topology.connectivity(dim - 1, dim)
    inner = next(f for f in range(links.num_nodes) if len(links.links(f)) == 2)
    cell = links.links(inner)[0]
    facets = mesh.topology.connectivity(dim, dim - 1).links(cell)
    place = len(facets) * cell + list(facets).index(inner)
    original = codes[place]
    codes[place] = original ^ 1  # a reflection of the facet
    assert fem.assemble_scalar(form) > 1e-3
    codes[place] = original
    assert fem.assemble_scalar(form) < 1e-28
