# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factor of safety of a block that slides on joints in an earthquake, and Newmark's block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Annotated, Any

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked, declarations
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.parameters import check_kind_of, check_named
from dolfinx_joints.exact import projected_force
from dolfinx_joints.postprocessing.frames import ground_in_steps
from dolfinx_joints.postprocessing.joints.extremes import NEGLIGIBLE_SUM, FrictionAngle
from dolfinx_joints.postprocessing.joints.resultants import block_resultants, joint_resultants
from dolfinx_joints.postprocessing.joints.surface import is_plane
from dolfinx_joints.results.joint_points import free_areas, gaps
from dolfinx_joints.results.reader import Results

# A plane is parallel to the direction of sliding if the angle is below about 1 degree [radians].
PARALLEL = 0.02


@dataclass(frozen=True, kw_only=True)
class BlockSliding:
    """Forces and slip of a block along its direction of sliding, equations (38) and (39).

    The forces of a record are means of the step that ends there; the first record is static.

    Attributes:
        direction: Unit vector of the motion of the block, shape (3,).
        mass: Mass of the block [kg].
        time: Times, shape (records,), [s].
        driving: Force D on the rigid block along the direction, shape (records,), [N].
        resistance: Shear strength R of the planes of a rigid block, shape (records,), [N].
        slip_time: Times of the stored states, shape (states,), [s].
        slip: Mean slip along the direction since the first state, shape (states,), [m].
    """

    direction: Floats
    mass: float
    time: Floats
    driving: Floats
    resistance: Floats
    slip_time: Floats
    slip: Floats

    @property
    def safety(self) -> Floats:
        """Factor of safety F = R / D, infinite without a driving force, shape (records,)."""
        negligible = NEGLIGIBLE_SUM * float(np.max(np.abs(self.driving), initial=0.0))
        safety = np.full(len(self.driving), np.inf)
        return np.divide(self.resistance, self.driving, safety, where=self.driving > negligible)

    @property
    def newmark_slip(self) -> Floats:
        """Slip of Newmark's rigid block, which starts if D > R, shape (records,), [m]."""
        steps = np.diff(self.time)
        excess = (self.driving - self.resistance)[1:] / self.mass
        gained = np.append(0.0, np.cumsum(steps * excess))
        # The block stops if its velocity falls to zero; it does not slide back.
        velocity = gained - np.minimum.accumulate(gained)
        return np.append(0.0, np.cumsum(0.5 * steps * (velocity[1:] + velocity[:-1])))

    def measures(self) -> dict[str, float]:
        """Return the main numbers, by name as in the table of quantities.

        ``yield_acceleration`` is (R - D) / m of the static state, along the direction of sliding.
        """
        safety = self.safety
        least = int(np.argmin(safety))
        return {
            "safety_static": float(safety[0]),
            "safety_min": float(safety[least]),
            "safety_time": float(self.time[least]),
            "time_below_one": float(np.diff(self.time) @ (safety[1:] < 1.0)),
            "yield_acceleration": float(self.resistance[0] - self.driving[0]) / self.mass,
            "slip_residual": float(self.slip[-1]),
            "newmark_residual": float(self.newmark_slip[-1]),
        }


@checked
def block_sliding(
    results: Results,
    planes: Annotated[Sequence[str], at.MinLen(1)],
    *,
    direction: Annotated[Sequence[float], at.Len(3, 3)] | None = None,
    friction_angle_deg: FrictionAngle | Sequence[float] | None = None,
) -> BlockSliding:
    """Return the factor of safety of a block against sliding on joints, at every step.

    The block is next to all planes; of two blocks the lighter one, unless it has no mass. The
    active force on the block is that of the static equilibrium at the start, plus the change of the
    forces of its other joints, such as the thrust of a dam, minus mass times ground acceleration.
    Loads on the block must be constant.

    If the block slides in the run, the slip also reduces the recorded thrust. For forces that do
    not depend on the slip, use a run with a `KeyedJoint` on each plane, and give the angles.

    Args:
        results: A run with ``ResultsMonitor(resultants=True)``, from static equilibrium.
        planes: Names of the joints on which the block slides.
        direction: Direction of sliding along a plane and into none, shape (3,). By default that of
            the static forces: the line of intersection of two planes, or the steepest line of one.
        friction_angle_deg: Friction angle of all planes, or one for each plane; by default that of
            each joint law.

    Raises:
        ResultsError: A name is not a plane joint with friction, the run did not record forces on
            blocks, no block is next to all planes, or no plane lets it move along the direction.
    """
    _check_planes("", planes, friction_angle_deg)
    blocks = block_resultants(results)
    pairs = zip(planes, np.broadcast_to(np.asarray(friction_angle_deg), len(planes)), strict=True)
    joints = [joint_resultants(results, p, friction_angle_deg=angle) for p, angle in pairs]
    block, sides = _block_of(results, planes, blocks.mass)
    for joint in joints:
        if not joint.geometry.nearly_plane or np.isnan(joint.friction):
            fault = joint.geometry.warning or "without a known friction angle"
            raise ResultsError(f"A block slides on plane joints; {joint.joint!r} is {fault}.")
    ground = ground_in_steps(results)
    rows = min(len(blocks.time), len(ground) + 1, *(len(joint.contact) for joint in joints))
    mass = float(blocks.mass[block])
    of_planes = sum(side * joint.force[:rows] for side, joint in zip(sides, joints, strict=True))
    active = blocks.total_force[:rows, block] - blocks.total_force[0, block] - of_planes
    active[1:] -= mass * ground[: rows - 1]
    normals = np.array([s * joint.geometry.normal for s, joint in zip(sides, joints, strict=True)])
    along = np.asarray(projected_force(normals, active[0])[1] if direction is None else direction)
    along = along / (np.linalg.norm(along) or 1.0)
    opening = normals @ along
    parallel = np.abs(opening) < PARALLEL  # the other planes open
    blocked = opening.min() < -PARALLEL or (is_plane(results) and abs(along[2]) > PARALLEL)
    if blocked or not (along.any() and (direction is None or parallel.any())):
        raise ResultsError(
            f"direction is {direction}; it must be along a plane of {', '.join(planes)} and into "
            "none, or None if the static forces push the block."
        )
    forces = np.array([projected_force(normals[parallel], row)[0] for row in active])
    resistance = np.zeros(rows)
    for joint, normal_force in zip(compress(joints, parallel), forces.T, strict=True):
        resistance += joint.friction * normal_force + joint.bond[:rows]
    return BlockSliding(
        direction=along,
        mass=mass,
        time=blocks.time[:rows],
        driving=active @ along,
        resistance=resistance,
        slip_time=results.time("states"),
        slip=_mean_slip(results, dict(zip(planes, sides, strict=True)), along),
    )


def recorded_blocks(results: Results) -> Mapping[str, BlockSliding]:
    """Return the blocks of the metadata ``sliding``: names, and planes or all arguments."""
    blocks = check_blocks(results.metadata.get("sliding", {}))
    return {name: block_sliding(results, **of) for name, of in blocks.items()}


def check_blocks(given: Any, *, resultants: bool = True) -> dict[str, dict[str, Any]]:
    """Check the metadata ``sliding``; return arguments of `block_sliding` by block."""
    check_named("metadata 'sliding'", given, "planes, or arguments of block_sliding, by block")
    blocks = {n: dict(of) if isinstance(of, Mapping) else {"planes": of} for n, of in given.items()}
    allowed = {item.name: item for item in declarations(block_sliding)}
    for name, arguments in blocks.items():
        where = f"metadata 'sliding', block {name!r}"
        fits = "planes" in arguments and arguments.keys() <= allowed.keys()
        check_kind_of(where, given[name], fits, f"planes, or {', '.join(allowed)} by name")
        for argument, value in arguments.items():
            allowed[argument].check(value, where)
        _check_planes(f"{where}: ", arguments["planes"], arguments.get("friction_angle_deg"))
    if blocks and not resultants:
        raise ValueError("metadata 'sliding' needs the forces on blocks: set resultants=True, too.")
    return blocks


def _check_planes(where: str, planes: Sequence[str], angles: Any) -> None:
    """Raise ValueError unless each plane is named once, with one angle for all or for each."""
    fits = all(isinstance(plane, str) for plane in planes) and len(set(planes)) == len(planes)
    check_kind_of(f"{where}planes", planes, fits, "names of joints, each once")
    fits = np.size(angles) in (1, len(planes))
    check_kind_of(f"{where}friction_angle_deg", angles, fits, "one angle per plane")


def _block_of(results: Results, planes: Sequence[str], mass: Floats) -> tuple[int, list[float]]:
    """Return the block next to all planes, and 1 for planes whose + side it is, otherwise -1."""
    pairs = [results.static(f"joints/{plane}/blocks") for plane in planes]
    sides = [
        {int(of[0, k]): 2.0 * k - 1.0 for k in (0, 1) if (of[:, k] == of[0, k]).all()}
        for of in pairs
    ]
    common = set(sides[0]).intersection(*sides)
    if not common:
        raise ResultsError(f"No block is next to all points of {', '.join(planes)}.")
    block = min(common, key=lambda number: mass[number] or np.inf)  # rock may have no mass
    return block, [of_plane[block] for of_plane in sides]


def _mean_slip(results: Results, sides: Mapping[str, float], along: Floats) -> Floats:
    """Return the mean slip of a block on its planes since the first state, (states,), [m]."""
    moved, area = np.zeros(results.rows("states")), 0.0
    for plane, side in sides.items():
        areas, frames = free_areas(results, plane), results.static(f"joints/{plane}/frames")
        gap = gaps(results, "states", plane)[: len(moved)]
        moved += side * np.einsum("tnk,nk,n->t", gap, frames @ along, areas)
        area += float(areas.sum())
    return np.asarray((moved - moved[0]) / area)
