# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A gravity dam slides and opens at its lift joints
#
# The model is the tallest non-overflow monolith of Koyna dam in plane strain. A lift joint cuts it
# at the neck, where the downstream face bends and the dam cracked in 1967. A second joint is at its
# base:
#
# ```text
#            ___
#           |   \      103 m
#   91.75 m |    |
#   ~~~~~~~~|     |
#           |======\   neck, 66.5 m
#           |       \
#           |         \
#           |___________\
#           =============   base, 0 m
#           [foundation ]
#           /////////////
# ```
#
# Self weight and the reservoir act first, then an artificial earthquake. Westergaard's added mass
# moves with the upstream face. There is no water in the joints, so no uplift.
#
#     ./with-dolfinx python3 demos/04_gravity_dam.py

# %%
import math
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for the geometry scripts

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import abort_on_error, on_root
from dolfinx_joints.geometry.gravity_dam import KOYNA, gravity_dam
from dolfinx_joints.postprocessing.measures import (
    displacement_history,
    joint_history,
    joint_measures,
)

comm = MPI.COMM_WORLD
abort_on_error(comm)
out = Path("output/04_gravity_dam")
on_root(comm, lambda: out.mkdir(parents=True, exist_ok=True))


def say(text: str) -> None:
    """Print on rank 0."""
    if comm.rank == 0:
        print(text, flush=True)


# %% [markdown]
# ## The dam
#
# The properties are the published ones of Koyna. The joint `neck` becomes the group `joint_neck`.
# The joint at height 0 is the base joint; below it the mesh has a row of cells of the ground, which
# is fixed here.

# %%
WATER = 91.75  # level of the reservoir above the base [m]
G = 9.80665  # [m/s^2]
CONCRETE = dj.Elastic(young=31.027e9, poisson=0.2, density=2643.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e12, shear_stiffness=4e11, friction_angle_deg=45.0)
NECK, BASE = "joint_neck", "joint_base"
MAGNIFIED = 200.0  # displacements in the figure

mesh = out / "koyna.msh"
heights = {"base": 0.0, "neck": 66.5}
on_root(comm, lambda: gravity_dam(mesh, section=KOYNA, joints=heights, size=4.0, order=1))
dam = dj.read_msh(mesh, comm)
model = dj.Model(
    dam,
    material=CONCRETE,
    joints=LAW,
    supports=[dj.Fixed(group="base"), dj.Fixed(group="foundation_ends")],
    loads=[dj.Gravity(), dj.HydrostaticPressure(group="upstream", level=WATER)],
    water=dj.WestergaardMass(group="upstream", level=WATER),
    damping=dj.rayleigh(ratio=0.05, frequencies=(2.5, 10.0)),
    body=dj.Body(plane="strain"),
)
frequencies = dj.modes(model.system(), 2).frequencies
say("Statics and 2000 steps of an earthquake take about 10 seconds.")
say(f"joints closed, with water: {frequencies[0]:.2f} and {frequencies[1]:.2f} Hz")

# %% [markdown]
# ## Weight and water
#
# The joints carry the weight and the thrust above them, for any mesh and joint stiffness.

# %%
results = out / "koyna.h5"
monitor = dj.ResultsMonitor(results, points={"crest": (0.0, 103.0)}, every=5, overwrite=True)
run = dj.Simulation(model, monitors=[monitor])
static = run.statics(steps=4).joints


def carried(joint: str) -> tuple[float, float]:
    """Return compression and shear of a joint [N/m]."""
    number = model.operator.names.index(joint)
    normal, shear, _ = (model.contact.integrals(t)[number] for t in static.traction.T)
    return -float(normal), abs(float(shear))


def expected(height: float) -> tuple[float, float]:
    """Return the weight and the thrust of the water above a height [N/m]."""
    levels = np.unique(np.clip(KOYNA.levels, height, None))
    weight = CONCRETE.density * G * np.trapezoid(KOYNA.thickness(levels), levels)
    return float(weight), 0.5 * 1000.0 * G * (WATER - height) ** 2


resultants = {joint: carried(joint) for joint in (BASE, NECK)}
for joint, (normal, shear) in resultants.items():
    say(
        f"{joint}: carries {normal / 1e6:.3f} MN/m and {shear / 1e6:.3f} MN/m, "
        f"safety against sliding {normal * math.tan(math.radians(45.0)) / shear:.2f}"
    )

# %% [markdown]
# ## Earthquake
#
# Four seconds with 0.4 g along the stream and 0.25 g upwards. A plane model uses the components x
# and z of a motion.

# %%
motion = dj.synthetic_motion(seed=4, duration=4.0, peaks_g=(0.4, 0.0, 0.25))
outcome = run.dynamics(dt=0.002, steps=2000, motion=motion)
say(run.report(outcome))


# %% [markdown]
# ## Opening and slip of the joints
#
# Slips count from the static state.


# %%
def report() -> dict[str, dict[str, float]]:
    """Print the largest and the residual motions of the joints, and draw."""
    with dj.Results(results) as file:
        measured = joint_measures(file, tail=0.5)
        for name, m in measured.items():
            print(
                f"{name}: opens by up to {1e3 * m['opening_max']:.1f} mm, slides by "
                f"{1e3 * m['slip_max']:.1f} mm and stays {1e3 * m['slip_residual']:.1f} mm off"
            )
        draw(file, measured[NECK]["opening_time"])
    return measured


def draw(file: dj.Results, time: float) -> None:
    """Draw the dam at the widest opening of its neck, and histories of crest and joints."""
    figure = Figure(figsize=(7.4, 4.2), layout="constrained")
    body, crest, opening, slip = figure.subplot_mosaic(
        [["dam", "crest"], ["dam", "opening"], ["dam", "slip"]], width_ratios=(1.0, 1.7)
    ).values()
    nodes, lines = file.static("mesh/nodes")[:, :2], file.static("mesh/surface")
    record = int(np.abs(file.time("states") - time).argmin())
    moved = nodes + MAGNIFIED * file.series("states", "displacement")[record, :, :2]
    for points, colour, width in ((nodes, "0.75", 0.6), (moved, "#08519c", 1.0)):
        body.add_collection(LineCollection(list(points[lines]), color=colour, linewidth=width))
    body.autoscale()
    body.set_aspect("equal")
    body.set_title(f"{time:.2f} s, displacements times {MAGNIFIED:g}", fontsize="small")
    body.set_xlabel("x [m]")
    body.set_ylabel("y [m]")
    t, x = displacement_history(file, "crest", "x")
    crest.plot(t, 1e3 * x, color="black", linewidth=0.8)
    for name, colour in ((NECK, "#b2182b"), (BASE, "#08519c")):
        t, gaps, slips = joint_history(file, name)
        opening.plot(t, 1e3 * gaps.max(axis=1), color=colour, linewidth=0.8, label=name)
        slip.plot(t, 1e3 * slips.max(axis=1), color=colour, linewidth=0.8)
    opening.legend(frameon=False, fontsize="small")
    for ax, label in ((crest, "crest x [mm]"), (opening, "opening [mm]"), (slip, "slip [mm]")):
        ax.set_ylabel(label)
        ax.grid(linewidth=0.3)
        ax.set_xlim(0.0, t[-1])
    slip.set_xlabel("time [s]")
    figure.align_ylabels()
    figure.savefig(out / "koyna.png", dpi=150)
    print(f"figure: {out / 'koyna.png'}; results: {out}/*.h5")


measured = on_root(comm, report)

# %% [markdown]
# ## Verification
#
# The static state agrees with equilibrium by hand to rounding, and the energies balance to
# rounding. The neck is closed under weight and water, opens and slides in the earthquake, and keeps
# a slip.

# %%
for joint, height in ((BASE, 0.0), (NECK, 66.5)):
    assert np.allclose(resultants[joint], expected(height), rtol=1e-8), joint
assert outcome.energy_error < 1e-9
if comm.rank == 0:
    assert measured[NECK]["opening_static"] == 0.0
    assert measured[NECK]["opening_max"] > 1e-3
    for joint in (BASE, NECK):
        assert measured[joint]["slip_max"] >= measured[joint]["slip_residual"] > 0.0
