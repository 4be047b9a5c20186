# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shaken blocks and a jointed wall, side by side with OpenSees.

The same nodes, bricks, consistent mass, damping by stiffness and joint points in both programs, in
OpenSees a contact element at each pair of nodes. Three bodies, each under its weight and then
shaken:

- a block of 2 x 2 x 2 m on a joint with 10 degrees of friction, which slides to and fro along x;
- a block of 1 x 1 x 4 m on a joint with 40 degrees, which a pulse of half a sine, 0.45 g over 0.4
  s, makes rock and strike again;
- the wall of 20 x 4 x 20 m with three joints of `benchmarks/opensees_wall.py`.

Compared are displacements of a point at the top over time, in steps of 4.88 ms. OpenSees takes
contact at the end of a step and average acceleration, this program the mean over a step. Beside the
sliding block is a rigid one, integrated in steps of 2.4 us. Runs end where OpenSees converges no
longer.

The differences are errors of the steps. In steps a quarter as long (the fine run) both programs
differ by 0.23 % (sliding) and 0.13 % (rocking) instead of 5.1 and 3.1 %. In full steps the sliding
block of OpenSees is 5.3 % off the rigid one, ours 0.3 %; in halved steps 1.2 and 0.1 %.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from benchmarks.opensees_wall import SceneFile, missing, opensees
from benchmarks.shared.measure import march
from benchmarks.shared.scenes import GRAVITY, TIME_STEP, Scene, ground_acceleration, wall
from dolfinx_joints.geometry.two_blocks import two_blocks
from validation.atlas import LeftOutError, Outcome, curve, estimate, new_figure

SOURCE = "OpenSees 3.8, zeroLengthContactASDimplex, run for comparison"

Floats = NDArray[np.float64]


def half_sine(time: float) -> Floats:
    """The pulse along x [m/s^2]."""
    return np.array([0.45 * GRAVITY * np.sin(np.pi * time / 0.4) * (time < 0.4), 0.0, 0.0])


def along_x(time: float) -> Floats:
    """The x component of the wall's motion [m/s^2]."""
    return ground_acceleration(time) * [1.0, 0.0, 0.0]


def block(width: float, height: float, angle: float, shaking: object) -> Scene:
    """A block on a slab 0.5 m thick."""
    return Scene(
        name="block",
        write=lambda path: two_blocks(
            path, length=width, width=width, lower_height=0.5, upper_height=height, size=1.0
        ),
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        held=["base"],
        loads=[dj.Gravity(acceleration=(0.0, 0.0, -GRAVITY))],
        shear_ratio=1.0,
        load_steps=1,
        shaking=lambda _: shaking,
        crest=(0.0, 0.0, 0.5 + height),
        friction_angle=angle,
    )


OVERLAP = 1e-9  # of faces in OpenSees before the weight acts [m]
FINE = 4  # parts of a step in the fine run
# Scene, component, steps, quick ones.
CASES = {
    "sliding block, x": (block(2.0, 2.0, 10.0, along_x), 0, 160, 110),
    "rocking block, x": (block(1.0, 4.0, 40.0, half_sine), 0, 200, 40),
    "wall, y": (wall("tiny"), 1, 30, 10),
}
# Relative errors by steps, of ours and of theirs: what halving them changes, in the fine run what
# halving them from two to four parts of a step changes. Of the rocking block theirs is 0.018, and
# the sum is kept at 0.05. The motions of the wall change alike by 0.9 %, of which half is taken.
STEPS = {
    "sliding block, x": (0.004, 0.051),
    "rocking block, x": (0.034, 0.016),
    "wall, y": (0.005,),
}
FINE_STEPS = {
    "sliding block, x": (0.0022, 0.011),
    "rocking block, x": (0.0054, 0.0093),
    "wall, y": (0.0025,),
}
RIGID = 0.01  # strain and vibration of the sliding block, and its steps


def both(scene: Scene, steps: int, parts: int = 1) -> tuple[Floats, Floats]:
    """Return displacements of the watched point from the static state, ours and theirs, (steps, 3).

    Args:
        scene: What is shaken.
        steps: Number of steps of `TIME_STEP`.
        parts: Number of steps that are taken for each of these.
    """
    dt = TIME_STEP / parts
    with TemporaryDirectory() as name, scene.mesh_file() as mesh:
        path = Path(name) / "jointed.npz"
        watch = SceneFile(scene, path, parts * steps, overlap=OVERLAP, dt=dt)
        march(scene, mesh, parts * steps, law=scene.law(), watch=watch, dt=dt)
        theirs = opensees("jointed", path)
    each = slice(parts - 1, None, parts)
    return np.array(watch.crest)[each], theirs["history"][:, 0][each]


def rigid_slide(friction: float, steps: int, parts: int = 2000) -> Floats:
    """Slip of a rigid block under `along_x` at the ends of steps [m]."""
    slip, velocity, found = 0.0, 0.0, []
    limit, part = friction * GRAVITY, TIME_STEP / parts
    for step in range(steps):
        push = [-along_x(TIME_STEP * (step + (k + 0.5) / 40))[0] for k in range(40)]
        for k in range(parts):
            load = push[k * 40 // parts]
            if velocity == 0.0 and abs(load) <= limit:
                continue
            way = np.sign(velocity or load)
            after = velocity + part * (load - way * limit)
            after = 0.0 if velocity * after < 0.0 else after
            slip, velocity = slip + part * (velocity + after) / 2.0, after
        found.append(slip)
    return np.array(found)


def run(quick: bool, *, fine: bool = False) -> Outcome:
    """Shake all three bodies in both programs; quick for fewer steps, fine in shorter ones."""
    if reason := missing():
        raise LeftOutError(f"OpenSees ({reason}); `make validate` brings it")
    rows = []
    figure, axes = new_figure(len(CASES), width=6.0)
    for ax, (name, case) in zip(axes, CASES.items(), strict=True):
        scene, axis, steps, few = case
        steps = few if quick else steps
        ours, theirs = both(scene, steps, FINE if fine else 1)
        errors = dict(
            zip(("steps", "their steps"), (FINE_STEPS if fine else STEPS)[name], strict=False)
        )
        quantity = f"displacement of the {name}"
        found, other = ours[:, axis], theirs[:, axis]
        rows.append(curve(quantity, found, other, **estimate(**errors)))
        time = TIME_STEP * np.arange(1, len(ours) + 1)
        ax.plot(time, 1e3 * ours[:, axis], label="ours")
        ax.plot(time, 1e3 * theirs[:, axis], "--", label="OpenSees")
        if name.startswith("sliding"):
            exact = rigid_slide(np.tan(np.radians(scene.friction_angle)), steps)
            limit = estimate(elastic=RIGID)
            rows.append(curve(f"{quantity}, rigid block", found, exact, **limit))
            ax.plot(time, 1e3 * exact, "k:", label="rigid block")
        ax.set_title(name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("displacement of the top [mm]")
    axes[0].legend()
    return Outcome(rows=rows, figure=figure)
