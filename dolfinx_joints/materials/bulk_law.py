# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of the body, and the protocol of plastic materials: arrays in, arrays out.

Stresses and strains are vectors (xx, yy, zz, yz, xz, xy), positive in tension; shear strains are
the angles 2 eps_yz, 2 eps_xz, 2 eps_xy. A law never changes the state that it receives. It returns
the new state, which the caller keeps if the step is accepted.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.materials.orthotropic import Orthotropic


class BulkStatus(IntEnum):
    """Status of a point of the bulk in a step."""

    ELASTIC = 0
    YIELD = 1
    APEX = 2


@dataclass(frozen=True, kw_only=True)
class BulkState:
    """Committed state of n points of the bulk.

    Attributes:
        strain: Total strain at the last accepted step, shape (n, 6).
        plastic_strain: Plastic part of the strain, shape (n, 6).
        accumulated: Sum of sqrt(2/3) |d eps_p| over all steps, shape (n,).
    """

    strain: Floats
    plastic_strain: Floats
    accumulated: Floats

    @classmethod
    def at_rest(cls, strain: Floats) -> BulkState:
        """Return the state without plastic strain at a given strain, shape (n, 6)."""
        return cls(
            strain=strain.copy(),
            plastic_strain=np.zeros_like(strain),
            accumulated=np.zeros(len(strain)),
        )


@dataclass(frozen=True, kw_only=True)
class BulkResponse:
    """Response of a material law to a strain at n points.

    Attributes:
        stress: Stress that acts in the step, shape (n, 6), [Pa].
        plastic_strain: Plastic strain of this stress, shape (n, 6): at the end of the step, or the
            mean over the step for `BulkLaw.discrete_gradient`.
        tangent: d stress / d strain at the end of the step, shape (n, 6, 6), [Pa].
        state: New state, which becomes the committed state if the step is accepted.
        dissipation: Plastic work of the step per volume, shape (n,), [J/m^3]; for backward Euler
            the mean of start and end stress times the plastic strain increment.
        status: `BulkStatus` of each point, shape (n,).
    """

    stress: Floats
    plastic_strain: Floats
    tangent: Floats
    state: BulkState
    dissipation: Floats
    status: NDArray[np.int8]


@runtime_checkable
class BulkLaw(Protocol):
    """Plastic material; implement this protocol for a user-defined material."""

    @property
    def elastic(self) -> Elastic:
        """Elastic part of the material."""

    def backward_euler(self, strain: Floats, state: BulkState) -> BulkResponse:
        """Return stress and consistent tangent at the end of a step, strain (n, 6)."""

    def discrete_gradient(self, strain: Floats, state: BulkState) -> BulkResponse:
        """Return a stress whose work over the step equals stored plus dissipated energy."""


Material: TypeAlias = Elastic | Orthotropic | BulkLaw


def is_plastic(material: Material) -> bool:
    """Return True if a material is plastic."""
    return isinstance(material, BulkLaw)


def elastic_part(material: Material) -> Elastic | Orthotropic:
    """Return an elastic material unchanged, or the elastic part of a plastic material."""
    return material.elastic if isinstance(material, BulkLaw) else material
