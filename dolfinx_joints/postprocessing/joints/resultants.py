# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces and moments that joints transmit, safety against sliding, from a results file.

Forces are those on the + side of a joint; the - side receives the opposite ones. Tractions of a
joint with water are effective, the water's part is given beside it.
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

# Normals that lie within about 18 degrees of their mean; below, a joint has no plane to speak of.
NEARLY_PLANE = 0.95

SLIDING = ("compression", "shear_sum", "bond")  # of which the sliding safety is made


@dataclass(frozen=True, kw_only=True)
class JointGeometry:
    """Where the resultants of a joint refer to.

    Attributes:
        centroid: Of the joint's area, shape (3,), [m].
        normal: Mean normal, from the - to the + side, shape (3,); NaN where a joint closes on
            itself and has none.
        area: [m^2].
        flatness: |integral of n| / area: 1 of a plane joint, 0 of a closed one.
    """

    centroid: Floats
    normal: Floats
    area: float
    flatness: float

    @classmethod
    def from_sums(cls, area: float, first: Floats, normal: Floats) -> JointGeometry:
        """Of the sums over the area of 1, of the position, and of the normal."""
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
        """Whether the mean normal stands for the joint: a flatness of 0.95 or more."""
        return self.flatness >= NEARLY_PLANE

    @property
    def warning(self) -> str:
        """What to keep in mind of forces along the mean normal; empty of a nearly plane joint."""
        if self.nearly_plane:
            return ""
        return (
            f"curved (flatness {self.flatness:.2f}): its mean normal says little, and so do the "
            "normal and the shear force; the sliding safety is that of its points"
        )


@dataclass(frozen=True, kw_only=True)
class _Resultants:
    """Forces and moments, with those of water in joints where there is some."""

    force: Floats
    moment: Floats
    water_force: Floats | None = None
    water_moment: Floats | None = None

    @property
    def total_force(self) -> Floats:
        """Force with that of the water, shape (..., 3), [N]."""
        return self.force if self.water_force is None else self.force + self.water_force

    @property
    def total_moment(self) -> Floats:
        """Moment with that of the water, shape (..., 3), [N m]."""
        return self.moment if self.water_moment is None else self.moment + self.water_moment


@dataclass(frozen=True, kw_only=True)
class JointResultants(_Resultants):
    """Forces that a joint transmits to its + side, at the records of a run or in one state.

    Of a run all arrays begin with an axis of records; of one state they are without it.

    Attributes:
        joint: Name.
        time: Times, [s]; None of a single state.
        geometry: Centroid, mean normal, area, flatness.
        force: Effective, in global axes, shape (..., 3), [N].
        moment: About the centroid, effective, shape (..., 3), [N m].
        water_force: Of the water in the joint, likewise; None without.
        water_moment: Likewise.
        contact: Share of the area under pressure, t_n < 0, shape (...); tied points do not count.
        compression: Integral of the pressure over the area, of tension too where a bond holds,
            shape (...), [N].
        shear_sum: Integral of the magnitude of the shear traction, shape (...), [N].
        bond: Cohesion times the area whose bond is intact, shape (...), [N].
        friction: mu, NaN where the law has no limit to the shear or is not known.
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
        """N along the mean normal, positive where it presses, shape (...), [N].

        Of a curved joint, see ``geometry.warning``, it is a component and not what presses.
        """
        return self.force @ self.geometry.normal

    @property
    def shear(self) -> Floats:
        """V, the force in the plane of the mean normal, global axes, shape (..., 3), [N]."""
        return self.force - self.normal_force[..., None] * self.geometry.normal

    @property
    def shear_force(self) -> Floats:
        """|V|, shape (...), [N]."""
        return np.linalg.norm(self.shear, axis=-1)

    @property
    def sliding_safety(self) -> Floats:
        """Strength over shear, added up point by point: `safety_against_sliding`, shape (...)."""
        return safety_against_sliding(self.friction, self.compression, self.shear_sum, self.bond)

    @property
    def plane_safety(self) -> Floats:
        """That of the resultants on the mean plane, (mu N + bond) / |V|, shape (...).

        Of a plane joint never below ``sliding_safety``, as shear that balances itself within the
        joint does not count, and the same where the joint is sheared in one direction. Infinite
        without shear; NaN where nothing is transmitted, where mu is not known, and of joints that
        are not nearly plane.
        """
        if not self.geometry.nearly_plane:
            return np.full(np.shape(self.contact), np.nan)
        strength = self.friction * np.maximum(self.normal_force, 0.0) + self.bond
        size = np.linalg.norm(self.force, axis=-1)
        return ratio(strength, self.shear_force, NEGLIGIBLE * np.max(size, initial=0.0))

    @property
    def line_of_action(self) -> Floats:
        """Where the normal force acts, in the mean plane through the centroid, (..., 3), [m].

        NaN without a normal force, and of joints that are not nearly plane.
        """
        if not self.geometry.nearly_plane:
            return np.full(np.shape(self.force), np.nan)
        n, normal = self.geometry.normal, self.normal_force
        size = np.linalg.norm(self.force, axis=-1)
        some = np.abs(normal) > NEGLIGIBLE * np.max(size, initial=0.0)
        safe = np.where(some, normal, np.nan)[..., None]
        return np.asarray(self.geometry.centroid + np.cross(n, self.moment) / safe)


@dataclass(frozen=True, kw_only=True)
class BlockResultants(_Resultants):
    """Forces of its joints on each block, cells that are connected without crossing a joint.

    Attributes:
        time: Shape (records,), [s].
        mass: Shape (blocks,), [kg].
        centre: Centre of mass, of a block without mass the mean of its nodes, (blocks, 3), [m].
        force: Sum of the joints' effective forces, shape (records, blocks, 3), [N].
        moment: About ``centre``, likewise [N m].
        water_force: Of the water in the joints, None without.
        water_moment: Likewise.
    """

    time: Floats
    mass: Floats
    centre: Floats


def forces_of(frames: Floats, areas: Floats, traction: Floats) -> Floats:
    """Force of each joint point on the + side, in global axes, shape (..., n, 3), [N]."""
    return -areas[:, None] * np.einsum("nki,...nk->...ni", frames, traction)


@checked
def joint_resultants(
    results: Results, joint: str, *, friction_angle_deg: FrictionAngle | None = None
) -> JointResultants:
    """Resultants of a joint at every step if the run recorded them, else at its stored states.

    Args:
        results: The run; ``ResultsMonitor(resultants=True)`` records every step.
        joint: Name of the joint.
        friction_angle_deg: For the sliding safety; that of the joint's law unless given, which
            files of earlier versions do not hold.

    Raises:
        ResultsError: There is no such joint.
    """
    results.check_joint(joint)
    friction, cohesion = strength_of(results, joint, friction_angle_deg)
    where = f"joints/{joint}"
    forces = f"{where}/force" in results.streams.get("resultants", [])
    if forces and recorded(results, joint):
        # A run that is still writing adds more.
        stream, rows = "resultants", slice(min(results.rows(s) for s in ("resultants", "joints")))
        names = ("force", "moment", "water_force", "water_moment", "contact")
        parts = _recorded(results, where, names, rows)
        parts["geometry"] = joint_geometry(results, joint)
        extremes = joint_extremes(results, joint)
        parts |= {name: extremes.values[name][rows] for name in SLIDING}
    else:
        stream, rows = "states", slice(results.rows("states"))
        parts = _from_fields(results, stream, joint, cohesion, rows)
    time = results.time(stream)[rows]
    return JointResultants(joint=joint, time=time, friction=friction, **parts)


def stage_resultants(results: Results, joint: str) -> JointResultants:
    """Resultants of a joint at the end of each static stage, records as `Results.stage_names`.

    ``time`` is that at which the loads of the stages are taken.

    Raises:
        ResultsError: There is no such joint, or no stage.
    """
    results.check_joint(joint)
    friction, cohesion = strength_of(results, joint, None)
    rows = slice(results.rows("statics"))
    parts = _from_fields(results, "statics", joint, cohesion, rows)
    time = results.series("statics", "load_time", rows)
    return JointResultants(joint=joint, time=time, friction=friction, **parts)


def block_resultants(results: Results) -> BlockResultants:
    """Forces of its joints on each block at every step.

    Raises:
        ResultsError: The run did not record it.
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
        **_recorded(results, "blocks", names, rows),
    )


def resultant_measures(results: Results) -> dict[str, dict[str, float]]:
    """Extremes of the forces of each joint.

    By joint: ``safety_min``, the smallest sliding safety of `joint_extremes`, with its
    ``safety_time`` [s], both NaN where no friction angle is known; and over the records of
    `joint_resultants`, ``normal_force_max``, ``normal_force_min``, ``shear_force_max`` [N], along
    the mean normal; ``contact_min``, the smallest share of the area under pressure; ``flatness``.
    """
    check_results(results)
    return {joint: _measures_of(results, joint) for joint in results.joints}


def _measures_of(results: Results, joint: str) -> dict[str, float]:
    found, extremes = joint_resultants(results, joint), joint_extremes(results, joint)
    safety = extremes.safety
    known = np.flatnonzero(~np.isnan(safety))
    least = known[np.argmin(safety[known])] if known.size else None
    return {
        "safety_min": np.nan if least is None else float(safety[least]),
        "safety_time": np.nan if least is None else float(extremes.time[least]),
        "normal_force_max": float(np.max(found.normal_force, initial=-np.inf)),
        "normal_force_min": float(np.min(found.normal_force, initial=np.inf)),
        "shear_force_max": float(np.max(found.shear_force, initial=-np.inf)),
        "contact_min": float(np.min(found.contact, initial=np.inf)),
        "flatness": found.geometry.flatness,
    }


class _Arrays(NamedTuple):
    """Points (n, 3), frames (n, 3, 3) and areas (n,) of a joint, these zero at tied points."""

    points: Floats
    frames: Floats
    areas: Floats


def joint_geometry(results: Results, joint: str) -> JointGeometry:
    """Centroid, mean normal, area and flatness of a joint."""
    return _geometry(results, joint)[1]


def _geometry(results: Results, joint: str) -> tuple[_Arrays, JointGeometry]:
    """Arrays of a joint, and its centroid, mean normal and area."""
    arrays = _Arrays(*(results.static(f"joints/{joint}/{name}") for name in _Arrays._fields))
    first, normal = (arrays.areas @ each for each in (arrays.points, arrays.frames[:, 0]))
    geometry = JointGeometry.from_sums(arrays.areas.sum(), first, normal)
    return arrays._replace(areas=free_areas(results, joint)), geometry


def _recorded(results: Results, where: str, names: Iterable[str], rows: slice) -> dict[str, Any]:
    """Those of the series below a name that the file has."""
    known = results.streams["resultants"]
    return {
        name: results.series("resultants", f"{where}/{name}", rows)
        for name in names
        if f"{where}/{name}" in known
    }


def _from_fields(
    results: Results, stream: str, joint: str, cohesion: float, rows: slice
) -> dict[str, Any]:
    """Geometry, and resultants from the tractions that a stream holds."""
    arrays, geometry = _geometry(results, joint)
    series, where = results.streams[stream], f"joints/{joint}"
    traction = results.series(stream, f"{where}/traction", rows)
    parts: dict[str, Any] = {"geometry": geometry} | _moved(arrays, geometry, traction, "")
    parts["contact"] = (traction[..., 0] < 0.0) @ arrays.areas / arrays.areas.sum()
    if f"{where}/pressure" in series:
        pressed = np.zeros_like(traction)
        pressed[..., 0] = -results.series(stream, f"{where}/pressure", rows)
        parts |= _moved(arrays, geometry, pressed, "water_")
    points = state_points(results, stream, joint, cohesion, rows)
    each = (points.compression, points.shear, points.cohesion)
    return parts | {k: v @ arrays.areas for k, v in zip(SLIDING, each, strict=True)}


def _moved(
    arrays: _Arrays, geometry: JointGeometry, traction: Floats, prefix: str
) -> dict[str, Floats]:
    """Force and moment of tractions (records, n, 3)."""
    force = forces_of(arrays.frames, arrays.areas, traction)
    arms = arrays.points - geometry.centroid
    return {
        f"{prefix}force": force.sum(axis=-2),
        f"{prefix}moment": np.cross(arms, force).sum(axis=-2),
    }
