# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Streams with a row for each step, computed for a block of steps at once.

Sums over points and exchanges between ranks cost little more for many steps than for one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Dealt, Flags, Floats
from dolfinx_joints.common.mpi import of_ranks, summed
from dolfinx_joints.laws.law import Status
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.fields import energies
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.probes import PointProbe
from dolfinx_joints.monitors.resultants import JointForces, ResultantsStream
from dolfinx_joints.postprocessing.joints.extremes import ALIKE
from dolfinx_joints.results.quantities import TABLE, JointPoints, at_points, rows_below, rows_by
from dolfinx_joints.simulation.record import Record

# Rows of the table of quantities by kind, and columns of maxima whose positions are recorded.
_LARGEST, _PLACES = rows_by("largest"), rows_by("place")
_SUMS, _MEANS = rows_by("integral"), rows_by("mean")
_SLIP = [row.key for row in _LARGEST].index("slip")
_PLACED = [[row.key for row in _LARGEST].index(row.key.removesuffix("_at")) for row in _PLACES]


class JointExtremesStream:
    """Stream ``joints`` of a results file; each rank reduces its own points first.

    Attributes:
        forces: Sums over the points of each joint.
        maxima: Rows of the stream ``joint_maxima`` at the points of this rank, shape (rows, n).
    """

    def __init__(self, model: Model) -> None:
        """Determine the series of each joint (collective)."""
        assert model.operator is not None
        assert model.contact is not None
        self._operator, self._tied = model.operator, model.contact.tied
        self.forces = JointForces(model)
        self.maxima: Floats = np.zeros((len(TABLE["joint_maxima"]), len(model.operator.joint)))
        # The points of a joint are consecutive.
        self._joints, self._starts = np.unique(model.operator.joint, return_index=True)
        # Values below the rounding error of coordinates (1e-35 m for example) count as zero.
        points = model.operator.points
        ends = np.array([points.min(initial=np.inf), -points.max(initial=-np.inf)])
        lowest, highest = of_ranks(model.operator.comm, ends).min(axis=0)
        self._rounding = np.finfo(np.float64).eps * float(-highest - lowest)

    def values(self, points: JointPoints, sliding: Flags) -> dict[str, Floats]:
        """Return the series of consecutive steps by name, a row for each step (collective).

        ``sliding`` is True at sliding points, shape (steps, n).
        """
        count, operator = len(_LARGEST), self._operator
        # The first rows of the maxima are those of _LARGEST.
        local = np.maximum(at_points(TABLE["joint_maxima"], points), 0.0)
        local[..., self._tied] = 0.0
        slid = (sliding & (local[_SLIP] > 0.0)).any(axis=0)
        np.maximum(self.maxima, [*local.max(axis=1), slid], out=self.maxima)
        local = local[:count]
        largest = np.zeros((*local.shape[:-1], len(operator.names)))
        self._reduce(np.maximum, local, largest)
        integrands = at_points((*_SUMS, *_MEANS), points) * self.forces.areas
        by_rank = np.concatenate([largest, self.forces.local_sums(integrands)])
        by_rank = of_ranks(operator.comm, by_rank)
        largest, sums = by_rank[:, :count].max(axis=0), by_rank[:, count:].sum(axis=0)
        sums[len(_SUMS) :] /= self.forces.free_area
        columns = [*largest, *self._places(local[_PLACED], largest[_PLACED]), *sums]
        rows = (*_LARGEST, *_PLACES, *_SUMS, *_MEANS)
        return {
            row.name.replace("*", joint): values[:, number]
            for number, joint in enumerate(operator.names)
            for row, values in zip(rows, columns, strict=True)
            if not row.rare or joint in self.forces.bonded
        }

    def _places(self, local: Floats, largest: Floats) -> Floats:
        """Return positions of the largest values in each joint, shape (m, steps, joints, 3)."""
        operator, count = self._operator, local.shape[-1]
        least = np.maximum(ALIKE * largest, np.nextafter(self._rounding, np.inf))
        first = np.full(largest.shape, count)
        is_largest = local >= least.take(operator.joint, axis=-1)
        self._reduce(np.minimum, np.where(is_largest, np.arange(count), count), first)
        nowhere = np.full((1, 3), np.nan)
        by_rank = of_ranks(operator.comm, np.concatenate([operator.points, nowhere])[first])
        rank = (~np.isnan(by_rank[..., :1])).argmax(axis=0)  # The first rank has the first point.
        return np.asarray(np.take_along_axis(by_rank, rank[None], axis=0)[0])

    def _reduce(self, ufunc: np.ufunc, local: Any, by_joint: Any) -> None:
        """Reduce values (..., n) to joints (..., joints); joints without local points are kept."""
        if len(self._starts):
            by_joint[..., self._joints] = ufunc.reduceat(local, self._starts, axis=-1)


STATIC_PART = "static_displacement"

# Largest number of steps in a block, and largest size of its arrays [bytes]: caches contain them.
_BLOCK_STEPS, _BLOCK_BYTES = 128, 1 << 21


class StepSeries:
    """Collects steps from a record ``first`` on, and computes their series.

    Attributes:
        last: Time [s] and velocities of all points [m/s] of the last step taken.
        resultants: Resultants of joints and blocks if they are recorded.
        static: True if the static part of the displacement is recorded.
    """

    resultants: ResultantsStream | None = None
    static = False

    def __init__(self, model: Model, probe: PointProbe, first: Record) -> None:
        """Find the nodes of the supports (collective)."""
        self._model, self._probe = model, probe
        self._supports = (*model.constraints.groups, *model.constraints.points)
        nodes = [model.nodes(group) for group in self._supports]
        at_supports = np.concatenate([np.empty(0, dtype=np.int64), *nodes])
        self._dofs = model.gdim * at_supports + np.arange(model.gdim)[:, None]
        self._ends = np.cumsum([0, *map(len, nodes)])
        counts = map(model.constraints.counts, self._supports, nodes)
        self._counts = np.concatenate([np.empty((0, model.gdim), dtype=bool), *counts]).T
        self.last: tuple[float, Floats | None] = (-np.inf, None)
        self._steps: list[tuple[Any, ...]] = []
        self._extremes: JointExtremesStream | None = None
        points = 0
        if model.contact is not None and first.joints is not None:
            self._extremes = JointExtremesStream(model)
            static = first.stages[-1].state.joints if first.stages else None
            self._gap = (static or first.joints).state.gap.copy()  # from which slip is measured
            points = len(self._gap)
        size = 8 * (3 * probe.dofs.size + self._dofs.size + 8 * points)
        comm = model.jointed.mesh.comm
        count = max(1, min(_BLOCK_STEPS, *comm.allgather(_BLOCK_BYTES // max(1, size))))
        # A row for each step: at the points u, v and the static part of u; reactions; joint points.
        self._moved = np.empty((3, count, *probe.dofs.shape))
        self._reactions = np.empty((count, *self._dofs.shape))
        self._gaps, self._tractions = np.empty((2, count, points, 3))
        self._cohesion = np.empty((count, points))
        self._status = np.empty((count, points), dtype=np.int8)

    def collect(self, record: Record) -> PETSc.Vec | None:
        """Copy the values of a step; return the static part of u if recorded (collective)."""
        ground = {"ground_acceleration": record.ground_acceleration}
        if record.free_surface is not None:
            ground = {"free_surface_velocity": record.free_surface(record.time)}
        if record.reservoir_force is not None:
            ground["reservoir_force"] = record.reservoir_force
        contact, joints, solve = self._model.contact, record.joints, record.solve
        row, pressure, static = len(self._steps), None, None
        counts = solve.counts if solve else None
        if self._extremes is not None and joints is not None and contact is not None:
            self._gaps[row], self._tractions[row] = joints.state.gap, joints.traction
            self._cohesion[row] = self._extremes.forces.cohesion(joints)
            self._status[row] = joints.status
            counts = contact.counts(joints.status) if counts is None else counts
        if self.resultants is not None and record.pressure is not None:
            pressure = record.pressure()
        local, moved = self._probe.local, self._moved
        moved[0, row], moved[1, row] = local(record.displacement), local(record.velocity)
        if self.static and record.static_part is not None:
            static = record.static_part(record.time)
            moved[2, row] = local(static)
        self._reactions[row] = record.reaction.getArray(readonly=True).take(self._dofs)
        iterations = solve.iterations if solve else 0
        self._steps.append((record.time, ground, counts, iterations, record.energy, pressure))
        return static

    @property
    def full(self) -> bool:
        """True if the block of collected steps has its largest size."""
        return len(self._steps) == len(self._gaps)

    def take(self) -> tuple[Sequence[float], dict[str, dict[str, Any]]]:
        """Return times and series by stream of the collected steps; discard them (collective)."""
        steps, self._steps = self._steps, []
        if not steps:
            return [], {}
        times, ground, counts, iterations, rows, pressure = zip(*steps, strict=True)
        count = len(steps)
        histories = self._motion(times, *self._moved[: 3 if self.static else 2, :count])
        histories |= _shares(counts)
        histories |= {name: _stacked([step[name] for step in ground]) for name in ground[0]}
        at_nodes, ends = self._reactions[:count] * self._counts, pairwise(self._ends)
        sums = np.array([at_nodes[..., start:stop].sum(axis=-1) for start, stop in ends])
        forces = summed(self._model.jointed.mesh.comm, sums)
        histories |= zip([f"reaction/{name}" for name in self._supports], forces, strict=True)
        streams = {"histories": histories | {"iterations": np.array(iterations)}}
        streams["energy"] = energies(self._model, rows)
        if self._extremes is not None:
            gap, slip = self._gaps[:count], (self._gaps[:count] - self._gap)[..., 1:]
            points = JointPoints(gap, slip, self._tractions[:count], self._cohesion[:count])
            sliding = self._status[:count] >= Status.SLIP  # also closed without friction
            streams["joints"] = self._extremes.values(points, sliding)
            if self.resultants is not None:
                water = None if pressure[0] is None else _stacked(pressure)
                streams["resultants"] = self.resultants.values(points, water)
        return times, streams

    def state_dict(self) -> dict[str, Any]:
        """Return ``last``, first gaps and joint maxima (collective)."""
        joints: dict[str, Floats] = {}
        if self._extremes is not None:
            joints = {"gap": self._gap, "joint_maxima": self._extremes.maxima.T}
        parts = {name: Dealt(self._model.jointed.mesh.comm, v) for name, v in joints.items()}
        return {"time": self.last[0], "velocity": self.last[1], **parts}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the values from ``state_dict``."""
        self.last = state_dict["time"], state_dict["velocity"]
        if self._extremes is not None:
            self._gap = state_dict["gap"].copy()
            self._extremes.maxima = state_dict["joint_maxima"].T.copy()

    def joint_maxima(self, rows: JointRows | None) -> dict[str, Any]:
        """Return the largest values of the joint points over the steps taken (collective)."""
        series: dict[str, Any] = {}
        if self._extremes is not None and rows is not None:
            for i, row in enumerate(TABLE["joint_maxima"]):
                by_joint = rows.across(rows(self._extremes.maxima[i])).items()
                series |= {row.name.replace("*", joint): values for joint, values in by_joint}
        return series

    def _motion(
        self, times: Sequence[float], u: Floats, v: Floats, *static: Floats
    ) -> dict[str, Floats]:
        """Return the motion of the points in consecutive steps (collective).

        The acceleration is the mean since the last record: change of velocity divided by time. This
        mean is defined for every scheme and any number of substeps.
        """
        everywhere, time = self._probe.of_all_ranks, np.array(times)
        velocity, (last, before) = everywhere(v), self.last
        self.last = times[-1], velocity[-1].copy()
        before = velocity[0] if before is None else before  # no acceleration in the first record
        change = np.diff(velocity, axis=0, prepend=before[None])
        acceleration = change / np.diff(time, prepend=last)[:, None, None]
        values = {"displacement": everywhere(u), "acceleration": acceleration}
        return values | ({STATIC_PART: everywhere(*static)} if static else {})


def _stacked(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays of equal shape as one array; `np.stack` takes longer for small arrays."""
    return np.concatenate(arrays).reshape(len(arrays), *arrays[0].shape)


def _shares(counts: Sequence[Any]) -> dict[str, Floats]:
    """Return the shares of joint points by status from `StatusCounts`, None without joints."""
    total = [max(c.total, 1) if c else 1 for c in counts]
    shares = {}
    for row in rows_below("histories", "joint_"):
        status = row.name.removeprefix("joint_")
        shares[row.name] = np.divide([getattr(c, status) if c else 0 for c in counts], total)
    return shares
