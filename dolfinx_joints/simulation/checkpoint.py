# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic stages kept on the disk as they go, and continued from there.

Nodal vectors are stored in the order of the input mesh's nodes and joint arrays in the global order
of the points, so that a run can go on with another number of ranks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Dealt
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import CheckpointError, OtherRunError, warn
from dolfinx_joints.common.files import FileLock
from dolfinx_joints.common.mpi import handing_out, on_root, raised_together
from dolfinx_joints.laws.law import JointState, Response, StatusCounts
from dolfinx_joints.loads.load import Load
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.dynamic_stage import DynamicRun
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import StageRecord
from dolfinx_joints.simulation.static_energy import Jump, StaticEnergy
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.states import DynamicState

if TYPE_CHECKING:
    from dolfinx_joints.simulation.checkpoint_file import Tree

_MOST_NAMED = 5  # values in a warning

# Parts of every checkpoint.
PARTS = ("run", "monitors", "state_dict", "state", "origin", "static")

# Numbers of a state besides its time.
_NUMBERS = ("exact_modes", "rate")


@dataclass(frozen=True, kw_only=True)
class _Saved:
    """Content of a checkpoint: what `DynamicRun` goes on from, and its static state."""

    state: DynamicState
    origin: PETSc.Vec
    static: StaticState | None
    state_dict: Tree


@dataclass(eq=False)
@checked
class Checkpoints:
    """Where and how often a dynamic stage is kept on the disk.

    The first checkpoint is written before the first step, so that statics are never lost.

    Args:
        path: The file; each checkpoint replaces the one before it at once.
        every: Steps between two checkpoints.
        overwrite: Let a new run replace a checkpoint that is there already.
        resume: Go on from the checkpoint in the file.
    """

    path: str | PathLike[str]
    _: KW_ONLY
    every: Annotated[int, at.Ge(1)] = 100
    overwrite: bool = False
    resume: bool = False

    def __post_init__(self) -> None:
        """Keep the settings; files are written from the start of the run on."""
        self.file = Path(self.path)
        self._lock: FileLock | None = None

    @property
    def found(self) -> bool:
        """Whether there is a checkpoint to go on from."""
        return self.file.exists()

    def check(self, comm: Any) -> None:
        """Check early that no checkpoint would be lost, and lock the file (collective).

        From here to `release` no other run may write the checkpoint or go on from it.
        """
        begins = not (self.resume or self.overwrite)
        if begins and on_root(comm, lambda: self.found):
            raise CheckpointError(
                f"The checkpoint {self.path} exists; pass resume=True to Checkpoints to go on from "
                "it, or overwrite=True to begin anew."
            )

        def lock() -> None:
            self._lock = FileLock(self.file, CheckpointError)

        on_root(comm, lock)

    def release(self) -> None:
        """Let other runs write the checkpoint."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None


class CheckpointKeeper:
    """Writes and reads the checkpoints of one run, known by its `fingerprint`."""

    def __init__(
        self,
        checkpoints: Checkpoints,
        model: Model,
        system: MatrixSystem,
        settings: Mapping[str, Any],
        loads: Sequence[Load],
        times: NDArray[np.float64],
    ) -> None:
        """Find the facts of the run (collective)."""
        if model.bulk is not None:
            raise CheckpointError(
                "Checkpoints do not hold the state of plastic cells; run this model without them."
            )
        self._path, self._every = checkpoints.file, checkpoints.every
        self._model, self._comm = model, model.jointed.mesh.comm
        from dolfinx_joints.simulation.fingerprint import fingerprint

        self._nodes = NodeNumbering(model.V)
        facts = fingerprint(model, system, self._nodes, settings, loads, times)
        self._facts, self._unknown = facts

    def save_if_due(self, run: DynamicRun, static: StaticState | None) -> None:
        """Write a checkpoint every so many steps (collective)."""
        if run.step % self._every:
            return
        from dolfinx_joints.simulation.checkpoint_file import write_checkpoint

        tree = {
            "run": self._facts,
            "monitors": [type(monitor).__name__ for monitor in run.monitors],
            "state_dict": run.state_dict(),
            "state": self._kept(run.state),
            "origin": self._kept(run.origin),
            "static": self._kept(static),
        }
        with handing_out(self._comm, tree):
            if self._comm.rank == 0:
                write_checkpoint(self._path, tree)

    def save_static(self, static: StaticState, stages: Sequence[StageRecord]) -> None:
        """Write a static state and the stages that led there alone (collective)."""
        from dolfinx_joints.simulation.checkpoint_file import write_checkpoint

        tree = {"run": self._facts, "static": self._kept(static)}
        tree["stages"] = {str(i): self._kept(stage) for i, stage in enumerate(stages)}
        with handing_out(self._comm, tree):
            if self._comm.rank == 0:
                with FileLock(self._path, CheckpointError):
                    write_checkpoint(self._path, tree)

    def load_static(self) -> tuple[StaticState, list[StageRecord]]:
        """State and stages that `save_static` wrote (collective)."""
        tree = self._read(("run", "static", "stages"))
        kept = tree["stages"]
        return self._static(tree["static"]), [self._stage(kept[str(i)]) for i in range(len(kept))]

    def load(self, monitors: Sequence[Any]) -> _Saved:
        """Content of the last checkpoint (collective)."""
        names = [type(monitor).__name__ for monitor in monitors]
        tree = self._read(PARTS, monitors=str(names))
        static = tree["static"]
        return _Saved(
            state=self._state(tree["state"]),
            origin=self._vector(tree["origin"]),
            static=None if static is None else self._static(static),
            state_dict=tree["state_dict"],
        )

    def _read(self, names: Sequence[str], **facts: str) -> Tree:
        """The tree of the file, if it is of this run (collective)."""
        from dolfinx_joints.simulation.checkpoint_file import read_checkpoint
        from dolfinx_joints.simulation.fingerprint import first_difference

        comm, tree = self._comm, {}
        for first in (True, False):  # only the first checks that the file is whole
            with raised_together(comm):
                if (comm.rank == 0) == first:
                    tree = read_checkpoint(self._path, names, rank=comm.rank, ranks=comm.size)

        def compare() -> None:
            saved = {**tree["run"], **{name: str(tree[name]) for name in facts}}
            difference = first_difference(saved, {**self._facts, **facts})
            if difference is not None:
                raise OtherRunError(
                    f"The checkpoint {self._path} is of another model or run; {difference}."
                )
            if self._unknown:
                more = len(self._unknown) - _MOST_NAMED
                named = "; ".join(self._unknown[:_MOST_NAMED])
                warn(
                    f"Going on from {self._path}: whether it was written with the same values "
                    f"cannot be told of {named}{f'; and {more} more' if more > 0 else ''}."
                )

        on_root(comm, compare)
        return tree

    def _kept(self, thing: Any) -> Any:
        """A state, response or vector as a tree of dealt arrays (collective)."""
        if isinstance(thing, PETSc.Vec):
            coupled = self._model.coupled
            if coupled is not None and coupled.has_water(thing):
                water = Dealt(self._comm, coupled.of_water(thing))
                return {"body": self._kept(coupled.body(thing)), "water": water}
            return Dealt(self._comm, self._nodes.dealt(thing)[:, : self._model.gdim])
        if isinstance(thing, np.ndarray):
            return Dealt(self._comm, thing)
        if isinstance(thing, StaticEnergy):
            return asdict(thing)
        if isinstance(thing, DynamicState | Response | JointState | StaticState | StageRecord):
            return {f.name: self._kept(getattr(thing, f.name)) for f in fields(thing)}
        if isinstance(thing, Mapping):
            return {name: self._kept(each) for name, each in thing.items()}
        if isinstance(thing, list):
            return {str(i): asdict(each) for i, each in enumerate(thing)}
        return thing

    def _vector(self, values: NDArray[np.float64] | Tree) -> PETSc.Vec:
        """A vector from the rank's part of what is stored, the water's with it (collective)."""
        if isinstance(values, dict):
            coupled = self._model.coupled
            assert coupled is not None
            return coupled.joined(self._vector(values["body"]), values["water"])
        vector = self._model.stiffness.createVecRight()
        vector.setArray(self._nodes.own(values).ravel())
        return vector

    def _state(self, tree: Tree) -> DynamicState:
        vectors = {
            name: self._vector(value)
            for name, value in tree.items()
            if name not in ("time", "joints", "water", *_NUMBERS) and value is not None
        }
        numbers = {name: tree[name] for name in _NUMBERS}
        return DynamicState(
            time=tree["time"],
            joints=self._response(tree["joints"]),
            water=tree["water"],
            **numbers,
            **vectors,
        )

    def _static(self, tree: Tree) -> StaticState:
        reports = []
        for i in range(len(tree["reports"])):
            report = tree["reports"][str(i)]
            counts = report["counts"]
            counts = None if counts is None else StatusCounts(**counts)
            residuals = tuple(report["residuals"])
            reports.append(SolveReport(**{**report, "counts": counts, "residuals": residuals}))
        return StaticState(
            displacement=self._vector(tree["displacement"]),
            joints=self._response(tree["joints"]),
            reaction=self._vector(tree["reaction"]),
            reports=reports,
            inactive=tuple(tree["inactive"]),
            absent=tuple(tree["absent"]),
            missing=tuple(tree["missing"]),
            cuts=tree["cuts"],
            energy=StaticEnergy(**tree["energy"]),
            loads={name: self._vector(load) for name, load in tree["loads"].items()},
            jumps=[Jump(**{**j, "joints": tuple(j["joints"])}) for j in tree["jumps"].values()],
        )

    def _stage(self, tree: Tree) -> StageRecord:
        return StageRecord(
            name=tree["name"],
            time=tree["time"],
            state=self._static(tree["state"]),
            loads=tuple(tree["loads"]),
            pressure=tree["pressure"],
        )

    def _response(self, tree: Tree | None) -> Response | None:
        """The response of the rank's joint points."""
        return None if tree is None else Response(**{**tree, "state": JointState(**tree["state"])})


def static_keeper(path: str | Path, model: Model) -> CheckpointKeeper:
    """Writer and reader of a static state of a model (collective)."""
    return CheckpointKeeper(Checkpoints(path), model, model.system(), {}, (), np.zeros(1))
