# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction from residual slip: where the gradient predicts it, and where it does not.

    ./with-dolfinx python3 -m studies.friction_from_slip
    ./with-dolfinx python3 -m studies.friction_from_slip --quick

The first table shows slopes of the residual slip by the friction coefficient, and the largest
change of the friction up to which they predict the change of the slip with errors of at most 10 %:
for a block in a pulse, next to Newmark's formula (1965), and for a wall. In the second table the
friction is found from the residual slip after a synthetic earthquake, with the gradient (Newton's
method) and without it (secant and Brent's method).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.optimize import root_scalar

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.exact import SlidingBlock
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.geometry.two_blocks import two_blocks

CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
FRICTION = 0.5
PULSE, DURATION = 8.0, 0.1  # [m/s^2], [s]
# Sizes of the changes of the friction, as parts of `CHANGE`.
CHANGE, SIZES = 0.2 * FRICTION, tuple(2.0**-k for k in range(15))
# Search for the friction: true values, start, second start or interval, and error.
TRUTHS, START, SECOND, INTERVAL, ERROR = (0.42, 0.5, 0.58), 0.55, 0.54, (0.35, 0.65), 5e-4
METHODS: dict[str, dict[str, Any]] = {
    "newton": {"x0": START, "fprime": True},
    "secant": {"x0": START, "x1": SECOND},
    "brentq": {"bracket": INTERVAL},
}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Structure in a motion of the ground, and the joint whose residual slip is observed.

    Attributes:
        name: Name in the tables.
        mesh: The mesh.
        joint: Observed joint.
        axis: Axis of the slip in the joint, 1 or 2.
        law: Function that returns the law of all joints for a friction coefficient.
        damping: Damping of the body.
        dt: Time step [s].
        steps: Number of time steps.
        motion: Acceleration of the ground.
        scheme: Time scheme.
    """

    name: str
    mesh: dj.JointedMesh
    joint: str
    axis: int
    law: Callable[[float], Any]
    damping: Any
    dt: float
    steps: int
    motion: Any
    scheme: Any = None

    def model(self, friction: float = FRICTION) -> dj.Model:
        """Return the model with a friction coefficient (collective)."""
        return dj.Model(
            self.mesh,
            material=CONCRETE,
            joints=self.law(friction),
            supports=[dj.Fixed(group="base")],
            loads=[dj.Gravity()],
            damping=self.damping,
        )

    def run(self, model: dj.Model, tape: dj.Tape) -> None:
        """Run self weight and motion (collective)."""
        simulation = dj.Simulation(model, monitors=[tape])
        simulation.statics()
        simulation.dynamics(dt=self.dt, steps=self.steps, motion=self.motion, scheme=self.scheme)

    def tape(self) -> dj.Tape:
        """Return an empty tape that observes the slip."""
        return dj.Tape(gaps={"slip": self.joint})

    @property
    def slip(self) -> dj.Quantity:
        """Mean residual slip of the joint [m]."""
        return dj.Quantity.at_end("slip", self.axis)

    def slip_and_slope(self, friction: float, *, slope: bool) -> tuple[float, float]:
        """Return the residual slip [m], and its derivative by friction or NaN [m] (collective)."""
        tape = self.tape()
        self.run(self.model(friction), tape)
        if not slope:
            return self.slip.value_of(tape.history()), math.nan
        gradient = dj.gradient_of(tape, self.slip)
        return gradient.value, sum(gradient.by_joint["friction_coefficient"].values())


def joint_law(stiffness: float, shear: float) -> Callable[[float], Any]:
    """Return the function of a scene that makes the law of its joints."""
    return lambda friction: dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=shear, friction_coefficient=friction
    )


def damped(ratio: float, frequency: float) -> Any:
    """Return damping proportional to stiffness, with a ratio at a frequency [Hz]."""
    return dj.stiffness_proportional(ratio=ratio, frequency=frequency)


def mesh_from(write: Callable[..., Any], path: Path, **options: Any) -> dj.JointedMesh:
    """Write a mesh file and read it (collective)."""
    on_root(MPI.COMM_WORLD, lambda: path.parent.mkdir(parents=True, exist_ok=True))
    on_root(MPI.COMM_WORLD, lambda: write(path, **options))
    return dj.read_msh(path, MPI.COMM_WORLD)


def pulse(time: float) -> tuple[float, float, float]:
    """Return the acceleration of the ground in the pulse [m/s^2]."""
    return (PULSE if time < DURATION else 0.0, 0.0, 0.0)


def earthquake(peak: float) -> dj.Motion:
    """Return a synthetic earthquake of 2 s with a horizontal peak [g]."""
    return dj.synthetic_motion(duration=2.0, peaks_g=(peak, peak, 0.75 * peak))


def scenes(folder: Path, *, quick: bool) -> tuple[list[Scene], list[Scene]]:
    """Return the scenes of both tables (collective)."""
    blocks = mesh_from(two_blocks, folder / "blocks.msh", size=0.5, width=1.2)
    wall = mesh_from(jointed_wall, folder / "wall.msh", divisions=(8, 2, 8))
    law, short = joint_law(1e10, 5e9), {"dt": 0.002, "steps": 120, "motion": pulse}
    block: dict[str, Any] = {"mesh": blocks, "joint": "joint_1", "axis": 1, "law": law}
    strong, weak = (damped(ratio, 100.0) for ratio in (0.5, 0.05))
    shaken: dict[str, Any] = {"mesh": wall, "joint": "joint_2", "axis": 2, "dt": 0.005}
    shaken |= {"law": joint_law(1e11, 1e11), "steps": 20 if quick else 400}
    shaken |= {"motion": earthquake(0.4)}
    walls = [
        Scene(name="wall, damping of 2 % at 5 Hz", damping=damped(0.02, 5.0), **shaken),
        Scene(name="wall, undamped", damping=None, **shaken),
    ]
    name = "block, damping of 50 % at 100 Hz"
    pulses = [
        Scene(name=name, damping=strong, **block, **short),
        Scene(name="block, damping of 5 % at 100 Hz", damping=weak, **block, **short),
        Scene(name="the same with Newmark", damping=weak, scheme=dj.Newmark(), **block, **short),
        Scene(name="block, undamped", damping=None, **block, **short),
    ]
    long = {"dt": 0.002, "steps": 100 if quick else 1000, "motion": earthquake(0.8)}
    return [*pulses, *walls], [Scene(name=name, damping=strong, **block, **long), *walls]


def tested(scene: Scene) -> dj.TaylorTest:
    """Return the Taylor test of the slope of a scene (collective)."""
    tape = scene.tape()
    scene.run(scene.model(), tape)
    change = {"friction_coefficient": CHANGE}
    return dj.taylor_test(scene.run, tape, scene.slip, change, sizes=SIZES)


def newmark_1965() -> dj.TaylorTest:
    """Return the Taylor test of a rigid block in the pulse: s = A t^2 / 2 (A / (mu g) - 1).

    The base moves along -s1, so that the slip along s1 is -s and grows with the friction.
    """

    def slip(friction: float) -> float:
        level = friction * STANDARD_GRAVITY
        return -SlidingBlock(pulse=PULSE, yield_acceleration=level, duration=DURATION).final_slip

    slope = 0.5 * (PULSE * DURATION / FRICTION) ** 2 / STANDARD_GRAVITY
    changes = [slip(FRICTION + size * CHANGE) - slip(FRICTION) for size in SIZES]
    none = np.zeros(len(SIZES))
    return dj.TaylorTest(
        sizes=np.array(SIZES), changes=np.array(changes), linear=slope * CHANGE, flipped=none
    )


@dataclass(frozen=True)
class Found:
    """Result of a search for the friction.

    Attributes:
        friction: Friction coefficient, NaN if the search failed.
        runs: Number of runs.
    """

    friction: float
    runs: int


def search(scene: Scene, measured: float, method: str) -> Found:
    """Search the friction that gives a measured slip by one of the `METHODS` (collective)."""
    runs = 0

    def residual(friction: float) -> Any:
        nonlocal runs
        runs += 1
        slip, slope = scene.slip_and_slope(friction, slope=method == "newton")
        error = slip / measured - 1.0
        return (error, slope / measured) if method == "newton" else error

    try:
        found = root_scalar(residual, method=method, xtol=ERROR, maxiter=20, **METHODS[method])
    except ValueError:  # negative friction, or slips at the ends of the interval on one side
        return Found(math.nan, runs)
    return Found(found.root if found.converged else math.nan, runs)


def slope_row(name: str, test: dj.TaylorTest) -> str:
    """Return a row of the first table."""
    slope, largest = 1e3 * test.linear / CHANGE, 100.0 * CHANGE / FRICTION * test.linear_range
    return f"{name:34s}{slope:12.4g}{f'{largest:.2g} %' if largest else 'none':>14s}"


def search_row(name: str, found: list[Found]) -> str:
    """Return a row of the second table; ``found`` has one entry per true friction."""
    errors = [abs(f.friction / truth - 1.0) for f, truth in zip(found, TRUTHS, strict=True)]
    shown = [f"{100.0 * e:.2g}" if math.isfinite(e) else "failed" for e in errors]
    runs = [str(f.runs) for f in found]
    return f"{name:42s}{', '.join(runs):>14s}{', '.join(shown):>24s}"


def main(arguments: list[str] | None = None) -> None:
    """Print both tables."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("output/friction_from_slip"))
    parser.add_argument("--quick", action="store_true", help="short earthquakes, one search")
    options = parser.parse_args(arguments)
    # Newmark's method does not balance the energy of chattering joints, which is part of the table.
    warnings.filterwarnings("ignore", "The energy error is")
    warnings.filterwarnings(
        "ignore", "Tolerance of"
    )  # equal slips in two steps of the secant method

    def show(text: str) -> None:
        if MPI.COMM_WORLD.rank == 0:
            print(text, flush=True)

    slopes, searches = scenes(options.out, quick=options.quick)
    show(f"{'residual slip':34s}{'slope [mm]':>12s}{'valid up to':>14s}")
    show(slope_row("rigid block, Newmark (1965)", newmark_1965()))
    for scene in slopes:
        show(slope_row(scene.name, tested(scene)))
    show(f"\n{'friction from residual slip':42s}{'runs':>14s}{'errors of friction [%]':>24s}")
    for scene in searches[: 1 if options.quick else None]:
        measured = [scene.slip_and_slope(truth, slope=False)[0] for truth in TRUTHS]
        for method in METHODS:
            found = [search(scene, slip, method) for slip in measured]
            show(search_row(f"{scene.name}: {method}", found))


if __name__ == "__main__":
    main()
