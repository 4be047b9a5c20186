# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of joint points by what they do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class StatusCounts:
    """Joint points by what they do, as `Status` says, on all ranks."""

    open: int
    stick: int
    slip: int
    frictionless: int = 0
    tied: int = 0

    @property
    def total(self) -> int:
        """Number of points that can open or slide: all but tied ones."""
        return self.open + self.stick + self.slip + self.frictionless
