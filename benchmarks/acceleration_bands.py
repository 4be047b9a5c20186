#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much accelerations and 5 % spectra change under half the step, raw and low-passed.

The README's dam, at the crest on a joint and at its next node on none, 6 m away (the mesh has none
nearer), and the dam of demo 03 at 0.65 of its height, on the crown's joint and some 3 m from it.
Printed are, for each component, the peaks with both steps, the change of the peak, and the largest
change of the spectrum at periods not below one over the band (raw: from 0.03 s), each relative to
the run with half the step. ``--figure FILE`` draws the component across the valley of the joint.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints import measures, plots
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest
from dolfinx_joints.motions.spectra import equally_spaced, response_spectrum
from dolfinx_joints.time_integration.scheme import Scheme
from studies import ambiesta as study

BANDS = (None, 40.0, 25.0, 20.0, 15.0, 10.0)
PERIODS = np.geomspace(0.03, 3.0, 80)
STEPS = {"readme": 0.001, "demo03": 0.00488}  # s


def readme(path: Path, dt: float, seconds: float, scheme: Scheme | None = None) -> None:
    """Write results of the README's dam with a step [s]."""
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
    points = {
        "joint": dj.Probe(tuple(crest), group="joint_6+"),
        "off joint": (-7.578609, 6.020018, crest[2]),
    }
    march(model, points, path, dt, seconds, dj.synthetic_motion(duration=2.0), scheme)


def demo03(path: Path, dt: float, seconds: float) -> None:
    """Write results of the dam of demo 03 with a step [s]."""
    case = study.Case(time_step=dt)
    model = study.build(case, "joints", study.make_mesh(case, path.parent))
    s = np.linspace(0.0, 0.3, 301)
    places = np.array([case.dam().point(each, 0.0, 0.65) for each in s])
    away = np.argmin(abs(np.linalg.norm(places - places[0], axis=1) - 3.0))
    points = {
        "joint": dj.Probe(tuple(places[0]), group="joint_6+"),
        "off joint": tuple(places[away]),
    }
    march(model, points, path, dt, seconds, study.make_motion(case))


def march(
    model: dj.Model,
    points: dict,
    path: Path,
    dt: float,
    seconds: float,
    motion: dj.Motion,
    scheme: Scheme | None = None,
) -> None:
    """Weight, then the motion, with the default scheme unless another is given."""
    recorded = dj.ResultsMonitor(path, points=points, every=1000, overwrite=True)
    simulation = dj.Simulation(model, monitors=[recorded])
    simulation.statics()
    chosen = scheme or dj.EnergyConsistent()
    simulation.dynamics(dt=dt, steps=round(seconds / dt), motion=motion, scheme=chosen)


def changes(coarse: dj.Results, fine: dj.Results, point: str, band: float | None) -> None:
    """Print a line for each component."""
    shortest = 0.0 if band is None else 1.0 / band
    for component in measures.COMPONENTS:
        peaks, spectra = [], []
        for results in (coarse, fine):
            moved = measures.acceleration_history(results, point, component, band=band)
            dt, a = equally_spaced(*moved)
            shown = PERIODS >= shortest  # noqa: SIM300
            peaks.append(np.abs(a).max())
            spectra.append(response_spectrum(a, dt, PERIODS[shown], 0.05).pseudo_acceleration)
        spectrum = np.abs(spectra[0] / spectra[1] - 1.0).max()
        by = peaks[0] / peaks[1] - 1.0
        name = "raw" if band is None else f"{band:g} Hz"
        line = f"{peaks[0]:9.3g} {peaks[1]:9.3g} {by:+8.1%} {spectrum:8.1%}"
        print(f"{point:9} {component} {name:6} {line}")


def draw(coarse: dj.Results, fine: dj.Results, path: Path) -> None:
    """Acceleration across the valley at the joint, raw above, in the band below."""
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
    """Run both steps and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dam", choices=tuple(STEPS), default="readme")
    parser.add_argument("--seconds", type=float, default=2.0, help="of the motion")
    parser.add_argument("--dt", type=float, help="the longer step [s]")
    parser.add_argument("--out", type=Path, default=Path("output/acceleration_bands"))
    parser.add_argument("--figure", type=Path, help="where to draw")
    parser.add_argument("--again", action="store_true", help="of the files that are there")
    arguments = parser.parse_args()
    dt = arguments.dt or STEPS[arguments.dam]
    arguments.out.mkdir(parents=True, exist_ok=True)
    paths = [arguments.out / f"{arguments.dam}_{name}.h5" for name in ("whole", "half")]
    if not arguments.again:
        for path, step in zip(paths, (dt, 0.5 * dt), strict=True):
            {"readme": readme, "demo03": demo03}[arguments.dam](path, step, arguments.seconds)
    with dj.Results(paths[0]) as whole, dj.Results(paths[1]) as half:
        places = whole.static("histories/points")
        print(f"dt {dt} s, points {np.linalg.norm(places[1] - places[0]):.2f} m apart")
        print("point, component, band, peak dt   peak dt/2 [m/s^2]  peak, spectrum change")
        for point in ("joint", "off joint"):
            for band in BANDS:
                changes(whole, half, point, band)
        if arguments.figure:
            draw(whole, half, arguments.figure)


if __name__ == "__main__":
    main()
