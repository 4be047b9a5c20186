# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which methods of a law are asked."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import FrictionNoTension
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.law import BACKWARD_EULER


class WithRates(FrictionNoTension):
    """Also a `RateDependentLaw`."""

    def for_step(self, dt):
        return self, dt


def test_laws_with_rates_are_asked_for_the_length_of_the_step():
    law = WithRates(normal_stiffness=1e9, shear_stiffness=1e9, friction_angle_deg=30.0)
    points = LawPoints(law, np.arange(1))
    assert points.law_over(BACKWARD_EULER.over(0.5)) == (law, 0.5)
    assert points.compiled_over(BACKWARD_EULER.over(0.5)) is None
