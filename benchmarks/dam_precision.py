#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error against run time of the dam of demo 03: midpoint, and exact in its lowest modes.

Runs start from self weight where the shaking is strong. The reference is midpoint with
`REFERENCE` times shorter steps than the demo's; its own error is that of the run with twice its
steps, over 3 (second order). Errors of the crest's displacement and of the largest opening are the
largest in time over the largest value of the reference, at the ends of the steps of a run; that of
the friction work is the final value's. Processor times of a step are medians.

Runs are kept in ``--out``; those found there are not repeated.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from benchmarks.exact_modes import shaken, steps_for
from benchmarks.shared.scenes import DAM_SIZES, TIME_STEP, dam
from dolfinx_joints.common.command_line import Parser

Run = dict[str, NDArray[np.float64]]

# Steps per step of the demo.
PARTS = (0.5, 1, 2, 4)
REFERENCE = 32
GOALS = (0.05, 0.01)
QUANTITIES = ("crest", "opening", "friction work")


class Runs:
    """Runs of a dam, each made when first asked for."""

    def __init__(self, name: str, seconds: float, folder: Path) -> None:
        """Nothing is run yet."""
        self._scene, self._seconds = dam(name), seconds
        self._folder, self._name = folder, f"{name.replace(' ', '_')}_{seconds:g}s"
        self._model: dj.Model | None = None
        folder.mkdir(parents=True, exist_ok=True)

    def take(self, parts: float, modes: int) -> Run:
        """Histories, and processor times [ms] of the steps, with steps of the demo's over parts."""
        path = self._folder / f"{self._name}_{parts:g}_{modes}.npz"
        if not path.exists():
            dt = TIME_STEP / parts
            steps = round(parts * 2.0 * round(self._seconds / (2.0 * TIME_STEP)))
            watch, friction = shaken(self._scene, self._built(), dt, steps, modes)
            np.savez(path, crest=watch.crest, opening=watch.opening, work=friction, cpu=watch.cpu)
        with np.load(path) as kept:
            return dict(kept)

    def _built(self) -> dj.Model:
        if self._model is None:
            with ExitStack() as stack:
                jointed = self._scene.read(stack.enter_context(self._scene.mesh_file()))
                self._model = self._scene.model(jointed, self._scene.law())
        return self._model


def errors(run: Run, right: Run) -> list[float]:
    """Of `QUANTITIES`, against a run whose steps divide those of this one."""
    every = len(right["opening"]) // len(run["opening"])
    found = []
    for name in ("crest", "opening"):
        of = right[name][every - 1 :: every].reshape(len(run[name]), -1)
        off = np.linalg.norm(run[name].reshape(of.shape) - of, axis=1).max()
        largest = np.linalg.norm(right[name].reshape(-1, of.shape[1]), axis=1).max()
        found.append(float(off / largest))
    return [*found, abs(float(run["work"] / right["work"]) - 1.0)]


def rows(runs: Runs, modes: int, right: Run) -> Iterator[tuple[int, float, list[float]]]:
    """Steps, processor time of a step [ms] and errors, coarse to fine."""
    for parts in PARTS:
        run = runs.take(parts, modes)
        off = errors(run, right)
        step = float(np.median(run["cpu"][1:]))
        print(
            f"{modes:5d} {1e3 * TIME_STEP / parts:8.2f} "
            + " ".join(f"{100 * error:13.3f}" for error in off)
            + f" {step:12.1f} {1e-3 * step * len(run['cpu']):8.1f}",
            flush=True,
        )
        yield len(run["cpu"]), step, off


def main(arguments: list[str] | None = None) -> None:
    """Print tables."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--dam", choices=DAM_SIZES, default="dam", help="which mesh")
    parser.add_argument("--seconds", type=float, default=2.44, help="of its motion")
    parser.add_argument("--modes", type=int, nargs="+", default=[0, 5, 10, 20, 50], help="exact")
    parser.add_argument("--out", type=Path, default=Path("output/dam_precision"), help="folder")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    runs = Runs(options.dam, options.seconds, options.out)
    right = runs.take(REFERENCE, 0)
    own = errors(runs.take(REFERENCE / 2, 0), right)
    print(f"{options.dam}, {options.seconds} s; friction work {float(right['work']):.4g} J")
    text = ", ".join(f"{q} {100 * e / 3:.3f} %" for q, e in zip(QUANTITIES, own, strict=True))
    print(f"error of the reference: {text}")
    print("exact  dt [ms]     crest [%]   opening [%]  friction [%]    step [ms]    all [s]")
    found = {modes: list(rows(runs, modes, right)) for modes in options.modes}
    for goal in GOALS:
        print(f"\nsteps, and processor time [s], for an error of {100 * goal:g} %")
        print("exact " + " ".join(f"{quantity:>18s}" for quantity in QUANTITIES))
        for modes, table in found.items():
            steps, taken, off = zip(*table, strict=True)
            each = 1e-3 * float(np.median(taken))
            needed = [steps_for(goal, list(steps), list(those)) for those in zip(*off, strict=True)]
            print(f"{modes:5d} " + " ".join(f"{n:8.0f} {each * n:9.1f}" for n in needed))


if __name__ == "__main__":
    main()
