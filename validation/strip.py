# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A strip of layers along x that lets one kind of plane wave through, and its exact answer.

A wave v_i(t) enters at x = 0 through dashpots that take what comes back; the other end takes the
wave as well, or is unconstrained. Joints may lie between layers.
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
    """A part of the strip.

    Attributes:
        length: [m].
        material: Of it.
    """

    length: float
    material: dj.Elastic

    def speed(self, wave: str) -> float:
        """Of P or S waves in plane strain [m/s]."""
        m = self.material
        modulus = m.first_lame("strain") * (wave == "P") + m.shear_modulus * (1 + (wave == "P"))
        return float(np.sqrt(modulus / m.density))

    def impedance(self, wave: str) -> float:
        """Density times speed [Pa s/m]."""
        return float(self.material.density * self.speed(wave))


@dataclass(frozen=True, kw_only=True)
class Strip:
    """Layers from x = 0 on.

    Attributes:
        layers: One after the other.
        wave: ``P`` or ``S``.
        size: Length of the cells, of degree 2 [m].
        joint: Law of joints between all layers; none unless given.
        open_end: Whether the far end is unconstrained instead of absorbing.
        overlap: By how much unstressed faces of a joint would overlap [m].
    """

    layers: Sequence[Layer]
    wave: str
    size: float
    joint: Any = None
    open_end: bool = False
    overlap: float = 0.0

    def mesh(self) -> dj.JointedMesh:
        """One row of quadrilaterals, with a joint between every two layers if there is a law."""
        counts = [round(layer.length / self.size) for layer in self.layers]
        ends = np.cumsum([0, *counts])
        at = np.concatenate(
            [
                [0.0],
                *(np.full(n, each.length / n) for n, each in zip(counts, self.layers, strict=True)),
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
        """The model; nodes move along the wave's axis only."""
        jointed = self.mesh()
        across = "xy"[1 - AXIS[self.wave]]
        ends = ["near"] if self.open_end else ["near", "far"]
        faces = [name + side for name in jointed.joint_names for side in "+-"]
        groups = ["sides", "near", "far", *faces]
        held = [dj.Fixed(group=group, components=across) for group in groups]
        return dj.Model(
            jointed,
            material={f"layer_{i}": each.material for i, each in enumerate(self.layers)},
            joints=dj.Joints(
                self.joint, initial_gaps={name: -self.overlap for name in jointed.joint_names}
            ),
            supports=[*(dj.ViscousBoundary(group=group) for group in ends), *held],
            body=dj.Body(degree=2),
        )

    def send(self, incident: Callable[[float], float], *, dt: float, steps: int) -> Sent:
        """Let a wave of velocity v_i(t) [m/s] in at x = 0."""
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
        """Velocity at the far end over the incident one, linear joints of a stiffness [Pa/m].

        Velocity and stress of a harmonic wave go through layers and joints by their matrices, as in
        Haskell 1953 and Schoenberg 1980.
        """
        found = []
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
            found.append(into[0] * first + start[0])
        return np.array(found)


@dataclass(frozen=True, kw_only=True)
class Sent:
    """What a wave did.

    Attributes:
        times: Of the steps [s], shape (n,).
        near: Velocity at x = 0 [m/s], at the middle of each step.
        far: Velocity at the far end, likewise.
        slips: Slip of the first joint [m], at the times.
        outcome: Of the run.
        area: Of the cross-section [m^2].
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
        """Velocity at the far end over the incident one at frequencies [Hz]."""
        waves = np.exp(-2j * np.pi * np.outer(frequencies, self.middles))
        return np.asarray((waves @ self.far) / (waves @ [incident(t) for t in self.middles]))


class _Ends(Monitor):
    """Mean velocities of the steps at both ends, slips of the first joint."""

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
        """Keep the step."""
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
    """sin^4 over a time [s], of a height [m/s]."""
    return lambda t: height * float(np.sin(np.pi * t / length) ** 4) if 0.0 < t < length else 0.0
