# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of the body, and the protocol of nonlinear materials: arrays in, arrays out.

Stresses and strains are vectors (xx, yy, zz, yz, xz, xy), positive in tension; shear strains are
the angles 2 eps_yz, 2 eps_xz, 2 eps_xy. A law never changes the state that it receives. It returns
the new state, which the caller keeps if the step is accepted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.materials.orthotropic import Orthotropic


class BulkStatus(IntEnum):
    """Status of a point of the bulk in a step; YIELD if any internal variable changes."""

    ELASTIC = 0
    YIELD = 1
    APEX = 2


@dataclass(frozen=True, kw_only=True)
class BulkState:
    """Committed state of n points of the bulk.

    Attributes:
        strain: Total strain at the last accepted step, shape (n, 6).
        stress: Stress at the last accepted step, shape (n, 6), [Pa].
        energy: Stored energy per volume, shape (n,), [J/m^3].
        internal: Internal variables of the law, one column per component, shape (n, m).
    """

    strain: Floats
    stress: Floats
    energy: Floats
    internal: Floats

    @classmethod
    def elastic(cls, strain: Floats, stiffness: Floats, internal: Floats) -> BulkState:
        """Return the linear elastic state at a strain (n, 6).

        The stiffness [Pa] has the shape (6, 6) or (n, 6, 6).
        """
        stress = np.einsum("...ij,...j->...i", stiffness, strain)
        return cls(
            strain=strain.copy(),
            stress=stress,
            energy=0.5 * product(stress, strain),
            internal=internal.copy(),
        )


@dataclass(frozen=True, kw_only=True)
class BulkResponse:
    """Response of a material law to a strain at n points.

    Attributes:
        stress: Stress that acts in the step, shape (n, 6), [Pa].
        tangent: d stress / d strain at the end of the step, shape (n, 6, 6), [Pa].
        state: New state, which becomes the committed state if the step is accepted.
        dissipation: Loss of the step per volume, such as plastic work, shape (n,), [J/m^3].
        numerical: Loss caused by the integration in time, shape (n,), [J/m^3]. Dissipation and
            numerical loss are the work of the step minus the change of the stored energy. For
            backward Euler the work is that of the mean of start and end stress.
        status: `BulkStatus` of each point, shape (n,).
    """

    stress: Floats
    tangent: Floats
    state: BulkState
    dissipation: Floats
    numerical: Floats
    status: NDArray[np.int8]


@runtime_checkable
class BulkLaw(Protocol):
    """Nonlinear material; `NumpyMaterial` and `UflMaterial` implement it for functions of users."""

    @property
    def elastic(self) -> Elastic | Orthotropic:
        """Elastic material for the density, the matrix K, modes and damping."""

    @property
    def internal_variables(self) -> Mapping[str, tuple[int, ...]]:
        """Shapes of the internal variables by name, in the order of their columns."""

    def initial_variables(self, sizes: Floats) -> Floats:
        """Return the internal variables at rest, (n, m); ``sizes`` are those of the cells [m]."""

    def backward_euler(self, strain: Floats, state: BulkState, dt: float = 0.0) -> BulkResponse:
        """Return stress and consistent tangent at the end of a step, strain (n, 6).

        The step takes ``dt`` seconds, zero in load ramps of ``statics``.
        """

    def discrete_gradient(self, strain: Floats, state: BulkState, dt: float = 0.0) -> BulkResponse:
        """Return a stress whose work over the step equals stored plus dissipated energy."""


Material: TypeAlias = Elastic | Orthotropic | BulkLaw


def elastic_part(material: Material) -> Elastic | Orthotropic:
    """Return an elastic material unchanged, or the elastic part of a nonlinear material."""
    return material.elastic if isinstance(material, BulkLaw) else material


def product(stress: Floats, strain: Floats) -> Floats:
    """Return stress : strain of each point, shape (n,)."""
    return np.einsum("ni,ni->n", stress, strain)
