# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports on named groups: fixed or prescribed components, springs, viscous boundaries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from dolfinx_joints.body.viscous_boundary import ViscousBoundary
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import number_at, shown
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

Stiffness = Annotated[float, at.Ge(0), at.Unit("Pa/m")]


def components_of(components: str, gdim: int) -> list[int]:
    """Numbers of the axes that letters name, each once."""
    axes = ["xyz"[:gdim].find(letter) for letter in components]
    if -1 in axes or not axes or len(set(axes)) < len(axes):
        raise ValueError(
            f"components is {shown(components)}; it must name some of {'xyz'[:gdim]!r}, each once."
        )
    return axes


@dataclass(frozen=True, kw_only=True)
@checked
class Fixed:
    """Displacement components fixed at zero on a facet group.

    Attributes:
        group: Name of the facet group.
        components: Letters of the fixed axes, all of them unless given.
    """

    group: str
    components: str | None = None

    def __post_init__(self) -> None:
        """Check the letters."""
        if self.components is not None:
            components_of(self.components, 3)


@dataclass(frozen=True, kw_only=True)
@checked
class Prescribed:
    """Displacement component given as a function of time on a facet group.

    Attributes:
        group: Name of the facet group.
        component: ``x``, ``y`` or ``z``.
        value: Displacement [m] at a time [s].
    """

    group: str
    component: Literal["x", "y", "z"]
    value: Callable[[float], float]


@dataclass(frozen=True, kw_only=True)
@checked
class Spring:
    """Distributed springs to the fixed ground on a facet group.

    Adds k_n (u.n)(v.n) + k_t (u_t . v_t) over the group to the stiffness.

    Attributes:
        group: Name of the facet group.
        normal_stiffness: k_n [Pa/m].
        tangential_stiffness: k_t [Pa/m].
    """

    group: str
    normal_stiffness: Stiffness
    tangential_stiffness: Stiffness = 0.0

    def form(self, jointed: JointedMesh, u: Any, v: Any) -> Any:
        """The bilinear form of the springs."""
        stiffness = self.normal_stiffness, self.tangential_stiffness
        # As constants, so that no other values of them are compiled anew.
        of_normal, of_tangential = (fem.Constant(jointed.mesh, float(k)) for k in stiffness)
        n = ufl.FacetNormal(jointed.mesh)
        normal = ufl.inner(u, n) * ufl.inner(v, n)
        tangential = ufl.inner(u, v) - normal
        return (of_normal * normal + of_tangential * tangential) * jointed.ds(self.group)


Support = Fixed | Prescribed | Spring | ViscousBoundary


class Constraints:
    """Constrained dofs of a space and their values in time.

    Where supports share a dof, a prescribed value goes before a fixed one, and of two prescribed
    ones the later in the list counts.

    Args:
        jointed: The mesh with its facet groups.
        V: The displacement space.
        supports: The supports; springs are ignored here.

    Attributes:
        dofs: Owned constrained dofs, local numbers, ascending, shape (n,).
        static_dofs: Likewise in static stages, which hold viscous boundaries as well.
        groups: Names of the groups with constrained dofs.

    Raises:
        ValueError: A component is unknown.
        MeshError: A facet group does not exist.
    """

    def __init__(self, jointed: JointedMesh, V: Any, supports: list[Support]) -> None:
        """Locate the dofs (collective)."""
        gdim, bs = jointed.mesh.geometry.dim, V.dofmap.index_map_bs
        owned = V.dofmap.index_map.size_local
        fixed: list[NDArray[np.int64]] = []
        held: list[NDArray[np.int64]] = []
        self._prescribed: list[tuple[NDArray[np.int64], Prescribed]] = []
        for support in supports:
            if not isinstance(support, Support):
                raise ValueError(
                    f"{shown(support)} is no support; supports are Fixed, Prescribed, Spring and "
                    "ViscousBoundary."
                )
            if isinstance(support, Spring):
                continue
            named: str | None = None
            if isinstance(support, Prescribed):
                named = support.component
            elif isinstance(support, Fixed):
                named = support.components
            components = components_of("xyz"[:gdim] if named is None else named, gdim)
            facets = jointed.facets(support.group)
            blocks = fem.locate_dofs_topological(V, jointed.mesh.topology.dim - 1, facets)
            blocks = blocks[blocks < owned].astype(np.int64)
            dofs = (bs * blocks[:, None] + components).ravel()
            if isinstance(support, Prescribed):
                self._prescribed.append((dofs, support))
            elif isinstance(support, ViscousBoundary):
                held += [dofs] if support.in_statics == "held" else []
            else:
                fixed.append(dofs)
        clamped = [s.group for s in supports if isinstance(s, Fixed | Prescribed)]
        self.groups = tuple(dict.fromkeys(clamped))
        every = [np.empty(0, dtype=np.int64), *fixed, *(dofs for dofs, _ in self._prescribed)]
        self.dofs = np.unique(np.concatenate(every))
        self.static_dofs = np.unique(np.concatenate([self.dofs, *held]))

    @property
    def moves(self) -> bool:
        """Whether any value is prescribed as a function of time."""
        return bool(self._prescribed)

    def values(self, time: float, *, static: bool = False) -> NDArray[np.float64]:
        """Displacements of `dofs`, or of `static_dofs`, at a time [s], shape (n,), [m]."""
        all_dofs = self.static_dofs if static else self.dofs
        values = np.zeros(len(all_dofs))
        for dofs, support in self._prescribed:
            name = f"The displacement {support.component} prescribed on {shown(support.group)}"
            value = number_at(name, support.value, time, unit="m")
            values[np.searchsorted(all_dofs, dofs)] = value
        return values
