# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series with a row for each step: motion of points, reactions, energies and joint values.

A step is copied when it is recorded. Series are computed for a block of steps, because sums over
points and exchanges between ranks cost little more for many steps than for one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.laws.law import StatusCounts
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.fields import energies
from dolfinx_joints.monitors.joint_extremes import JointExtremesStream
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.probes import PointProbe
from dolfinx_joints.monitors.resultants import ResultantsStream
from dolfinx_joints.results.quantities import rows_below
from dolfinx_joints.simulation.record import Record
from dolfinx_joints.time_integration.energy import EnergyRow

STATIC_PART = "static_displacement"

# Largest number of steps in a block, and largest size of its arrays [bytes].
_BLOCK_STEPS, _BLOCK_BYTES = 256, 1 << 24


class Step(NamedTuple):
    """Copy of the values of a step on this rank.

    Attributes:
        time: Time [s].
        displacement: Displacement of this rank's monitor points, shape (local points, gdim), [m].
        velocity: Velocity of this rank's monitor points, shape (local points, gdim), [m/s].
        static: Static part of the displacement of these points, None if it is not recorded.
        reaction: Reactions at this rank's supported nodes, by support, shape (nodes, gdim), [N].
        ground: Ground motion and reservoir force by name, equal on all ranks.
        counts: Number of joint points by status, None without joints.
        iterations: Iterations of the step.
        energy: Energies, works and losses.
        gap: Gaps of the local joint points, shape (n, 3), [m]; empty without joints.
        traction: Tractions of the local joint points, shape (n, 3), [Pa]; empty without joints.
        cohesion: Cohesion of intact bonds, shape (n,), [Pa]; empty without joints.
        pressure: Water pressure at the local joint points, [Pa]; None if no resultants need it.
    """

    time: float
    displacement: Floats
    velocity: Floats
    static: Floats | None
    reaction: Floats
    ground: Mapping[str, Floats]
    counts: StatusCounts | None
    iterations: int
    energy: EnergyRow
    gap: Floats
    traction: Floats
    cohesion: Floats
    pressure: Floats | None


class StepSeries:
    """Collects steps, and computes the streams with a row for each step.

    Args:
        model: The model.
        probe: Monitor points.
        first: Record at the start of the run or of its continuation.
        resultants: Node numbering and joint rows if forces of joints and blocks are recorded.

    Attributes:
        extremes: Stream ``joints``, None without joints.
        resultants: Stream ``resultants``, None if it is not recorded.
    """

    def __init__(
        self,
        model: Model,
        probe: PointProbe,
        first: Record,
        resultants: tuple[NodeNumbering, JointRows] | None,
    ) -> None:
        """Find the nodes of the supports (collective)."""
        self._model, self._probe, self._steps = model, probe, list[Step]()
        self._supports = (*model.constraints.groups, *model.constraints.points)
        nodes = [model.nodes(group) for group in self._supports]
        self._nodes = np.concatenate([np.empty(0, dtype=np.int64), *nodes])
        self._ends = np.cumsum([0, *map(len, nodes)])
        self._before: tuple[float, Floats] | None = None
        self.extremes = self.resultants = None
        if model.contact is not None and first.joints is not None:
            self.extremes = JointExtremesStream(model, first.joints.state.gap)
            if resultants is not None:
                forces, wet = self.extremes.forces, first.wet_joints
                self.resultants = ResultantsStream(model, *resultants, forces, wet)

    def collect(self, record: Record, static: PETSc.Vec | None) -> None:
        """Copy the values of a step; ``static`` is the static part of its displacement [m].

        With resultants of joints that contain water the call is collective.
        """
        if record.free_surface is None:
            ground = {"ground_acceleration": record.ground_acceleration}
        else:
            ground = {"free_surface_velocity": record.free_surface(record.time)}
        if record.reservoir_force is not None:
            ground["reservoir_force"] = record.reservoir_force
        contact, joints, solve, pressure = self._model.contact, record.joints, record.solve, None
        counts = solve.counts if solve else None
        gap = traction = cohesion = np.empty(0)
        if self.extremes is not None and joints is not None and contact is not None:
            gap, traction = joints.state.gap.copy(), joints.traction.copy()
            cohesion = self.extremes.forces.cohesion(joints)
            counts = contact.counts(joints.status) if counts is None else counts
        if self.resultants is not None and record.pressure is not None:
            pressure = record.pressure()
        reactions = record.reaction.getArray(readonly=True).reshape(-1, self._model.gdim)
        self._steps.append(
            Step(
                record.time,
                self._probe.local(record.displacement),
                self._probe.local(record.velocity),
                None if static is None else self._probe.local(static),
                reactions.take(self._nodes, axis=0),
                ground,
                counts,
                solve.iterations if solve else 0,
                record.energy,
                gap,
                traction,
                cohesion,
                pressure,
            )
        )

    @property
    def full(self) -> bool:
        """True if the block of collected steps has its largest size."""
        size = sum(part.nbytes for part in self._steps[0] if isinstance(part, np.ndarray))
        return len(self._steps) >= _BLOCK_STEPS or len(self._steps) * size >= _BLOCK_BYTES

    def take(self) -> tuple[list[float], dict[str, dict[str, Any]]]:
        """Return times and series by stream and name of the collected steps (collective).

        Each series has a row for each step. The steps are discarded.
        """
        steps, self._steps = self._steps, []
        if not steps:
            return [], {}
        block = Step(*zip(*steps, strict=True))  # type: ignore[arg-type]
        streams = {"histories": self._histories(block)}
        streams["energy"] = energies(self._model, block.energy)
        if self.extremes is not None:
            parts = (block.gap, block.traction, block.cohesion)
            points = self.extremes.points(*(np.stack(part) for part in parts))
            streams["joints"] = self.extremes.values(points)
            if self.resultants is not None:
                pressure = None if steps[0].pressure is None else np.stack(block.pressure)
                streams["resultants"] = self.resultants.values(points, pressure)
        return list(block.time), streams

    def state_dict(self) -> dict[str, Any]:
        """Return time and velocity of the last step taken, for a restart (collective)."""
        assert self._before is not None
        (time, velocity), extremes = self._before, self.extremes
        gap = None if extremes is None else extremes.state_dict()
        return {"time": time, "velocity": velocity, "gap": gap}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the values from ``state_dict``."""
        self._before = state_dict["time"], state_dict["velocity"]
        if self.extremes is not None:
            self.extremes.load_state_dict(state_dict["gap"])

    def _histories(self, block: Any) -> dict[str, Any]:
        """Return the stream ``histories`` of a block, a `Step` of sequences (collective)."""
        values: dict[str, Any] = {"displacement": self._probe.of_all_ranks(block.displacement)}
        values["acceleration"] = self._accelerations(np.array(block.time), block.velocity)
        values |= {
            name: np.stack([step[name] for step in block.ground]) for name in block.ground[0]
        }
        at_nodes, ends = np.stack(block.reaction), pairwise(self._ends)
        forces = np.array([at_nodes[:, start:stop].sum(axis=1) for start, stop in ends])
        forces = summed(self._model.jointed.mesh.comm, forces)
        values |= zip([f"reaction/{group}" for group in self._supports], forces, strict=True)
        if block.static[0] is not None:
            values[STATIC_PART] = self._probe.of_all_ranks(block.static)
        total = [max(c.total, 1) if c else 1 for c in block.counts]
        for row in rows_below("histories", "joint_"):
            status = row.name.removeprefix("joint_")
            numbers = [getattr(c, status) if c else 0 for c in block.counts]
            values[row.name] = np.divide(numbers, total)
        return values | {"iterations": np.array(block.iterations)}

    def _accelerations(self, time: Floats, local: Sequence[Floats]) -> Floats:
        """Return the accelerations of the points in consecutive steps (collective).

        The acceleration is the mean since the last record: change of velocity divided by time. This
        mean is defined for every scheme and any number of substeps.
        """
        velocity = self._probe.of_all_ranks(local)
        last, before = self._before or (-np.inf, velocity[0])  # zero at the first record of a run
        self._before = float(time[-1]), velocity[-1].copy()
        change = np.diff(velocity, axis=0, prepend=before[None])
        return np.asarray(change / np.diff(time, prepend=last)[:, None, None])
