# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints of dynamic stages, and restart from them.

Nodal vectors are stored in the node order of the input mesh, arrays of nonlinear cells in its cell
order, and joint arrays in the global order of the points. The number of ranks may therefore change
at a restart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, fields, is_dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Dealt
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import CheckpointError, OtherRunError, warn
from dolfinx_joints.common.files import FileLock
from dolfinx_joints.common.mpi import dealt, handing_out, on_root, raised_together, rows_at
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.loads.load import Load
from dolfinx_joints.materials.bulk_law import BulkState
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.dynamic_stage import DynamicRun
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import StageRecord
from dolfinx_joints.time_integration.states import DynamicState

_MOST_NAMED = 5  # Largest number of values named in a warning.


@dataclass(frozen=True, kw_only=True)
class Saved:
    """Content of a checkpoint: the state of a `DynamicRun`, and the static state before it."""

    state: DynamicState
    origin: PETSc.Vec
    static: StaticState | None
    state_dict: dict[str, Any]


@dataclass(eq=False)
@checked
class Checkpoints:
    """File and interval of the checkpoints of a dynamic stage.

    The first checkpoint is written before the first step, so that static stages are never lost.

    Args:
        path: Path of the file; a checkpoint replaces the previous one in a single operation.
        every: Steps between two checkpoints.
        overwrite: Let a new run replace an existing checkpoint.
        resume: Continue from the checkpoint in the file.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> stage = {"dt": 0.01, "steps": 10, "motion": lambda t: (1.0, 0.0, 0.0)}
        >>> kept = dj.Checkpoints("run.ckpt", every=5)
        >>> outcome = dj.Simulation(model).dynamics(**stage, checkpoint=kept)
        >>> kept = dj.Checkpoints("run.ckpt", every=5, resume=True)  # as after a crash
        >>> round(dj.Simulation(model).dynamics(**stage, checkpoint=kept).state.time, 6)  # [s]
        0.1
    """

    path: str | PathLike[str]
    _: KW_ONLY
    every: Annotated[int, at.Ge(1)] = 100
    overwrite: bool = False
    resume: bool = False

    def __post_init__(self) -> None:
        """Check the path; the file is written when the dynamic stage starts."""
        self.file = Path(self.path)
        self._lock: FileLock | None = None

    @property
    def found(self) -> bool:
        """True if the file exists."""
        return self.file.exists()

    def check(self, comm: Any) -> None:
        """Check that no checkpoint would be overwritten, and lock the file (collective).

        Until `release` no other run can write the checkpoint or continue from it.
        """
        begins = not (self.resume or self.overwrite)
        if begins and on_root(comm, lambda: self.found):
            raise CheckpointError(
                f"The checkpoint {self.path} exists; pass resume=True to Checkpoints to continue "
                "from it, or overwrite=True to start a new run."
            )

        def lock() -> None:
            self._lock = FileLock(self.file, CheckpointError)

        on_root(comm, lock)

    def release(self) -> None:
        """Unlock the file."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None


class CheckpointKeeper:
    """Writes and reads the checkpoints of one run, which is identified by its `fingerprint`."""

    def __init__(
        self,
        checkpoints: Checkpoints,
        model: Model,
        system: MatrixSystem,
        settings: Mapping[str, Any],
        loads: Sequence[Load],
        times: NDArray[np.float64],
    ) -> None:
        """Compute the fingerprint of the run (collective)."""
        self._path, self._every = checkpoints.file, checkpoints.every
        self._model, self._comm = model, model.jointed.mesh.comm
        from dolfinx_joints.simulation.fingerprint import fingerprint

        self._nodes = NodeNumbering(model.V)
        # Types of states with nonlinear cells, and types with one row per point of these cells.
        self._kinds: dict[type, type] = {}
        self._by_point: tuple[type, ...] = ()
        if model.bulk is not None:
            from dolfinx_joints.body.nonlinear_cells import BodyResponse, BodyState, CellResponse

            self._kinds = {Response: BodyResponse, JointState: BodyState}
            self._by_point = (BulkState, CellResponse)
            self._points = model.bulk.operator.numbers()
        facts = fingerprint(model, system, self._nodes, settings, loads, times)
        self._facts, self._unknown = facts

    def save_if_due(self, run: DynamicRun, static: StaticState | None) -> None:
        """Write a checkpoint if one is due after this step (collective)."""
        if run.step % self._every:
            return
        from dolfinx_joints.simulation.checkpoint_file import write_checkpoint

        tree = {
            "run": self._facts,
            "monitors": [type(monitor).__name__ for monitor in run.monitors],
            "state_dict": run.state_dict(),
            "state": self._tree(run.state),
            "origin": self._tree(run.origin),
            "static": self._tree(static),
        }
        with handing_out(self._comm, tree):
            if self._comm.rank == 0:
                write_checkpoint(self._path, tree)

    def save_static(self, static: StaticState, stages: Sequence[StageRecord]) -> None:
        """Write a static state and the stages so far, without a dynamic state (collective)."""
        from dolfinx_joints.simulation.checkpoint_file import write_checkpoint

        tree = {"run": self._facts, "static": self._tree(static), "stages": self._tree([*stages])}
        with handing_out(self._comm, tree):
            if self._comm.rank == 0:
                with FileLock(self._path, CheckpointError):
                    write_checkpoint(self._path, tree)

    def load_static(self) -> tuple[StaticState, list[StageRecord]]:
        """Return the state and the stages written by `save_static` (collective)."""
        tree = self._read(("run", "static", "stages"))
        stored = tree["static"], tree["stages"]
        return self._restore(StaticState, stored[0]), self._restore(list[StageRecord], stored[1])

    def load(self, monitors: Sequence[Any]) -> Saved:
        """Return the content of the last checkpoint (collective)."""
        names = [type(monitor).__name__ for monitor in monitors]
        parts = ("run", "monitors", *(f.name for f in fields(Saved)))
        saved: Saved = self._restore(Saved, self._read(parts, monitors=str(names)))
        return saved

    def _read(self, names: Sequence[str], **facts: str) -> dict[str, Any]:
        """Return the tree of the file; check that the file belongs to this run (collective)."""
        from dolfinx_joints.simulation.checkpoint_file import read_checkpoint
        from dolfinx_joints.simulation.fingerprint import first_difference

        comm, tree = self._comm, dict[str, Any]()
        for first in (True, False):  # Rank 0 reads first and checks that the file is complete.
            with raised_together(comm):
                if (comm.rank == 0) == first:
                    tree = read_checkpoint(self._path, names, rank=comm.rank, ranks=comm.size)

        def compare() -> None:
            saved = {**tree["run"], **{name: str(tree[name]) for name in facts}}
            difference = first_difference(saved, {**self._facts, **facts})
            if difference is not None:
                raise OtherRunError(
                    f"The checkpoint {self._path} belongs to another model or run, "
                    f"or to another version of the package; {difference}."
                )
            if self._unknown:
                omitted = len(self._unknown) - _MOST_NAMED
                named = "; ".join(self._unknown[:_MOST_NAMED])
                warn(
                    f"Continuing from {self._path}: this program cannot detect changes of "
                    f"{named}{f'; and of {omitted} more' if omitted > 0 else ''}."
                )

        on_root(comm, compare)
        return tree

    def _tree(self, value: Any) -> Any:
        """Return a state, response or vector as a tree of arrays by rank (collective)."""
        if isinstance(value, PETSc.Vec):
            coupled = self._model.coupled
            if coupled is not None and coupled.has_water(value):
                water = Dealt(self._comm, coupled.of_water(value))
                return {"body": self._tree(coupled.body(value)), "water": water}
            return Dealt(self._comm, self._nodes.dealt(value)[:, : self._model.gdim])
        if isinstance(value, np.ndarray):
            return Dealt(self._comm, value)
        if isinstance(value, self._by_point):
            to_blocks = partial(dealt, self._comm, sum(self._comm.allgather(len(self._points))))
            parts = vars(value).items()
            return {n: Dealt(self._comm, to_blocks(self._points, rows)) for n, rows in parts}
        if isinstance(value, DynamicState | Response | JointState | StaticState | StageRecord):
            return {f.name: self._tree(getattr(value, f.name)) for f in fields(value)}
        if is_dataclass(value) and not isinstance(value, type):
            return asdict(value)  # Numbers of the whole model, equal on all ranks.
        if isinstance(value, list):
            return {str(i): self._tree(item) for i, item in enumerate(value)}
        if isinstance(value, Mapping):
            return {name: self._tree(item) for name, item in value.items()}
        return value

    def _restore(self, kind: Any, tree: Any) -> Any:
        """Return the object of a type from the tree of `_tree` (collective)."""
        if tree is None:
            return None
        types = get_args(kind)
        if get_origin(kind) is UnionType:  # A type or None.
            return self._restore(types[0], tree)
        if kind is PETSc.Vec:
            return self._vector(tree)
        if kind in self._by_point:
            return kind(**{n: rows_at(self._comm, r, self._points) for n, r in tree.items()})
        kind = self._kinds.get(kind, kind)
        if is_dataclass(kind):
            hints = get_type_hints(kind)
            parts = {f.name: self._restore(hints[f.name], tree[f.name]) for f in fields(kind)}
            return kind(**parts)  # type: ignore[operator]
        if get_origin(kind) is list:
            return [self._restore(types[0], tree[str(i)]) for i in range(len(tree))]
        if get_origin(kind) is tuple:
            return tuple(tree)
        if get_origin(kind) is Mapping:
            return {name: self._restore(types[1], item) for name, item in tree.items()}
        return tree

    def _vector(self, values: Any) -> PETSc.Vec:
        """Return a vector, including water, from this rank's part of the stored values."""
        if isinstance(values, dict):
            coupled = self._model.coupled
            assert coupled is not None
            return coupled.joined(self._vector(values["body"]), values["water"])
        vector = self._model.stiffness.createVecRight()
        vector.setArray(self._nodes.own(values).ravel())
        return vector


def static_keeper(path: str | Path, model: Model) -> CheckpointKeeper:
    """Return the object that writes and reads static states of a model (collective)."""
    return CheckpointKeeper(Checkpoints(path), model, model.system(), {}, (), np.zeros(1))
