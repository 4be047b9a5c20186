# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strip of layers along x with one kind of plane wave, and its exact solution.

A wave v_i(t) enters at x = 0 through dashpots that absorb the reflected wave. The other end absorbs
the wave too, or is unconstrained. There may be joints between the layers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
AXIS = {"P": 0, "S": 1}


@dataclass(frozen=True, kw_only=True)
class Layer:
    """Layer of the strip.

    Attributes:
        length: Length along x [m].
        material: Material of the layer.
    """

    length: float
    material: dj.Elastic

    def speed(self, wave: str) -> float:
        """Return the speed of P or S waves in plane strain [m/s]."""
        m = self.material
        modulus = m.first_lame("strain") * (wave == "P") + m.shear_modulus * (1 + (wave == "P"))
        return float(np.sqrt(modulus / m.density))

    def impedance(self, wave: str) -> float:
        """Return density times wave speed [Pa s/m]."""
        return float(self.material.density * self.speed(wave))


@dataclass(frozen=True, kw_only=True)
class Strip:
    """Strip of layers that begins at x = 0.

    Attributes:
        layers: Consecutive layers.
        wave: ``P`` or ``S``.
        size: Length of the cells, of degree 2 [m].
        joint: Law of joints between all layers; no joints by default.
        open_end: Whether the far end is unconstrained instead of absorbing.
        overlap: Overlap of the unstressed faces of a joint, which puts it under pressure [m].
    """

    layers: Sequence[Layer]
    wave: str
    size: float
    joint: Any = None
    open_end: bool = False
    overlap: float = 0.0

    def mesh(self) -> dj.JointedMesh:
        """Return a row of quadrilaterals, with a joint between any two layers if there is a law."""
        counts = [round(layer.length / self.size) for layer in self.layers]
        ends = np.cumsum([0, *counts])
        at = np.concatenate(
            [
                [0.0],
                *(np.full(n, part.length / n) for n, part in zip(counts, self.layers, strict=True)),
            ]
        )
        x = np.cumsum(at)
        n = len(x)
        lower = np.arange(n - 1)
        upright = lambda k: np.array([[k, k + n]])  # noqa: E731
        facets = {"near": upright(0), "far": upright(n - 1)}
        along = np.column_stack([lower, lower + 1])
        facets["sides"] = np.vstack([along, along + n])
        if self.joint is not None:
            facets |= {f"joint_{i}": upright(k) for i, k in enumerate(ends[1:-1], 1)}
        parts = pairwise(ends)
        return dj.mesh_from_arrays(
            MPI.COMM_SELF,
            cell="quadrilateral",
            x=np.column_stack([np.tile(x, 2), np.repeat([0.0, self.size], n)]),
            cells=np.column_stack([lower, lower + 1, lower + n, lower + n + 1]),
            facet_groups=facets,
            cell_groups={f"layer_{i}": np.arange(a, b) for i, (a, b) in enumerate(parts)},
        )

    def model(self) -> dj.Model:
        """Return the model; nodes move only along the wave's axis."""
        jointed = self.mesh()
        across = "xy"[1 - AXIS[self.wave]]
        ends = ["near"] if self.open_end else ["near", "far"]
        faces = [name + side for name in jointed.joint_names for side in "+-"]
        groups = ["sides", "near", "far", *faces]
        fixed = [dj.Fixed(group=group, components=across) for group in groups]
        return dj.Model(
            jointed,
            material={f"layer_{i}": layer.material for i, layer in enumerate(self.layers)},
            joints=dj.Joints(
                self.joint, initial_gaps={name: -self.overlap for name in jointed.joint_names}
            ),
            supports=[*(dj.ViscousBoundary(group=group) for group in ends), *fixed],
            body=dj.Body(degree=2),
        )

    def send(self, incident: Callable[[float], float], *, dt: float, steps: int) -> Sent:
        """Run a wave of velocity v_i(t) [m/s] that enters at x = 0."""
        model, ends = self.model(), _Ends(AXIS[self.wave])
        run = dj.Simulation(model, monitors=[ends])
        if self.joint is not None:
            run.statics()
        stress = 2.0 * self.layers[0].impedance(self.wave) * np.eye(2)[AXIS[self.wave]]
        push = dj.Traction(group="near", value=stress, factor=incident)
        outcome = run.dynamics(dt=dt, steps=steps, loads=[push])
        return Sent(
            times=np.array(ends.times),
            near=np.array(ends.near),
            far=np.array(ends.far),
            slips=np.array(ends.slips),
            outcome=outcome,
            area=self.size,
        )

    def transfer(self, frequencies: Floats, stiffness: float = np.inf) -> Complex:
        """Return the ratio of far-end to incident velocity for linear joints of a stiffness [Pa/m].

        Velocity and stress of a harmonic wave are propagated by matrices of layers and joints, as
        in Haskell 1953 and Schoenberg 1980.
        """
        ratios = []
        for omega in 2.0 * np.pi * frequencies:
            path = np.eye(2, dtype=complex)
            for i, layer in enumerate(self.layers):
                if i and self.joint is not None:
                    path = np.array([[1.0, 1j * omega / stiffness], [0.0, 1.0]]) @ path
                z, phase = layer.impedance(self.wave), omega * layer.length / layer.speed(self.wave)
                sine, cosine = 1j * np.sin(phase), np.cos(phase)
                path = np.array([[cosine, sine / z], [z * sine, cosine]]) @ path
            z = self.layers[0].impedance(self.wave)
            last = 0.0 if self.open_end else self.layers[-1].impedance(self.wave)
            into, start = path @ [1.0, z], path @ [0.0, -2.0 * z]
            first = -(start[1] + last * start[0]) / (into[1] + last * into[0])
            ratios.append(into[0] * first + start[0])
        return np.array(ratios)


@dataclass(frozen=True, kw_only=True)
class Sent:
    """Response of the strip to a wave.

    Attributes:
        times: Times of the steps [s], shape (n,).
        near: Velocity at x = 0 in the middle of each step [m/s].
        far: Velocity at the far end in the middle of each step [m/s].
        slips: Slip of the first joint at the times [m].
        outcome: Outcome of the run.
        area: Area of the cross-section [m^2].
    """

    times: Floats
    near: Floats
    far: Floats
    slips: Floats
    outcome: Any
    area: float

    @property
    def middles(self) -> Floats:
        """Middles of the steps [s]."""
        return np.asarray((self.times[1:] + self.times[:-1]) / 2.0)

    def ratio(self, frequencies: Floats, incident: Callable[[float], float]) -> Complex:
        """Return the ratio of far-end to incident velocity at frequencies [Hz]."""
        waves = np.exp(-2j * np.pi * np.outer(frequencies, self.middles))
        return np.asarray((waves @ self.far) / (waves @ [incident(t) for t in self.middles]))


class _Ends(Monitor):
    """Monitor of the mean velocities of steps at both ends and of the first joint's slip."""

    def __init__(self, axis: int) -> None:
        self._axis = axis

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Find the nodes."""
        self._nodes = [int(model.nodes(group)[0]) for group in ("near", "far")]
        self.times: list[float] = [first.time]
        self.near: list[float] = []
        self.far: list[float] = []
        self.slips: list[float] = []
        self._last = self._displacements(first)
        self._slip(first)

    def record(self, record: Record) -> None:
        """Store the step."""
        now = self._displacements(record)
        near, far = (now - self._last) / (record.time - self.times[-1])
        self.near.append(float(near))
        self.far.append(float(far))
        self.times.append(record.time)
        self._last = now
        self._slip(record)

    def _displacements(self, record: Record) -> Floats:
        values = record.displacement.getArray(readonly=True).reshape(-1, 2)
        return np.asarray(values[self._nodes, self._axis].copy())

    def _slip(self, record: Record) -> None:
        if record.joints is not None:
            self.slips.append(float(record.joints.state.gap[0, 1]))


def pulse(length: float, height: float = 1.0) -> Callable[[float], float]:
    """Return a sin^4 pulse with a duration [s] and a height [m/s]."""
    return lambda t: height * float(np.sin(np.pi * t / length) ** 4) if 0.0 < t < length else 0.0
