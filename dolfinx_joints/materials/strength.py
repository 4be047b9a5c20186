# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strength of concrete, for checks of recorded stresses; it does not affect a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dolfinx_joints.common.declared import checked


@dataclass(frozen=True, kw_only=True)
@checked
class Strength:
    """Static strength of concrete, and the ratio of its dynamic to its static tensile strength.

    The ratio 1.5 is that of J. M. Raphael, Tensile strength of concrete, ACI Journal 81 (1984),
    158-165. Check it against the standard that applies. The compressive strength is not increased.

    Attributes:
        tensile: Static tensile strength.
        compressive: Compressive strength.
        dynamic_factor: Dynamic tensile strength divided by ``tensile``.

    Example:
        >>> import dolfinx_joints as dj
        >>> concrete = dj.Strength(tensile=2e6, compressive=25e6)
        >>> concrete.dynamic_tensile  # 1.5 x 2 MPa [Pa]
        3000000.0
    """

    tensile: Annotated[float, at.Gt(0), at.Unit("Pa")]
    compressive: Annotated[float, at.Gt(0), at.Unit("Pa")]
    dynamic_factor: Annotated[float, at.Ge(1)] = 1.5

    @property
    def dynamic_tensile(self) -> float:
        """Dynamic tensile strength [Pa]."""
        return self.dynamic_factor * self.tensile
