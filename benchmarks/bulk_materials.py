# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time per step of the same linear body as a linear and as a nonlinear material.

Two blocks with a friction joint slide on each other in an earthquake. Hooke's law is given as
`Elastic`, as an energy in UFL, as a function in NumPy, and as `DruckerPrager` below its limit.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import ufl

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.two_blocks import two_blocks

SOLID = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
DT = 2e-3  # [s]


class Row(NamedTuple):
    """Result of a run.

    Attributes:
        name: Material and solver.
        seconds: Time per step [s].
        difference: Difference of the displacement to that of the first run, relative.
        imbalance: Energy imbalance, relative to the largest energy.
    """

    name: str
    seconds: float
    difference: float
    imbalance: float


def materials() -> dict[str, Any]:
    """Return the materials by name."""
    lame, shear, c = SOLID.first_lame("strain"), SOLID.shear_modulus, SOLID.stiffness_matrix()

    def hooke(strain: Any) -> Any:
        return 0.5 * lame * ufl.tr(strain) ** 2 + shear * ufl.inner(strain, strain)

    def respond(strain: Any, internal: Any, dt: float) -> Any:
        stress = strain @ c
        return stress, np.tile(c, (len(strain), 1, 1)), 0.5 * np.sum(stress * strain, axis=1)

    return {
        "Elastic": SOLID,
        "UflMaterial": dj.UflMaterial(energy=hooke, elastic=SOLID),
        "NumpyMaterial": dj.NumpyMaterial(respond, elastic=SOLID),
        "DruckerPrager": dj.DruckerPrager(elastic=SOLID, cohesion=1e9, friction_angle_deg=30.0),
    }


def run(material: Any, size: float, steps: int, solver: Any = "monolithic") -> tuple[Any, float]:
    """Return the outcome of a run and its time per step [s]; cells have a size [m]."""
    jointed = mesh_of(two_blocks, size=size)
    base, loads = [dj.Fixed(group="base")], [dj.Gravity()]
    model = dj.Model(jointed, material=material, joints=LAW, supports=base, loads=loads)
    options = dj.SolverOptions(relative_tolerance=1e-13)
    simulation = dj.Simulation(model, solver=solver, options=options)
    simulation.statics()
    motion = dj.synthetic_motion(duration=2.0).resampled(DT)
    start = time.perf_counter()
    outcome = simulation.dynamics(dt=DT, steps=steps, motion=motion)
    return outcome, (time.perf_counter() - start) / steps


def rows(size: float, steps: int) -> Sequence[Row]:
    """Return the results of all materials."""
    runs = [(name, law, "monolithic") for name, law in materials().items()]
    runs.append(("Elastic, condensed", SOLID, "condensed"))
    table: list[Row] = []
    first = None
    for name, law, solver in runs:
        outcome, seconds = run(law, size, steps, solver)
        u = outcome.state.displacement
        first = first or u
        table.append(Row(name, seconds, (u - first).norm() / first.norm(), outcome.imbalance))
    return table


def main() -> None:
    """Print a table."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few cells and steps")
    quick = parser.parse_args().quick
    warnings.simplefilter("ignore")
    table = rows(*((0.5, 5) if quick else (0.125, 40)))
    print("material              s per step   ratio   difference   imbalance")
    for row in table:
        ratio = row.seconds / table[0].seconds
        print(
            f"{row.name:20s} {row.seconds:11.4f} {ratio:7.2f} {row.difference:12.1e} "
            f"{row.imbalance:11.1e}"
        )


if __name__ == "__main__":
    main()
