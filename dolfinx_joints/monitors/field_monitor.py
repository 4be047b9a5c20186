# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that writes fields for ParaView."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.file_lock import FileLock, released
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord


@dataclass(eq=False)
@checked
class FieldMonitor(Monitor):
    """Writes the displacement for ParaView (VTX, folder ``*.bp``), joints opened.

    Each static stage has a folder of its own, ``NAME_NUMBER_STAGE.bp`` beside that of the dynamic
    one, such as ``run_2_grouting_1.bp``, with the stage's number as its time.

    A continued run writes a folder of its own, ``NAME_from_STEP.bp`` beside the first, since such
    folders cannot be opened again; the times of the first after that step are there twice.

    Args:
        path: The folder; what an earlier run left there is replaced.
        every: Steps between two times.
    """

    path: str | PathLike[str]
    _: KW_ONLY
    every: Annotated[int, at.Ge(1)] = 10

    def __post_init__(self) -> None:
        """Keep the settings; files are written from the start of the run on."""
        self._path = Path(self.path)
        self._lock: FileLock | None = None

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Write a folder of the stage (collective)."""
        plain = re.sub(r"[^\w.+-]", "_", stages[-1].name)
        name = f"{self._path.stem}_{len(stages)}_{plain}{self._path.suffix}"
        self._open(self._path.with_name(name), model, stages[-1].state.displacement)
        with released(self._lock, at_end=True):
            self._writer.write(len(stages))
            self._writer.close()

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the folder and write the first time (collective)."""
        self._open(self._path, model, first.displacement)
        with released(self._lock, at_end=False):
            self.record(first)

    def _open(self, path: Path, model: Model, displacement: PETSc.Vec) -> None:
        """Create a folder that no other run writes (collective)."""
        from dolfinx.io import VTXWriter

        def take() -> None:
            """Find out on one rank what would leave the others waiting in the writer."""
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ResultsError(f"{path} cannot be written: {error}.") from None
            self._lock = FileLock(path, ResultsError)

        on_root(model.jointed.mesh.comm, take)
        with released(self._lock, at_end=False):
            self._u = model.function(displacement)
            self._writer = VTXWriter(model.jointed.mesh.comm, path, [self._u])

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Create a folder for the times after ``last`` (collective)."""
        name = f"{self._path.stem}_from_{last.step}{self._path.suffix}"
        self._open(self._path.with_name(name), model, last.displacement)

    def record(self, record: Record) -> None:
        """Append a time (collective)."""
        if record.step % self.every == 0:
            owned = record.displacement.getLocalSize()
            self._u.x.array[:owned] = record.displacement.getArray(readonly=True)
            self._u.x.scatter_forward()
            self._writer.write(record.time)

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close the folder and let others write it (collective)."""
        with released(self._lock, at_end=True):
            self._writer.close()
