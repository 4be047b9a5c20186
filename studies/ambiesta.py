# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arch dam of the 1992 paper: computes a results file from the parameters of a case.

The dam has a rigid base and an empty basin. Self weight acts first, with active joints or before
the joints are grouted. Then the ground shakes in three directions. Damping is a constant matrix,
2 % at 5 Hz. Other parameters give another dam::

    run(Case(height=100.0, crest_length=300.0, joints=20, size=12.0, steps=410), "joints", folder)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import check_count, check_kind_of, check_number
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.geometry.arch import ArchDam
from dolfinx_joints.simulation.outcome import Outcome
from dolfinx_joints.time_integration.scheme import Scheme
from studies.summary import summary_row

Which = Literal["linear", "joints"]

TIME_STEP = 0.00488
ALL_STEPS = 2288
STATE_INTERVAL = 5
LOAD_STEPS = 4
CONCRETE = dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0)
DAMPING = dj.stiffness_proportional(ratio=0.02, frequency=5.0)
SUPPORTS = (dj.Fixed(group="base"), dj.Fixed(group="abutments"))
SCHEMES: dict[str, Scheme] = {"ec": dj.EnergyConsistent(), "newmark": dj.Newmark()}
TAPER = 0.25  # s, at both ends of a record
RECORD_TURN = 25.0  # degrees: turns the largest peak of the Tolmezzo record to the stream axis

# Relative height at which bodies with and without a crest arch are compared.
COMPARED_LEVEL = 0.75

_POSITIVE = ("height", "crest_length", "base_width", "base_thickness", "crest_thickness", "size")
_CHOICES = {
    "order": (1, 2),
    "cell": ("hex", "tet"),
    "self_weight": ("finished", "grouted"),
    "scheme": tuple(SCHEMES),
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """Dam, mesh, joints, ground motion and time steps; the defaults are the paper's.

    Args:
        height: Height of the dam [m].
        crest_length: Length of the crest along the upstream edge [m].
        base_width: Chord of the arch at the base [m].
        base_thickness: Thickness of the crown at the base [m].
        crest_thickness: Thickness of the crown at the crest [m].
        crest_half_angle: Half angle of the arch at the crest [degrees].
        crest_arch: Whether an uncut arch is above the active height; else the body ends there.
        joints: Number of vertical joints, radial at the crest.
        active_height: Relative height up to which the joints are cut; 1.0 is the crest.
        size: Cell size in elevation [m].
        order: Degree of the cells and of the displacement, 1 or 2.
        cell: ``hex`` or ``tet``.
        layers: Number of cells through the thickness.
        friction_angle_deg: Friction angle of the joints [degrees].
        normal_stiffness: k_n of the joints [Pa/m].
        shear_ratio: k_s/k_n.
        gap: Gap of all joints [m], before self weight acts or after grouting. The first state of
            the results file shows where it remains open under self weight.
        self_weight: ``finished``: it acts on the finished dam with active joints. ``grouted``: it
            acts on separate blocks, whose joints are then closed without stress. An uncut crest
            arch ties the blocks in both.
        scheme: ``ec``, energy-consistent, or ``newmark``, average acceleration.
        time_step: Time step [s].
        steps: Number of time steps.
        record_folder: Folder of the AT2 files of a record; None for the built-in synthetic motion.
        record_name: Part of the file names, if the folder has several records.
        rotate: Rotation of the horizontal axes [degrees]; by default 25 for a record, else 0.
        scale: Factor on the motion.

    Raises:
        ValueError: A number is out of its range.
    """

    height: float = 57.0
    crest_length: float = 144.6
    base_width: float = 24.0
    base_thickness: float = 9.0
    crest_thickness: float = 2.0
    crest_half_angle: float = 50.0
    crest_arch: bool = True
    joints: int = 11
    active_height: float = 0.75
    size: float = 5.5
    order: int = 2
    cell: str = "hex"
    layers: int = 1
    friction_angle_deg: float = 30.0
    normal_stiffness: float = 1e11
    shear_ratio: float = 0.4
    gap: float = 0.0
    self_weight: str = "finished"
    scheme: str = "ec"
    time_step: float = TIME_STEP
    steps: int = ALL_STEPS
    record_folder: str | None = None
    record_name: str | None = None
    rotate: float | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        """Check the parameters, so that messages use their names."""
        for name in _POSITIVE:
            check_number(name, getattr(self, name), lambda v: v > 0, "positive", unit="m")
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            allowed = " or ".join(repr(choice) for choice in choices)
            check_kind_of(name, value, value in choices, allowed)
        check_number("time_step", self.time_step, lambda v: v > 0, "positive", unit="s")
        check_number("active_height", self.active_height, lambda v: 0 < v <= 1, "in (0, 1]")
        check_number("shear_ratio", self.shear_ratio, lambda v: v >= 0, "zero or more")
        check_number("gap", self.gap, lambda v: v >= 0, "zero or more", unit="m")
        check_number("scale", self.scale, lambda _: True, "a number")
        for name, least in (("joints", 1), ("layers", 1), ("steps", 1)):
            check_count(name, getattr(self, name), least, f"it must be at least {least}")
        check_kind_of("crest_arch", self.crest_arch, isinstance(self.crest_arch, bool), "a bool")
        named = self.record_folder is not None or self.record_name is None
        check_kind_of("record_name", self.record_name, named, "given with a record_folder")
        self.law()
        self.dam()

    def dam(self) -> ArchDam:
        """Return the shape of the dam."""
        return ArchDam.of_crest(
            self.crest_length,
            height=self.height,
            base_half_chord=0.5 * self.base_width,
            base_thickness=self.base_thickness,
            crest_thickness=self.crest_thickness,
            crest_half_angle=self.crest_half_angle,
        )

    def law(self) -> dj.FrictionNoTension:
        """Return the law of all joints."""
        return dj.FrictionNoTension(
            normal_stiffness=self.normal_stiffness,
            shear_stiffness=self.shear_ratio * self.normal_stiffness,
            friction_angle_deg=self.friction_angle_deg,
        )

    @property
    def turn(self) -> float:
        """Rotation of the horizontal axes [degrees]."""
        if self.rotate is not None:
            return self.rotate
        return 0.0 if self.record_folder is None else RECORD_TURN

    @property
    def top(self) -> float:
        """Relative height at which the body ends."""
        return 1.0 if self.crest_arch else self.active_height

    def points(self) -> dict[str, tuple[float, float, float]]:
        """Return points at the upstream edge of the top, and one at a height of all bodies [m].

        Left and right are as seen looking downstream; y points to the left.
        """
        dam, places = self.dam(), {"mid-crest": (0.0, self.top)}
        places |= {"left-quarter": (0.5, self.top), "right-quarter": (-0.5, self.top)}
        places["crown-75"] = (0.0, min(COMPARED_LEVEL, self.top))
        coordinates = {}
        for name, (s, zeta) in places.items():
            x, y, z = dam.point(s, 0.0, zeta)
            coordinates[name] = (float(x), float(y), float(z))
        return coordinates


NAMES = tuple(field.name for field in fields(Case))


def make_motion(case: Case) -> dj.Motion:
    """Return the ground motion in the axes of the dam at the time step of the analysis.

    A record is detrended, tapered, rotated to the dam's axes (x downstream, y across the valley,
    z up) and resampled.
    """
    if case.record_folder is None:
        motion = dj.synthetic_motion()
    else:
        motion = dj.read_record(case.record_folder, name=case.record_name)
        motion = motion.detrended().tapered(seconds=TAPER)
    return motion.rotated(case.turn).resampled(case.time_step).scaled(case.scale)


def make_mesh(case: Case, folder: str | Path, comm: Any = MPI.COMM_WORLD) -> Path:
    """Write the mesh to a folder, which is created if missing (collective)."""
    place = Path(folder)

    def make() -> Path:
        place.mkdir(parents=True, exist_ok=True)
        return ambiesta(
            place / "dam.msh",
            size=case.size,
            order=case.order,
            cell=case.cell,
            joints=case.joints,
            active_height=case.active_height,
            crest_arch=case.crest_arch,
            layers=case.layers,
            parameters=case.dam(),
        )

    return on_root(comm, make)


def build(
    case: Case,
    which: Which,
    mesh: Path,
    comm: Any = MPI.COMM_WORLD,
    *,
    loads: Sequence[Any] = (),
) -> dj.Model:
    """Return the dam as a monolith ("linear") or cut at its joints ("joints") (collective).

    Args:
        case: The case.
        which: ``linear`` or ``joints``.
        mesh: Mesh file of `make_mesh`.
        comm: MPI communicator of the mesh.
        loads: Loads in addition to self weight.
    """
    check_kind_of("which", which, which in get_args(Which), " or ".join(get_args(Which)))
    cut = which == "joints"
    jointed = dj.read_msh(mesh, comm, joints=None if cut else [])
    return dj.Model(
        jointed,
        material=CONCRETE,
        joints=dj.Joints(
            case.law() if cut else None,
            initial_gaps=dict.fromkeys(jointed.joint_names, case.gap) if case.gap else None,
        ),
        supports=list(SUPPORTS),
        loads=[dj.Gravity(), *loads],
        damping=DAMPING,
    )


@dataclass(frozen=True, kw_only=True)
class Finished:
    """Completed run.

    Attributes:
        results: The results file.
        outcome: Outcome of the dynamic stage.
        report: Final report as text.
    """

    results: Path
    outcome: Outcome
    report: str


def simulate(
    case: Case,
    which: Which,
    model: dj.Model,
    folder: str | Path,
    *,
    solver: str = "auto",
    envelopes: bool = False,
    monitors: Sequence[Any] = (),
) -> Finished:
    """Run the static loads in four steps, then the earthquake (collective).

    Args:
        case: The case.
        which: Name of the results file, ``linear.h5`` or ``joints.h5``; replaced.
        model: Model of `build`.
        folder: Output folder.
        solver: Solver of the time steps.
        envelopes: Whether to record envelopes of stresses.
        monitors: Further monitors.
    """
    comm = model.jointed.mesh.comm
    motion = on_root(comm, lambda: make_motion(case))
    cells = model.jointed.mesh.topology.index_map(model.jointed.mesh.topology.dim).size_global
    facts = {"case": "ambiesta", "run": which, **asdict(case), "rotate": case.turn}
    results = Path(folder) / f"{which}.h5"
    recorded = dj.ResultsMonitor(
        results,
        points=case.points(),
        every=STATE_INTERVAL,
        metadata={**facts, "record": motion.name, "cells": cells},
        overwrite=True,
        envelopes=envelopes,
    )
    simulation = dj.Simulation(model, monitors=[recorded, *monitors], solver=solver)
    if case.self_weight == "grouted":
        weight = [load for load in model.loads if isinstance(load, dj.Gravity)]
        simulation.statics(joints="inactive", loads=weight)
        simulation.grout(gap=case.gap)
    simulation.statics(steps=LOAD_STEPS)
    outcome = simulation.dynamics(
        dt=case.time_step, steps=case.steps, motion=motion, scheme=SCHEMES[case.scheme]
    )
    return Finished(results=results, outcome=outcome, report=simulation.report(outcome))


def run(case: Case, which: Which, folder: str | Path, *, envelopes: bool = False) -> Path:
    """Mesh, build and simulate a case; return the path of the results file (collective)."""
    model = build(case, which, make_mesh(case, folder))
    finished = simulate(case, which, model, folder, envelopes=envelopes)
    if MPI.COMM_WORLD.rank == 0:
        print(finished.report, flush=True)
    return finished.results


def study_row(
    folder: Path, *, run_as: Which, envelopes: bool = False, keep: bool = True, **numbers: Any
) -> dict[str, Any]:
    """Run a case of a study; return the measures of its response.

    Args:
        folder: Output folder.
        run_as: ``linear`` or ``joints``.
        envelopes: Whether to record envelopes of stresses.
        keep: Whether to keep the results file.
        numbers: Parameters of `Case`.
    """
    case = Case(**numbers)
    path = run(case, run_as, folder, envelopes=envelopes)
    with dj.Results(path) as results:
        measured = summary_row(results)
        facts = {name: results.metadata[name] for name in ("dofs", "cells", "joint_points")}
    if not keep:
        path.unlink()
    return {name: v for name, v in {**facts, **measured}.items() if name not in numbers}


def parameters(case: Case, which: Which, **options: Any) -> dict[str, Any]:
    """Return the arguments that a study passes to `study_row`."""
    return {"run_as": which, **options, **asdict(case)}
