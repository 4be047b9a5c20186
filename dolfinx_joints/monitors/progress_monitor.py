# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that shows a progress bar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dolfinx_joints.common.declared import checked
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record


@dataclass(eq=False)
@checked
class ProgressMonitor(Monitor):
    """Progress bar on rank 0: remaining time, Newton iterations, open and sliding points.

    Args:
        label: Text before the bar.
    """

    label: str = "dynamic"

    def __post_init__(self) -> None:
        self._bar: Any = None

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Show the bar."""
        if model.jointed.mesh.comm.rank == 0:
            from tqdm.auto import tqdm

            self._bar = tqdm(
                total=steps, initial=first.step, desc=self.label, unit="step", mininterval=1.0
            )

    def record(self, record: Record) -> None:
        """Advance the bar."""
        if self._bar is None or record.step == 0 or record.solve is None:
            return
        counts, text = record.solve.counts, f"{record.solve.iterations} it"
        if counts is not None and counts.total:
            opened, sliding = counts.open / counts.total, counts.slip / counts.total
            text += f", {100 * opened:.0f} % open, {100 * sliding:.0f} % sliding"
            if counts.frictionless:
                text += f", {100 * counts.frictionless / counts.total:.0f} % without friction"
        self._bar.set_postfix_str(text, refresh=False)
        self._bar.update(1)

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()
