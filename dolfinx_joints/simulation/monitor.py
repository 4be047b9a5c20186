# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the observers of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.mpi import OF_ERRORS, all_fail, lasting
from dolfinx_joints.time_integration.substeps import located

if TYPE_CHECKING:
    from dolfinx_joints.model.model import Model
    from dolfinx_joints.simulation.record import Record, StageRecord


class Monitor:
    """Base of the observers of a run, which override what they need.

    Every method is called on all ranks. A monitor that keeps values from step to step overrides
    `state_dict` and `resume` as well; without them it begins anew where a run goes on from a
    checkpoint.
    """

    def check(self, model: Model) -> None:
        """Called when a simulation is made; raises an error for what the model does not have."""

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Called after each static stage; ``stages`` are all so far, the last has just ended."""

    def static_failure(
        self, model: Model, stages: Sequence[StageRecord], status: str, error: str
    ) -> None:
        """Called where a static stage did not reach its end; ``stages`` are those before.

        ``status`` is ``stopped`` or ``failed``, ``error`` the reason.
        """

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Called before the first step of a dynamic stage."""

    def record(self, record: Record) -> None:
        """Called after each step."""

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Called at the end of a dynamic stage.

        ``status`` is ``complete``, ``stopped`` or ``failed``.
        """

    def state_dict(self) -> dict[str, Any]:
        """State to go on from, asked for at each checkpoint.

        Names to arrays and to what JSON can hold; those of rank 0 are kept.
        """
        return {}

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Called in the place of ``start``, with the last step and the state that was kept."""
        self.start(model, stage, steps, last)


_LONGEST_ERROR = 2000  # characters


@contextmanager
def failures_shown(
    name: str, model: Model, monitors: Sequence[Monitor], stages: Sequence[StageRecord]
) -> Iterator[None]:
    """Show monitors that a static stage did not reach its end, whatever ended it on all ranks.

    The error is raised with the name of the stage.
    """
    of_errors = lasting(model.jointed.mesh.comm, OF_ERRORS)
    try:
        yield
    except BaseException as error:
        ended = located(error, name=name) if isinstance(error, ConvergenceError) else error
        if ended is error:
            error.add_note(f"In the static stage {name!r}.")
        for monitor in monitors if all_fail(of_errors, error) else ():
            try:
                monitor.static_failure(model, stages, *ending(ended))
            except Exception as more:  # what ended the stage is what a caller is to catch
                ended.add_note(f"{type(monitor).__name__} could not keep this: {more}")
        if ended is error:
            raise
        raise ended from None


def ending(error: BaseException) -> tuple[str, str]:
    """Status of a stage that an error ended, and the error in words."""
    status = "failed" if isinstance(error, Exception) else "stopped"
    notes = getattr(error, "__notes__", ())
    return status, " ".join([f"{type(error).__name__}: {error}", *notes])[:_LONGEST_ERROR]
