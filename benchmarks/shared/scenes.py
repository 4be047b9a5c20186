# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Jointed wall and arch dam as scenes: mesh, loads and ground motion."""

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
# Start of the strong motion of the dam; runs with fewer steps begin here [s].
STRONG_START = 3.0


Wall = tuple[tuple[int, int, int], int]  # cells along x, y, z; number of joints


@contextmanager
def mesh_file(write: Callable[[Path], object]) -> Iterator[Path]:
    """Write a mesh file that exists within the context (collective)."""
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
    """Body with joints, its loads and its ground motion.

    Attributes:
        name: Name in tables and JSON.
        write: Function that writes the mesh to a path.
        material: Material of the body.
        fixed: Facet groups that are fixed.
        loads: Static loads, which remain during the motion.
        shear_ratio: k_s / k_n of the joints.
        load_steps: Steps of the static stage.
        shaking: Function that returns the ground acceleration for the duration of a run [s].
        crest: Point whose peaks are reported [m].
        friction_angle: Friction angle of the joints [degrees].
        onset: Time until the motion is strong [s].
        tied_peaks_mm: Known peaks without joints in `TIED_STEPS` steps, or None.
    """

    name: str
    write: Callable[[Path], object]
    material: dj.Elastic
    fixed: Sequence[str]
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
        """Return a ground acceleration of ``length`` [s] that is strong from the first step."""
        shaking = self.shaking(self.onset + length)
        return lambda time: shaking(self.onset + time)

    def law(self, stiffness: float = 1e11, angle: float | None = None) -> Law:
        """Return a law with k_n [Pa/m] and angle [degrees]; a rigid one for infinite k_n."""
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
        """Read the mesh, split at the joints unless they are tied (collective)."""
        return dj.read_msh(path, comm, joints=[] if tied else None)

    def model(self, jointed: dj.JointedMesh, law: Law | None, **options: Any) -> dj.Model:
        """Return the model with a law for all joints, or without joints (collective).

        ``options`` are those of `Model`.
        """
        options.setdefault("damping", dj.stiffness_proportional(ratio=0.02, frequency=5.0))
        return dj.Model(
            jointed,
            material=self.material,
            joints=law,
            supports=[dj.Fixed(group=name) for name in self.fixed],
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
    """Return the sum of the sines of each axis with its onset, unscaled."""
    onset = np.sin(0.5 * np.pi * time / ONSET) ** 2 if time < ONSET else 1.0
    return onset * np.sin(2 * np.pi * FREQUENCIES * time + PHASES).sum(axis=1)


SCALE = PEAKS / np.abs([_sines(i * TIME_STEP) for i in range(TIED_STEPS + 1)]).max(axis=0)


def ground_acceleration(time: float) -> np.ndarray:
    """Return the acceleration of the wall's base (x, y, z) [m/s^2]."""
    return SCALE * _sines(time)


def wall(
    mesh: str = "coarse",
    *,
    pressure: float = 0.0,
    divisions: Sequence[int] | None = None,
    joints: int = 3,
) -> Scene:
    """Return a wall of 20 x 4 x 20 m on a fixed base, cut by vertical joints.

    Args:
        mesh: Name in `DIVISIONS`.
        pressure: Pressure on both end faces that closes the joints [MPa].
        divisions: Cells along x, y and z instead of a named mesh.
        joints: Number of joints.
    """
    squeezed = [dj.Pressure(group=g, value=1e6 * pressure) for g in ("x_min", "x_max")]
    cells = divisions or DIVISIONS[mesh]
    return Scene(
        name=f"{mesh} {pressure:g} MPa" if pressure else mesh,
        write=lambda path: jointed_wall(path, divisions=cells, joints=joints),
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        fixed=["base"],
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

    A separate process writes the file, because Gmsh does not free its memory.
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
    """Return demo 03's motion from its strong part on, or earlier if it is too short for that."""
    motion = dj.synthetic_motion().resampled(TIME_STEP)
    length += 2.0 * TIME_STEP  # trimmed moves bounds between samples inwards
    start = max(0.0, min(STRONG_START, motion.duration - length))
    return motion.trimmed(min(length, motion.duration - start), start=start)


def dam(name: str = "dam") -> Scene:
    """Return the dam of demo 03 (`DAM_SIZES`) with its synthetic motion."""
    return Scene(
        name=name,
        write=lambda path: ambiesta(path, **DAM_SIZES[name]),
        material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
        fixed=["base", "abutments"],
        loads=[dj.Gravity()],
        shear_ratio=0.4,
        load_steps=4,
        shaking=_synthetic,
        crest=mid_crest(),
    )
