# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Temperatures in a body from those of its faces: steady, and over the year.

Steady: div grad T = 0. Over the year, T = T_m + T_c cos(w t) + T_s sin(w t) with w of one year and
the diffusivity kappa,

    w T_s = kappa div grad T_c,   -w T_c = kappa div grad T_s,

so that a body takes part in the season as far as its thickness lets it. Nothing flows through
faces without a given temperature, and from block to block through joints of a given conductance
only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_each, check_kind_of
from dolfinx_joints.loads.temperature.joint_conductance import Joints, Openings, joint_term
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

Parts = tuple[Floats, Floats, Floats]
Day = Annotated[float, at.Interval(ge=0, le=366), at.Unit("days")]

DAY = 86400.0  # s
YEAR = 365.25 * DAY
MONTH = YEAR / 12.0
FREQUENCY = 2.0 * math.pi / YEAR  # rad/s

# A field of ones that is met worse than this belongs to a block without a given temperature.
ISOLATED = 1e-6


@dataclass(frozen=True, kw_only=True)
@checked
class AnnualWave:
    """A temperature that swings with the seasons, such as that of the air.

    Attributes:
        mean: Over the year [degrees C].
        amplitude: Half of what lies between summer and winter, not negative [K].
        warmest_day: Day of the year at which it is highest, 0 being its first.
    """

    mean: Annotated[float, at.Unit("degrees C")]
    amplitude: Annotated[float, at.Ge(0), at.Unit("K")]
    warmest_day: Day = 201.0

    def parts(self, points: Floats, day: float) -> Parts:
        """Mean, cosine and sine parts at points (n, 3) [m], each (n,), t = 0 being a day."""
        ones = np.ones(len(points))
        return _swing(self.mean * ones, self.amplitude * ones, 0.0 * ones, self.warmest_day - day)


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirTemperature:
    """Water below a level, air above it; deep reservoirs after Zhu (1997).

    At a depth y the mean is c + (m - c) exp(-0.04 y), the amplitude A exp(-0.018 y), and the water
    is warmest 2.15 - 1.30 exp(-0.085 y) months after the air, y in m.

    Attributes:
        level: Height of the surface along the last axis [m].
        air: The air above it.
        surface_mean: m, of the water at the surface over the year [degrees C].
        surface_amplitude: A, there [K].
        deep_mean: c, of the water far below [degrees C].
    """

    level: Annotated[float, at.Unit("m")]
    air: AnnualWave
    surface_mean: Annotated[float, at.Unit("degrees C")]
    surface_amplitude: Annotated[float, at.Ge(0), at.Unit("K")]
    deep_mean: Annotated[float, at.Unit("degrees C")]

    def parts(self, points: Floats, day: float) -> Parts:
        """Mean, cosine and sine parts at points (n, gdim) [m], each (n,), t = 0 being a day."""
        depth = self.level - points[:, -1]
        y = np.maximum(depth, 0.0)
        mean = self.deep_mean + (self.surface_mean - self.deep_mean) * np.exp(-0.04 * y)
        amplitude = self.surface_amplitude * np.exp(-0.018 * y)
        lag = np.asarray((2.15 - 1.30 * np.exp(-0.085 * y)) * MONTH / DAY, dtype=np.float64)
        water = _swing(mean, amplitude, lag, self.air.warmest_day - day)
        dry = self.air.parts(points, day)
        mean, cosine, sine = (np.where(depth > 0.0, w, a) for w, a in zip(water, dry, strict=True))
        return mean, cosine, sine


Face = float | Callable[[Floats], Floats] | AnnualWave | ReservoirTemperature


Conductivity = Annotated[float, at.Gt(0), at.Unit("W/(m K)")]


@checked
def steady_temperature(
    jointed: JointedMesh,
    faces: Mapping[str, Face],
    *,
    conductivity: Conductivity = 2.5,
    joints: Joints | None = None,
    openings: Openings | None = None,
) -> Any:
    """Temperature of a body whose faces have kept theirs for long (collective).

    Args:
        jointed: The mesh.
        faces: Temperature of each facet group that has one: a number, or a function of points
            (n, gdim) [m] that gives (n,); of what swings with the seasons the mean counts. Where
            groups meet the later one goes before.
        conductivity: k of the body, which only `joints` is compared with.
        joints: Conductance of the joints that let heat through.
        openings: Their normal gaps [m], numbers or UFL scalars; zero unless given.

    Returns:
        A DOLFINx function of the degree of the mesh, a `Temperature.value` [degrees C].

    Raises:
        ValueError: No face is given, a value is not finite, or nothing gives a block its
            temperature.
        MeshError: There is no such group or joint.
    """
    values = face_values(jointed, faces, 0.0)[:, :1]
    return _solve(jointed, values, None, _Through(conductivity, joints, openings))


@checked
def seasonal_temperatures(
    jointed: JointedMesh,
    faces: Mapping[str, Face],
    *,
    reference: float | Mapping[str, float],
    expansion: Annotated[float, at.Ge(0), at.Unit("1/K")],
    diffusivity: Annotated[float, at.Gt(0), at.Unit("m^2/s")] = 1e-6,
    day: Day = 15.0,
    conductivity: Conductivity = 2.5,
    joints: Joints | None = None,
    openings: Openings | None = None,
) -> list[Temperature]:
    """Loads of a body that follows the seasons, mean and swing (collective).

    Args:
        jointed: The mesh. Cells should resolve sqrt(2 kappa / w), 3.2 m by default.
        faces: As in `steady_temperature`, `AnnualWave` and `ReservoirTemperature` with their swing.
        reference: Temperature at which the joints were closed, or one per cell group [degrees C].
        expansion: Coefficient of linear thermal expansion [1/K].
        diffusivity: kappa [m^2/s].
        day: Day of the year at t = 0.
        conductivity: As in `steady_temperature`, and the next two.
        joints: Conductance of the joints that let heat through.
        openings: Their normal gaps [m].

    Returns:
        Three loads, for `Model`: the mean less the reference, and the swing's cosine and sine.

    Raises:
        ValueError: As in `steady_temperature`.
        MeshError: There is no such group.
    """
    values = face_values(jointed, faces, day)
    through = _Through(conductivity, joints, openings)
    mean = _solve(jointed, values[:, :1], None, through)
    swing = _solve(jointed, values[:, 1:], diffusivity, through)
    return [
        Temperature(value=mean, reference=reference, expansion=expansion),
        Temperature(value=swing[0], reference=0.0, expansion=expansion, factor=_cosine),
        Temperature(value=swing[1], reference=0.0, expansion=expansion, factor=_sine),
    ]


def _cosine(time: float) -> float:
    return math.cos(FREQUENCY * time)


def _sine(time: float) -> float:
    return math.sin(FREQUENCY * time)


def _swing(mean: Floats, amplitude: Floats, lag: Floats, days: float) -> Parts:
    """Parts of mean + amplitude cos(w (t - lag)), warmest ``days`` after t = 0; lag in days."""
    phase = FREQUENCY * DAY * (days + lag)
    return mean, amplitude * np.cos(phase), amplitude * np.sin(phase)


class _Through(NamedTuple):
    """Heat through joints: conductivity of the body, conductances and openings."""

    conductivity: float
    joints: Joints | None
    openings: Openings | None


def factored(matrix: PETSc.Mat) -> PETSc.KSP:
    """A solver by the matrix's factor (collective).

    Raises:
        JointsError: The factor does not fit into memory.
    """
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOptionsPrefix("dolfinx_joints_temperature_")
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setOperators(matrix)
    ksp.setFromOptions()
    ksp.setUp()
    if ksp.getPC().getFailedReason() == PETSc.PC.FailedReason.FACTOR_OUTMEMORY:
        raise JointsError(
            "The factor of the matrix of temperatures does not fit into memory, or into what MUMPS "
            "sets aside: take a coarser mesh, more memory, or a larger "
            "dolfinx_joints_temperature_mat_mumps_icntl_14 in PETSC_OPTIONS."
        )
    return ksp


def scalar_space(jointed: JointedMesh, components: int = 1) -> Any:
    """Lagrange space of the degree of the mesh."""
    shape = () if components == 1 else (components,)
    return fem.functionspace(jointed.mesh, ("Lagrange", jointed.shape.degree, shape))


def face_values(jointed: JointedMesh, faces: Mapping[str, Face], day: float) -> Floats:
    """Parts of the given temperatures at the nodes, shape (n, 3), NaN where none is given."""
    good = isinstance(faces, Mapping) and bool(faces)
    check_kind_of("faces", faces, good, "a temperature per facet group")
    space = scalar_space(jointed)
    gdim = jointed.mesh.geometry.dim
    points = space.tabulate_dof_coordinates()[:, :gdim]
    values = np.full((len(points), 3), np.nan)
    for group, face in faces.items():
        facets = jointed.facets(group)
        nodes = fem.locate_dofs_topological(space, jointed.mesh.topology.dim - 1, facets)
        with raised_together(jointed.mesh.comm):
            values[nodes] = _parts(group, face, points[nodes], day)
    return values


def _parts(group: str, face: Face, points: Floats, day: float) -> Floats:
    """Mean, cosine and sine of one face at its nodes, shape (n, 3)."""
    name = f"The temperature of {group!r}"
    if isinstance(face, AnnualWave | ReservoirTemperature):
        return np.column_stack(face.parts(points, day))
    mean = check_each(name, face(points) if callable(face) else face, len(points))
    return np.column_stack([mean, np.zeros((len(points), 2))])


def _solve(
    jointed: JointedMesh, given: Floats, diffusivity: float | None, through: _Through
) -> Any:
    """Field with given values at some nodes, NaN at the others (collective).

    Args:
        jointed: The mesh.
        given: Shape (n, components).
        diffusivity: None for a steady field, else that of the cosine and sine parts [m^2/s].
        through: Heat through joints.
    """
    components = given.shape[1]
    space = scalar_space(jointed, components)
    t, q = ufl.TrialFunction(space), ufl.TestFunction(space)
    kappa = fem.Constant(jointed.mesh, float(diffusivity or 1.0))
    form = kappa * ufl.inner(ufl.grad(t), ufl.grad(q)) * ufl.dx
    share = fem.Constant(jointed.mesh, float(diffusivity or 1.0) / through.conductivity)
    form += joint_term(jointed, through.joints, through.openings, share * t, q)
    if diffusivity is not None:
        form += FREQUENCY * (t[1] * q[0] - t[0] * q[1]) * ufl.dx
    matrix = fem_petsc.assemble_matrix(jointed.form(form))
    matrix.assemble()
    b, x = matrix.createVecLeft(), matrix.createVecRight()
    owned = given[: b.getLocalSize() // components].ravel()
    known = np.isfinite(owned)
    rows = (np.flatnonzero(known) + matrix.getOwnershipRange()[0]).astype(PETSc.IntType)
    sides = [np.where(known, owned, 0.0)]
    if diffusivity is None:
        sides.append(known.astype(np.float64))
    loads = []
    for values in sides:
        x.setArray(values)
        matrix.mult(x, b)
        loads.append(np.where(known, values, -b.getArray()))
    matrix.zeroRowsColumns(rows, diag=1.0)
    ksp, found = factored(matrix), []
    for load in loads:
        b.setArray(load)
        x.set(0.0)
        ksp.solve(b, x)
        found.append(x.getArray().copy())
    for thing in (ksp, matrix, b, x):
        thing.destroy()
    comm = jointed.mesh.comm
    # Where all faces are at 1 so is the body, unless a block has no such face.
    isolated = [float(np.abs(ones - 1.0).max(initial=0.0)) for ones in found[1:]]
    if not all(comm.allgather(all(error < ISOLATED for error in isolated))):
        raise ValueError(
            "A block has no face with a given temperature; joints let no heat through unless "
            "joints gives their conductance, so name a facet group of each block in faces."
        )
    return field_of(space, found[0])


def field_of(space: Any, values: Floats) -> fem.Function:
    """Return the temperature with values at the rank's own nodes (collective)."""
    field = fem.Function(space, name="temperature")
    field.x.array[: len(values)] = values
    field.x.scatter_forward()
    return field
