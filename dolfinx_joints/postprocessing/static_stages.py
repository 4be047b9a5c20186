# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacements, joints and stresses at the end of each static stage, from a results file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.postprocessing.envelopes import STAGE_STRESSES, extreme_of
from dolfinx_joints.postprocessing.joints.resultants import JointResultants, stage_resultants
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.joint_points import gaps, tied_points
from dolfinx_joints.results.layout import JUMP
from dolfinx_joints.results.quantities import rows_below
from dolfinx_joints.results.reader import Results


@dataclass(frozen=True, kw_only=True)
class StageJoint:
    """A joint at the end of a static stage.

    Attributes:
        normal_force: Effective force along the mean normal, positive in compression [N].
        shear_force: Magnitude of the force in the mean plane [N].
        plane_safety: As in `JointResultants`, of the resultants.
        sliding_safety: As in `JointResultants`; NaN if no force is transmitted.
        contact: Share of the area under pressure.
        opening_max: Largest opening [m].
        slip_max: Largest tangential gap, including the elastic part [m].
        pressure_max: Largest contact pressure [Pa].
        water_force: Force of the water in the joint along the mean normal, positive if it pushes
            the faces apart; zero without water [N].
    """

    normal_force: float
    shear_force: float
    plane_safety: float
    sliding_safety: float
    contact: float
    opening_max: float
    slip_max: float
    pressure_max: float
    water_force: float


@dataclass(frozen=True, kw_only=True)
class StageEnergy:
    """Energies at the end of a static stage, relative to the unloaded body [J].

    Attributes:
        strain: Elastic energy of the bulk and of springs.
        loads: Work of each load.
        supports: Work of supports and prescribed displacements.
        plastic: Plastic work and other losses of the bulk.
        bulk_numerical: Loss of a reversible nonlinear bulk because paths are straight within load
            increments; zero in files of earlier versions.
        joints: Energies of each joint by name: ``elastic``; ``friction``, work against friction;
            ``numerical``, loss because paths are straight within load increments, negative for a
            gain; ``bonds``, loss at broken bonds; ``released`` in load increments, including
            jumps, a part of ``friction`` and ``numerical``.
        water_released: Energy released in increments in which water entered or left joint points.
        error: Sum of all terms, zero except for rounding errors and the tolerance of the solver.
        scale: Largest of stored energy, input and losses so far.
        jump_count: Number of jumps in this stage.
        jump_energy: Energy released by these jumps.
    """

    strain: float
    loads: dict[str, float]
    supports: float
    plastic: float
    bulk_numerical: float
    joints: dict[str, dict[str, float]]
    water_released: float
    error: float
    scale: float
    jump_count: int
    jump_energy: float

    @property
    def relative_error(self) -> float:
        """Absolute error divided by the scale."""
        return abs(self.error) / self.scale if self.scale else 0.0


@dataclass(frozen=True, kw_only=True)
class StaticStage:
    """End of a static stage.

    Attributes:
        name: Name of the stage.
        load_time: Time at which the loads are evaluated [s]; zero except in `quasi_statics`.
        displacement: Displacement of each monitor point relative to the unloaded body, (3,), [m].
        reaction: Force of each support on the body, shape (gdim,), [N].
        joints: State of each joint.
        stresses: Extremes on the boundary by the names of the envelopes, tension positive [Pa];
            NaN if not recorded.
        energy: Energies, None in files of earlier versions.
        jumps: Joints, energy and load factors of each jump in the stage, in words.
    """

    name: str
    load_time: float
    displacement: dict[str, Floats]
    reaction: dict[str, Floats]
    joints: dict[str, StageJoint]
    stresses: dict[str, float]
    energy: StageEnergy | None = None
    jumps: tuple[str, ...] = ()


def static_stages(results: Results) -> list[StaticStage]:
    """Return the recorded static stages in order; empty for files of earlier versions."""
    check_results(results)
    names = results.stage_names
    if not names:
        return []
    forces = [stage_resultants(results, joint) for joint in results.joints]
    reactions = [n for n in results.streams["statics"] if n.startswith("reaction/")]
    energies = _energies(results, len(names))
    jumps, stages = stage_jumps(results), []
    for i, name in enumerate(names):
        points = results.series("statics", "point_displacement", i)
        stages.append(
            StaticStage(
                name=name,
                load_time=float(results.series("statics", "load_time", i)),
                displacement=dict(zip(results.point_names, points, strict=True)),
                reaction={
                    n.removeprefix("reaction/"): results.series("statics", n, i) for n in reactions
                },
                joints={f.joint: joint_in_state(results, "statics", f, i) for f in forces},
                stresses=_stresses(results, i),
                energy=energies[i],
                jumps=jumps.get(name, ()),
            )
        )
    return stages


def stage_jumps(results: Results) -> dict[str, tuple[str, ...]]:
    """Return the manifest's descriptions of jumps, for each static stage with jumps."""
    texts = (results.metadata.get("manifest") or {}).get("static_stages", {})
    of_stages = {
        name: tuple(p.removeprefix(JUMP) for p in text.split("; ") if p.startswith(JUMP))
        for name, text in texts.items()
    }
    return {name: jumps for name, jumps in of_stages.items() if jumps}


def joint_in_state(
    results: Results, stream: str, forces: JointResultants, number: int
) -> StageJoint:
    """Return a joint at record ``number`` of a stream; ``forces`` must have the same records."""
    gap = gaps(results, stream, forces.joint, number)
    traction = results.series(stream, f"joints/{forces.joint}/traction", number)
    normal = traction[~tied_points(results, forces.joint), 0]
    water = 0.0
    if forces.water_force is not None:
        water = float(forces.water_force[number] @ forces.geometry.normal)
    return StageJoint(
        normal_force=float(forces.normal_force[number]),
        shear_force=float(forces.shear_force[number]),
        plane_safety=float(forces.plane_safety[number]),
        sliding_safety=float(forces.sliding_safety[number]),
        contact=float(forces.contact[number]),
        opening_max=float(gap[:, 0].max(initial=0.0)),
        slip_max=float(np.linalg.norm(gap[:, 1:], axis=1).max(initial=0.0)),
        pressure_max=float(abs(normal.min(initial=0.0))),
        water_force=water,
    )


def _stresses(results: Results, i: int) -> dict[str, float]:
    """Return extreme stresses of stage ``i`` over the vertices with a value, by envelope name."""
    stresses = dict.fromkeys(STAGE_STRESSES, np.nan)
    for name, series in STAGE_STRESSES.items():
        if series in results.streams["statics"]:
            stresses[name] = extreme_of(name, results.series("statics", series, i))
    return stresses


def _energies(results: Results, count: int) -> Sequence[StageEnergy | None]:
    """Return the energies at the end of each stage."""
    names = results.streams["statics"]
    if "jump_energy" not in names:
        return [None] * count
    start = "energy/loads/"
    loads = [name.removeprefix(start) for name in names if name.startswith(start)]
    numbers = [n for n in names if n.startswith("energy/") or n in ("jumps", "jump_energy")]
    columns: dict[str, Any] = {
        name: results.series("statics", name, slice(count)).tolist() for name in numbers
    }
    plain, of_joint = rows_below("statics", "energy/"), rows_below("statics", "energy/joints/*/")
    return [
        StageEnergy(
            **{row.key: columns[row.name][i] if row.name in columns else 0.0 for row in plain},
            loads={load: columns[start + load][i] for load in loads},
            joints={
                joint: {r.key: columns[r.name.replace("*", joint)][i] for r in of_joint}
                for joint in results.joints
            },
            jump_count=columns["jumps"][i],
            jump_energy=columns["jump_energy"][i],
        )
        for i in range(count)
    ]
