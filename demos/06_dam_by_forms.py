#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # The paper's dam by interior-facet integrals
#
# The [arch dam](03_ambiesta.py) run as the paper ran it, by integrals over joints that open and
# slide. Their nodal forces and their stiffness
#
# $$\mathbf r = \int_A \mathbf B^T\mathbf t\,dA, \qquad
# \mathbf K = \int_A \mathbf B^T\mathbf D\,\mathbf B\,dA$$
#
# are interior-facet integrals, `inner(t, jump(v)) * dS` and `inner(D * jump(u), jump(v)) * dS`,
# with traction and tangent of the friction no-tension law from return mapping at the quadrature
# points; average acceleration (Newmark) at the paper's constant step of 0.00488 s. Then the same
# by the operator B, and the paper's statements.
#
# A coarse mesh and the first two seconds of a synthetic motion, unless more is asked for:
#
#     ./with-dolfinx python3 demos/06_dam_by_forms.py
#     ./with-dolfinx python3 demos/06_dam_by_forms.py --steps 2288   # all of it, some minutes
#     ./with-dolfinx mpirun -n 2 python3 demos/06_dam_by_forms.py

# %%
from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints import measures, plots, views
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.laws.law import Status
from dolfinx_joints.report.runs import Run
from studies import ambiesta
from studies.ambiesta import Case, Finished
from studies.paper_statements import Pair, departure, judged

COMM = MPI.COMM_WORLD


def parse_arguments(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the command line."""
    parser = Parser(description="The paper's dam by interior-facet integrals.")
    parser.add_argument("--size", type=float, default=8.0, help="cell size [m] (default 8)")
    parser.add_argument("--order", type=int, default=1, choices=(1, 2), help="element order")
    parser.add_argument(
        "--steps", type=at_least(2), default=410, help="time steps of 0.00488 s (default 410)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("output/06_dam_by_forms"), help="where to write"
    )
    return parser.parse_args(arguments)


def say(text: str) -> None:
    """Print once, whatever the number of ranks."""
    if COMM.rank == 0:
        print(text, flush=True)


# %% [markdown]
# ## By forms and by the operator
#
# `"forms"` and `"monolithic"` are the same Newton iteration, on integrals and on sums with B;
# `"condensed"` solves at the joint points alone. One solution, to what Newton's method leaves.


# %%
def by_each(case: Case, model: dj.Model, out: Path) -> tuple[dict[str, Finished], dict[str, float]]:
    """The run by each solver, and how far its displacement is off that by forms."""
    runs: dict[str, Finished] = {}
    apart: dict[str, float] = {}
    for solver in ("forms", "monolithic", "condensed"):
        folder = out / solver
        on_root(COMM, lambda place=folder: place.mkdir(parents=True, exist_ok=True))
        done = ambiesta.simulate(case, "joints", model, folder, solver=solver, envelopes=True)
        runs[solver] = done
        u, reference = (run.outcome.state.displacement for run in (done, runs["forms"]))
        apart[solver] = (u - reference).norm() / reference.norm()
        each = done.outcome.iterations / case.steps
        time = on_root(COMM, lambda path=done.results: step_time(path))
        cost = f"{time:6.1f} ms and {each:5.2f} iterations per step"
        off = f"off by {apart[solver]:.0e}" if done is not runs["forms"] else "the reference"
        say(f"{solver:<11}{cost}, {off}")
    return runs, apart


def step_time(path: Path) -> float:
    """Wall time of a step [ms]."""
    with dj.Results(path) as results:
        return 1e3 * results.summary["seconds"]["time steps"] / results.summary["steps"]


# %% [markdown]
# ## The law on the joints
#
# The paper's figures 5 to 7: open points carry nothing, sliding ones have a ratio of shear to
# pressure of tan 30°. The picture shows the moment of the largest pressure.


# %%
def joint_points(results: dj.Results) -> tuple[float, float]:
    """Errors of the ratio of sliding points and, over the largest, of open points' traction."""

    def series(name: str) -> np.ndarray:
        parts = [results.series("states", f"joints/{j}/{name}") for j in results.joints]
        return np.concatenate(parts, axis=1)

    traction, status = series("traction"), series("status")
    normal, shear = -traction[..., 0], np.linalg.norm(traction[..., 1:], axis=-1)
    slides, free = status == Status.SLIP, status == Status.OPEN
    off = np.abs(shear[slides] / normal[slides] - np.tan(np.pi / 6)).max(initial=0.0)
    pulled = np.abs(traction[free]).max(initial=0.0) / np.abs(traction).max()
    shares = f"{free.mean():.1%} open, {slides.mean():.1%} sliding"
    print(f"points and states: {shares}; ratio of sliding ones off tan 30° by {off:.0e}")
    for name, m in measures.joint_measures(results).items():
        print(f"{name}: opens by {1e3 * m['opening_max']:.3f} mm, open {m['share_open']:.0%}")
    return float(off), float(pulled)


# %% [markdown]
# ## The paper's statements
#
# The numbers behind them, of this run and that of the monolith. There is no verdict on another
# motion than the paper's record, or a shorter one.


# %%
def statements(linear: dj.Results, joints: dj.Results) -> dict[str, float]:
    """Print each statement, its numbers and the bounds that agree with it."""
    pair, said, found = Pair(Run(linear, "linear"), Run(joints, "joints")), "", {}
    for judgement in judged(pair):
        check = judgement.check
        if check.statement != said:
            said = check.statement
            print(f"\n{said}")
        verdict = "" if judgement.reason else f": {judgement.verdict}"
        value = "the run is too short" if np.isnan(judgement.value) else f"{judgement.value:.3g}"
        print(f"  {check.quantity}: {value} (paper: {check.rule}){verdict}")
        found[check.quantity] = judgement.value
    print(f"\nno verdict: {departure(pair)}" if departure(pair) else "")
    return found


# %% [markdown]
# ## All of it, and verification


# %%
def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Run everything; give the numbers behind the paper's statements."""
    options = parse_arguments(arguments)
    case = Case(size=options.size, order=options.order, steps=options.steps, scheme="newmark")
    mesh = ambiesta.make_mesh(case, options.out)
    linear, joints = (ambiesta.build(case, which, mesh) for which in ("linear", "joints"))
    say(f"{joints.num_dofs} dofs, {joints.operator.num_points} joint points, {case.steps} steps")
    whole = ambiesta.simulate(case, "linear", linear, options.out, envelopes=True)
    runs, apart = by_each(case, joints, options.out)

    def read() -> tuple[tuple[float, float], dict[str, float]]:
        with dj.Results(whole.results) as one, dj.Results(runs["forms"].results) as other:
            each = measures.joint_measures(other).values()
            moment = max(each, key=lambda m: m["pressure_max"])["pressure_time"]
            figure = views.joint_map(other, "normal", time=moment)
            errors = joint_points(other)
            u = np.linalg.norm(other.series("states", "displacement"), axis=2).max()
            print(f"largest displacement of a node: {1e3 * u:.12g} mm")
            found = statements(one, other)
            print(f"figure: {plots.save(figure, options.out / 'tractions.png')}")
        return errors, found

    (ratio, pulled), found = on_root(COMM, read)
    assert apart["monolithic"] < 1e-10
    assert apart["condensed"] < 1e-7  # of another iteration
    assert ratio < 1e-12
    assert pulled == 0.0
    assert runs["forms"].outcome.energy_error < 0.04
    assert whole.outcome.energy_error < 0.02
    say("verified: one solution, the law at all points, energy errors below 2 and 4 %")
    return found


if __name__ == "__main__":
    dj.abort_on_error(COMM)
    try:
        main()
    except (dj.JointsError, ValueError) as error:
        say(f"06_dam_by_forms: {error}")
        raise SystemExit(2) from None
