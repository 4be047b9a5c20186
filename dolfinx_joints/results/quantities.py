# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of all quantities of a run: names, units, labels, and formulas at the joint points.

Results files, CSV, pandas, reports, figures and ParaView use these rows. A row with ``of`` is
computed from the joint points. The values of other rows come from monitors.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import ResultsError

_FACTORS = {"mm": 1e3, "MPa": 1e-6, "MN": 1e-6, "%": 100.0}


class JointPoints(NamedTuple):
    """State of joint points; rows with ``of`` are functions of it.

    Attributes:
        gap: Components (n, s1, s2), shape (..., points, 3), [m].
        slip: Tangential gap since the last static stage, without stages since the first record,
            shape (..., points, 2), [m].
        traction: Components (n, s1, s2), shape (..., points, 3), [Pa].
        cohesion: Cohesion that a bond still has, zero without bond, shape (..., points), [Pa].
    """

    gap: Floats
    slip: Floats
    traction: Floats
    cohesion: Floats

    @property
    def pressure(self) -> Floats:
        """-t_n, positive under compression, shape (..., points), [Pa]."""
        return np.asarray(-self.traction[..., 0])

    @property
    def compression(self) -> Floats:
        """Pressure [Pa]; tension counts only at unbroken bonds, whose strength it reduces."""
        return np.where(self.cohesion > 0.0, self.pressure, np.maximum(self.pressure, 0.0))

    @property
    def shear(self) -> Floats:
        """Magnitude of the tangential traction, shape (..., points), [Pa]."""
        return _size(self.traction[..., 1:])


@dataclass(frozen=True)
class Quantity:
    """Row of the table.

    Attributes:
        name: Name in its stream or table; ``*`` is the name of a joint, support or load.
        unit: SI unit of files and tables.
        label: Label in tables, figures and reports; empty if these do not show the quantity.
        shown: Unit in figures and reports; ``unit`` if empty.
        text: Description in the results file; ``label`` if empty. ``{}`` is the name at ``*``,
            ``{frame}`` the reference of displacements.
        style: Line style and colour in figures of several quantities.
        dtype: Type in the results file.
        rare: True if only some runs or joints have the quantity.
        by: How the values of the points are combined for a joint: the largest value, or zero if
            all are negative; its place; the integral over the area without tied points; the mean.
        of: Values of the points, shape (..., points).
    """

    name: str
    unit: str
    label: str = ""
    shown: str = ""
    text: str = ""
    style: tuple[str, str] = ("-", "#444444")
    dtype: DTypeLike = np.float64
    rare: bool = False
    by: Literal["", "largest", "place", "integral", "mean"] = ""
    of: Callable[[JointPoints], Floats] | None = None

    @property
    def key(self) -> str:
        """Last part of the name."""
        return self.name.rpartition("/")[2]

    @property
    def factor(self) -> float:
        """Factor from the unit in files to the unit in figures and reports."""
        return _FACTORS.get(self.shown, 1.0)

    @property
    def heading(self) -> str:
        """Label with the unit of figures and reports."""
        return f"{self.label} [{self.shown or self.unit}]"


Q = Quantity
_FRAME = "of monitor points, {frame}"
_STATIC_PART = Q("static_displacement", "m", text="quasi-static displacement by support motion")
_REACTION = Q("reaction/*", "N", text="force of the support {} on the body")
_STATUS = "0 open, 1 sticking, 2 sliding in the step ending here, 3 closed without friction, 4 tied"
_PRESSED = "integral of the pressure, including tension at unbroken bonds"
_BOND = "integral of the cohesion that the points still have"
_STATES = (
    Q("displacement", "m", text="displacement of the nodes from the unloaded body"),
    _STATIC_PART,
    Q("joints/*/gap", "m", text="gap (n, s1, s2), open if n > 0"),
    Q("joints/*/traction", "Pa", text="traction (n, s1, s2), compression if n < 0"),
    Q("joints/*/status", "-", text=_STATUS, dtype=np.int8),
    Q("joints/*/pressure", "Pa", text="water pressure, positive if it opens the joint"),
    Q("joints/*/broken", "-", text="share of the cohesion that is lost, 1 if broken"),
    Q("stress/plane", "Pa", text="in-plane stress (xx, yy, xy) at envelopes/nodes", rare=True),
)
TABLE: dict[str, tuple[Quantity, ...]] = {
    "histories": (
        Q("displacement", "m", text=f"displacement from the unloaded body, {_FRAME}"),
        Q("acceleration", "m/s^2", text=f"mean acceleration of the step ending here {_FRAME}"),
        _STATIC_PART,
        Q("free_surface_velocity", "m/s", text="velocity of the free surface without the body"),
        Q("ground_acceleration", "m/s^2", text="acceleration of the ground at this time"),
        Q("reservoir_force", "N", text="force of the reservoir waves on the wet face"),
        _REACTION,
        Q("iterations", "-", "iterations", text="iterations of the step", dtype=np.int64),
        Q("joint_open", "-", "open", "%", "share of open joint points", ("-", "black")),
        Q("joint_stick", "-", "sticking", "%", "share of sticking joint points"),
        Q("joint_slip", "-", "sliding", "%", "share of sliding joint points", ("-", "#b2182b")),
        Q("joint_frictionless", "-", "closed without friction", "%", style=("-", "#756bb1")),
    ),
    "energy": (
        Q("waves", "J", style=("-", "#a65628"), rare=True),  # only from `energy_lines`
        Q("kinetic", "J", "kinetic energy", style=("-", "#56b4e9")),
        Q("strain", "J", "strain energy", style=("-", "#08519c")),
        Q("joint", "J", "elastic energy of the joints", style=("-", "#238b45")),
        Q("input", "J", "work of loads and supports", style=("-", "black")),
        Q("viscous", "J", "work against damping", style=("--", "#e69f00")),
        Q("friction", "J", "work against friction", style=("--", "#b2182b")),
        Q("numerical", "J", "numerical loss", style=("-.", "#7b3294")),
        Q("water", "J", "energy of waves in the reservoir", style=("-", "#1b9e9e"), rare=True),
        Q("plastic", "J", "plastic and other bulk losses", style=("--", "#a50f15"), rare=True),
        Q("impact", "J", "loss of points that do not rebound", style=("--", "#e7298a"), rare=True),
        Q("fracture", "J", "broken bonds, in friction", style=(":", "#b2182b"), rare=True),
        Q("absorbed", "J", text="part of viscous at absorbing boundaries", rare=True),
        Q("error", "J", "residual", style=(":", "#8c8c8c")),
        Q("joints/*/elastic", "J", text="elastic energy of {}"),
        Q("joints/*/friction", "J", text="work against friction in {}"),
        Q("joints/*/numerical", "J", text="numerical loss in {}"),
        Q("loads/*", "J", text="work of {}"),
    ),
    "states": _STATES,
    "statics": (
        Q("name", "-", text="name of the stage, UTF-8 padded with zeros", dtype=np.uint8),
        Q("load_time", "s", text="time at which the loads are evaluated"),
        Q("load_factor", "-", text="factor of the controlled loads, NaN without them"),
        Q("controlled", "m", text="controlled gap or displacement, NaN without one"),
        Q("point_displacement", "m", text="displacement of points from the unloaded body"),
        *_STATES,
        _REACTION,
        Q("energy/loads/*", "J", "work of {}"),
        Q("energy/supports", "J", "work of supports"),
        Q("energy/strain", "J", "strain energy"),
        Q("energy/plastic", "J", "plastic work"),
        Q("energy/bulk_numerical", "J", "numerical loss of the bulk"),
        Q("energy/joints/*/elastic", "J", "joints, elastic"),
        Q("energy/joints/*/friction", "J", "friction"),
        Q("energy/joints/*/numerical", "J", "numerical"),
        Q("energy/joints/*/bonds", "J", "broken bonds"),
        Q("energy/joints/*/released", "J", "released", text="released, in friction and numerical"),
        Q("energy/water_released", "J", "energy released with water"),
        Q("energy/error", "J", "error of the energies"),
        Q("energy/scale", "J", "largest energy"),
        Q("jumps", "-", "jumps", dtype=np.int64),
        Q("jump_energy", "J", "energy released by jumps"),
        Q("stress/principal_max", "Pa", text="largest principal stress"),
        Q("stress/principal_min", "Pa", text="smallest principal stress"),
        Q("stress/arch", "Pa", text="stress along the arch direction"),
        Q("stress/cantilever", "Pa", text="stress along the cantilever direction"),
    ),
    "joints": (
        Q("*/opening", "m", "largest opening", "mm", by="largest", of=lambda p: p.gap[..., 0]),
        Q("*/opening_at", "m", "largest opening at", by="place"),
        Q("*/slip", "m", "largest slip", "mm", by="largest", of=lambda p: _size(p.slip)),
        Q("*/slip_at", "m", "largest slip at", by="place"),
        Q("*/pressure", "Pa", "largest pressure", "MPa", by="largest", of=lambda p: p.pressure),
        Q("*/mean_pressure", "Pa", "mean pressure", "MPa", by="mean", of=lambda p: p.pressure),
        Q("*/compression", "N", text=_PRESSED, by="integral", of=lambda p: p.compression),
        Q("*/shear_sum", "N", text="integral of the shear", by="integral", of=lambda p: p.shear),
        Q("*/bond", "N", text=_BOND, rare=True, by="integral", of=lambda p: p.cohesion),
        Q("*/safety", "-", "sliding safety"),  # from the integrals, by `joint_extremes`
        Q("*/mobilised", "-", "mobilised friction"),  # 1 / safety
    ),
    "resultants": (
        Q("joints/*/force", "N", "effective force", text="effective force on the + side of {}"),
        Q("joints/*/moment", "N m", "moment about the centroid"),
        Q("joints/*/water_force", "N", text="force of the water in {} on its + side"),
        Q("joints/*/water_moment", "N m", text="moment of the water about the centroid"),
        Q("joints/*/total_force", "N", "total force"),
        Q("joints/*/total_moment", "N m", "total moment about the centroid"),
        Q("joints/*/normal_force", "N", "normal force"),
        Q("joints/*/shear", "N", "shear force"),
        Q("joints/*/shear_force", "N", "shear force"),
        Q("joints/*/sliding_safety", "-", "sliding safety"),
        Q("joints/*/plane_safety", "-", "sliding safety of the resultants"),
        Q("joints/*/contact", "-", "share of area under pressure"),
        Q("joints/*/line_of_action", "m", "normal force acts at"),
        Q("joints/*/flatness", "-", "flatness"),
        Q("blocks/force", "N", "effective force", text="effective force of the joints"),
        Q("blocks/moment", "N m", text="moment of the joints about the centre"),
        Q("blocks/water_force", "N", text="force of the water in joints"),
        Q("blocks/water_moment", "N m", text="moment of the water about the centre"),
        Q("blocks/total_force", "N", "total force"),
        Q("blocks/total_moment", "N m", "total moment about the centre"),
        Q("blocks/mass", "kg", "mass"),
        Q("blocks/centre", "m", "centre"),
    ),
    "envelopes": (
        Q("principal_max", "Pa", text="largest principal stress over the run"),
        Q("principal_min", "Pa", text="smallest principal stress over the run"),
        Q("arch_max", "Pa", text="largest stress along the arch direction"),
        Q("arch_min", "Pa", text="smallest stress along the arch direction"),
        Q("cantilever_max", "Pa", text="largest stress along the cantilever direction"),
        Q("cantilever_min", "Pa", text="smallest stress along the cantilever direction"),
        Q("overstress_time", "s", text="time above each level x dynamic tensile strength"),
    ),
    # Attributes of `StageJoint`, not in files.
    "stage_joints": (
        Q("opening_max", "m", "largest opening", "mm"),
        Q("slip_max", "m", "largest tangential gap", "mm"),
        Q("normal_force", "N", "normal force, pressure > 0", "MN"),
        Q("shear_force", "N", "shear force", "MN"),
        Q("plane_safety", "-", "safety N tan φ / V"),
        Q("sliding_safety", "-", "safety of magnitudes"),
        Q("contact", "-", "area under pressure", "%"),
        Q("pressure_max", "Pa", "largest pressure", "MPa"),
        Q("water_force", "N", "water force in the joint", "MN"),
    ),
    # From `joint_measures`, not in files; the end of this module adds rows from "joints".
    "measures": (
        Q("opening_static", "m", "opening in the {zero}", "mm"),
        Q("opening_residual", "m", "residual opening, mean of the last second", "mm"),
        Q("slip_residual", "m", "residual slip, mean of the last second", "mm"),
        Q("share_open", "-", "open", "%"),
        Q("share_sliding", "-", "sliding", "%"),
        Q("share_frictionless", "-", "closed without friction", "%"),
        Q("share_broken", "-", "cohesion lost at the end", "%"),
    ),
    # From `BlockSliding`, not in files.
    "sliding": (
        Q("driving", "N", "driving force"),
        Q("resistance", "N", "shear strength"),
        Q("safety", "-", "factor of safety"),
        Q("newmark_slip", "m", "slip of Newmark's block", "mm"),
    ),
    "sliding_measures": (
        Q("safety_static", "-", "static F"),
        Q("safety_min", "-", "least F"),
        Q("safety_time", "s", "least F at"),
        Q("time_below_one", "s", "time with F < 1"),
        Q("yield_acceleration", "m/s^2", "yield acceleration along the slip", "m/s²"),
        Q("slip_residual", "m", "slip at the end", "mm"),
        Q("newmark_residual", "m", "slip of Newmark's block", "mm"),
    ),
    # From `resultant_measures`, not in files.
    "resultant_measures": (
        Q("safety_min", "-"),
        Q("safety_time", "s"),
        Q("normal_force_max", "N"),
        Q("normal_force_min", "N"),
        Q("shear_force_max", "N"),
        Q("contact_min", "-"),
        Q("flatness", "-"),
    ),
}


def _size(vectors: Floats) -> Floats:
    """Return the length of vectors with two components, shape (...)."""
    first, second = vectors[..., 0], vectors[..., 1]  # `einsum` over two components is slower
    return np.asarray(np.sqrt(first * first + second * second))


def rows_below(stream: str, start: str = "") -> tuple[Quantity, ...]:
    """Return the rows of a stream whose name is ``start`` plus a part without ``/`` and ``*``."""
    rows = (row for row in TABLE[stream] if row.name.startswith(start))
    return tuple(row for row in rows if not set("/*") & set(row.name.removeprefix(start)))


def row_of(stream: str, name: str) -> tuple[Quantity, str]:
    """Return the row of a series, and the name of the joint, support or load at ``*``.

    Raises:
        ResultsError: The table has no row for the series.
    """
    for row in TABLE.get(stream, ()):
        match = re.fullmatch(re.escape(row.name).replace(r"\*", "(.+)"), name)
        if match:
            return row, "".join(match.groups())
    raise ResultsError(f"The table of quantities has no row for {name!r} of {stream!r}.")


def rows_by(*methods: str) -> tuple[Quantity, ...]:
    """Return the rows of the stream ``joints`` with given values of ``by``, in this order."""
    return tuple(row for method in methods for row in TABLE["joints"] if row.by == method)


def at_points(rows: Iterable[Quantity], points: JointPoints) -> Floats:
    """Evaluate rows at joint points, shape (rows, ..., points)."""
    return np.stack([row.of(points) for row in rows if row.of is not None])


ENERGY_TERMS = tuple(row.name for row in rows_below("energy") if not row.rare)
# Largest values of each joint point over all steps.
TABLE["joint_maxima"] = (
    *rows_by("largest"),
    Q("*/tension", "Pa", "largest tension", "MPa", of=lambda p: p.traction[..., 0]),
    Q("*/shear", "Pa", "largest tangential traction", "MPa", of=lambda p: p.shear),
    Q("*/slid", "-", text="1 where a point slid in any step, zero elsewhere", dtype=np.int8),
)
# Series of a joint that figures show. The measures include their largest values and times.
JOINT_SERIES = tuple(row for row in rows_by("largest", "mean") if row.label)
for _row in reversed(JOINT_SERIES):
    _words = f"largest {_row.label.removeprefix('largest ')}"
    _largest = replace(_row, name=f"{_row.key}_max", label=_words)
    TABLE["measures"] = (_largest, Q(f"{_row.key}_time", "s", f"{_words} at"), *TABLE["measures"])
