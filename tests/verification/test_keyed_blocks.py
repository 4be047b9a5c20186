# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two blocks under their weight, the joint between them grouted under pressure.

The problem and the openings of code_aster's test SSNP143 (`validation.published.grouted_blocks`).
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from validation.published.grouted_blocks import GEFDYN, GROUT, STIFFNESS, openings

pytestmark = pytest.mark.mpi


def test_openings_under_the_grout(comm):
    height, opening, state = openings(0.5, comm=comm)
    np.testing.assert_allclose(state.joints.traction[:, 0], -GROUT, rtol=1e-9)
    # The gap counts from the grout; the opening of the blocks is in their displacement.
    np.testing.assert_allclose(state.joints.state.gap[:, 0], -GROUT / STIFFNESS, rtol=1e-9)
    found = np.interp(list(GEFDYN), height, opening)
    np.testing.assert_allclose(found, list(GEFDYN.values()), rtol=0.05)
