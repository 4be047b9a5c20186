# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces and moments in joints, and the safety of joints against sliding, from a results file.

Forces act on the + side of a joint; the forces on the - side are opposite. In joints with water
the forces are effective: they exclude the forces of the water, which are separate quantities.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.joints.extremes import (
    NEGLIGIBLE,
    FrictionAngle,
    joint_extremes,
    ratio,
    recorded,
    safety_against_sliding,
    state_points,
    strength_of,
)
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.joint_points import free_areas
from dolfinx_joints.results.reader import Results

# Least flatness of a nearly plane joint: normals are within about 18 degrees of the mean normal.
NEARLY_PLANE = 0.95

SLIDING = ("compression", "shear_sum", "bond")  # quantities from which the safety is computed


@dataclass(frozen=True, kw_only=True)
class JointGeometry:
    """Reference point and normal of the resultants of a joint.

    Attributes:
        centroid: Centroid of the joint's area, shape (3,), [m].
        normal: Mean normal from the - to the + side, shape (3,); NaN for a closed surface.
        area: Area of the joint [m^2].
        flatness: |integral of n| / area: 1 for a plane joint, 0 for a closed surface.
    """

    centroid: Floats
    normal: Floats
    area: float
    flatness: float

    @classmethod
    def from_sums(cls, area: float, first: Floats, normal: Floats) -> JointGeometry:
        """Return the geometry, given the integrals of 1, of the position, and of the normal."""
        length = float(np.linalg.norm(normal))
        unit = np.asarray(normal / length) if length > 1e-9 * area else np.full(3, np.nan)
        return cls(
            centroid=np.asarray(first / area),
            normal=unit,
            area=float(area),
            flatness=length / float(area),
        )

    @property
    def nearly_plane(self) -> bool:
        """True if the mean normal represents the joint: the flatness is at least 0.95."""
        return self.flatness >= NEARLY_PLANE

    @property
    def warning(self) -> str:
        """Warning about forces along the mean normal; empty for a nearly plane joint."""
        if self.nearly_plane:
            return ""
        return (
            f"curved (flatness {self.flatness:.2f}): the mean normal does not represent it, so its "
            "normal and shear force are not meaningful; the sliding safety is summed over points"
        )


@dataclass(frozen=True, kw_only=True)
class _Resultants:
    """Forces and moments of joints, and of the water in the joints."""

    force: Floats
    moment: Floats
    water_force: Floats | None = None
    water_moment: Floats | None = None

    @property
    def total_force(self) -> Floats:
        """Sum of effective force and water force, shape (..., 3), [N]."""
        return self.force if self.water_force is None else self.force + self.water_force

    @property
    def total_moment(self) -> Floats:
        """Sum of effective moment and water moment, shape (..., 3), [N m]."""
        return self.moment if self.water_moment is None else self.moment + self.water_moment


@dataclass(frozen=True, kw_only=True)
class JointResultants(_Resultants):
    """Forces that a joint transmits to its + side, at the records of a run or in one state.

    For a run, records are the first axis of all arrays; for a single state this axis is missing.

    Attributes:
        joint: Name of the joint.
        time: Times [s]; None for a single state.
        geometry: Centroid, mean normal, area, flatness.
        force: Effective force in global axes, shape (..., 3), [N].
        moment: Effective moment about the centroid, shape (..., 3), [N m].
        water_force: Force of the water in the joint, shape (..., 3), [N]; None without water.
        water_moment: Moment of the water about the centroid, shape (..., 3), [N m].
        contact: Share of the area under pressure, t_n < 0, without tied points, shape (...).
        compression: Integral of the pressure over the area, including tension at intact bonds,
            shape (...), [N].
        shear_sum: Integral of the magnitude of the shear traction, shape (...), [N].
        bond: Integral of the cohesion that the points still have, shape (...), [N].
        friction: mu; NaN if the law does not limit the shear, or is unknown.
    """

    joint: str
    time: Floats | None
    geometry: JointGeometry
    contact: Floats
    compression: Floats
    shear_sum: Floats
    bond: Floats
    friction: float

    @property
    def normal_force(self) -> Floats:
        """Force N along the mean normal, positive in compression, shape (...), [N].

        For a curved joint this is not the total compression; see ``geometry.warning``.
        """
        return self.force @ self.geometry.normal

    @property
    def shear(self) -> Floats:
        """Force V in the mean plane, in global axes, shape (..., 3), [N]."""
        return self.force - self.normal_force[..., None] * self.geometry.normal

    @property
    def shear_force(self) -> Floats:
        """Magnitude |V| of the shear, shape (...), [N]."""
        return np.linalg.norm(self.shear, axis=-1)

    @property
    def sliding_safety(self) -> Floats:
        """Strength / shear, both summed over the points: `safety_against_sliding`, shape (...)."""
        return safety_against_sliding(self.friction, self.compression, self.shear_sum, self.bond)

    @property
    def plane_safety(self) -> Floats:
        """Sliding safety of the resultants on the mean plane, (mu N + bond) / |V|, shape (...).

        For a plane joint it is at least ``sliding_safety``, because opposite shear tractions cancel
        in V. The two safeties are equal if the shear has one direction. The value is infinite
        without shear, and NaN without a force or mu, or if the joint is not nearly plane.
        """
        if not self.geometry.nearly_plane:
            return np.full(np.shape(self.contact), np.nan)
        strength = self.friction * np.maximum(self.normal_force, 0.0) + self.bond
        size = np.linalg.norm(self.force, axis=-1)
        return ratio(strength, self.shear_force, NEGLIGIBLE * np.max(size, initial=0.0))

    @property
    def line_of_action(self) -> Floats:
        """Point where the normal force acts in the mean plane through the centroid, (..., 3), [m].

        NaN without a normal force, and for joints that are not nearly plane.
        """
        if not self.geometry.nearly_plane:
            return np.full(np.shape(self.force), np.nan)
        n, normal = self.geometry.normal, self.normal_force
        size = np.linalg.norm(self.force, axis=-1)
        loaded = np.abs(normal) > NEGLIGIBLE * np.max(size, initial=0.0)
        divisor = np.where(loaded, normal, np.nan)[..., None]
        return np.asarray(self.geometry.centroid + np.cross(n, self.moment) / divisor)


@dataclass(frozen=True, kw_only=True)
class BlockResultants(_Resultants):
    """Forces of the joints on each block, a set of cells connected without crossing a joint.

    Attributes:
        time: Times, shape (records,), [s].
        mass: Mass, shape (blocks,), [kg].
        centre: Centre of mass, or mean of the nodes of a block without mass, (blocks, 3), [m].
        force: Sum of the joints' effective forces, shape (records, blocks, 3), [N].
        moment: Sum of the moments about ``centre``, shape (records, blocks, 3), [N m].
        water_force: Force of the water in the joints; None without water.
        water_moment: Moment of the water about ``centre``; None without water.
    """

    time: Floats
    mass: Floats
    centre: Floats


def forces_of(frames: Floats, areas: Floats, traction: Floats) -> Floats:
    """Return the force of each joint point on the + side, global axes, shape (..., n, 3), [N]."""
    return -areas[:, None] * np.einsum("nki,...nk->...ni", frames, traction)


@checked
def joint_resultants(
    results: Results, joint: str, *, friction_angle_deg: FrictionAngle | None = None
) -> JointResultants:
    """Return the resultants of a joint at every step if recorded, otherwise at the stored states.

    Args:
        results: The run; ``ResultsMonitor(resultants=True)`` records every step.
        joint: Name of the joint.
        friction_angle_deg: Friction angle for the sliding safety; by default from the joint law,
            which files of earlier versions do not contain.

    Raises:
        ResultsError: The file has no joint of this name.
    """
    results.check_joint(joint)
    friction, cohesion = strength_of(results, joint, friction_angle_deg)
    where = f"joints/{joint}"
    forces = f"{where}/force" in results.streams.get("resultants", [])
    if forces and recorded(results, joint):
        # Fix the number of rows here, as a run in progress adds rows.
        stream, rows = "resultants", slice(min(results.rows(s) for s in ("resultants", "joints")))
        names = ("force", "moment", "water_force", "water_moment", "contact")
        parts = _series_of(results, where, names, rows)
        parts["geometry"] = joint_geometry(results, joint)
        extremes = joint_extremes(results, joint)
        parts |= {name: extremes.values[name][rows] for name in SLIDING}
    else:
        stream, rows = "states", slice(results.rows("states"))
        parts = _from_tractions(results, stream, joint, cohesion, rows)
    time = results.time(stream)[rows]
    return JointResultants(joint=joint, time=time, friction=friction, **parts)


def stage_resultants(results: Results, joint: str) -> JointResultants:
    """Return the resultants of a joint at the end of each stage of `Results.stage_names`.

    ``time`` is the time at which the loads of a stage are evaluated.

    Raises:
        ResultsError: The file has no joint of this name, or no static stage.
    """
    results.check_joint(joint)
    friction, cohesion = strength_of(results, joint, None)
    rows = slice(results.rows("statics"))
    parts = _from_tractions(results, "statics", joint, cohesion, rows)
    time = results.series("statics", "load_time", rows)
    return JointResultants(joint=joint, time=time, friction=friction, **parts)


def block_resultants(results: Results) -> BlockResultants:
    """Return the forces of the joints on each block at every step.

    Raises:
        ResultsError: The run did not record the resultants of blocks.
    """
    check_results(results)
    series = results.streams.get("resultants", [])
    if "blocks/force" not in series:
        raise ResultsError(
            f"{results.path} has no resultants of blocks; record them with "
            "ResultsMonitor(resultants=True)."
        )
    rows = slice(results.rows("resultants"))
    names = ("force", "moment", "water_force", "water_moment")
    return BlockResultants(
        time=results.time("resultants")[rows],
        mass=results.static("blocks/mass"),
        centre=results.static("blocks/centre"),
        **_series_of(results, "blocks", names, rows),
    )


def resultant_measures(results: Results) -> dict[str, dict[str, float]]:
    """Return extremes of the forces of each joint, by joint.

    ``safety_min`` is the smallest sliding safety of `joint_extremes`, and ``safety_time`` its time
    [s]; both are NaN without a friction angle. ``normal_force_max``, ``normal_force_min`` (along
    the mean normal), ``shear_force_max`` [N] and ``contact_min`` (share of the area under pressure)
    are extremes over the records of `joint_resultants`. ``flatness`` is constant.
    """
    check_results(results)
    return {joint: _measures_of(results, joint) for joint in results.joints}


def _measures_of(results: Results, joint: str) -> dict[str, float]:
    resultants, extremes = joint_resultants(results, joint), joint_extremes(results, joint)
    safety = extremes.safety
    valid = np.flatnonzero(~np.isnan(safety))
    least = valid[np.argmin(safety[valid])] if valid.size else None
    return {
        "safety_min": np.nan if least is None else float(safety[least]),
        "safety_time": np.nan if least is None else float(extremes.time[least]),
        "normal_force_max": float(np.max(resultants.normal_force, initial=-np.inf)),
        "normal_force_min": float(np.min(resultants.normal_force, initial=np.inf)),
        "shear_force_max": float(np.max(resultants.shear_force, initial=-np.inf)),
        "contact_min": float(np.min(resultants.contact, initial=np.inf)),
        "flatness": resultants.geometry.flatness,
    }


class _Arrays(NamedTuple):
    """Points (n, 3), frames (n, 3, 3) and areas (n,) of a joint, areas zero at tied points."""

    points: Floats
    frames: Floats
    areas: Floats


def joint_geometry(results: Results, joint: str) -> JointGeometry:
    """Return centroid, mean normal, area and flatness of a joint."""
    return _geometry(results, joint)[1]


def _geometry(results: Results, joint: str) -> tuple[_Arrays, JointGeometry]:
    """Return the arrays of a joint, and its geometry, which includes tied points."""
    arrays = _Arrays(*(results.static(f"joints/{joint}/{name}") for name in _Arrays._fields))
    first, normal = (arrays.areas @ values for values in (arrays.points, arrays.frames[:, 0]))
    geometry = JointGeometry.from_sums(arrays.areas.sum(), first, normal)
    return arrays._replace(areas=free_areas(results, joint)), geometry


def _series_of(results: Results, where: str, names: Iterable[str], rows: slice) -> dict[str, Any]:
    """Return the series ``where/name`` of the stream ``resultants``, if recorded, by name."""
    available = results.streams["resultants"]
    return {
        name: results.series("resultants", f"{where}/{name}", rows)
        for name in names
        if f"{where}/{name}" in available
    }


def _from_tractions(
    results: Results, stream: str, joint: str, cohesion: float, rows: slice
) -> dict[str, Any]:
    """Return geometry and resultants, computed from the tractions in a stream."""
    arrays, geometry = _geometry(results, joint)
    series, where = results.streams[stream], f"joints/{joint}"
    traction = results.series(stream, f"{where}/traction", rows)
    parts: dict[str, Any] = {"geometry": geometry} | _sums(arrays, geometry, traction, "")
    parts["contact"] = (traction[..., 0] < 0.0) @ arrays.areas / arrays.areas.sum()
    if f"{where}/pressure" in series:
        water = np.zeros_like(traction)
        water[..., 0] = -results.series(stream, f"{where}/pressure", rows)
        parts |= _sums(arrays, geometry, water, "water_")
    points = state_points(results, stream, joint, cohesion, rows)
    integrands = (points.compression, points.shear, points.cohesion)
    return parts | {k: v @ arrays.areas for k, v in zip(SLIDING, integrands, strict=True)}


def _sums(
    arrays: _Arrays, geometry: JointGeometry, traction: Floats, prefix: str
) -> dict[str, Floats]:
    """Return force and moment of tractions (records, n, 3)."""
    force = forces_of(arrays.frames, arrays.areas, traction)
    arms = arrays.points - geometry.centroid
    return {
        f"{prefix}force": force.sum(axis=-2),
        f"{prefix}moment": np.cross(arms, force).sum(axis=-2),
    }
