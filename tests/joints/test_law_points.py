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
        return self


def test_condensed_forms_of_laws_with_rates_are_not_asked():
    """They know nothing of the length of the step: what depends on it would be lost."""
    parameters = {"normal_stiffness": 1e9, "shear_stiffness": 1e9, "friction_angle_deg": 30.0}
    laws = [kind(**parameters) for kind in (FrictionNoTension, WithRates)]
    found = [LawPoints(law, np.arange(1)).condenses(BACKWARD_EULER) for law in laws]
    assert found == [True, False]
