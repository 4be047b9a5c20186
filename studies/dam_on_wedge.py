# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arch dam on a wedge of rock in the left bank: safety before, in and after an earthquake.

    ./with-dolfinx python3 -m studies.dam_on_wedge                      # synthetic motion
    ./with-dolfinx python3 -m studies.dam_on_wedge --record DIRECTORY   # three AT2 files
    ./with-dolfinx python3 -m studies.dam_on_wedge --quick              # one second
    ./with-dolfinx python3 -m studies.dam_on_wedge --variants           # slip and Newmark's block

Dam and wedge are like those of Malpasset: the wedge lies between a fault that dips upstream and a
foliation plane that dips towards the right bank and downstream. x is downstream, y towards the left
bank, z up. The program prints the factor of safety under the reservoir, its least value in the
earthquake, the permanent displacement, and the factor of safety after the earthquake with the full
pressure of the reservoir in both planes.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gmsh
import numpy as np

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.from_step import from_step
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.planes import bounded
from dolfinx_joints.postprocessing import plots, views
from studies.ambiesta import Case, make_motion

# Published of Malpasset: height, largest thickness, 222 m of crest, level 0.3 m below the spillway.
HEIGHT, THICKNESS, LEVEL = 66.5, 6.8, 66.2  # [m]
# Published: the foliation dips at 30 to 50 degrees, the fault upstream. Chosen: the fault's dip.
PLANES = {"fault": (10.0, 270.0, 20.0, 0.0, 18.0), "foliation": (50.0, 160.0, 8.0, 42.0, 20.6)}
# Chosen: all other numbers.
RADIUS, FLOOR, BANK = 105.0, 20.0, 91.0  # upstream face; half widths of the valley, below and above
LOWER, UPPER = (-60.0, -120.0, -45.0), (130.0, 160.0, HEIGHT)  # rock
DOWNSTREAM = {"slope": (60.0, 90.0, 75.0, 0.0, HEIGHT)}  # end of the rock: the fault crops out
CUTS = (-70.0, -30.0, 0.0, 30.0, 70.0)  # angles from the crown; the banks end the arch [degrees]
DAM = {f"dam_{k}": 0.5 * (a + b) for k, (a, b) in enumerate(pairwise(CUTS), 1)}
IN_WEDGE, IN_ROCK = (45.0, 80.0, 53.0), (0.0, 0.0, -10.0)
SLIDING = ["joint_fault", "joint_foliation"]
SIDES = {f"side_{axis}_{end}": (axis, end) for axis in "xy" for end in ("min", "max")}
SIDES["bottom"] = ("z", "min")

CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
ROCK = dj.Elastic(young=5e9, poisson=0.25, density=0.0)  # foundation without mass
WEDGE = dj.Elastic(young=5e9, poisson=0.25, density=2650.0)
STIFF, SOFT = (dict(normal_stiffness=k, shear_stiffness=0.4 * k) for k in (5e10, 5e9))
ANGLES = {"fault": 30.0, "foliation": 35.0, "contact": 50.0, "between blocks": 45.0}  # phi
ADHESION = 5e5  # of the dam on the rock [Pa]
# Water level in both planes, from the reservoir to the outcrop of the fault [m].
SEEPAGE = {"start": (10.0, 0.0, 16.0), "end": (95.0, 0.0, 31.0), "upstream": LEVEL}
SEEPAGE["downstream"] = 31.0
DRAINED = dj.SeepageLine(**SEEPAGE, drain=(0.15, 0.2))  # a fifth of the difference is left
FULL = dj.SeepageLine(**SEEPAGE)
CREST = dj.Probe((0.0, 0.0, HEIGHT), group="joint_dam_2_dam_3-")
TOLERANCE = 5e-3  # of F
DT, END, QUICK = 0.005, 11.165, 1.0  # [s]


@dataclass(frozen=True, kw_only=True)
class Variant:
    """Parameters of a variant of the study.

    Attributes:
        rock: Factor of Young's modulus of the rock.
        wedge: Factor of Young's modulus of the wedge.
        joints: Factor of the normal stiffness of the planes.
        ratio: k_s / k_n of the planes.
        sticks: True if the planes do not slide.
    """

    rock: float = 1.0
    wedge: float = 1.0
    joints: float = 1.0
    ratio: float = 0.4
    sticks: bool = False


BASE = Variant()
VARIANTS = {
    "as studied": BASE,
    "planes 10 times stiffer": Variant(joints=10.0),
    "k_s = k_n": Variant(ratio=1.0),
    "k_s = k_n / 10": Variant(ratio=0.1),
    "wedge 100 times stiffer": Variant(wedge=100.0),
    "rock 100 times stiffer": Variant(rock=100.0),
    "wedge and rock 100 times stiffer": Variant(wedge=100.0, rock=100.0),
    "the same, planes 20 times stiffer": Variant(wedge=100.0, rock=100.0, joints=20.0),
    "planes stick": Variant(sticks=True),
}


def on_face(angle: float, height: float, depth: float = 0.0) -> tuple[float, float, float]:
    """Return a point at a depth behind the upstream face, at an angle from the crown."""
    radius, a = RADIUS - depth, math.radians(angle)
    return RADIUS - radius * math.cos(a), radius * math.sin(a), height


def write_step(path: Path) -> Path:
    """Write rock and dam to a STEP file."""
    occ, lengths = gmsh.model.occ, np.subtract(UPPER, LOWER)

    def valley() -> list[tuple[int, int]]:
        places = ((-FLOOR, 0.0), (FLOOR, 0.0), (BANK, HEIGHT), (-BANK, HEIGHT))
        corners = [occ.addPoint(LOWER[0], y, z) for y, z in places]
        lines = [occ.addLine(corners[k - 1], corners[k]) for k in range(4)]
        face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
        return [e for e in occ.extrude([(2, face)], lengths[0], 0, 0) if e[0] == 3]

    with gmsh_model.gmsh_session():
        box = occ.addBox(*LOWER, *lengths)
        occ.synchronize()
        occ.cut([(3, bounded(box, DOWNSTREAM, IN_ROCK))], valley())
        for a, b in pairwise(CUTS):
            outer, inner = (
                (3, occ.addCylinder(RADIUS, 0, 0, 0, 0, HEIGHT, r, angle=math.radians(b - a)))
                for r in (RADIUS, RADIUS - THICKNESS)
            )
            occ.rotate([outer, inner], RADIUS, 0, 0, 0, 0, 1, math.radians(180.0 - b))
            occ.intersect(occ.cut([outer], [inner])[0], valley())
        occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.write(str(path))
    return path


def make_mesh(folder: Path) -> Path:
    """Write the mesh; every dam block has its own contact with rock and wedge."""
    folder.mkdir(parents=True, exist_ok=True)
    wet = {f"wet_{name}": on_face(angle, HEIGHT - 6.0) for name, angle in DAM.items()}
    y = 75.0  # upstream of the dam the reservoir presses on the wedge
    x = on_face(math.degrees(math.asin(y / RADIUS)), 0.0)[0] - 3.0
    wet["wet_wedge"] = (x, y, HEIGHT * (y - FLOOR) / (BANK - FLOOR))
    return from_step(
        folder / "dam.msh",
        write_step(folder / "dam.step"),
        size=40.0,
        joint_size=15.0,
        order=1,
        solids={"rock": IN_ROCK}
        | {name: on_face(a, HEIGHT - 6.0, THICKNESS / 2) for name, a in DAM.items()},
        planes=PLANES,
        wedge=IN_WEDGE,
        surfaces=SIDES | wet,
    )


def kind_of(joint: str) -> str:
    """Return the kind of a joint, a key of ``ANGLES``."""
    place = joint.removeprefix("joint_")
    contact = "rock" in place or "wedge" in place
    return place if place in PLANES else "contact" if contact else "between blocks"


def build(jointed: dj.JointedMesh, level: dj.SeepageLine, variant: Variant = BASE) -> dj.Model:
    """Return the model with a water level in both planes of the wedge."""
    normal = variant.joints * SOFT["normal_stiffness"]
    of_planes = {"normal_stiffness": normal, "shear_stiffness": variant.ratio * normal}

    def law(name: str) -> dj.AdhesiveJoint | dj.FrictionNoTension | dj.KeyedJoint:
        kind = kind_of(name)
        if variant.sticks and kind in PLANES:
            return dj.KeyedJoint(**of_planes)
        stiffness = of_planes if kind in PLANES else STIFF
        strength = stiffness | {"friction_angle_deg": ANGLES[kind]}
        if kind == "contact":
            return dj.AdhesiveJoint(**strength, adhesion=ADHESION)
        return dj.FrictionNoTension(**strength)

    wet = [f"wet_{name}" for name in DAM]
    rock = replace(ROCK, young=variant.rock * ROCK.young)
    wedge = replace(WEDGE, young=variant.wedge * WEDGE.young)
    return dj.Model(
        jointed,
        material={"rock": rock, "wedge": wedge} | dict.fromkeys(DAM, CONCRETE),
        joints={name: law(name) for name in jointed.joint_names},
        supports=[dj.Fixed(group=name) for name in SIDES],
        loads=[
            dj.Gravity(),
            *(dj.HydrostaticPressure(group=name, level=LEVEL) for name in [*wet, "wet_wedge"]),
            *(dj.Uplift(joint=name, pressure=level) for name in SLIDING),
        ],
        water=[dj.WestergaardMass(group=name, level=LEVEL, depth=LEVEL) for name in wet],
        damping=dj.rayleigh(ratio=0.05, frequencies=(3.0, 20.0)),
    )


def in_statics(model: dj.Model, path: Path, *, every: int = 10) -> dj.Simulation:
    """Apply weight and reservoir; a later motion is recorded in a file (collective)."""
    options: dict[str, Any] = {"resultants": True, "every": every, "overwrite": True}
    monitor = dj.ResultsMonitor(path, points={"crest": CREST}, **options)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics(loads=model.loads[:1], name="weight")
    simulation.statics(steps=4, name="reservoir")
    return simulation


def read_mesh(folder: Path) -> dj.JointedMesh:
    """Write and read the mesh (collective)."""
    comm = MPI.COMM_WORLD
    return dj.read_msh(on_root(comm, lambda: make_mesh(folder)), comm)


def motion_of(record: str | None, *, quick: bool) -> dict[str, Any]:
    """Return the arguments of `Simulation.dynamics` for a record, None for a synthetic motion."""
    steps = round((QUICK if quick else END) / DT)
    return {
        "dt": DT,
        "steps": steps,
        "motion": make_motion(Case(record_folder=record, time_step=DT)),
    }


def run(folder: Path, record: str | None, *, quick: bool) -> dict[str, float]:
    """Compute all stages, write result files and return the numbers (collective)."""
    jointed = read_mesh(folder)
    before, after = build(jointed, DRAINED), build(jointed, FULL)
    foundation = [name for name in jointed.joint_names if kind_of(name) != "between blocks"]
    simulation = in_statics(before, folder / "shaking.h5")
    limit = dj.ResultsMonitor(folder / "limit.h5", points={"crest": CREST}, overwrite=True)
    static = dj.factor_of_safety(
        simulation, joints=foundation, tolerance=TOLERANCE, monitors=[limit]
    )
    numbers = {"F by reduced strength": static.factor}
    outcome = simulation.dynamics(**motion_of(record, quick=quick))
    with dj.Results(folder / "shaking.h5") as results:
        numbers |= dj.block_sliding(results, SLIDING).measures()
    settled = dj.to_rest(simulation, outcome.state, dt=DT)
    lifted = dj.factor_of_safety(
        dj.Simulation(after), joints=foundation, tolerance=TOLERANCE, start=settled.static
    )
    return numbers | {"F after, full uplift": lifted.factor}


def compare(folder: Path, record: str | None, *, quick: bool) -> dict[str, list[float]]:
    """Return least F(t), slip of Newmark's block, and slip of the wedge by variant (collective).

    The slip of the wedge is that of the whole motion, of steps with F < 1, with F from 1 to 1.5,
    and without a driving force [mm].
    """
    jointed, path, rows = read_mesh(folder), folder / "variant.h5", {}
    angles = [ANGLES[kind] for kind in PLANES]
    for name, variant in VARIANTS.items():
        simulation = in_statics(build(jointed, DRAINED, variant), path, every=1)
        simulation.dynamics(**motion_of(record, quick=quick))
        with dj.Results(path) as results:
            block = dj.block_sliding(results, SLIDING, friction_angle_deg=angles)
        steps, safety = 1e3 * np.diff(block.slip), block.safety[1:]
        selected = safety < 1.0, abs(safety - 1.25) <= 0.25, np.isinf(safety)
        parts = [steps.sum(), *(steps[of_kind].sum() for of_kind in selected)]
        rows[name] = [block.safety.min(), 1e3 * block.newmark_slip[-1], *parts]
    return rows


def draw(path: Path, picture: Path) -> Path:
    """Draw the mechanism of the static failure, F(t), and the slip of the wedge."""
    from matplotlib import pyplot as plt

    with dj.Results(path.with_name("limit.h5")) as results:
        shape = views.deformed(results, stage="mechanism", groups=[*DAM, "wedge"])
        mechanism = plt.imread(plots.save(shape, picture.with_name("mechanism.png")))
    with dj.Results(path) as results:
        block = dj.block_sliding(results, SLIDING)
    figure = plt.figure(figsize=(11.0, 4.4), layout="constrained")
    axes = figure.subplot_mosaic([["shape", "safety"], ["shape", "slip"]])
    axes["shape"].imshow(mechanism)
    axes["shape"].axis("off")
    axes["safety"].plot(block.time, block.safety, lw=0.7)
    axes["safety"].axhline(1.0, color="0.5", lw=0.7)
    axes["safety"].set(ylabel="F(t) [-]", ylim=(0.0, 2.0 * block.safety[0]))
    axes["slip"].plot(block.slip_time, 1e3 * block.slip, label="wedge")
    axes["slip"].plot(block.time, 1e3 * block.newmark_slip, label="Newmark's block")
    axes["slip"].set(xlabel="time [s]", ylabel="slip [mm]")
    axes["slip"].legend(frameon=False)
    return plots.save(figure, picture)


def main(arguments: list[str] | None = None) -> None:
    """Run the study, print the numbers and draw the figure."""
    parser = Parser(description="Arch dam on a wedge of rock.")
    parser.add_argument("--record", help="folder with three AT2 files (default: synthetic motion)")
    parser.add_argument("--out", type=Path, default=Path("output/dam_on_wedge"))
    parser.add_argument("--quick", action="store_true", help="one second of the motion")
    parser.add_argument(
        "--variants", action="store_true", help="compare the slip with that of Newmark's block"
    )
    options = parser.parse_args(arguments)
    if options.variants:
        rows = compare(options.out, options.record, quick=options.quick)

        def table() -> None:
            columns = ("least F", "Newmark", "wedge", "F < 1", "F 1 to 1.5", "F infinite")
            print(f"{'slips in mm':<36}", *(f"{column:>11}" for column in columns))
            for name, row in rows.items():
                print(f"{name:<36}", *(f"{value:11.3g}" for value in row))

        return on_root(MPI.COMM_WORLD, table)
    numbers = run(options.out, options.record, quick=options.quick)

    def show() -> None:
        for name, value in numbers.items():
            print(f"{name:<24}{value:12.4g}")
        print(draw(options.out / "shaking.h5", options.out / "dam_on_wedge.png"))

    on_root(MPI.COMM_WORLD, show)


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    try:
        main()
    except (dj.JointsError, ValueError) as error:
        if MPI.COMM_WORLD.rank == 0:
            print(f"studies.dam_on_wedge: {error}", file=sys.stderr)
        raise SystemExit(2) from None
