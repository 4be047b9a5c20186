# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spatially varying ground motion: by facet groups, by stations, with wave passage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.common.summary import Rows, Summarised
from dolfinx_joints.motions.courses import displacement_of
from dolfinx_joints.motions.motion import Motion

# Largest difference between final velocities of motions, relative to the largest velocity.
DRIFT = 0.01


@dataclass(frozen=True, kw_only=True)
@checked
class Passage:
    """Wave passage along the ground: the delay at x is x.n / c, with the unit vector n.

    Attributes:
        speed: Apparent velocity c along the direction [m/s].
        direction: Direction of propagation, of any length; two numbers for a 2-D model.
    """

    speed: Annotated[float, at.Gt(0.0), at.Unit("m/s")]
    direction: Annotated[Sequence[float], at.Len(2, 3)]

    def __post_init__(self) -> None:
        if not np.any(self.direction):
            raise ValueError(f"Passage: direction is {shown(self.direction)}; it must not be zero.")

    def delays(self, x: Floats) -> Floats:
        """Return the delays at places (n, 3) [m] relative to the origin, shape (n,), [s]."""
        n = _three_numbers(self.direction)
        return np.asarray(x @ n / (np.linalg.norm(n) * self.speed))


@dataclass(frozen=True, kw_only=True, repr=False)
@checked
class DifferingMotion(Summarised):
    """Spatially varying motion of the supports, for the ``motion`` of a dynamic stage.

    Displacements are relative to a reference ground motion, which loads the body by inertia forces
    like a uniform motion. In addition, each support moves by the displacement of its ground minus
    the displacement of the reference.

    Attributes:
        motions: One motion, or several by name: names of facet groups with supports, or of the
            stations in ``positions``. A node of several groups moves with the last group.
        positions: Coordinates of the stations by name [m].
        between: Interpolation between stations. ``line``: linear in the distance along the line
            from first to last station, constant beyond. ``places``: by 3-D distances, for stations
            on both banks and at several heights.
        passage: Wave passage; its delay is zero at the support reached first. None by default.
        reference: Name of the reference motion, which has no delay; the first by default.
    """

    motions: Motion | Mapping[str, Motion]
    positions: Mapping[str, Sequence[float]] | None = None
    between: Literal["line", "places"] = "line"
    passage: Passage | None = None
    reference: str | None = None

    def __post_init__(self) -> None:
        expected = "a Motion, or several by name"
        valid = isinstance(self.motions, Motion | Mapping) and bool(self.named)
        check_kind_of("DifferingMotion: motions", self.motions, valid, expected)
        for name, motion in self.named.items():
            check_kind_of(
                f"The motion of {shown(name)}", motion, isinstance(motion, Motion), "a Motion"
            )
        valid = isinstance(self.passage, Passage | None)
        check_kind_of("DifferingMotion: passage", self.passage, valid, "a Passage")
        if self.reference is not None and self.reference not in self.named:
            raise ValueError(
                f"DifferingMotion: reference is {shown(self.reference)}; it must be one of "
                f"{', '.join(self.named)}."
            )
        if self.positions is not None:
            self._check_stations(self.positions)
        self._warn_of_drift()

    def _check_stations(self, positions: Mapping[str, Sequence[float]]) -> None:
        if set(positions) != set(self.named) or len(positions) < 2:
            raise ValueError(
                f"DifferingMotion: positions has {', '.join(positions)}; it must have the names of "
                f"all motions, at least two: {', '.join(self.named)}."
            )
        for name, place in positions.items():
            check_vector(f"DifferingMotion: the position of {shown(name)}", place, (2, 3))
        places = self._places(positions)
        if len(np.unique(places, axis=0)) < len(places):
            raise ValueError("DifferingMotion: two of the positions are the same.")
        along = self._along(positions)(places)
        if self.between == "line" and len(np.unique(along)) < len(positions):
            raise ValueError(
                "DifferingMotion: two of the positions are at the same distance along the line "
                'from the first to the last; use between="places".'
            )

    def _warn_of_drift(self) -> None:
        ends = np.array([m.integrated()[0][-1] for m in self.named.values()])
        largest = max(np.abs(m.integrated()[0]).max() for m in self.named.values())
        spread = float(np.ptp(ends, axis=0).max())
        if spread > DRIFT * largest:
            warn(
                f"The motions of {', '.join(self.named)} end with velocities that differ by up to "
                f"{spread:.3g} m/s, so the ground keeps moving apart; correct their baselines.",
                PlausibilityWarning,
            )

    def _summary(self) -> Rows:
        for name, motion in self.named.items():
            velocity, displacement = (part[-1] for part in motion.integrated())
            ends = f"{np.abs(velocity).max():.2g} m/s, {np.abs(displacement).max():.2g} m"
            yield name, f"{motion.duration:g} s, at the end up to {ends}"
        if self.passage is not None:
            yield "passage", f"{self.passage.speed:g} m/s along {self.passage.direction}"
        yield "relative to", self._reference

    @property
    def named(self) -> Mapping[str, Motion]:
        """Motions by name."""
        motions = self.motions
        return {motions.name: motions} if isinstance(motions, Motion) else motions

    @property
    def name(self) -> str:
        """Name in results."""
        passing = "" if self.passage is None else f" at {self.passage.speed:g} m/s"
        return ", ".join(motion.name for motion in self.named.values()) + passing

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the facet groups with separate motions."""
        by_group = isinstance(self.motions, Mapping) and self.positions is None
        return tuple(self.named) if by_group else ()

    @property
    def _reference(self) -> str:
        return next(iter(self.named)) if self.reference is None else self.reference

    def __call__(self, time: float) -> Floats:
        """Return the acceleration of the reference at a time [s], shape (3,), [m/s^2]."""
        return self.named[self._reference](time)

    def relative_to_reference(
        self, x: Floats, members: Mapping[str, Flags], first: float, *, rate: bool = False
    ) -> Callable[[float], Floats]:
        """Return the displacement of the ground relative to the reference as a function of time.

        The function takes a time [s] and returns shape (n, 3).

        Args:
            x: Coordinates of the places, shape (n, 3), [m].
            members: True for the places in each of the `groups`, shape (n,).
            first: `Passage.delays` of the support that is reached first [s].
            rate: Return velocities [m/s] instead of displacements [m].
        """
        shares = self._shares(x, members)
        delays = np.zeros(len(x)) if self.passage is None else self.passage.delays(x) - first
        histories = {n: displacement_of(motion, rate=rate) for n, motion in self.named.items()}
        parts = [
            (acts := np.flatnonzero(shares[:, k]), shares[acts, k, None], delays[acts], history)
            for k, history in enumerate(histories.values())
        ]

        def relative_displacement(time: float) -> Floats:
            displacement = np.zeros((len(x), 3))
            for acting, share, delay, history in parts:
                displacement[acting] += share * history(time - delay)
            return displacement - histories[self._reference](np.array([time]))

        return relative_displacement

    def _shares(self, x: Floats, members: Mapping[str, Flags]) -> Floats:
        """Return the share of each motion at each place, shape (n, motions)."""
        unit_rows = np.eye(len(self.named))
        if self.groups:
            shares = np.zeros((len(x), len(self.named)))
            for row, name in zip(unit_rows, self.named, strict=True):
                shares[members[name]] = row
            return shares
        if self.positions is None:
            return np.ones((len(x), 1))
        if self.between == "places":
            from scipy.interpolate import RBFInterpolator

            stations = self._places(self.positions)
            # Shares by distances, (12ae).
            return np.asarray(RBFInterpolator(stations, unit_rows, kernel="linear", degree=0)(x))
        along = self._along(self.positions)
        places = along(self._places(self.positions))
        order = np.argsort(places)
        columns = [np.interp(along(x), places[order], row[order]) for row in unit_rows]
        return np.stack(columns, axis=1)

    def _places(self, positions: Mapping[str, Sequence[float]]) -> Floats:
        """Return the positions in the order of the motions, shape (motions, 3), [m]."""
        return np.array([_three_numbers(positions[name]) for name in self.named])

    def _along(self, positions: Mapping[str, Sequence[float]]) -> Callable[[Floats], Floats]:
        """Return the function of the distance along the line through first and last station [m]."""
        places = self._places(positions)
        line = places[-1] - places[0]
        return lambda x: np.asarray(x @ line / (np.linalg.norm(line) or 1.0))


def _three_numbers(vector: Sequence[float]) -> Floats:
    """Return a vector of two or three numbers as three numbers, padded by zero."""
    padded = np.zeros(3)
    padded[: len(vector)] = vector
    return padded
