# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the observers of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.mpi import OF_ERRORS, all_fail, lasting
from dolfinx_joints.time_integration.substeps import locate

if TYPE_CHECKING:
    from dolfinx_joints.model.model import Model
    from dolfinx_joints.simulation.record import Record, StageRecord
    from dolfinx_joints.simulation.statics.ledger import SolvedIncrement
    from dolfinx_joints.simulation.statics.load_increments import Increment
    from dolfinx_joints.simulation.statics.stage import Equilibrium
    from dolfinx_joints.time_integration.scheme import StepReport
    from dolfinx_joints.time_integration.states import DynamicState
    from dolfinx_joints.time_integration.substeps import Stepper


class Monitor:
    """Base class of the observers of a run; all methods are optional.

    Every method is called on all ranks. A monitor that stores values from step to step must also
    override `state_dict` and `resume`; otherwise a restarted run starts the monitor again.
    """

    def check(self, model: Model) -> None:
        """Check the model when a simulation is created; raise an error if it is not suitable."""

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Process the end of a static stage, which is the last item of ``stages``."""

    def increment(
        self, equilibrium: Equilibrium, solved: SolvedIncrement, increment: Increment
    ) -> None:
        """Process an accepted increment of a static stage, at its end (collective)."""

    def static_failure(
        self, model: Model, stages: Sequence[StageRecord], status: str, error: str
    ) -> None:
        """Process a static stage that did not complete; ``stages`` are the previous stages.

        ``status`` is ``stopped`` or ``failed``; ``error`` is the reason.
        """

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Process the start of a dynamic stage, before its first step."""

    def record(self, record: Record) -> None:
        """Process a step."""

    def substep(
        self, stepper: Stepper, before: DynamicState, after: DynamicState, report: StepReport
    ) -> None:
        """Process an accepted substep of a dynamic stage, from ``before`` to ``after``."""

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Process the end of a dynamic stage.

        ``status`` is ``complete``, ``stopped`` or ``failed``.
        """

    def state_dict(self) -> dict[str, Any]:
        """Return the data for a restart; called at each checkpoint.

        The data are arrays, or values that can be stored as JSON. The data of rank 0 are stored.
        """
        return {}

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Continue a restarted run, instead of `start`; ``last`` is the last completed step."""
        self.start(model, stage, steps, last)


_LONGEST_ERROR = 2000  # Largest number of characters.


@contextmanager
def report_failures(
    name: str, model: Model, monitors: Sequence[Monitor], stages: Sequence[StageRecord]
) -> Iterator[None]:
    """Inform the monitors if an error on all ranks ends a static stage.

    The error is raised again, with the name of the stage.
    """
    of_errors = lasting(model.jointed.mesh.comm, OF_ERRORS)
    try:
        yield
    except BaseException as error:
        ended = locate(error, name=name) if isinstance(error, ConvergenceError) else error
        if ended is error:
            error.add_note(f"In the static stage {name!r}.")
        for monitor in monitors if all_fail(of_errors, error) else ():
            try:
                monitor.static_failure(model, stages, *ending(ended))
            except Exception as failure:  # The caller must get the error that ended the stage.
                ended.add_note(f"{type(monitor).__name__} could not record this: {failure}")
        if ended is error:
            raise
        raise ended from None


def ending(error: BaseException) -> tuple[str, str]:
    """Return the status of a stage that ended with an error, and the error as text."""
    status = "failed" if isinstance(error, Exception) else "stopped"
    notes = getattr(error, "__notes__", ())
    return status, " ".join([f"{type(error).__name__}: {error}", *notes])[:_LONGEST_ERROR]
