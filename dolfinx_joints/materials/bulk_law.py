# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of the body, and the protocol of those with a plastic law: arrays in, arrays out.

Stresses and strains are vectors (xx, yy, zz, yz, xz, xy), tension positive, shear strains being the
angles 2 eps_yz, ... A trial never changes the state it starts from; whoever accepts a step keeps
the state that the trial returned.
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
    """What a point of the bulk did in a step."""

    ELASTIC = 0
    YIELD = 1
    APEX = 2


@dataclass(frozen=True, kw_only=True)
class BulkState:
    """Committed state of n points of the bulk.

    Attributes:
        strain: Total strain at the last accepted step, shape (n, 6).
        plastic_strain: Its plastic part, shape (n, 6).
        accumulated: Sum of sqrt(2/3) |d eps_p| over all steps, shape (n,).
    """

    strain: Floats
    plastic_strain: Floats
    accumulated: Floats

    @classmethod
    def at_rest(cls, strain: Floats) -> BulkState:
        """State without plastic strain at a given strain, shape (n, 6)."""
        return cls(
            strain=strain.copy(),
            plastic_strain=np.zeros_like(strain),
            accumulated=np.zeros(len(strain)),
        )


@dataclass(frozen=True, kw_only=True)
class BulkResponse:
    """Answer of a law to a trial strain of n points.

    Attributes:
        stress: That acts in the step, shape (n, 6), [Pa].
        plastic_strain: Plastic strain that belongs to this stress, shape (n, 6): that of the end of
            the step, or the mean of the step where the law was asked for the whole of it.
        tangent: d stress / d strain, the strain at the end of the step, shape (n, 6, 6), [Pa].
        state: State to keep if the step is accepted.
        dissipation: Plastic work of the step per volume, shape (n,), [J/m^3]; at the end point the
            mean stress times the plastic strain of the step, as for joints.
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
    """A plastic material; implement it for a user-defined one."""

    @property
    def elastic(self) -> Elastic:
        """What the material is below its limit."""

    def backward_euler(self, strain: Floats, state: BulkState) -> BulkResponse:
        """Stress and consistent tangent at the end of a step, strain of shape (n, 6)."""

    def discrete_gradient(self, strain: Floats, state: BulkState) -> BulkResponse:
        """The same for a whole step: stress times change of strain is stored or dissipated."""


Material: TypeAlias = Elastic | Orthotropic | BulkLaw


def is_plastic(material: Material) -> bool:
    """Whether a material has a law beyond its elastic part."""
    return isinstance(material, BulkLaw)


def elastic_part(material: Material) -> Elastic | Orthotropic:
    """The material itself, or what a plastic one is below its limit."""
    return material.elastic if isinstance(material, BulkLaw) else material
