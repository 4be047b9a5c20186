#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Change of accelerations and 5 % spectra with half the step, raw and low-passed.

One dam is the README's, with points at the crest on a joint and at the nearest node off the joint,
6 m away. The other is the dam of demo 03 at 0.65 of its height, with points on the crown's joint
and about 3 m from it. A run with a motion 1 + 1e-6 times as large shows the scatter of results that
depend on the order of contacts. ``--finer`` adds a mesh of half the size (demo 03).

For each component and band the program prints the peak. For each other run it prints the change of
the peak. Two columns have the largest change of the spectrum: at periods above one over the band
(raw: from 0.03 s), and at those also above ten steps. The last column is the shortest period from
which on the change is at most 5 %. ``--figure FILE`` draws the joint's component across the valley.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints import measures, plots
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest
from dolfinx_joints.motions.spectra import equally_spaced, response_spectrum
from studies import ambiesta as study

BANDS = (None, 40.0, 25.0, 20.0, 15.0, 10.0)
PERIODS = np.geomspace(0.03, 3.0, 80)
STEPS = {"readme": 0.001, "demo03": 0.00488}  # s


def readme(path: Path, run: Run) -> None:
    """Write results of the README's dam."""
    mesh = ambiesta(path.with_suffix(".msh"), size=8.0, order=1, active_height=1.0)
    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
    model = dj.Model(
        dj.read_msh(mesh, MPI.COMM_WORLD),
        material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
        joints=law,
        supports=[dj.Fixed(group="base"), dj.Fixed(group="abutments")],
        loads=[dj.Gravity()],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
    )
    crest = np.asarray(mid_crest())
    places = (tuple(crest), (-7.578609, 6.020018, crest[2]))
    march(model, path, run, places, dj.synthetic_motion(duration=2.0))


def demo03(path: Path, run: Run) -> None:
    """Write results of the dam of demo 03."""
    case = study.Case(time_step=run.dt, size=study.Case.size * run.mesh)
    model = study.build(case, "joints", study.make_mesh(case, path.parent / path.stem))
    s = np.linspace(0.0, 0.3, 301)
    line = np.array([case.dam().point(position, 0.0, 0.65) for position in s])
    away = np.argmin(abs(np.linalg.norm(line - line[0], axis=1) - 3.0))
    march(model, path, run, (tuple(line[0]), tuple(line[away])), study.make_motion(case))


@dataclass(frozen=True, kw_only=True)
class Run:
    """Parameters of a compared run; motion and mesh are relative to the usual ones."""

    dt: float
    seconds: float
    scheme: dj.EnergyConsistent
    motion: float = 1.0
    mesh: float = 1.0
    places: tuple[tuple[float, ...], ...] = ()


def march(model: dj.Model, path: Path, run: Run, places: tuple, motion: dj.Motion) -> None:
    """Run self weight, then the motion."""
    joint, away = run.places or places
    points = {"joint": dj.Probe(joint, group="joint_6+"), "off joint": away}
    recorded = dj.ResultsMonitor(path, points=points, every=1000, overwrite=True)
    simulation = dj.Simulation(model, monitors=[recorded])
    simulation.statics()
    steps = round(run.seconds / run.dt)
    simulation.dynamics(dt=run.dt, steps=steps, motion=motion.scaled(run.motion), scheme=run.scheme)


def changes(runs: dict[str, dj.Results], point: str, component: str, band: float | None) -> str:
    """Return the line of a component in a band."""
    by_run = {}
    for name, results in runs.items():
        moved = measures.acceleration_history(results, point, component, band=band)
        dt, a = equally_spaced(*moved)
        spectrum = response_spectrum(a, dt, PERIODS, 0.05).pseudo_acceleration
        by_run[name] = np.abs(a).max(), spectrum
    peak, spectrum = by_run.pop("whole")
    from_band = 0.0 if band is None else 1.0 / band
    from_step = max(from_band, 10.0 * np.diff(runs["whole"].time("histories")).max())
    line = f"{point:9} {component} {'raw' if band is None else f'{band:g} Hz':6} {peak:8.3g}"
    for other_peak, other in by_run.values():
        by = np.abs(spectrum / other - 1.0)
        tails = (by[shortest * (1 - 1e-9) <= PERIODS].max() for shortest in (from_band, from_step))
        worse = np.flatnonzero(by > 0.05)
        since = PERIODS[min(worse[-1] + 1, len(PERIODS) - 1)] if len(worse) else PERIODS[0]
        shares = " ".join(f"{100 * by:7.2g}" for by in (peak / other_peak - 1.0, *tails))
        line += f" |{shares} {since:5.2f}"
    return line


def draw(coarse: dj.Results, fine: dj.Results, path: Path) -> None:
    """Draw the joint's acceleration across the valley: raw in the upper, band in the lower plot."""
    from matplotlib.figure import Figure

    axes = Figure(figsize=(7.5, 5.0), layout="constrained").subplots(2, 1, sharex=True)
    for ax, band in zip(axes, (None, measures.ACCELERATION_BAND), strict=True):
        for results, name, colour in ((fine, "half the step", "C1"), (coarse, "step", "C0")):
            time, a = measures.acceleration_history(results, "joint", "y", band=band)
            style = "--" if band and results is coarse else "-"
            ax.plot(time, a, style, color=colour, linewidth=0.9, label=name)
        ax.set_ylabel("acceleration y [m/s²]")
        ax.set_title(f"absolute, {measures.band_name(band)}", loc="left")
        ax.legend(loc="upper right")
    axes[1].set_xlabel("time [s]")
    plots.save(axes[0].figure, path, dpi=110)


def main() -> None:
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dam", choices=tuple(STEPS), default="readme")
    parser.add_argument("--seconds", type=float, default=2.0, help="duration of the motion")
    parser.add_argument("--dt", type=float, help="the longer step [s]")
    parser.add_argument("--exact-modes", type=int, default=0, help="modes of EnergyConsistent")
    parser.add_argument("--mesh", type=float, default=1.0, help="relative cell size (demo03)")
    parser.add_argument("--finer", action="store_true", help="also run a finer mesh (demo03)")
    parser.add_argument("--out", type=Path, default=Path("output/acceleration_bands"))
    parser.add_argument("--figure", type=Path, help="file of the figure")
    parser.add_argument("--again", action="store_true", help="print from existing files")
    given = parser.parse_args()
    whole = Run(
        dt=given.dt or STEPS[given.dam],
        seconds=given.seconds,
        scheme=dj.EnergyConsistent(exact_modes=given.exact_modes),
        mesh=given.mesh,
    )
    given.out.mkdir(parents=True, exist_ok=True)
    names = ("whole", "half", "nudged", *(["finer"] if given.finer else []))
    paths = {name: given.out / f"{given.dam}_{name}.h5" for name in names}
    make = {"readme": readme, "demo03": demo03}[given.dam]
    if not given.again:
        make(paths["whole"], whole)
        make(paths["half"], replace(whole, dt=0.5 * whole.dt))
        make(paths["nudged"], replace(whole, motion=1.0 + 1e-6))
        if given.finer:
            with dj.Results(paths["whole"]) as results:
                places = tuple(map(tuple, results.static("histories/points")))
            make(paths["finer"], replace(whole, mesh=0.5 * given.mesh, places=places))
    with ExitStack() as stack:
        runs = {name: stack.enter_context(dj.Results(path)) for name, path in paths.items()}
        for name, results in runs.items():
            places = results.static("histories/points")
            dofs = results.metadata["dofs"]
            print(f"{name}: dt {np.diff(results.time('histories')).max():g} s, {dofs} dofs, points")
            print(np.round(places, 3).tolist())
        print("point, component, band, peak [m/s^2]; against", " | ".join(names[1:]))
        print("change [%] of the peak, of spectra from 1/band, from 10 dt; 5 % and less from [s]")
        for point in ("joint", "off joint"):
            for band in BANDS:
                for component in measures.COMPONENTS:
                    print(changes(runs, point, component, band))
        if given.figure:
            draw(runs["whole"], runs["half"], given.figure)


if __name__ == "__main__":
    main()
