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
# # A mass on a spring strikes a stop
#
# The test problem of Bolognini, Masarati, Dusi and Galimberti (their section 3 and Fig. 2, after
# Ayari and Saoun 1988):
#
# ```text
#   |      k          u, v0 ->        k_stop  |
#   |--/\/\/\/\--[   m   ]--|  gap  |--/\/\/--|
# ```
#
# $$m\ddot u + k u + k_{stop}\langle u - gap\rangle = 0,\qquad u(0) = 0,\ \dot u(0) = v_0$$
#
# The stop is a joint point with one degree of freedom. Its normal gap is $gap - u$, and its law is
# the no-tension law of the package with $k_n = k_{stop}$ on 1 m². The exact motion consists of two
# harmonics (`dolfinx_joints.exact.ImpactOscillator`).
#
# As in the paper, the time step is T/1500 near the impact and T/20 otherwise, where T is the period
# of the mass on its spring. The scheme is Newmark's average acceleration. A second run takes the
# same steps with the energy-consistent scheme, the default of the package.

# %%
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

from dolfinx_joints import EnergyConsistent, FrictionNoTension, MatrixSystem, Newmark
from dolfinx_joints.exact import ImpactOscillator
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.scheme import Scheme, StepReport
from dolfinx_joints.time_integration.states import DynamicState

STEPS_AWAY, STEPS_NEAR = 20, 1500  # per period of the mass on its spring (paper, section 3)
PROBLEMS = {
    gap: ImpactOscillator(
        mass=100.0, stiffness=1e4, stop_stiffness=1e6, initial_velocity=1.0, gap=gap
    )
    for gap in (0.0, 0.03)
}

# %% [markdown]
# ## The choice of the step
#
# A scheme does not change the state it starts from, so a step can be tried and rejected. A long
# step is accepted if the stop is open at both of its ends. Otherwise a short step replaces it. So
# short steps resolve the contact and up to one long step before it.


# %%
def is_open(state: DynamicState) -> bool:
    """Return True if the mass does not touch the stop."""
    return bool(state.joints.state.gap[0, 0] > 0.0)


def step(
    scheme: Scheme, solver: StepSolver, state: DynamicState, *, away: float, near: float
) -> tuple[DynamicState, StepReport]:
    """Advance by ``away`` [s] if the stop stays open, else by ``near`` [s]."""
    if is_open(state):
        trial = scheme.advance(solver, state, away)
        if is_open(trial[0]):
            return trial
    return scheme.advance(solver, state, near)


# %% [markdown]
# ## The time loop
#
# `refinement` divides both step lengths.


# %%
@dataclass(frozen=True)
class History:
    """Results of a run, one entry per step, in SI units."""

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray  # of the stop, positive in compression
    energy: np.ndarray  # columns: kinetic, spring, stop
    energy_error: float

    @property
    def steps(self) -> int:
        return len(self.time) - 1


def march(
    problem: ImpactOscillator,
    *,
    scheme: Scheme | None = None,
    refinement: int = 1,
    steps_away: int = STEPS_AWAY,
) -> History:
    """Compute two periods of the motion with impacts."""
    system = MatrixSystem.from_arrays(
        mass=[[problem.mass]],
        stiffness=[[problem.stiffness]],
        gap=[[-1.0], [0.0], [0.0]],
        initial_gap=problem.gap,
        law=FrictionNoTension(
            normal_stiffness=problem.stop_stiffness, shear_stiffness=0.0, friction_angle_deg=0.0
        ),
    )
    scheme = scheme or Newmark()
    solver = make_solver(system)
    velocity = system.mass.createVecRight()
    velocity.setArray([problem.initial_velocity])
    state = initial_state(solver, velocity=velocity)
    ledger = EnergyLedger(system)
    rows = [(state, ledger.start(state))]
    away = problem.free_period / (steps_away * refinement)
    near = problem.free_period / (STEPS_NEAR * refinement)
    while state.time < 2.0 * problem.period:
        state, report = step(scheme, solver, state, away=away, near=near)
        rows.append((state, ledger.record(ledger.after(state, report))))
    return History(
        time=np.array([s.time for s, _ in rows]),
        displacement=np.array([s.displacement.array[0] for s, _ in rows]),
        force=np.array([-s.joints.traction[0, 0] for s, _ in rows]),
        energy=np.array([(e.kinetic, e.strain, e.joint) for _, e in rows]),
        energy_error=ledger.relative_error,
    )


# %% [markdown]
# ## Measures
#
# The displacement error is the largest over the run, relative to the free amplitude $v_0/\omega$.
# The start and the end of the first contact are interpolated between the steps. The impulse is the
# trapezoidal sum of the force, as in Newmark's rule.


# %%
def displacement_error(problem: ImpactOscillator, run: History) -> float:
    """Return the largest displacement error relative to the amplitude."""
    difference = run.displacement - problem.displacement(run.time)
    return float(np.abs(difference).max() / problem.amplitude)


def first_contact(problem: ImpactOscillator, run: History) -> tuple[float, float, float]:
    """Return duration [s], largest force [N] and impulse [N s] of the first contact."""
    closed = run.displacement >= problem.gap
    begin = int(np.argmax(closed))
    end = begin + int(np.argmin(closed[begin:]))

    def crossing(i: int) -> float:
        depth = run.displacement[i : i + 2] - problem.gap
        return float(run.time[i] - depth[0] * (run.time[i + 1] - run.time[i]) / np.diff(depth)[0])

    touched = crossing(begin - 1) if begin else 0.0
    part = slice(max(begin - 1, 0), end + 1)
    impulse = float(np.trapezoid(run.force[part], run.time[part]))
    return crossing(end - 1) - touched, float(run.force[part].max()), impulse


# %% [markdown]
# ## With the paper's steps

# %%
comm = MPI.COMM_WORLD  # all processes run the same small problem; the first one prints
runs = {gap: march(problem) for gap, problem in PROBLEMS.items()}

lines = [
    f"{'gap [m]':>8} {'steps':>6} {'energy error':>13} {'displ. error':>13} "
    f"{'contact [s]':>20} {'force [N]':>20} {'impulse [N s]':>20}"
]
for gap, problem in PROBLEMS.items():
    computed = first_contact(problem, runs[gap])
    exact = (problem.contact_duration, problem.max_force, problem.impulse)
    pairs = zip(computed, exact, (".6f", ".2f", ".3f"), strict=True)
    cells = " ".join(f"{f'{a:{form}} ({b:{form}})':>20}" for a, b, form in pairs)
    lines.append(
        f"{gap:8.2f} {runs[gap].steps:6d} {100 * runs[gap].energy_error:11.4f} % "
        f"{100 * displacement_error(problem, runs[gap]):11.3f} % {cells}"
    )
if comm.rank == 0:
    print(f"Two periods, dt = T/{STEPS_AWAY} and T/{STEPS_NEAR} (exact values in brackets)")
    print("\n".join(lines))

# %% [markdown]
# The displacement error is an error of phase. At T/20 the average-acceleration rule makes the free
# period $(\omega\,\Delta t)^2/12 = 0.82\,\%$ too long, with any treatment of the contact. The mass
# arrives late but with the correct speed, so duration, force and impulse of the contact are
# accurate to 0.1 %. With short steps throughout, the error nearly vanishes:

# %%
short = march(PROBLEMS[0.03], steps_away=STEPS_NEAR)
if comm.rank == 0:
    print(
        f"\ngap 0.03 m, dt = T/{STEPS_NEAR} throughout: {short.steps} steps, displacement error "
        f"{100 * displacement_error(PROBLEMS[0.03], short):.4f} %, energy error "
        f"{100 * short.energy_error:.4f} %"
    )

# %% [markdown]
# ## The energy-consistent scheme
#
# This scheme does not use the force of the stop at the end of a step. It uses a mean force whose
# work in the step is exactly the change of the stored energy. The energy balance then closes
# wherever the contact begins within a step. The phase still depends on the step length.

# %%
consistent = {gap: march(problem, scheme=EnergyConsistent()) for gap, problem in PROBLEMS.items()}
if comm.rank == 0:
    print("\nEnergy-consistent scheme, the same steps")
    for gap, problem in PROBLEMS.items():
        run = consistent[gap]
        print(
            f"gap {gap:.2f} m: {run.steps} steps, energy error {run.energy_error:.1e}, "
            f"displacement error {100 * displacement_error(problem, run):.3f} %"
        )

# %% [markdown]
# ## Refinement
#
# Both steps are divided by 2, 4 and 8. The scheme keeps its order 2, although impacts begin and end
# within a step. If the contact begins within a step, the error of the velocity is at most
# $k_{stop} v_1 \Delta t^2/8m$. This is of second order, too, with a factor that depends on where in
# the step the contact begins. Such a step changes the energy by up to $k_{stop} \Delta t^2/4m$
# (0.044 % at T/1500). Because of the factor, the energy error decreases unevenly.

# %%
LEVELS = (1, 2, 4, 8)


def observed_order(errors: list[float]) -> float:
    """Return the order of convergence fitted over `LEVELS`."""
    return float(-np.polyfit(np.log(LEVELS), np.log(errors), 1)[0])


problem = PROBLEMS[0.03]
finer = [runs[0.03], *(march(problem, refinement=level) for level in LEVELS[1:])]
errors = [displacement_error(problem, run) for run in finer]
if comm.rank == 0:
    print(
        f"\ngap 0.03 m\n{'dt away':>8} {'dt near':>9} {'steps':>6} {'displ. error':>13} "
        f"{'energy error':>13}"
    )
    for level, run, error in zip(LEVELS, finer, errors, strict=True):
        print(
            f"{f'T/{STEPS_AWAY * level}':>8} {f'T/{STEPS_NEAR * level}':>9} {run.steps:6d} "
            f"{100 * error:11.4f} % {100 * run.energy_error:11.5f} %"
        )
    print(f"observed order in dt: {observed_order(errors):.2f}")

# %% [markdown]
# ## Figure
#
# Displacement, force of the stop and energies. Lines are exact; symbols are the long steps and
# every fifth of the short ones.


# %%
def draw(problem: ImpactOscillator, run: History, axes: list) -> None:
    """Draw one run and its exact solution in a column of three axes."""
    colours = ("#08519c", "#b2182b", "#33803a")
    t = np.linspace(0.0, run.time[-1], 4000)
    u, v = problem.displacement(t), problem.velocity(t)
    exact = [
        (0, 1e3 * u, "black", "exact"),
        (1, 1e-3 * problem.force(t), "black", None),
        (2, 0.5 * problem.mass * v**2, colours[0], None),
        (2, 0.5 * problem.stiffness * u**2, colours[1], None),
        (2, 0.5 * problem.force(t) ** 2 / problem.stop_stiffness, colours[2], None),
    ]
    for row, values, colour, label in exact:
        axes[row].plot(t, values, color=colour, linewidth=0.8, label=label, zorder=1)
    long_step = np.diff(run.time, prepend=0.0) > problem.free_period / (10 * STEPS_AWAY)
    shown = long_step | (np.arange(len(run.time)) % 5 == 0)  # every fifth of the short steps
    marks = {"linestyle": "none", "marker": "o", "markersize": 2.6, "zorder": 2}
    time = run.time[shown]
    axes[0].plot(time, 1e3 * run.displacement[shown], color=colours[0], label="computed", **marks)
    axes[1].plot(time, 1e-3 * run.force[shown], color=colours[0], **marks)
    names = ("kinetic", "spring", "stop")
    for name, colour, values in zip(names, colours, run.energy.T, strict=True):
        axes[2].plot(time, values[shown], color=colour, label=name, **marks)
    axes[0].axhline(
        1e3 * problem.gap, color="0.6", linewidth=0.8, linestyle=":", label="face of the stop"
    )
    axes[0].set_title(
        f"gap {problem.gap:g} m, energy error {100 * run.energy_error:.3f} %", fontsize=9
    )
    axes[2].set_xlabel("time [s]")
    for ax in axes:
        ax.grid(color="0.92", linewidth=0.6)
        ax.set_xlim(0.0, run.time[-1])
        ax.set_axisbelow(True)


if comm.rank == 0:
    figure = Figure(figsize=(7.2, 6.0), layout="constrained")
    grid = figure.subplots(3, len(runs), sharex="col", sharey="row")
    for column, (gap, run) in enumerate(runs.items()):
        draw(PROBLEMS[gap], run, list(grid[:, column]))
    for ax, label in zip(
        grid[:, 0], ("displacement [mm]", "force of the stop [kN]", "energy [J]"), strict=True
    ):
        ax.set_ylabel(label)
    for row in (0, 2):
        handles, names = grid[row, 0].get_legend_handles_labels()
        grid[row, 1].legend(
            handles, names, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False
        )
    output = Path("output")
    output.mkdir(exist_ok=True)
    figure.savefig(output / "01_impact.png", dpi=200)
    print(f"\nfigure: {output / '01_impact.png'}")

# %% [markdown]
# # Verification
#
# The paper states an energy error below 0.6 % and a solution "quite coincident with the analytical
# one".

# %%
for gap, problem in PROBLEMS.items():
    duration, force, impulse = first_contact(problem, runs[gap])
    assert runs[gap].energy_error < 1e-3
    assert displacement_error(problem, runs[gap]) < 0.07  # 0.8 % of phase per flight at T/20
    assert abs(duration / problem.contact_duration - 1.0) < 1e-3
    assert abs(force / problem.max_force - 1.0) < 1e-3
    assert abs(impulse / problem.impulse - 1.0) < 1e-3
    assert consistent[gap].energy_error < 1e-10
    assert displacement_error(problem, consistent[gap]) < 0.07
assert displacement_error(PROBLEMS[0.03], short) < 1e-3
assert 1.9 < observed_order(errors) < 2.1
