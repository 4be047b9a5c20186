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
# # A block slides on its base
#
# An elastic block, 2 m x 1 m x 0.2 m, rests on a thin slab that is clamped below. The joint between
# them has friction and no tension.
#
# ```text
#        z                      springs (first problem only)
#        |            ___________________________
#        |           |  block, 0.2 m             | -> slip
#        |           |___________________________|
#        '---> x     |___________________________|  slab, 0.1 m
#                    /////////////////////////////  -> ground acceleration
# ```
#
# 1. On an incline, at 99 % and at 101 % of the friction limit. The model turns gravity instead of
#    the plane. Weak springs along the top face carry the force that exceeds friction. With the
#    weight $W$, the coefficient $\mu$, the slope $\theta$ and the stiffness $K$ of the springs, the
#    slip beyond the limit is
#    $$s = \frac{W (\sin\theta - \mu\cos\theta)}{K}.$$
# 2. Newmark's block: the ground accelerates with $A$ for a time $t_p$. The block accelerates with
#    at most $a_y = \mu g$, lags behind, and comes to rest on its base at $t = A t_p/a_y$ after
#    $$s = \frac{(A - a_y) A t_p^2}{2 a_y}.$$
#
# The package assumes small displacements and evaluates the joint at its original place. On a level
# base with uniform pressure even a slip of half a metre makes no difference.

# %%
import math
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for the geometry scripts

from dolfinx_joints import (
    Elastic,
    Fixed,
    FrictionNoTension,
    Gravity,
    JointedMesh,
    Model,
    Monitor,
    Simulation,
    Spring,
    read_msh,
)
from dolfinx_joints.common.mpi import abort_on_error, on_root
from dolfinx_joints.exact import SlidingBlock
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.joints.contact import StatusCounts
from dolfinx_joints.laws.law import Response
from dolfinx_joints.simulation.outcome import Outcome
from dolfinx_joints.simulation.record import Record

LENGTH, WIDTH, HEIGHT = 2.0, 1.0, 0.2  # of the block [m]
CONCRETE = Elastic(young=30e9, poisson=0.2, density=2400.0)
MASS = CONCRETE.density * LENGTH * WIDTH * HEIGHT
K_N, K_S = 1e10, 4e9  # of the joint [Pa/m]

comm = MPI.COMM_WORLD
abort_on_error(comm)


def blocks(cell: str = "hex") -> JointedMesh:
    """Return the mesh; only rank 0 writes and reads the file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "blocks.msh"
        on_root(
            comm,
            lambda: two_blocks(
                path,
                length=LENGTH,
                width=WIDTH,
                lower_height=0.1,
                upper_height=HEIGHT,
                size=0.25,
                cell=cell,
            ),
        )
        return read_msh(path, comm)


def mean_slip(model: Model, joints: Response) -> np.ndarray:
    """Return the mean tangential gap of the joint, (s1, s2) = (x, y), [m]."""
    slip = joints.state.gap[:, 1:]
    area = model.contact.integral(np.ones(len(slip)))
    return np.array([model.contact.integral(slip[:, axis]) for axis in (0, 1)]) / area


# %% [markdown]
# ## On the incline
#
# The stiffness of the springs gives a slip of 10 mm at 101 % of the limit. Block and joint deform
# elastically by less than a thousandth of that.

# %%
FRICTION_ANGLE = 30.0  # degrees
SLIP_BEYOND = 0.01  # m, at 101 %
GRAVITY = 9.80665  # m/s^2


def incline(jointed: JointedMesh, share: float) -> tuple[np.ndarray, float, StatusCounts]:
    """Return computed slip, exact slip and points at a share of the limit of tan(theta)."""
    mu = math.tan(math.radians(FRICTION_ANGLE))

    def excess(share: float) -> float:
        theta = math.atan(share * mu)
        return MASS * GRAVITY * (math.sin(theta) - mu * math.cos(theta))

    springs = excess(1.01) / SLIP_BEYOND  # N/m
    theta = math.atan(share * mu)
    model = Model(
        jointed,
        material=CONCRETE,
        joints=FrictionNoTension(
            normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=FRICTION_ANGLE
        ),
        supports=[
            Fixed(group="base"),
            Spring(
                group="top",
                normal_stiffness=0.0,
                tangential_stiffness=springs / (LENGTH * WIDTH),
            ),
        ],
        loads=[Gravity(acceleration=(GRAVITY * math.sin(theta), 0.0, -GRAVITY * math.cos(theta)))],
    )
    joints = Simulation(model).statics().joints
    counts = model.contact.counts(joints.status)
    return mean_slip(model, joints), max(excess(share), 0.0) / springs, counts


jointed = blocks()
inclines = {share: incline(jointed, share) for share in (0.99, 1.01)}
if comm.rank == 0:
    print("incline\n   limit   slip [mm]  rigid [mm]   points open / stick / slip")
    for share, (slip, rigid, counts) in inclines.items():
        print(
            f"{100 * share:6.0f} % {1e3 * slip[0]:11.6f} {1e3 * rigid:11.6f}   "
            f"{counts.open} / {counts.stick} / {counts.slip}"
        )

# %% [markdown]
# At 99 % many points already slide: the slope shifts pressure towards the lower edge, so the limit
# differs from point to point. The sticking points keep the block in place. It moves by the elastic
# slip of the joint, less than a micrometre. At 101 % all points slide.
#
# ## Newmark's block
#
# A monitor records the slip. At the end of the pulse the ground acceleration is set to its mean
# value, so that the trapezoidal rule integrates the exact impulse.

# %%
MOTION = SlidingBlock(pulse=4.0, yield_acceleration=2.0, duration=0.5)
LEVEL_GRAVITY = 10.0  # m/s^2, hence mu = 0.2
DURATION = 1.2  # s


class SlipHistory(Monitor):
    """Monitor that records time [s], mean slip (n, 2) [m] and friction work [J]."""

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        self.model, self.rows = model, []
        self.record(first)

    def record(self, record: Record) -> None:
        slip = mean_slip(self.model, record.joints)
        self.rows.append((record.time, *slip, record.energy.friction))

    def finish(self, status: str, summary: dict) -> None:
        self.time, slip_x, slip_y, self.friction = np.array(self.rows).T
        self.slip = np.column_stack([slip_x, slip_y])


def ground(time: float) -> tuple[float, float, float]:
    """Return the ground acceleration [m/s^2], towards -x: the block slides towards +x."""
    remaining = MOTION.duration - time
    share = 0.5 if abs(remaining) < 1e-9 else float(remaining > 0.0)
    return -MOTION.pulse * share, 0.0, 0.0


def shake(jointed: JointedMesh, dt: float) -> tuple[SlipHistory, Outcome]:
    """Run self weight, then the pulse with a time step [s]."""
    mu = MOTION.yield_acceleration / LEVEL_GRAVITY
    model = Model(
        jointed,
        material=CONCRETE,
        joints=FrictionNoTension(
            normal_stiffness=K_N,
            shear_stiffness=K_S,
            friction_angle_deg=math.degrees(math.atan(mu)),
        ),
        supports=[Fixed(group="base")],
        loads=[Gravity(acceleration=(0.0, 0.0, -LEVEL_GRAVITY))],
    )
    history = SlipHistory()
    simulation = Simulation(model, monitors=[history])
    simulation.statics()
    outcome = simulation.dynamics(dt=dt, steps=round(DURATION / dt), motion=ground)
    return history, outcome


def slip_error(history: SlipHistory) -> float:
    """Return the relative error of the final slip, with its sign."""
    return float(history.slip[-1, 0] / MOTION.final_slip - 1.0)


def expected_error(dt: float) -> float:
    """Return the expected error of the final slip, see below."""
    return -0.25 * MOTION.pulse * dt**2 / MOTION.final_slip


STEPS = (0.01, 0.005, 0.0025)
runs = {dt: shake(jointed, dt) for dt in STEPS}
weight = MASS * LEVEL_GRAVITY
mu = MOTION.yield_acceleration / LEVEL_GRAVITY
if comm.rank == 0:
    print(f"\nNewmark's block, exact slip {MOTION.final_slip} m, stops at {MOTION.stop_time} s")
    print(
        f"{'dt [s]':>8} {'slip [m]':>10} {'error':>9} {'expected':>9} {'energy error':>13} "
        f"{'friction work / (mu N slip)':>28}"
    )
    for dt, (history, outcome) in runs.items():
        slip = history.slip[-1, 0]
        print(
            f"{dt:8.4f} {slip:10.6f} {100 * slip_error(history):7.3f} % "
            f"{100 * expected_error(dt):7.3f} % {outcome.energy_error:13.1e} "
            f"{history.friction[-1] / (mu * weight * slip):28.6f}"
        )

# %% [markdown]
# The error is of second order in the time step, and can be computed in advance. The load of a step
# is the mean of its ends. So in the two steps at the end of the pulse the ground accelerates with
# 3/4 and 1/4 of $A$ instead of $A$ and 0. The block is slower by $A\Delta t/4$ between these steps,
# and lags by $A\Delta t^2/4$ from then on.
#
# The run warns that slip exceeds a tenth of the element size, because points keep their partners.
# On a level base with uniform pressure this has no effect.
#
# ## Figure
#
# The velocity is the difference quotient of the slip, drawn in the middle of each step.

# %%
if comm.rank == 0:
    figure = Figure(figsize=(6.3, 4.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    t = np.linspace(0.0, DURATION, 601)
    axes[0].plot(t, MOTION.slip(t), color="black", linewidth=1.0, label="exact")
    axes[1].plot(t, MOTION.velocity(t), color="black", linewidth=1.0)
    for dt, colour, marker in zip(STEPS[::2], ("#b2182b", "#08519c"), ("o", "x"), strict=True):
        history, every = runs[dt][0], round(0.03 / dt)
        style = {"color": colour, "marker": marker, "markersize": 4, "linestyle": "none"}
        label = f"computed, $\\Delta t$ = {1e3 * dt:g} ms"
        axes[0].plot(history.time[::every], history.slip[::every, 0], label=label, **style)
        middle = 0.5 * (history.time[1:] + history.time[:-1])
        velocity = np.diff(history.slip[:, 0]) / np.diff(history.time)
        axes[1].plot(middle[::every], velocity[::every], **style)
    axes[0].set_ylabel("slip [m]")
    axes[0].legend(loc="lower right", frameon=False)
    axes[1].set_ylabel("sliding velocity [m/s]")
    axes[1].set_xlabel("time [s]")
    axes[1].axvspan(0.0, MOTION.duration, color="0.93", zorder=0, linewidth=0)
    axes[0].axvspan(0.0, MOTION.duration, color="0.93", zorder=0, linewidth=0)
    axes[0].annotate(
        f"pulse of {MOTION.pulse:g} m/s²", (0.5 * MOTION.duration, 0.9), ha="center",
        xycoords=("data", "axes fraction"),
    )  # fmt: skip
    for ax in axes:
        ax.grid(color="0.85", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.set_xlim(0.0, DURATION)
    output = Path("output")
    output.mkdir(exist_ok=True)
    figure.savefig(output / "02_sliding_block.png", dpi=200)
    print(f"\nfigure: {output / '02_sliding_block.png'}")

# %% [markdown]
# # Verification

# %%
sticking, _, _ = inclines[0.99]
slid, rigid, counts = inclines[1.01]
assert abs(sticking[0]) < 1e-6  # elastic slip, mu p / k_s with p about 5 kPa
assert abs(slid[0] / rigid - 1.0) < 1e-4  # the block's own deformation
assert counts.slip == counts.total
assert abs(slid[1]) < 1e-6 * rigid

finest, outcome = runs[STEPS[-1]]
assert abs(slip_error(finest)) < 1e-4
for dt, (history, outcome) in runs.items():
    assert abs(slip_error(history) / expected_error(dt) - 1.0) < 0.05
    assert outcome.energy_error < 1e-9  # rounding of K u, the body moving by half a metre
    assert np.abs(history.slip[:, 1]).max() < 1e-6
    work = mu * weight * history.slip[-1, 0]
    assert abs(history.friction[-1] / work - 1.0) < 1e-3
at_rest = finest.time > MOTION.stop_time + 3 * STEPS[-1]
assert np.ptp(finest.slip[at_rest, 0]) < 1e-6 + 1e-3 * MOTION.final_slip
