# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Synthetic twin of a calibration: an arch dam through three years of temperature and level.

    ./with-dolfinx python3 -m studies.calibration_twin

Five moduli, nine joint stiffnesses and nine initial gaps of a dam are chosen at random. The dam is
computed through three years, and noise of 5 % is added to its readings: joint meters in all
joints, a pendulum at three places, and the first frequencies. The calibration receives these
readings only. The program prints the recovered parameters, and the number of runs of three methods.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx.mesh import compute_midpoints
from scipy.optimize import least_squares, minimize

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.mesh.jointed_mesh import mesh_tags
from dolfinx_joints.study.calibration import jacobian

YEAR, WEEK = 365.25 * 86400.0, 7.0 * 86400.0
JOINTS = 9
# Largest coordinate z [m] of the lower zones, and bank of the zones above.
LOWER, BANKS = 20.0, ("left", "middle", "right")
LEVELS = (30.0, 38.0, 46.0, 54.0)  # [m]
MOST = 500  # runs of the method without derivatives


def level(time: float) -> float:
    """Return the level of the reservoir at a time [s], [m]."""
    return 43.0 + 9.0 * math.sin(2.0 * math.pi * time / YEAR) + 1.5 * math.sin(9.0 * time / YEAR)


def share(k: int) -> Any:
    """Return the weight of the k-th of the `LEVELS` in linear interpolation."""
    unit = np.eye(len(LEVELS))[k]
    return lambda time: float(np.interp(level(time), LEVELS, unit))


def dam(folder: Path, size: float, comm: Any) -> dj.JointedMesh:
    """Return the mesh of a dam with nine joints and five zones (collective)."""
    path = folder / "dam.msh"
    if comm.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
        ambiesta(path, size=size, joints=JOINTS, active_height=0.9)
    comm.barrier()
    whole = dj.read_msh(path, comm)
    mesh = whole.mesh
    cells = np.arange(mesh.topology.index_map(3).size_local + mesh.topology.index_map(3).num_ghosts)
    _, y, z = compute_midpoints(mesh, 3, cells.astype(np.int32)).T
    # Zone 0 and 1: lower and upper part of the middle; 2: left; 3: right; 4: crest.
    zone = np.select([z > 45.0, y > 20.0, y < -20.0, z > 22.0], [4, 2, 3, 1], 0)
    return replace(
        whole,
        cell_tags=mesh_tags(mesh, 3, cells, zone + 1),
        cell_groups={f"zone {i}": (i + 1,) for i in range(5)},
    )


def parametric(mesh: dj.JointedMesh) -> dj.ParametricModel:
    """Return the parametric model: moduli by zone, stiffnesses and gaps by joint (collective)."""
    moduli = [f"E of {name}" for name in mesh.cell_groups]
    stiffnesses, gaps = ([f"{kind} of {j}" for j in mesh.joint_names] for kind in ("k_n", "gap"))
    parameters = {n: dj.Parameter(value=25e9, deviation=5e9, lower=5e9, unit="Pa") for n in moduli}
    parameters |= {
        n: dj.Parameter(value=2e10, deviation=6e9, lower=1e9, unit="Pa/m") for n in stiffnesses
    }
    parameters |= {n: dj.Parameter(value=1e-3, deviation=3e-4, lower=1e-5, unit="m") for n in gaps}

    def parts(values: Mapping[str, float]) -> dict[str, Any]:
        solids = {
            group: dj.Elastic(young=values[name], poisson=0.2, density=2400.0)
            for group, name in zip(mesh.cell_groups, moduli, strict=True)
        }
        laws = {
            joint: dj.FrictionNoTension(
                normal_stiffness=values[name], shear_stiffness=4e9, friction_coefficient=0.7
            )
            for joint, name in zip(mesh.joint_names, stiffnesses, strict=True)
        }
        by_joint = {j: values[name] for j, name in zip(mesh.joint_names, gaps, strict=True)}
        return {"material": solids, "joints": dj.Joints(laws, initial_gaps=by_joint)}

    water = [
        dj.HydrostaticPressure(group="upstream", level=h, factor=share(k))
        for k, h in enumerate(LEVELS)
    ]
    season = dj.Temperature(
        value=lambda x: 10.0 * ufl.exp(-(57.0 - x[2]) / 60.0),
        reference=0.0,
        expansion=1e-5,
        factor=lambda time: -math.cos(2.0 * math.pi * (time / YEAR - 0.08)),
    )
    base = dj.Model(
        mesh,
        supports=[dj.Fixed(group="base"), dj.Fixed(group="abutments")],
        loads=[dj.Gravity(), *water, season],
        **parts({name: parameter.value for name, parameter in parameters.items()}),
    )
    return dj.ParametricModel(lambda values: dj.changed_model(base, **parts(values)), parameters)


def instruments(mesh: dj.JointedMesh) -> dict[str, dict[str, Any]]:
    """Return the points and gaps of a `Tape`: a pendulum at three places, all joint meters."""
    places = {"crown": (-7.8, 0.0, 57.0), "left bank": (0.0, 36.0, 50.0)}
    places |= {"right bank": (0.0, -36.0, 50.0)}
    nodes = mesh.mesh.geometry.x
    found = {}
    for name, place in places.items():
        distance = np.linalg.norm(nodes - place, axis=1)
        nearest = mesh.mesh.comm.allgather((float(distance.min()), nodes[distance.argmin()]))
        found[name] = tuple(min(nearest, key=lambda pair: pair[0])[1])
    return {"points": found, "gaps": {joint: joint for joint in mesh.joint_names}}


def years(model: dj.Model, tape: dj.Tape) -> None:
    """Run self weight, then three years in steps of a week (collective)."""
    simulation = dj.Simulation(model, monitors=[tape])
    simulation.statics()
    simulation.quasi_statics(WEEK * np.arange(1, 157))


def read(
    parametric: dj.ParametricModel, observed: Mapping[str, Any], truth: Mapping[str, float]
) -> tuple[list[dj.Readings], list[tuple[float, float]]]:
    """Return the readings of a dam with the true parameters, and its frequencies (collective).

    Readings every second week, changes since the first one, with noise of 5 % of their largest
    value; frequencies with noise of 0.5 %.
    """
    random = np.random.default_rng(2)
    tape = dj.Tape(**observed)
    years(parametric.model(truth), tape)
    history, rows = tape.history(), slice(1, None, 2)
    readings = []
    for name, values in history.values.items():
        exact = values[rows, 0] - values[1, 0]
        deviation = 0.05 * np.abs(exact).max()
        noisy = exact + deviation * random.standard_normal(len(exact))
        noisy -= noisy[0]  # the instrument was zeroed
        series = history.times[rows], noisy
        readings.append(
            dj.Readings(of=name, component=0, series=series, deviation=deviation, relative=True)
        )
    exact_frequencies = dj.modes(parametric.model(truth).system(), 6).frequencies
    noise = 1.0 + 0.005 * random.standard_normal(6)
    return readings, [(f, 0.005 * f) for f in (exact_frequencies * noise).tolist()]


def truth_of(parametric: dj.ParametricModel) -> dict[str, float]:
    """Return true parameters, drawn from the prior."""
    random = np.random.default_rng(1)
    return {
        name: p.value + p.deviation * float(np.clip(random.standard_normal(), -2.0, 2.0))
        for name, p in parametric.parameters.items()
    }


def smallest_of(misfit: dj.Misfit) -> float:
    """Return the smallest misfit of all runs so far."""
    return min(evaluation.misfit for _, evaluation in misfit.known)


def gauss_newton(misfit: dj.Misfit) -> float:
    """Return the smallest misfit of SciPy's Gauss-Newton method with finite differences."""
    scale = misfit.errors

    def residuals(x: Any) -> Any:
        computed = misfit.evaluate(x, gradient=False).computed
        return np.concatenate([(computed - misfit.measured) / scale, x])

    found = least_squares(
        residuals,
        np.zeros(len(misfit.names)),
        lambda x: np.vstack([jacobian(misfit, x), np.eye(len(x))]),
        bounds=np.transpose(misfit.bounds),
        ftol=1e-5,
    )
    return float(found.cost)


def without_derivatives(misfit: dj.Misfit) -> float:
    """Return the smallest misfit of a method without derivatives, in at most `MOST` runs."""
    found = minimize(
        lambda x: misfit.evaluate(x, gradient=False).misfit,
        np.zeros(len(misfit.names)),
        bounds=misfit.bounds,
        method="COBYQA",
        options={"maxfev": MOST},
    )
    return float(found.fun)


def main(arguments: list[str] | None = None) -> None:
    """Calibrate the twin, and print the parameters and the numbers of runs."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=float, default=12.0, help="cell size [m]")
    parser.add_argument("--out", type=Path, default=Path("output/calibration_twin"))
    parser.add_argument("--compare", action="store_true", help="also run the other methods")
    options = parser.parse_args(arguments)
    mesh = dam(options.out, options.size, MPI.COMM_WORLD)
    model, observed = parametric(mesh), instruments(mesh)
    truth = truth_of(model)
    readings, measured = read(model, observed, truth)
    facts = {**observed, "measured_frequencies": measured}
    misfit = dj.Misfit(model, years, readings, **facts, folder=options.out / "runs")
    found = dj.calibrate(misfit)
    if mesh.mesh.comm.rank == 0:
        print(found)
        print(f"{'parameter':16s}{'truth':>12s}{'found':>12s}{'deviation':>12s}  error/deviation")
    errors = []
    for row in found.rows():
        exact, value, deviation = truth[row["parameter"]], row["calibrated"], row["deviation"]
        errors.append((value - exact) / deviation)
        if mesh.mesh.comm.rank == 0:
            name = row["parameter"]
            print(f"{name:16s}{exact:12.4g}{value:12.4g}{deviation:12.2g}{errors[-1]:8.2f}")
    within = int(np.count_nonzero(np.abs(errors) < 2.0))
    count = len(truth)
    searched = sum(bool(np.isfinite(run.gradient).all()) for _, run in misfit.known)
    if mesh.mesh.comm.rank == 0:
        print(f"{within} of {count} parameters are within 2 deviations of the truth")
        print(f"runs: {searched} with a gradient, {misfit.runs - searched} for Jacobians")
        print(f"misfit: {smallest_of(misfit):.2f}")
    if options.compare:
        for name, method in (("Gauss-Newton", gauss_newton), ("COBYQA", without_derivatives)):
            other = dj.Misfit(model, years, readings, **facts, folder=options.out / name)
            smallest = method(other)
            if mesh.mesh.comm.rank == 0:
                print(f"{name}: misfit {smallest:.2f} after {other.runs} runs", flush=True)


if __name__ == "__main__":
    main()
