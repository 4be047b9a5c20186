# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The jointed wall and the arch dam as scenes: what is meshed, loaded and shaken."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.geometry.arch import mid_crest
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.laws.law import Law

Acceleration = Callable[[float], np.ndarray]

TIME_STEP = 0.00488
DIVISIONS = {"tiny": (8, 2, 8), "coarse": (20, 4, 20), "medium": (40, 8, 40)}
# Crest peaks (x, y, z) of the tied wall in 200 steps [mm], node at x = 10, mid thickness, top.
TIED_PEAKS = {"coarse": (0.48662, 28.5432, 0.060020), "medium": (0.48805, 29.3562, 0.060061)}
TIED_STEPS = 200
DAM_SIZES: dict[str, dict[str, Any]] = {
    "dam tiny": {"size": 12.0, "order": 1},
    "dam": {"size": 5.5},
    "dam middle": {"size": 4.2},
    "dam fine": {"size": 3.0, "layers": 2},
}
DAM_STEPS = 2288
# Where the motion of the dam is strong: where runs of fewer steps begin [s].
STRONG_START = 3.0


Wall = tuple[tuple[int, int, int], int]  # cells along x, y, z; number of joints


@contextmanager
def mesh_file(write: Callable[[Path], object]) -> Iterator[Path]:
    """Write a mesh file that exists as long as the context lasts (collective)."""
    comm = MPI.COMM_WORLD
    with TemporaryDirectory() as folder:
        path = Path(comm.bcast(folder)) / "scene.msh"
        on_root(comm, lambda: write(path))
        yield path
        comm.barrier()


def mesh_of(write: Callable[..., object], **options: Any) -> dj.JointedMesh:
    """Return the mesh that ``write(path, **options)`` writes to a file (collective)."""
    with mesh_file(lambda path: write(path, **options)) as path:
        return dj.read_msh(path, MPI.COMM_WORLD)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A body with joints, its loads and its shaking.

    Attributes:
        name: As in tables and JSON.
        write: Writes the mesh to a path.
        material: Of the body.
        held: Facet groups that are clamped.
        loads: Static loads, held through the motion.
        shear_ratio: k_s / k_n of the joints.
        load_steps: Steps of the static stage.
        shaking: Ground acceleration, given how long the run is to last [s].
        crest: Point whose peaks are reported [m].
        friction_angle: Of the joints [degrees].
        onset: How long it takes to become strong [s].
        tied_peaks_mm: What these are without joints in `TIED_STEPS` steps, where others know it.
    """

    name: str
    write: Callable[[Path], object]
    material: dj.Elastic
    held: Sequence[str]
    loads: Sequence[Any]
    shear_ratio: float
    load_steps: int
    shaking: Callable[[float], Acceleration]
    crest: Sequence[float]
    friction_angle: float = 30.0
    onset: float = 0.0
    tied_peaks_mm: Sequence[float] | None = None

    def mesh_file(self) -> AbstractContextManager[Path]:
        """Return a context in which the mesh file exists (collective)."""
        return mesh_file(self.write)

    def strong_shaking(self, length: float) -> Acceleration:
        """Ground acceleration that is strong from the first step on, for ``length`` [s]."""
        shaking = self.shaking(self.onset + length)
        return lambda time: shaking(self.onset + time)

    def law(self, stiffness: float = 1e11, angle: float | None = None) -> Law:
        """Friction without tension, k_n in [Pa/m] and the angle in degrees; rigid if infinite."""
        angle = self.friction_angle if angle is None else angle
        if math.isinf(stiffness):
            return dj.RigidJoint(friction_angle_deg=angle, stiffness_ratio=1.0 / self.shear_ratio)
        return dj.FrictionNoTension(
            normal_stiffness=stiffness,
            shear_stiffness=self.shear_ratio * stiffness,
            friction_angle_deg=angle,
        )

    def read(
        self, path: Path, *, tied: bool = False, comm: MPI.Comm = MPI.COMM_WORLD
    ) -> dj.JointedMesh:
        """The mesh, split at the joints unless they are tied (collective)."""
        return dj.read_msh(path, comm, joints=[] if tied else None)

    def model(self, jointed: dj.JointedMesh, law: Law | None, **options: Any) -> dj.Model:
        """The assembled model, with the law of all joints or without joints (collective).

        Further options are those of `Model`.
        """
        options.setdefault("damping", dj.stiffness_proportional(ratio=0.02, frequency=5.0))
        return dj.Model(
            jointed,
            material=self.material,
            joints=law,
            supports=[dj.Fixed(group=name) for name in self.held],
            loads=list(self.loads),
            **options,
        )


# ---------------------------------------------------------------- jointed wall

GRAVITY = 9.81
ONSET = 0.2  # [s]
FREQUENCIES = np.array([[2.3, 4.1, 6.7], [2.9, 5.2, 7.4], [3.1, 5.9, 7.9]])
PHASES = np.array([[0.0, 1.1, 2.3], [0.7, 2.0, 0.4], [1.9, 0.3, 2.8]])
PEAKS = np.array([0.4, 0.4, 0.3]) * GRAVITY


def _sines(time: float) -> np.ndarray:
    """Sum of the sines of each axis with its onset, not yet scaled."""
    onset = np.sin(0.5 * np.pi * time / ONSET) ** 2 if time < ONSET else 1.0
    return onset * np.sin(2 * np.pi * FREQUENCIES * time + PHASES).sum(axis=1)


SCALE = PEAKS / np.abs([_sines(i * TIME_STEP) for i in range(TIED_STEPS + 1)]).max(axis=0)


def ground_acceleration(time: float) -> np.ndarray:
    """Acceleration of the wall's base (x, y, z) [m/s^2]."""
    return SCALE * _sines(time)


def wall(
    mesh: str = "coarse",
    *,
    pressure: float = 0.0,
    divisions: Sequence[int] | None = None,
    joints: int = 3,
) -> Scene:
    """20 x 4 x 20 m on a clamped base, cut by vertical joints.

    Args:
        mesh: Name in `DIVISIONS`.
        pressure: On both end faces, closing the joints [MPa].
        divisions: Cells along x, y and z instead of a named mesh.
        joints: Number of joints.
    """
    squeezed = [dj.Pressure(group=g, value=1e6 * pressure) for g in ("x_min", "x_max")]
    cells = divisions or DIVISIONS[mesh]
    return Scene(
        name=f"{mesh} {pressure:g} MPa" if pressure else mesh,
        write=lambda path: jointed_wall(path, divisions=cells, joints=joints),
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        held=["base"],
        loads=[
            dj.Gravity(acceleration=(0.0, 0.0, -GRAVITY)),
            *(squeezed if pressure else []),
        ],
        shear_ratio=1.0,
        load_steps=1,
        shaking=lambda _: ground_acceleration,
        onset=ONSET,
        crest=(10.0, 2.0, 20.0),
        tied_peaks_mm=None if divisions else TIED_PEAKS.get(mesh),
    )


def wall_file(wall: Wall) -> AbstractContextManager[Path]:
    """Return a context with the mesh file of a wall (collective).

    Gmsh would keep its memory, so a process of its own writes the file.
    """
    divisions, joints = wall
    program = Path(__file__).resolve().parents[2] / "geometry/jointed_wall.py"
    command = [sys.executable, str(program), "--joints", str(joints)]
    command += ["--divisions", *map(str, divisions), "--out"]
    return mesh_file(
        lambda path: subprocess.run([*command, str(path)], check=True, stdout=subprocess.DEVNULL)
    )


# ---------------------------------------------------------------- arch dam


def _synthetic(length: float) -> Acceleration:
    """The motion of demo 03 from where it is strong, or as late as it must begin to last."""
    motion = dj.synthetic_motion().resampled(TIME_STEP)
    length += 2.0 * TIME_STEP  # bounds between two samples are moved inwards
    start = max(0.0, min(STRONG_START, motion.duration - length))
    return motion.trimmed(min(length, motion.duration - start), start=start)


def dam(name: str = "dam") -> Scene:
    """The dam of demo 03 (`DAM_SIZES`), shaken by its synthetic motion."""
    return Scene(
        name=name,
        write=lambda path: ambiesta(path, **DAM_SIZES[name]),
        material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
        held=["base", "abutments"],
        loads=[dj.Gravity()],
        shear_ratio=0.4,
        load_steps=4,
        shaking=_synthetic,
        crest=mid_crest(),
    )
