#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accuracy and cost of `ReservoirWaves`: forces on a rigid face, a jointed dam, time per step.

- Force on a rigid vertical face 100 m high, with 16 elements, under a pulse of the ground. It is
  compared with closed forms (`exact`) from 0 to 3 times the reservoir's first frequency. Errors are
  the largest error over the largest exact force. Without absorption at the bottom, 3 % around the
  poles are left out, and the last four fifths of the slowly decaying force are faded out.
- Jointed dam: its energy ledger, and processor time per step with joints and tied, in water and
  dry, in alternating runs.
"""

from __future__ import annotations

import warnings
from itertools import product
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_rectangle, locate_entities_boundary
from numpy.typing import NDArray

import dolfinx_joints as dj
from benchmarks.shared.measure import Marching
from benchmarks.shared.scenes import DAM_SIZES, TIME_STEP, dam
from benchmarks.shared.tables import head, line, table
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.loads.ground_motion import velocity_of
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

HEIGHT, DENSITY, SOUND = 100.0, 1000.0, 1440.0
FIRST = SOUND / (4.0 * HEIGHT)
STEPS_PER_PERIOD = 40  # at three times the first frequency
NEAR_POLES = 0.03
FADES = 0.2

# Direction, reflection, length and absorbing length over the height, far end, steps.
CASES = (
    ("stream", 0.75, 5.0, 0.0, "radiating", 2000),
    ("stream", 0.75, 10.0, 0.0, "radiating", 2000),
    ("stream", 0.75, 20.0, 0.0, "radiating", 2000),
    ("stream", 1.0, 10.0, 0.0, "radiating", 12000),
    ("stream", 1.0, 30.0, 0.0, "radiating", 12000),
    ("stream", 1.0, 15.0, 12.0, "radiating", 12000),
    ("stream", 1.0, 30.0, 25.0, "radiating", 12000),
    ("stream", 1.0, 30.0, 25.0, "radiating", 24000),
    ("upwards", 0.75, 1.0, 0.0, "radiating", 2500),
    ("upwards", 0.75, 5.0, 4.0, "radiating", 2500),
    ("upwards", 0.75, 1.0, 0.0, "rigid", 2500),
)


class _Forces(Monitor):
    """Monitor of the times and of the force of the water along x."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.forces: list[float] = []

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        self.record(first)

    def record(self, record: Record) -> None:
        assert record.reservoir_force is not None
        self.times.append(record.time)
        self.forces.append(float(record.reservoir_force[0]))


def exact(direction: str, frequency: Floats, alpha: float, length: float = np.inf) -> Complex:
    r"""Return the force per unit acceleration along x [N s^2/m per m].

    A rigid vertical face of depth H accelerates by a e^{i w t} at an endless reservoir with an
    absorbing floor (Fenves and Chopra 1984; Chopra 1967 without absorption). With q = (1 - alpha) /
    ((1 + alpha) c) and p_m = sin l_m (H - z), l_m cos l_m H + i w q sin l_m H = 0,

        F = -rho a sum I_m^2 / (N_m k_m),  k_m^2 = l_m^2 - (w / c)^2,  I_m = int p_m dz
        = (1 - cos l_m H) / l_m,  N_m = int p_m^2 dz = H / 2 - sin(2 l_m H) / (4 l_m).

    A floor that accelerates upwards, uniformly along the reservoir, gives

        p = rho a sin k (H - z) / (k cos k H + i w q sin k H),  k = w / c.

    Args:
        direction: ``stream`` or ``upwards``.
        frequency: Frequencies [Hz].
        alpha: Reflection coefficient of the bottom.
        length: Distance of a wall that also moves with the ground [m].
    """
    omega = 2.0 * np.pi * frequency
    damped = 1j * omega * (1.0 - alpha) / ((1.0 + alpha) * SOUND)
    k = omega / SOUND
    if direction == "upwards":
        bottom = k * np.cos(k * HEIGHT) + damped * np.sin(k * HEIGHT)
        return np.asarray(DENSITY * (1.0 - np.cos(k * HEIGHT)) / k / bottom)
    rates = (2.0 * np.arange(1, 200) - 1.0) * np.pi / (2.0 * HEIGHT) + 0j * omega[:, None]
    k, damped = k[:, None], damped[:, None]
    for _ in range(50):  # Newton's method for l cos l H + i omega q sin l H = 0
        sine, cosine = np.sin(rates * HEIGHT), np.cos(rates * HEIGHT)
        slope = cosine - rates * HEIGHT * sine + damped * HEIGHT * cosine
        rates -= (rates * cosine + damped * sine) / slope
    decay = np.sqrt(rates**2 - k**2)
    # Without absorption, choose the waves that travel away from the face.
    back = (decay.real < 0.0) | ((np.abs(decay.real) < 1e-12) & (decay.imag < 0.0))
    decay = np.where(back, -decay, decay)
    moment = (1.0 - np.cos(rates * HEIGHT)) / rates
    size = HEIGHT / 2.0 - np.sin(2.0 * rates * HEIGHT) / (4.0 * rates)
    # Between two walls with the same motion, p is antisymmetric about the middle.
    ended = 1.0 if np.isinf(length) else np.tanh(decay * length / 2.0)
    return np.asarray(-DENSITY * np.sum(moment**2 / size / decay * ended, axis=1))


def rigid_dam(waves: dj.ReservoirWaves) -> dj.Model:
    """Return a rigid dam, 20 m thick."""
    corners = [[0.0, 0.0], [20.0, HEIGHT]]
    mesh = create_rectangle(MPI.COMM_SELF, corners, [1, 16], CellType.quadrilateral)
    up = locate_entities_boundary(mesh, 1, lambda x: x[0] < 1e-9)
    down = locate_entities_boundary(mesh, 1, lambda x: x[0] > 20.0 - 1e-9)
    return dj.Model(
        dj.split_mesh(mesh, groups={"up": up, "down": down}),
        material=dj.Elastic(young=1e17, poisson=0.2, density=2400.0),
        supports=[dj.Fixed(group="down")],
        water=waves,
    )


def spectrum(
    direction: str,
    alpha: float,
    length: float,
    absorbing: float,
    far_end: Any,
    steps: int,
    layers: int | None = None,
) -> tuple[Floats, Complex, Complex, float]:
    """Return frequencies over the first one, computed and exact force, and energy imbalance."""
    waves = dj.ReservoirWaves(
        group="up",
        level=HEIGHT,
        length=length * HEIGHT,
        absorbing_length=absorbing * HEIGHT,
        far_end=far_end,
        layers=layers,
        bottom_reflection=alpha,
        sound_speed=SOUND,
    )
    axis, forces = {"stream": 0, "upwards": 2}[direction], _Forces()

    def pulse(time: float) -> Floats:
        return np.asarray(np.exp(-(((time - 0.3) / 0.05) ** 2)) * np.eye(3)[axis])

    dt = 1.0 / (3.0 * FIRST * STEPS_PER_PERIOD)
    outcome = dj.Simulation(rigid_dam(waves), monitors=[forces]).dynamics(
        dt=dt, steps=steps, motion=pulse
    )
    times, computed = np.array(forces.times), np.array(forces.forces)
    ratio = np.linspace(0.02, 3.0, 299)
    if alpha == 1.0:
        poles = np.array([1.0, 3.0])
        near = np.abs(ratio[:, None] - poles).min(axis=1) < NEAR_POLES
        ratio = np.sort(np.append(ratio[~near], [1 - NEAR_POLES, 1 + NEAR_POLES, 3 - NEAR_POLES]))
        late = np.maximum(times / times[-1] - FADES, 0.0) / (1.0 - FADES)
        computed = computed * 0.5 * (1.0 + np.cos(np.pi * late))
    transform = np.exp(-2j * np.pi * FIRST * np.outer(ratio, times))
    computed = (transform @ computed) / (transform @ [pulse(t)[axis] for t in times])
    end = length * HEIGHT if far_end == "rigid" else np.inf
    reference = exact(direction, ratio * FIRST, alpha, end)
    assert outcome.imbalance is not None
    return ratio, computed, reference, outcome.imbalance


def force(
    direction: str, alpha: float, length: float, absorbing: float, far_end: Any, steps: int
) -> tuple[float, float, float]:
    """Return the largest error, its frequency over the first one, and the energy imbalance."""
    ratio, computed, reference, imbalance = spectrum(
        direction, alpha, length, absorbing, far_end, steps
    )
    errors = np.abs(computed - reference) / np.abs(reference).max()
    return float(errors.max()), float(ratio[errors.argmax()]), imbalance


FACE = (
    "| direction | alpha | length / height | absorbing | far end | steps | error | at f/f1 |"
    " imbalance |\n"
    "| {direction} | {alpha} | {length:.0f} | {absorbing:.0f} | {far_end} | {steps} |"
    " {error:.2%} | {at:.2f} | {imbalance:.0e} |"
)
DAM = (
    "|  | unknowns | step [ms] | over tied | iterations | imbalance | first step [ms] |\n"
    "| {water} {joints} | {unknowns} | {step:.2f} | {over:.2f} | {iterations:.2f} |"
    " {imbalance:.0e} | {first:.0f} |"
)


def face(steps: int | None) -> None:
    """Print the errors of the forces on the rigid face."""
    print(head(FACE))
    for case in CASES:
        row = dict(
            zip(("direction", "alpha", "length", "absorbing", "far_end"), case, strict=False)
        )
        row["steps"] = case[-1] if steps is None else steps
        row |= dict(zip(("error", "at", "imbalance"), force(**row), strict=True))
        print(line(FACE, row), flush=True)


def cost(name: str, steps: int) -> None:
    """Print time per step and energy imbalance of a dam: dry or in water, tied or with joints."""
    scene, dt = dam(name), TIME_STEP
    level = float(scene.crest[2]) - 3.0
    shaking = scene.strong_shaking(steps * dt)
    motion = dj.BaseMotion(acceleration=shaking, velocity=velocity_of(shaking, dt))
    runs: dict[tuple[bool, bool], tuple[int, Marching]] = {}
    with scene.mesh_file() as path:
        for wet, tied in product((False, True), (True, False)):
            water = dj.ReservoirWaves(
                group="upstream", level=level, length=3.0 * level, bottom_reflection=0.8
            )
            model = scene.model(
                scene.read(path, tied=tied),
                None if tied else scene.law(),
                water=water if wet else None,
            )
            static = dj.Simulation(model).statics(steps=scene.load_steps)
            system = model.system([motion], waves=dt if wet else None)
            run = Marching(system, dt, static, dj.EnergyConsistent())
            runs[wet, tied] = system.stiffness.getSize()[0], run
    for _ in range(steps):
        for _, run in runs.values():
            run.step()
    rows = []
    for (wet, tied), (unknowns, run) in runs.items():
        imbalance = run.ledger.relative_imbalance
        assert imbalance < 1e-10
        rows.append(
            {
                "water": "water" if wet else "dry",
                "joints": "tied" if tied else "joints",
                "unknowns": unknowns,
                "step": np.median(run.ms[1:]),
                "over": np.median(np.divide(run.ms, runs[wet, True][1].ms)[1:]),
                "iterations": run.iterations / steps,
                "imbalance": imbalance,
                "first": run.ms[0],
            }
        )
    print(f"{name}: processor time per step\n{table(DAM, rows)}")


def main(arguments: list[str] | None = None) -> None:
    """Print tables."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--dam", choices=DAM_SIZES, help="print times per step of this dam")
    parser.add_argument("--steps", type=int, help="number of steps of each run")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    if options.dam:
        cost(options.dam, options.steps or 60)
    else:
        face(options.steps)


if __name__ == "__main__":
    main()
