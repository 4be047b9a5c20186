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
# # An arch dam, from its sections to the report
#
# The demo follows the analysis of a dam in an office. The shape is a table of sections. Blocks
# carry their weight alone until their joints are grouted; then come a full reservoir, a cold
# winter, and an earthquake from the rock. One run has a monolith, one has joints. A small study
# varies the uncertain parameters.
#
#     ./with-dolfinx python3 demos/07_arch_dam_study.py
#     ./with-dolfinx python3 demos/07_arch_dam_study.py --record DIRECTORY   # of three AT2 files
#     ./with-dolfinx mpirun -n 2 python3 demos/07_arch_dam_study.py --steps 50

# %%
from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.sections_dam import sections_dam
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report.writing import write as write_report
from dolfinx_joints.study import Study, Table, read_table, write_csv

COMM = MPI.COMM_WORLD
OUT = Path("output/07_arch_dam_study")
DT = 0.01  # [s]


def say(text: str) -> None:
    """Print on rank 0."""
    if COMM.rank == 0:
        print(text, flush=True)


# %% [markdown]
# ## Shape and mesh
#
# The dam has three horizontal sections between the base at 320 m and the crest at 370 m, a joint
# every 25 m of the crest, rock to a depth of 50 m, and a perimetral joint between dam and rock.

# %%
SECTIONS = """\
elevation, extrados_radius, centre_x, left_angle, right_angle, \
crown_thickness, left_thickness, right_thickness
320, 45, 45, 20, 24, 9.0, 11.0, 11.5
345, 62, 50, 34, 38, 6.5, 8.0, 8.2
370, 80, 60, 46, 50, 3.5, 4.0, 4.0
"""
CREST = 370.0  # [m]
CROWN = (-20.0, 0.0, CREST)  # upstream edge of the crest [m]


def make_mesh(folder: Path, size: float, order: int) -> Path:
    """Write the mesh file of dam and rock on rank 0."""

    def make() -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        sections = folder / "sections.csv"
        sections.write_text(SECTIONS)
        return sections_dam(
            folder / "dam.msh",
            sections,
            size=size,
            order=order,
            joints=5,
            foundation=50.0,
            spread=30.0,
            perimetral=True,
        )

    return on_root(COMM, make)


# %% [markdown]
# ## Model
#
# Dashpots support the rock. Its weight is left out, because it settled before the dam was built.
# The reference temperature is that of the concrete when the joints were grouted. The concrete is
# bonded to the rock: on these steep banks friction alone would not support single blocks.

# %%
ROCK = dj.Elastic(young=30e9, poisson=0.25, density=2600.0)
CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
CONTRACTION = [f"joint_{k}" for k in range(1, 6)]
WEIGHT = dj.Gravity(cells="concrete")
WATER = dj.HydrostaticPressure(group="upstream", level=CREST - 2.0)
WINTER = dj.Temperature(value=4.0, reference=9.0, expansion=1e-5, cells="concrete")


def make_model(
    mesh: Path, *, joints: bool = True, friction: float = 40.0, stiffness: float = 1e11
) -> dj.Model:
    """Return the model of the dam with its joints, or as a monolith."""
    elastic = {"normal_stiffness": stiffness, "shear_stiffness": 0.4 * stiffness}
    contraction = dj.FrictionNoTension(friction_angle_deg=friction, **elastic)
    perimetral = dj.MohrCoulombJoint(
        friction_angle_deg=45.0, cohesion=5e6, tensile_strength=3e6, **elastic
    )
    laws = dict.fromkeys(CONTRACTION, contraction) | {"joint_perimetral": perimetral}
    return dj.Model(
        dj.read_msh(mesh, COMM, joints=None if joints else []),
        material={"concrete": CONCRETE, "foundation": ROCK},
        joints=laws if joints else None,
        supports=[dj.ViscousBoundary(group="foundation_outer")],
        loads=[WEIGHT, WATER, WINTER],
        water=dj.WestergaardMass(group="upstream", level=CREST - 2.0),
        damping=dj.stiffness_proportional(ratio=0.05, frequency=5.0),
    )


# %% [markdown]
# ## Construction, water, winter
#
# The perimetral joint supports the blocks, and each block carries its weight alone. Then the
# contraction joints are grouted, the reservoir is filled, and the temperature falls.


# %%
def build_up(simulation: dj.Simulation) -> None:
    """Run the static stages."""
    jointed = simulation.model.contact is not None
    alone = ["joint_perimetral"] if jointed else "active"
    simulation.statics(loads=[WEIGHT], joints=alone, name="weight")
    if jointed:
        simulation.grout(CONTRACTION, name="grouting")
    simulation.statics(loads=[WEIGHT, WATER], name="full reservoir")
    simulation.statics(name="winter")


# %% [markdown]
# ## Earthquake
#
# The record is from the surface: half of its velocity is the wave that rises in the rock.


# %%
def make_motion(record: str | None, steps: int) -> dj.Motion:
    """Return the record of a folder, or an artificial one, with a corrected baseline."""
    if record is None:
        motion = dj.synthetic_motion(
            seed=1976, duration=max(4.0, DT * steps), peaks_g=(0.35, 0.3, 0.25)
        )
    else:
        motion = dj.read_record(record).band_passed(0.2, 25.0).resampled(DT)
    return motion.baseline_corrected(3)


def shake(simulation: dj.Simulation, motion: dj.Motion, steps: int) -> dj.Outcome:
    """Run the dynamic stage."""
    waves = dj.FreeField(
        groups=["foundation_outer"], incident=dj.incident_wave(motion), surface=CREST
    )
    return simulation.dynamics(dt=DT, steps=steps, loads=[waves])


def run(model: dj.Model, motion: dj.Motion, steps: int, results: Path) -> dj.Outcome:
    """Run all stages; write a results file and files for ParaView."""
    monitors = [
        dj.ResultsMonitor(
            results,
            points={"crown": CROWN, "rock": dj.Probe((0.0, 0.0, 320.0), group="foundation")},
            every=5,
            overwrite=True,
            resultants=model.contact is not None,
            envelopes=True,
        ),
        dj.FieldMonitor(results.with_suffix(".vtkhdf"), every=20, overwrite=True),
        dj.ProgressMonitor(results.stem),
    ]
    simulation = dj.Simulation(model, monitors=monitors)
    build_up(simulation)
    outcome = shake(simulation, motion, steps)
    say(simulation.report(outcome))
    return outcome


# %% [markdown]
# ## A study of four
#
# Friction angle and stiffness of the joints are uncertain. The study runs two values of each, every
# case in a separate process.


# %%
def case(
    folder: Path, *, friction: float, stiffness: float, mesh: str, record: str | None, steps: int
) -> dict[str, float]:
    """Run a case and return its row of the table."""
    model = make_model(Path(mesh), friction=friction, stiffness=stiffness)
    results = Path(folder) / "run.h5"
    run(model, make_motion(record, steps), steps, results)
    with dj.Results(results) as file:
        joints = measures.joint_measures(file)
        return {
            "opening_mm": 1e3 * max(joint["opening_max"] for joint in joints.values()),
            "slip_mm": 1e3 * max(joint["slip_max"] for joint in joints.values()),
            "slip_residual_mm": 1e3 * max(joint["slip_residual"] for joint in joints.values()),
        }


def study(mesh: Path, record: str | None, steps: int, out: Path) -> Table:
    """Run the cases and write their table."""
    cases = {
        f"friction={friction:g}_stiffness={stiffness:g}": {
            "friction": friction,
            "stiffness": stiffness,
            "mesh": str(mesh.resolve()),
            "record": record,
            "steps": steps,
        }
        for friction in (35.0, 45.0)
        for stiffness in (5e10, 2e11)
    }
    dj.set_log_level("INFO")  # a line for each case that has ended
    print(Study(out / "study", case, cases).run(workers=2))
    table = read_table(out / "study")
    columns = ("case", "opening_mm", "slip_mm", "slip_residual_mm")
    print("{:30}{:>12}{:>10}{:>18}".format(*columns))
    for row in zip(*(table[name] for name in columns), strict=True):
        print("{:30}{:12.2f}{:10.2f}{:18.2f}".format(*row))
    print(f"table: {write_csv(table, out / 'study.csv')}")
    return table


# %% [markdown]
# ## Report and tables
#
# Open the report in a browser, the tables in a spreadsheet, and the `.vtkhdf` files in ParaView.


# %%
def read(out: Path) -> None:
    """Write report and tables of both runs; print the largest openings and slips."""
    files = [out / "monolith.h5", out / "joints.h5"]
    print(f"report: {write_report(files, out / 'report.html')}")
    for path in files:
        with dj.Results(path) as results:
            dj.write_csv(results, out / f"{path.stem}_tables", overwrite=True)
        print(f"results: {path}, {path.with_suffix('.vtkhdf')}; tables: {out / path.stem}_tables")
    with dj.Results(files[1]) as results:
        for stage in measures.static_stages(results):
            print(f"{stage.name}: crown moves {1e3 * stage.displacement['crown'][0]:.1f} mm")
        for joint, values in measures.joint_measures(results).items():
            print(
                f"{joint}: opens by up to {1e3 * values['opening_max']:.2f} mm at "
                f"{values['opening_time']:g} s, slides by up to {1e3 * values['slip_max']:.2f} mm"
            )


def parse_arguments(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = Parser(description="An arch dam, from its sections to the report.")
    parser.add_argument("--size", type=float, default=12.0, help="cell size [m] (default 12)")
    parser.add_argument("--order", type=int, default=1, choices=(1, 2), help="element order")
    parser.add_argument("--steps", type=at_least(1), default=400, help="steps of 0.01 s")
    parser.add_argument("--record", help="directory with three AT2 files of one record")
    parser.add_argument("--out", type=Path, default=OUT, help="where files are written")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Run everything."""
    options = parse_arguments(arguments)
    say(f"Two runs of {options.steps} steps, then a study of four jointed ones: 2 to 5 minutes.")
    mesh = make_mesh(options.out, options.size, options.order)
    motion = make_motion(options.record, options.steps)
    for name, joints in (("monolith", False), ("joints", True)):
        outcome = run(
            make_model(mesh, joints=joints), motion, options.steps, options.out / f"{name}.h5"
        )
        assert outcome.imbalance < 1e-9  # sum of all energy lines
        assert outcome.energy_error < (
            0.02 if joints else 1e-9
        )  # including the loss by broken bonds
    on_root(COMM, lambda: read(options.out))
    if COMM.size == 1:
        study(mesh, options.record, options.steps, options.out)


if __name__ == "__main__":
    dj.abort_on_error(COMM)
    main()
