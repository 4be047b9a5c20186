# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports on named groups: fixed or prescribed components, springs, viscous boundaries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from itertools import combinations
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from dolfinx_joints.body.places import as_text, node_at, nodes_of_facets
from dolfinx_joints.body.quadrature import matrix_measure
from dolfinx_joints.body.viscous_boundary import ViscousBoundary
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_each, number_at, shown
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

Point = Annotated[Sequence[float], at.MinLen(2), at.MaxLen(3), at.Unit("m")]
_BY_POSITION = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)


# Smaller differences of prescribed values, relative to the largest value, are rounding error.
SAME_VALUE = 1e-9

Stiffness = Annotated[float, at.Ge(0), at.Unit("Pa/m")]


def components_of(components: str, gdim: int) -> list[int]:
    """Return the axis numbers of letters such as ``xz``; each letter may occur once."""
    axes = ["xyz"[:gdim].find(letter) for letter in components]
    if -1 in axes or not axes or len(set(axes)) < len(axes):
        raise ValueError(
            f"components is {shown(components)}; it must name some of {'xyz'[:gdim]!r}, each once."
        )
    return axes


@dataclass(frozen=True, kw_only=True)
@checked
class Fixed:
    """Displacement components fixed at zero on a facet group, or at a point.

    Attributes:
        group: Name of the facet group. For a point on a joint: name of a joint side, cell group or
            facet group that contains the node.
        components: Letters of the fixed axes (default: all axes).
        point: Coordinates of a node that is fixed instead of the whole group [m].

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base"), dj.Fixed(group="sides", components="xy")]
        >>> loads = [dj.Pressure(group="top", value=1e6)]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=loads)
        >>> state = dj.Simulation(model).statics()
        >>> round(model.resultant(state.reaction, "base")[2])  # the load on 1 m^2 [N]
        1000000
    """

    group: str | None = None
    components: str | None = None
    point: Point | None = None

    def __post_init__(self) -> None:
        """Check the letters, and that a group or point is given."""
        place_of(self)
        if self.components is not None:
            components_of(self.components, 3)


@dataclass(frozen=True, kw_only=True)
@checked
class Prescribed:
    """Displacement component prescribed as a function of time on a facet group, or at a point.

    Two Prescribed supports may share nodes and component if their values are equal there. Otherwise
    the evaluation of the values raises a ValueError.

    Attributes:
        group: Name of the facet group; for a point see `Fixed`.
        component: ``x``, ``y`` or ``z``.
        value: Displacement [m] as a function ``value(t)`` of time [s], or ``value(x, t)`` of nodes
            (n, 3), [m], and time, which returns shape (n,).
        point: Coordinates of a node that is moved instead of the whole group [m].

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=20e9, poisson=0.0, density=2400.0)
        >>> law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11)
        >>> top = dj.Prescribed(group="top", component="z", value=lambda t: -1.1e-4)  # [m]
        >>> base = [dj.Fixed(group="base"), top]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base)
        >>> state = dj.Simulation(model).statics()
        >>> round(model.resultant(state.reaction, "top")[2])  # -1.1e-4 / (2 / E + 1 / k_n) [N]
        -1000000
    """

    group: str | None = None
    component: Literal["x", "y", "z"]
    value: Callable[..., Any]
    point: Point | None = None

    def __post_init__(self) -> None:
        place_of(self)

    @property
    def varies_in_space(self) -> bool:
        """True if the value is a function of nodes and time."""
        try:
            parameters = signature(self.value).parameters.values()
        except (TypeError, ValueError):  # not a Python function
            return False
        required = [p for p in parameters if p.default is p.empty and p.kind in _BY_POSITION]
        return len(required) == 2


@dataclass(frozen=True, kw_only=True)
@checked
class Spring:
    """Distributed springs between a facet group and the fixed ground.

    The integral of k_n (u.n)(v.n) + k_t (u_t . v_t) over the group is added to the stiffness form.

    Attributes:
        group: Name of the facet group.
        normal_stiffness: k_n [Pa/m].
        tangential_stiffness: k_t [Pa/m].

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=20e9, poisson=0.0, density=2400.0)
        >>> law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11)
        >>> base = [dj.Spring(group="base", normal_stiffness=1e9, tangential_stiffness=1e9)]
        >>> loads = [dj.Pressure(group="top", value=1e6)]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=loads)
        >>> state = dj.Simulation(model).statics()
        >>> round(state.displacement.min()[1], 9)  # of the top, -p (1 / k + 2 / E + 1 / k_n) [m]
        -0.00111
    """

    group: str
    normal_stiffness: Stiffness
    tangential_stiffness: Stiffness = 0.0

    def form(self, jointed: JointedMesh, u: Any, v: Any) -> Any:
        """Return the bilinear form of the springs."""
        stiffness = self.normal_stiffness, self.tangential_stiffness
        # Constants avoid a new compilation for other values.
        of_normal, of_tangential = (fem.Constant(jointed.mesh, float(k)) for k in stiffness)
        n = ufl.FacetNormal(jointed.mesh)
        normal = ufl.inner(u, n) * ufl.inner(v, n)
        tangential = ufl.inner(u, v) - normal
        ds = matrix_measure(jointed.shape, jointed.ds(self.group))
        return (of_normal * normal + of_tangential * tangential) * ds


def place_of(support: Fixed | Prescribed) -> str:
    """Return the name of a support's place in results: a group, or coordinates of a point.

    Raises:
        ValueError: The support has neither group nor point.
    """
    group, point = support.group, support.point
    if point is None:
        if group is None:
            raise ValueError(f"{type(support).__name__}: group and point are both None; give one.")
        return group
    where = f"point ({' '.join(f'{x:g}' for x in point)})"
    return where if group is None else f"{where} of {group}"


Support = Fixed | Prescribed | Spring | ViscousBoundary


class Constraints:
    """Constrained dofs of a space, with their values as functions of time.

    If supports share a dof, Prescribed overrides Fixed; two prescribed values must be equal.

    Args:
        jointed: Mesh with its facet groups.
        V: Displacement space.
        supports: Supports; springs are ignored here.

    Attributes:
        dofs: Owned constrained dofs, local numbers, ascending, shape (n,).
        static_dofs: Owned dofs constrained in static stages, including viscous boundaries.
        groups: Names of the groups with constrained dofs.
        points: Owned nodes, local numbers, of supports at points, by `place_of`.

    Raises:
        ValueError: A component is unknown, or both Fixed by name and Prescribed at one place.
        MeshError: A group does not exist, or a point has no node or several nodes.
    """

    def __init__(self, jointed: JointedMesh, V: Any, supports: list[Support]) -> None:
        """Locate the dofs (collective)."""
        gdim, bs = jointed.mesh.geometry.dim, V.dofmap.index_map_bs
        constrained: list[tuple[str, Ints]] = []
        static_only: list[tuple[str, Ints]] = []
        self._prescribed: list[tuple[Ints, Floats, Prescribed]] = []
        self._comm, self._V, self.points = jointed.mesh.comm, V, dict[str, Ints]()
        x = V.tabulate_dof_coordinates()
        for support in supports:
            if not isinstance(support, Support):
                raise ValueError(
                    f"{shown(support)} is not a support; give Fixed, Prescribed, Spring or "
                    "ViscousBoundary."
                )
            if isinstance(support, Spring):
                continue
            letters = "xyz"[:gdim]
            if isinstance(support, Prescribed):
                letters = support.component
            elif isinstance(support, Fixed):
                letters = support.components or letters
            components = components_of(letters, gdim)
            if isinstance(support, ViscousBoundary) or support.point is None:
                nodes = nodes_of_facets(jointed, V, str(support.group))
            else:
                label, point = f"The support at {place_of(support)}", support.point
                remedy = "also give a side, for example group='joint_1+'"
                nodes = node_at(jointed, V, label, point, support.group, remedy=remedy)
                self.points[place_of(support)] = nodes
            dofs = (bs * nodes[:, None] + components).ravel()
            if isinstance(support, ViscousBoundary):
                held = support.in_statics == "held"
                static_only.append((support.group, dofs if held else dofs[:0]))
                continue
            constrained.append((place_of(support), dofs))
            if isinstance(support, Prescribed):
                self._prescribed.append((dofs, x[nodes], support))
        _check_not_both(supports)
        places = dict.fromkeys(place for place, _ in constrained)
        self.groups = tuple(place for place in places if place not in self.points)
        # First support that constrains each owned dof, or -1; viscous boundaries come last.
        self._names = [*(places | dict.fromkeys(place for place, _ in static_only))]
        self._first = np.full((V.dofmap.index_map.size_local, bs), -1)
        for place, dofs in reversed(constrained + static_only):
            self._first.flat[dofs] = self._names.index(place)
        parts = [np.empty(0, dtype=np.int64), *(dofs for _, dofs in constrained)]
        self.dofs = np.unique(np.concatenate(parts))
        self._shared = self._shared_dofs()
        self.static_dofs = np.unique(np.concatenate([self.dofs, *(d for _, d in static_only)]))

    @property
    def moves(self) -> bool:
        """True if a displacement is prescribed."""
        return bool(self._prescribed)

    def counts(self, group: str, nodes: Ints) -> NDArray[np.bool_]:
        """Return False for forces at a group's nodes that count in another support, (n, gdim)."""
        first = self._first[nodes]
        own = self._names.index(group) if group in self._names else first
        return (first == own) | (first == -1)

    def values(self, time: float, *, static: bool = False) -> NDArray[np.float64]:
        """Return the displacements (n,) [m] of `dofs` or `static_dofs` at a time [s] (collective).

        Raises:
            ValueError: Two supports prescribe different values at the same dof.
        """
        all_dofs = self.static_dofs if static else self.dofs
        values = np.zeros(len(all_dofs))
        prescribed: list[Floats] = []
        for dofs, x, support in self._prescribed:
            name = f"The displacement {support.component} prescribed on {shown(place_of(support))}"
            value: float | Floats
            if support.varies_in_space:
                with raised_together(self._comm):
                    result = support.value(x, time) if len(x) else np.zeros(0)
                    value = check_each(f"{name} at t = {time:g} s", result, len(x))
            else:
                value = number_at(name, support.value, time, unit="m")
            prescribed.append(np.broadcast_to(value, len(dofs)))
            values[np.searchsorted(all_dofs, dofs)] = value
        self._check_shared(prescribed, time)
        return values

    def _shared_dofs(self) -> list[tuple[int, int, Ints, Ints]]:
        """Find pairs of prescribed supports that share dofs on any rank (collective).

        A pair has the numbers of both supports and the positions of the shared dofs in both.
        """
        pairs = []
        for (i, (one, *_)), (j, (other, *_)) in combinations(enumerate(self._prescribed), 2):
            _, at_one, at_other = np.intersect1d(one, other, return_indices=True)
            if any(self._comm.allgather(len(at_one))):
                pairs.append((i, j, at_one, at_other))
        return pairs

    def _check_shared(self, prescribed: list[Floats], time: float) -> None:
        """Check that prescribed values are equal where supports share dofs (collective)."""
        for i, j, at_one, at_other in self._shared:
            scale = max(float(np.abs(prescribed[k]).max(initial=0.0)) for k in (i, j))
            values = np.column_stack([prescribed[i][at_one], prescribed[j][at_other]])
            largest = np.argsort(np.abs(values @ [1.0, -1.0]))[-1:]  # empty without shared dofs
            places = self._prescribed[i][1][at_one[largest]]
            from_ranks = self._comm.allgather((scale, [*zip(values[largest], places, strict=True)]))
            shared = [pair for _, pairs in from_ranks for pair in pairs]
            (one, other), place = max(shared, key=lambda pair: abs(pair[0][0] - pair[0][1]))
            if abs(one - other) <= SAME_VALUE * max(scale for scale, _ in from_ranks):
                continue
            supports = [self._prescribed[k][2] for k in (i, j)]
            groups = " and ".join(shown(place_of(support)) for support in supports)
            raise ValueError(
                f"The supports on {groups} both prescribe the displacement "
                f"{supports[0].component} at {as_text(place, self._V)}, which is {one:.10g} m and "
                f"{other:.10g} m at t = {time:g} s; make the values equal there, or remove "
                "the shared nodes from one of the groups."
            )


def _check_not_both(supports: Sequence[Support]) -> None:
    """Check that no component at one place is both fixed by name and prescribed."""
    fixed = [s for s in supports if isinstance(s, Fixed)]
    fixed_by_name = {(place_of(s), component) for s in fixed for component in s.components or ""}
    for motion in supports:
        if isinstance(motion, Prescribed) and (place_of(motion), motion.component) in fixed_by_name:
            label = f"The displacement {motion.component} on {shown(place_of(motion))}"
            raise ValueError(f"{label} is both Fixed and Prescribed; give one of them.")
