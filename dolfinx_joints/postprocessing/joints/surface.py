# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drawing data of a joint: the patch of each point in a plane, its values and colours."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.joints.extremes import (
    mobilised_friction,
    open_points,
    state_points,
    strength_of,
)
from dolfinx_joints.postprocessing.joints.unrolled import Unrolled, tangent_axes, unrolled
from dolfinx_joints.postprocessing.palette import OPEN, colour_limits, colours, signed_colours
from dolfinx_joints.results.arguments import chosen_state
from dolfinx_joints.results.joint_points import Statics, gaps, since, tied_points
from dolfinx_joints.results.quantities import TABLE
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap

Quantity = Literal["normal", "tangential", "mobilised"]
Largest = Literal[
    "largest_opening", "largest_slip", "largest_pressure", "largest_tension", "largest_shear"
]
MapQuantity = Literal[Quantity, "opening", "slip", "state", Largest]
# Rows of the stream ``joint_maxima`` by quantity.
OVER_RUN = {f"largest_{row.key}": row for row in TABLE["joint_maxima"] if row.label}

MAP_LABELS = {
    "normal": r"normal traction $t_n$ [MPa], tension $> 0$",
    "tangential": r"tangential traction $|t_s|$ [MPa]",
    "mobilised": r"mobilised friction $|t_s|/(\mu p + c)$ [-]",
    "opening": "opening [mm]",
    "slip": "tangential gap [mm]",
    "state": "state of the points",
    **{name: row.heading for name, row in OVER_RUN.items()},
}
_ELEVATION = "elevation [m]"
# Tolerance in reference coordinates: a corner closer to the bisector of two points counts as on the
# bisector, so that rounding errors do not assign it to either side.
ON_BISECTOR = 1e-9
# Least squared length of the mean normal of a flat joint, whose normals are within 27 degrees.
_FLAT = 0.8

# States in the order of their numbers in the file. Tied points have one colour in all maps.
STATES = {
    "open": OPEN,
    "sticking": "#9ecae1",
    "sliding": "#e6550d",
    "closed without friction": "#756bb1",
}


def is_plane(results: Statics) -> bool:
    """Return True if the body is plane, which means that its boundary consists of lines."""
    return results.static("mesh/surface").shape[1] == 2


class JointFacets:
    """Facets of a joint in 3-D, divided into one patch per joint point.

    Attributes:
        tied: Flags of the tied points, shape (n,).
        corners: Corners of the facets, shape (facets, 3 or 4, 3), [m].
        facet_of_point: Number of each point's facet, shape (n,).
    """

    def __init__(self, results: Statics, joint: str) -> None:
        points = results.static(f"joints/{joint}/points")
        self.tied = tied_points(results, joint)
        self.facet_of_point, self._both = facets_of_joint(results, joint)
        self._positions = results.static("mesh/nodes")
        self._surface = results.static("mesh/surface")
        if self._surface.shape[1] < 3:
            raise ValueError(
                f"The joint {joint!r} is a line of a plane model and has no map; "
                "plots.joint_profiles shows values along it."
            )
        self.corners: Floats = self._positions[self._surface[self._both[:, 0]]]
        axes = tangent_axes(self.corners)
        shape = _Bilinear(np.einsum("fci,fki->fck", self.corners, axes))
        own = np.einsum("pi,pki->pk", points, axes[self.facet_of_point])
        self._local = shape.inverse(own, self.facet_of_point)

    def nodes(self) -> Ints:
        """Return the node numbers on both sides of each corner, shape (facets, 3 or 4, 2)."""
        numbers = self._surface[self._both]  # (facets, sides, corners)
        places = self._positions[numbers][:, :, None] - self.corners[:, None, :, None]
        nearest = np.linalg.norm(places, axis=-1).argmin(axis=-1)
        pairs: Ints = np.take_along_axis(numbers, nearest, axis=-1)
        return pairs.swapaxes(1, 2)

    def patches_in_space(self) -> list[Floats]:
        """Return the polygon of each point: the part of the facet nearest to the point, [m].

        Distances are measured in reference coordinates, so a skew facet is divided like the
        reference square.
        """
        return self._patches(_Bilinear(self.corners))

    def patch_weights(self) -> list[Floats]:
        """Return weights of the facet's corners at the corners of each polygon, (n, 3 or 4)."""
        identity = np.eye(self.corners.shape[1])[None]
        return self._patches(_Bilinear(np.repeat(identity, len(self.corners), axis=0)))

    def _patches(self, target: _Bilinear) -> list[Floats]:
        lengths = [len(part) for part in self._parts]
        facets = np.repeat(self.facet_of_point, lengths)
        corners = target(np.concatenate(self._parts), facets)
        return np.split(corners, np.cumsum(lengths)[:-1])

    @cached_property
    def _parts(self) -> list[Floats]:
        """Part of the reference facet of each point; facets with equal points have equal parts."""
        reference = _Bilinear(self.corners).reference
        parts = [reference] * len(self._local)
        parts_by_points: dict[bytes, list[Floats]] = {}
        order = np.argsort(self.facet_of_point, kind="stable")
        for points in np.split(order, np.cumsum(np.bincount(self.facet_of_point))[:-1]):
            local = self._local[points]
            key = np.round(local / ON_BISECTOR).tobytes()
            if key not in parts_by_points:
                parts_by_points[key] = [_part_of(i, local, reference) for i in range(len(local))]
            for point, part in zip(points, parts_by_points[key], strict=True):
                parts[point] = part
        return parts


class JointSurface(JointFacets):
    """Joint mapped to a plane: points, facets and the patch of each point, in 2-D coordinates [m].

    The plane is the mean plane of the joint. A curved joint, such as the perimetral joint of a dam,
    is unrolled.

    Attributes:
        points: Joint points in the plane, shape (n, 2), [m].
        facets: Corners of the facets in the plane, shape (facets, 3 or 4, 2), [m].
        axes: Unit vectors across and up the mean plane, rows, shape (2, 3).
        labels: Labels of the two axes.
        ends: Names of the left, right, lower and upper end; empty names are not drawn.
        upright: True if the ordinate is the elevation.
    """

    def __init__(self, results: Results, joint: str) -> None:
        results.check_joint(joint)
        super().__init__(results, joint)
        frames = results.static(f"joints/{joint}/frames")
        areas = results.static(f"joints/{joint}/areas")
        normals = _means(frames[:, 0], areas, self.facet_of_point)
        mean = areas @ frames[:, 0] / areas.sum()
        self._place(mean, unrolled(self.corners, normals) if mean @ mean < _FLAT else None)

    def _place(self, normal: Floats, unrolled_joint: Unrolled | None) -> None:
        """Set the places in the plane, the labels and the names of the ends."""
        flat = np.linalg.norm(normal) > 1e-9
        axes, labels = _plane_axes(normal if flat else np.array([0.0, 0.0, 1.0]))
        self.axes: Floats = axes
        across = "upstream", "downstream"
        banks = "right bank", "left bank"
        if unrolled_joint is None:
            plane = self.corners @ axes.T
            self.facets: Floats = plane - [plane[..., 0].min(), 0.0]
            self.labels = labels
            self.upright = labels[1] == _ELEVATION
            self.ends = (*(across if abs(axes[0, 0]) > 0.5 else banks), "", "")
        else:
            self.facets = unrolled_joint.corners
            self.upright = False
            self.labels = ("developed length [m]", "developed width [m]")
            self.ends = (*across, "", "") if unrolled_joint.upright else (*banks, *across[::-1])
        self.points: Floats = _Bilinear(self.facets)(self._local, self.facet_of_point)

    def patches(self) -> list[Floats]:
        """Return the polygons of the points in the plane, of shape (corners, 2), [m]."""
        return self._patches(_Bilinear(self.facets))

    def outlines(self) -> Floats:
        """Return closed outlines of the facets, shape (facets, corners + 1, 2)."""
        return np.concatenate([self.facets, self.facets[:, :1]], axis=1)


def facets_of_joint(results: Statics, joint: str) -> tuple[Ints, Ints]:
    """Return the facet number of each joint point, (n,), and two boundary facets, (facets, 2).

    The two boundary facets, one on each side, have the centres nearest to the mean of the points.
    """
    from scipy.spatial import cKDTree

    points, areas, facet = (
        results.static(f"joints/{joint}/{name}") for name in ("points", "areas", "facet")
    )
    _, facet_of_point = np.unique(facet, return_inverse=True)
    corners = results.static("mesh/nodes")[results.static("mesh/surface")]
    centres = _means(points, areas, facet_of_point)
    distance, pairs = cKDTree(corners.mean(axis=1)).query(centres, k=2)
    # Sort equally distant facets by number, as rounding errors determine which is nearer.
    equal = np.diff(distance)[:, 0] < 1e-9 * np.ptp(corners)
    return facet_of_point, np.where(equal[:, None], np.sort(pairs, axis=1), pairs)


def _means(values: Floats, areas: Floats, facet_of_point: Ints) -> Floats:
    """Return the mean over each facet, (facets, 3), of values at points, (n, 3)."""
    weight = np.bincount(facet_of_point, areas)
    sums = [np.bincount(facet_of_point, areas * column) for column in values.T]
    return np.stack(sums, axis=1) / weight[:, None]


class _Bilinear:
    """Bilinear maps x = a + u b + v c + u v d of the unit square (or triangle, d = 0) onto facets.

    Args:
        corners: Corners of the facets in cyclic order, shape (facets, 3 or 4, any).
    """

    def __init__(self, corners: Floats) -> None:
        self.reference: Floats = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        self._a = corners[:, 0]
        self._b, self._c = corners[:, 1] - self._a, corners[:, -1] - self._a
        self._d = np.zeros_like(self._a)
        if corners.shape[1] == 3:
            self.reference = self.reference[[0, 1, 3]]
        else:
            self._d = corners[:, 2] - corners[:, 1] - self._c

    def __call__(self, local: Floats, facet: Ints) -> Floats:
        """Return 2-D or 3-D positions of reference coordinates (n, 2) on facets (n,)."""
        u, v = local[:, :1], local[:, 1:]
        linear = self._a[facet] + u * self._b[facet] + v * self._c[facet]
        return linear + u * v * self._d[facet]

    def inverse(self, points: Floats, facet: Ints) -> Floats:
        """Return reference coordinates of points (n, 2) on facets (n,), by Newton's method."""
        local: Floats = np.full(points.shape, 0.5)
        for _ in range(8):  # quadratic convergence; one iteration suffices on parallelograms
            along_u = self._b[facet] + local[:, 1:] * self._d[facet]
            along_v = self._c[facet] + local[:, :1] * self._d[facet]
            jacobian = np.stack([along_u, along_v], axis=2)
            residual = points - self(local, facet)
            local += np.linalg.solve(jacobian, residual[:, :, None])[:, :, 0]
        return local


def _plane_axes(normal: Floats) -> tuple[Floats, tuple[str, str]]:
    """Return two axes in the plane, rows, and their labels."""
    normal = normal / np.linalg.norm(normal)
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    if np.linalg.norm(up) < 0.1:  # a lift joint: seen from above, x to the right
        across = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
        across /= np.linalg.norm(across)
        up = np.cross(np.sign(normal[2]) * normal, across)
        return np.stack([across, up]), ("distance downstream [m]", "distance across the valley [m]")
    up /= np.linalg.norm(up)
    across = np.cross(up, normal)
    across *= 1.0 if (across[0] if abs(across[0]) > 1e-9 else across[1]) > 0.0 else -1.0
    name = _ELEVATION if up[2] > 0.9999 else "distance up the joint [m]"
    return np.stack([across, up]), ("horizontal distance [m]", name)


def _part_of(point: int, local: Floats, polygon: Floats) -> Floats:
    """Return the part of a convex polygon that is nearer to one point than to the other points."""
    for other in local[np.arange(len(local)) != point]:
        polygon = _nearer_part(polygon, local[point], other)
    return polygon


def _nearer_part(polygon: Floats, point: Floats, other: Floats) -> Floats:
    """Return the part of a convex polygon that is nearer to one point than to another."""
    excess = (polygon - 0.5 * (point + other)) @ (other - point)
    excess[np.abs(excess) < ON_BISECTOR] = 0.0
    inside = excess <= 0.0
    if inside.all():
        return polygon
    after = np.arange(1, len(polygon) + 1) % len(polygon)
    following = excess[after]
    crosses = excess * following < 0.0
    share = np.divide(excess, excess - following, out=np.zeros_like(excess), where=crosses)
    crossing = polygon + share[:, None] * (polygon[after] - polygon)
    pairs = np.stack([polygon, crossing], axis=1).reshape(-1, 2)
    return pairs[np.stack([inside, crosses], axis=1).ravel()]


def state_of_map(results: Results, quantity: MapQuantity, *state: Any) -> tuple[Results, int, str]:
    """Return results, record and time in words of a map; ``state`` is as in `chosen_state`.

    Quantities of the whole run have one record; ``state`` must have its default values.
    """
    if quantity not in OVER_RUN:
        return chosen_state(results, *state)
    if state != (None, -1, None):
        raise ValueError(f"{quantity!r} is of all steps: do not give time, index or stage.")
    if "joint_maxima" not in results.streams or not results.rows("joint_maxima"):
        raise ResultsError(
            f"{results.path} has no {quantity!r}, which a dynamic stage of this version records at "
            f"its end; the file is {results.status}. Choose a quantity of one state, as 'opening'."
        )
    return results, -1, f"over the run{since(results, quantity)}"


def map_value(results: Results, joint: str, quantity: MapQuantity, number: int) -> Floats:
    """Return the value of each point in the unit of its label, shape (n,).

    Tractions and mobilised friction are NaN at open points; all values are NaN at tied points. The
    state is 0 open, 1 sticking, 2 sliding, 3 closed without friction, as in the file.

    Raises:
        ResultsError: The joint has no friction, which its mobilised friction needs.
    """
    values = _value(results, joint, quantity, number)
    return np.where(tied_points(results, joint), np.nan, values)


def _value(results: Results, joint: str, quantity: MapQuantity, number: int) -> Floats:
    """Return the result of `map_value`, but with the file's values at tied points."""
    if row := OVER_RUN.get(quantity):
        return row.factor * results.series("joint_maxima", f"{joint}/{row.key}", number)
    if quantity == "state":
        return results.series("states", f"joints/{joint}/status", number).astype(float)
    if quantity == "opening" or quantity == "slip":
        gap = 1e3 * gaps(results, "states", joint, number)
        opening: Floats = np.maximum(gap[:, 0], 0.0)
        return opening if quantity == "opening" else np.hypot(gap[:, 1], gap[:, 2])
    friction, cohesion = strength_of(results, joint, None)
    points = state_points(results, "states", joint, cohesion, slice(number, number + 1 or None))
    if quantity == "mobilised":
        if np.isnan(friction):
            raise ResultsError(
                f"{results.path} has no friction of the joint {joint!r}, so its mobilised "
                "friction is undefined; choose other joints."
            )
        return mobilised_friction(friction, points)[0]
    values = 1e-6 * (points.traction[0, :, 0] if quantity == "normal" else points.shear[0])
    return np.where(open_points(points.gap, points.traction)[0], np.nan, values)


def map_limits(quantity: MapQuantity, values: Floats) -> tuple[float, float]:
    """Return the range of the colours of a quantity, including zero."""
    if quantity == "state":
        return -0.5, len(STATES) - 0.5
    low, high = colour_limits(values)
    if quantity == "mobilised":
        return 0.0, max(1.0, high)
    never_negative = quantity in ("tangential", "opening", "slip", *OVER_RUN)
    return (0.0, 1.0) if never_negative and high == 0.0 else (low, high)


def map_colours(quantity: MapQuantity, limits: tuple[float, float]) -> ListedColormap:
    """Return the colours of a quantity: diverging for signed values, otherwise light to dark."""
    from matplotlib.colors import ListedColormap

    if quantity == "state":
        return ListedColormap(list(STATES.values()))
    if quantity == "normal":
        return signed_colours(limits)
    return colours()
