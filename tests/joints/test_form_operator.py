# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interior-facet integrals over joints against the joint operator B, and their signs.

Expected: the same sums over points, so differences of rounding only, 1e-13 of the largest value.
"""

from __future__ import annotations

import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from benchmarks.interface_integrals import SCENES, against_operator
from benchmarks.shared.grids import SHAPES, distorted, name_of

pytestmark = pytest.mark.mpi


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_forms_are_the_operator(shape, scene):
    """Energy, jump, force and tangent, in general position, with a law that knows no symmetry."""
    rule = "auto" if shape.degree == 1 or shape.name == "tetrahedron" else "gauss"
    found = against_operator(distorted(MPI.COMM_WORLD, shape, scene), rule)
    assert max(found.values()) <= 1e-13
