# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shape of an arch dam from a table of horizontal sections in a CSV file."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import check_file, shown
from dolfinx_joints.geometry.arch import CircularArches, Sector
from dolfinx_joints.geometry.meshing.extrusion import BoolArray, FloatArray

_REQUIRED = ("elevation", "extrados_radius", "left_angle", "right_angle")
_OPTIONAL = ("intrados_radius", "crown_thickness", "left_thickness", "right_thickness", "centre_x")
_MAX_HEIGHT = 1000.0  # [m]; the highest dam is 305 m high
_MIN_ANGLE = 2.0  # [degrees]; if no angle is larger, the table has radians


@dataclass(frozen=True, eq=False)
class SectionTable:
    """Circular horizontal sections of a dam at rising elevations, interpolated smoothly.

    The upstream face of a section is an arc about (centre_x, 0), with its crown at the smallest x.
    The columns are interpolated in the elevation by monotone cubics (PCHIP), so values between two
    sections stay between the values of these sections.

    Args:
        columns: columns of the table by name, each of shape (num_sections,). Lengths are in m:
            elevation, extrados_radius, centre_x and the columns of the thickness. Angles from the
            crown to the abutments at +y and -y are in degrees: left_angle and right_angle.
        source: name of the table in error messages.

    Raises:
        ValueError: if columns are missing or contradict each other, or a number is out of range.
    """

    columns: Mapping[str, FloatArray]
    source: str = "The table"

    def __post_init__(self) -> None:
        _check_names(list(self.columns), self.source)
        self._check_numbers()
        for side in (1, -1):
            _check_thickness(self.half(side), self)
            _check_abutment(self.half(side), self)

    @property
    def base(self) -> float:
        """Lowest elevation [m]."""
        return float(self.columns["elevation"][0])

    @property
    def height(self) -> float:
        """Height of the crest above the lowest section [m]."""
        return float(self.columns["elevation"][-1] - self.base)

    @cached_property
    def curves(self) -> dict[str, PchipInterpolator]:
        """Columns as functions of the relative height in [0, 1]."""
        relative = (self.columns["elevation"] - self.base) / self.height
        return {name: PchipInterpolator(relative, c) for name, c in self.columns.items()}

    def half(self, side: int) -> SectionHalf:
        """Return the half at +y (side 1, left bank) or -y (side -1), mirrored to +y."""
        return SectionHalf(self, side)

    def _check_numbers(self) -> None:
        elevation = self.columns["elevation"]
        if len(elevation) < 2:
            raise ValueError(
                f"{self.source} has {len(elevation)} sections, but at least 2 are needed."
            )
        for name, values in self.columns.items():
            self._check(name, ~np.isfinite(values), "must be a finite number")
            if name.endswith(("radius", "thickness")):
                self._check(name, values <= 0, "must be positive [m]")
            if name.endswith("angle"):
                self._check(name, (values <= 0) | (values >= 90), "must be in (0, 90) [degrees]")
        falls = np.concatenate([[False], np.diff(elevation) <= 0])
        self._check("elevation", falls, "must be above the previous section")
        if self.height > _MAX_HEIGHT:
            raise ValueError(
                f"{self.source} gives a dam {self.height:g} m high, but elevations must be in "
                f"metres and within {_MAX_HEIGHT:g} m."
            )
        widest = max(self.columns[name].max() for name in ("left_angle", "right_angle"))
        if widest < _MIN_ANGLE:
            raise ValueError(
                f"{self.source} has no angle above {widest:g}, but angles must be in degrees."
            )
        for name in ("intrados_radius", "crown_thickness", "left_thickness", "right_thickness"):
            if name in self.columns:
                invalid = self.columns[name] >= self.columns["extrados_radius"]
                self._check(name, invalid, "must be below extrados_radius")

    def _check(self, name: str, invalid: BoolArray, rule: str) -> None:
        """Raise ValueError with the first section in which a column is invalid."""
        if invalid.any():
            row = int(np.flatnonzero(invalid)[0])
            raise ValueError(
                f"{self.source}, section {row + 1}: {name} is {self.columns[name][row]:g}, but it "
                f"{rule}."
            )


@dataclass(frozen=True, eq=False)
class SectionHalf(CircularArches):
    """Half of the dam of a table, with its abutment at s = 1.

    Args:
        table: the table.
        side: 1 for the half at +y, -1 for the mirrored half at -y.
    """

    table: SectionTable
    side: int

    @property
    def height(self) -> float:  # type: ignore[override]
        """Height of the crest above the lowest section [m]."""
        return self.table.height

    def _value(self, name: str, zeta: ArrayLike) -> FloatArray:
        """Return a column interpolated at relative heights."""
        values: FloatArray = self.table.curves[name](np.asarray(zeta))
        return values

    def half_angle(self, zeta: ArrayLike) -> FloatArray:
        """Return phi, the angle from the crown to the abutment [radians]."""
        return np.radians(self._value("left_angle" if self.side > 0 else "right_angle", zeta))

    def radius(self, zeta: ArrayLike) -> FloatArray:
        """Return R, the radius of the upstream face [m]."""
        return self._value("extrados_radius", zeta)

    def centre(self, zeta: ArrayLike) -> FloatArray:
        """Return the x coordinate of the centre of the upstream face [m]."""
        if "centre_x" not in self.table.columns:
            return np.zeros(np.shape(zeta))
        return self._value("centre_x", zeta)

    def thickness(self, zeta: ArrayLike, s: ArrayLike) -> FloatArray:
        """Return t, measured towards the centre of the upstream face [m].

        If the intrados has the radius r, and its centre is nearer to the crown by e than the
        centre of the extrados, t = R - e cos(alpha) - sqrt(r^2 - e^2 sin(alpha)^2).
        """
        names = self.table.columns
        if "intrados_radius" in names:
            outer, inner = self.radius(zeta), self._value("intrados_radius", zeta)
            if "crown_thickness" not in names:
                return outer - inner + 0 * np.asarray(s)
            e = outer - inner - self._value("crown_thickness", zeta)
            alpha = np.asarray(s) * self.half_angle(zeta)
            square = inner**2 - (e * np.sin(alpha)) ** 2
            with np.errstate(invalid="ignore"):  # NaN if the arc ends before the abutment
                return np.asarray(outer - e * np.cos(alpha) - np.sqrt(square))
        crown = self._value("crown_thickness", zeta)
        if "left_thickness" not in names:
            return crown + 0 * np.asarray(s)
        abutment = self._value("left_thickness" if self.side > 0 else "right_thickness", zeta)
        return crown + (abutment - crown) * np.square(s)


@checked
def read_sections(path: str | os.PathLike[str]) -> SectionTable:
    """Read a table of horizontal sections.

    The CSV file has a line of column names, then one line of numbers per section from the base up,
    separated by commas. Empty lines and lines that start with # are ignored.

    Args:
        path: the file.

    Raises:
        ValueError: if the file is not a valid table; the message gives the line.
    """
    file = Path(path)
    check_file(file, f"The table of sections {str(file)!r} does not exist.")
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{file} is not a text file: its byte {error.start + 1} is not UTF-8."
        ) from None
    rows = [
        (number, [word.strip() for word in next(csv.reader([line]))])
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise ValueError(f"{file} is empty.")
    names = rows[0][1]
    _check_names(names, f"{file}, line {rows[0][0]}")
    table = [_line_numbers(words, names, f"{file}, line {number}") for number, words in rows[1:]]
    columns = np.array(table).reshape(-1, len(names)).T
    return SectionTable(dict(zip(names, columns, strict=True)), str(file))


def _line_numbers(words: list[str], names: list[str], where: str) -> list[float]:
    """Return the numbers of one line."""
    if len(words) != len(names):
        raise ValueError(f"{where}: {len(words)} values for {len(names)} columns.")
    values = []
    for name, word in zip(names, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise ValueError(f"{where}: {name} is {word[:40]!r}, which is not a finite number.")
        values.append(value)
    return values


def _check_names(names: list[str], where: str) -> None:
    """Raise ValueError unless the columns are a valid table of sections."""
    columns = ", ".join(_REQUIRED + _OPTIONAL)
    for name in names:
        if name not in _REQUIRED + _OPTIONAL:
            raise ValueError(
                f"{where}: {shown(name)} is not a column of a table of sections: {columns}."
            )
        if names.count(name) > 1:
            raise ValueError(f"{where}: the column {name!r} is given {names.count(name)} times.")
    for name in _REQUIRED:
        if name not in names:
            raise ValueError(f"{where}: the column {name!r} is missing.")
    names_given = [name for name in _OPTIONAL[:-1] if name in names]
    allowed = [
        ["intrados_radius"],
        ["crown_thickness"],
        ["intrados_radius", "crown_thickness"],
        ["crown_thickness", "left_thickness", "right_thickness"],
    ]
    if names_given not in allowed:
        choices = "; ".join(" and ".join(way) for way in allowed)
        raise ValueError(
            f"{where}: the thickness is given by {' and '.join(names_given) or 'no column'}, but "
            f"it must be given by one of: {choices}."
        )


def _check_thickness(half: SectionHalf, table: SectionTable) -> None:
    """Raise ValueError if the faces meet or the downstream face ends before the abutment."""
    zeta = np.linspace(0, 1, 201)
    thickness = half.thickness(zeta[:, None], np.linspace(0, 1, 41))
    invalid = ~((thickness > 0) & (thickness < half.radius(zeta)[:, None])).all(axis=1)
    if invalid.any():
        level = table.base + table.height * zeta[invalid][0]
        raise ValueError(
            f"{table.source}: at elevation {level:g} m the downstream face does not reach the "
            f"{_bank(half)} abutment at a thickness above 0 and below extrados_radius."
        )


def _check_abutment(half: SectionHalf, table: SectionTable) -> None:
    """Raise ValueError unless the abutment is vertical or the valley widens steadily."""
    sector = Sector(half)
    if sector.upright:
        return
    zeta = np.linspace(0, 1, 401)
    angle = sector.abutment_angle(np.array([[0.0], [0.5], [1.0]]), zeta)
    falls = (np.diff(angle, axis=1) <= 0).any(axis=0)
    if falls.any():
        level = table.base + table.height * zeta[1:][falls][0]
        raise ValueError(
            f"{table.source}: at elevation {level:g} m the {_bank(half)} abutment does not move "
            "away from the crown, as seen from the axis of the crest's arch; the valley must widen "
            "up to the crest, or the abutment must be vertical from base to crest."
        )


def _bank(half: SectionHalf) -> str:
    return "left" if half.side > 0 else "right"
