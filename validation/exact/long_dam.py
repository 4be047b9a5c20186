# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Long dam under a ground wave that passes along it.

A wall of length L = 500 m, height H = 50 m and constant thickness is sheared across its length,
u = u_y(x, z, t). The ground moves by f(t - x/c), a sin^4 pulse of 0.05 s with c = 5000 m/s. The
shear wave velocity of the wall is c_s = 2000 m/s. The wave in the wall that moves with the ground
is a function of s = t - x/c and z,

    (1/c_s^2 - 1/c^2) u_ss = u_zz:  u = sum over k of
        (-1)^k (f(s - (z + 2 k H)/v) + f(s - (2 (k + 1) H - z)/v)),  1/v^2 = 1/c_s^2 - 1/c^2,

that is d'Alembert's waves up and down with v > c_s. Disturbances from the ends travel along the
wall with c_s at most, so this is the whole solution where c_s t < x < L - c_s (t - L/c). The static
part, with both ends unconstrained, is

    u_s = sum over n of a_n(t) cos(k_n x) cosh(k_n (H - z)) / cosh(k_n H),  k_n = n pi/L,

with the cosine coefficients a_n of the ground's displacement. Hexahedra have degree 2, one across.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box, locate_entities_boundary
from numpy.typing import NDArray
from scipy.fft import dct

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record
from validation.atlas import Outcome, curve, estimate, new_figure

SOURCE = "closed form: d'Alembert's waves that travel with the ground motion; Fourier series"

Floats = NDArray[np.float64]
LENGTH, HEIGHT, WIDTH = 500.0, 50.0, 5.0  # [m]
CONCRETE = dj.Elastic(young=20e9, poisson=0.25, density=2000.0)
SHEAR, SPEED, PULSE, END = 2000.0, 5000.0, 0.05, 0.12  # c_s, c [m/s]; pulse, run [s]
RISING = 1.0 / np.sqrt(SHEAR**-2 - SPEED**-2)  # v [m/s]
# Relative error by cells and steps: a third of the error with both twice as long, 0.8 %.
STEPS = 0.003


def ground(time: Floats) -> Floats:
    """Return f with unit amplitude."""
    return np.asarray(np.sin(np.pi * np.clip(time, 0.0, PULSE) / PULSE) ** 4)


def whole(x: Floats, z: Floats, time: float) -> Floats:
    """Return the wave in the wall."""
    s, displacement = time - x / SPEED, np.zeros_like(x)
    for k in range(int(END * RISING / HEIGHT) + 1):
        up, down = z + 2 * k * HEIGHT, 2 * (k + 1) * HEIGHT - z
        displacement += (-1) ** k * (ground(s - up / RISING) + ground(s - down / RISING))
    return displacement


def away_from_ends(x: Floats, time: float) -> NDArray[np.bool_]:
    """Return a mask of the places that no disturbance from an end has reached."""
    return np.asarray((x > SHEAR * time) & (x < LENGTH - SHEAR * (time - LENGTH / SPEED)))


def static(x: Floats, time: float, terms: int = 64) -> Floats:
    """Return the static part at the crest."""
    count = 4096
    middles = LENGTH * (np.arange(count) + 0.5) / count
    a = dct(ground(time - middles / SPEED))[:terms] / count
    a[0] /= 2.0
    k = np.pi * np.arange(terms) / LENGTH
    return np.asarray(np.cos(np.outer(x, k)) @ (a / np.cosh(k * HEIGHT)))


@dataclass(frozen=True)
class Found:
    """Results of a run at the nodes of this rank on one face.

    Attributes:
        x: Positions along the wall, shape (n,), [m].
        z: Heights, shape (n,), [m].
        times: Times of the steps, shape (m,), [s].
        whole: Absolute displacements over the amplitude of f, shape (m, n).
        static: Static part of them, shape (m, n).
    """

    x: Floats
    z: Floats
    times: Floats
    whole: Floats
    static: Floats


class _Across(Monitor):
    """Monitor of the displacements across the wall and their static part."""

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Store the first state."""
        self.times: list[float] = []
        self.whole: list[Floats] = []
        self.static: list[Floats] = []
        self.record(first)

    def record(self, record: Record) -> None:
        """Store the step."""
        assert record.static_part is not None
        self.times.append(record.time)
        self.whole.append(record.displacement.array.reshape(-1, 3)[:, 1].copy())
        self.static.append(record.static_part(record.time).array.reshape(-1, 3)[:, 1].copy())


def wall(comm: Any, cells: int) -> dj.Model:
    """Return the wall with ``cells`` cells in height and ten times as many along it."""
    corners = [np.zeros(3), np.array([LENGTH, WIDTH, HEIGHT])]
    mesh = create_box(comm, corners, [10 * cells, 1, cells], CellType.hexahedron)
    base = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0.0))
    faces = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[1] % WIDTH, 0.0))
    return dj.Model(
        dj.split_mesh(mesh, groups={"base": base, "faces": faces}),
        material=CONCRETE,
        supports=[dj.Fixed(group="base"), dj.Fixed(group="faces", components="xz")],
        body=dj.Body(degree=2),
    )


def march(comm: Any, cells: int, steps: int) -> Found:
    """Run the passing wave (collective)."""
    dt, size = END / steps, 0.01  # s, m
    time = dt / 4.0 * np.arange(round(4.0 * PULSE / dt) + 1)
    motion = dj.motion_from_displacement(np.outer(size * ground(time), np.eye(3)[1]), dt=dt / 4.0)
    passing = dj.DifferingMotion(
        motions=motion, passage=dj.Passage(speed=SPEED, direction=(1.0, 0.0, 0.0))
    )
    model, seen = wall(comm, cells), _Across()
    dj.Simulation(model, monitors=[seen]).dynamics(dt=dt, steps=steps, motion=passing)
    x = model.V.tabulate_dof_coordinates()[: len(seen.whole[0])]
    face = np.isclose(x[:, 1], 0.0)
    times = np.array(seen.times)
    first = ground(times)[:, None]  # motion that displacements are relative to
    return Found(
        x=x[face, 0],
        z=x[face, 2],
        times=times,
        whole=np.array(seen.whole)[:, face] / size + first,
        static=np.array(seen.static)[:, face] / size + first,
    )


def run(quick: bool) -> Outcome:
    """Run the passing wave; ``quick`` doubles cells and steps."""
    result = march(MPI.COMM_SELF, 5 if quick else 10, 120 if quick else 240)
    crest = np.flatnonzero(np.isclose(result.z, HEIGHT))
    crest = crest[np.argsort(result.x[crest])]
    x, z = result.x[crest], result.z[crest]
    alone = np.array([away_from_ends(x, t) for t in result.times])
    exact = np.array([whole(x, z, t) for t in result.times])
    still = np.array([static(x, t) for t in result.times])
    ours, own = result.whole[:, crest], result.static[:, crest]
    limits = estimate(steps=4.0 * STEPS if quick else STEPS)
    rows = [
        curve("crest away from the ends", ours[alone], exact[alone], **limits),
        curve("static part at the crest", own, still, tolerance=1e-4, reason="third order: cells"),
        curve(
            "dynamic part away from the ends", (ours - own)[alone], (exact - still)[alone], **limits
        ),
    ]
    figure, ax = new_figure()
    for time in (0.06, 0.08, 0.1, 0.12):
        step = int(np.abs(result.times - time).argmin())
        shown = np.where(alone[step], exact[step], np.nan)
        (line,) = ax.plot(x, shown, label=f"{1e3 * time:g} ms")
        ax.plot(x[::2], ours[step, ::2], ".", color=line.get_color())
        ax.plot(x, still[step], "--", lw=1, color=line.get_color())
        ax.plot(x[::10], own[step, ::10], "+", ms=4, color=line.get_color())
    ax.set_xlabel("along the dam [m]")
    ax.set_ylabel("crest / largest displacement of the ground")
    ax.set_title("lines: exact, dots: ours; static part: dashed, crosses", fontsize=9)
    ax.legend(fontsize=8)
    return Outcome(rows=rows, figure=figure)
