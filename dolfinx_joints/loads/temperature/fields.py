# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Temperature fields of a body with given face temperatures: steady and seasonal.

Steady: div grad T = 0. Seasonal: T = T_m + T_c cos(w t) + T_s sin(w t) with a period of one year
and the diffusivity kappa, where

    w T_s = kappa div grad T_c,   -w T_c = kappa div grad T_s.

Faces without a given temperature and joints without a given conductance are insulated.
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

from dolfinx_joints.body.quadrature import matrix_measure
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

# Tolerance of a test field that should be 1 everywhere; a block with a larger error is insulated.
ISOLATED = 1e-6


@dataclass(frozen=True, kw_only=True)
@checked
class AnnualWave:
    """Sinusoidal annual temperature, for example of the air.

    Attributes:
        mean: Annual mean [degrees C].
        amplitude: Half of the difference between highest and lowest temperature, at least 0 [K].
        warmest_day: Day of the year with the highest temperature; 0 is the first day.
    """

    mean: Annotated[float, at.Unit("degrees C")]
    amplitude: Annotated[float, at.Ge(0), at.Unit("K")]
    warmest_day: Day = 201.0

    def parts(self, points: Floats, day: float) -> Parts:
        """Return mean, cosine and sine parts (n,) at points (n, gdim) [m]; t = 0 is ``day``."""
        ones = np.ones(len(points))
        return _swing(self.mean * ones, self.amplitude * ones, 0.0 * ones, self.warmest_day - day)


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirTemperature:
    """Temperature of a deep reservoir, after Zhu (1997), with air above the water level.

    At a depth y [m], the mean is c + (m - c) exp(-0.04 y) and the amplitude is A exp(-0.018 y). The
    water is warmest 2.15 - 1.30 exp(-0.085 y) months after the air.

    Attributes:
        level: Height of the water surface along the last axis [m].
        air: Temperature of the air above the level.
        surface_mean: Annual mean m of the water at the surface [degrees C].
        surface_amplitude: Amplitude A of the water at the surface [K].
        deep_mean: Mean c of the water at great depth [degrees C].
    """

    level: Annotated[float, at.Unit("m")]
    air: AnnualWave
    surface_mean: Annotated[float, at.Unit("degrees C")]
    surface_amplitude: Annotated[float, at.Ge(0), at.Unit("K")]
    deep_mean: Annotated[float, at.Unit("degrees C")]

    def parts(self, points: Floats, day: float) -> Parts:
        """Return mean, cosine and sine parts (n,) at points (n, gdim) [m]; t = 0 is ``day``."""
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
    """Compute the steady temperature of a body with given face temperatures (collective).

    Args:
        jointed: The mesh.
        faces: Given temperatures by facet group: a number, a function of points (n, gdim) [m] that
            returns (n,), or a seasonal temperature, of which the mean is used. At a node of several
            groups, the last group counts.
        conductivity: k of the body; has no effect without `joints`.
        joints: Conductance of the joints that conduct heat.
        openings: Normal gaps of these joints [m], numbers or UFL scalars; zero by default.

    Returns:
        DOLFINx function of the degree of the mesh [degrees C], for `Temperature.value`.

    Raises:
        ValueError: No face is given, a value is not finite, or a block is insulated.
        MeshError: A group or joint does not exist.
    """
    values = face_values(jointed, faces, 0.0)[:, :1]
    return _solve(jointed, values, None, _JointHeat(conductivity, joints, openings))


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
    """Compute the thermal loads of a periodic annual temperature (collective).

    Args:
        jointed: The mesh. Its cells should resolve the depth sqrt(2 kappa / w), 3.2 m by default.
        faces: As in `steady_temperature`, with the annual variation of seasonal temperatures.
        reference: Closure temperature of the joints, one number or one per cell group [degrees C].
        expansion: Coefficient of linear thermal expansion [1/K].
        diffusivity: kappa [m^2/s].
        day: Day of the year at t = 0.
        conductivity: As in `steady_temperature`.
        joints: As in `steady_temperature`.
        openings: As in `steady_temperature`.

    Returns:
        Three loads for `Model`: the mean minus the reference, the cosine part and the sine part.

    Raises:
        ValueError: As in `steady_temperature`.
        MeshError: A group does not exist.
    """
    values = face_values(jointed, faces, day)
    through = _JointHeat(conductivity, joints, openings)
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
    """Return mean, cosine and sine parts of a wave that is warmest at ``days + lag`` [days]."""
    phase = FREQUENCY * DAY * (days + lag)
    return mean, amplitude * np.cos(phase), amplitude * np.sin(phase)


class _JointHeat(NamedTuple):
    """Heat flow through joints: conductivity of the body, conductances and openings."""

    conductivity: float
    joints: Joints | None
    openings: Openings | None


def factored(matrix: PETSc.Mat) -> PETSc.KSP:
    """Factor a matrix and return the solver (collective).

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
            "The factor of the temperature matrix does not fit into memory or the workspace of "
            "MUMPS. Use a coarser mesh, more memory, or a larger "
            "dolfinx_joints_temperature_mat_mumps_icntl_14 in PETSC_OPTIONS."
        )
    return ksp


def scalar_space(jointed: JointedMesh, components: int = 1) -> Any:
    """Return the Lagrange space of the degree of the mesh."""
    shape = () if components == 1 else (components,)
    return fem.functionspace(jointed.mesh, ("Lagrange", jointed.shape.degree, shape))


def face_values(jointed: JointedMesh, faces: Mapping[str, Face], day: float) -> Floats:
    """Return the parts of the face temperatures at the nodes, shape (n, 3), NaN elsewhere."""
    valid = isinstance(faces, Mapping) and bool(faces)
    check_kind_of("faces", faces, valid, "a temperature per facet group")
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
    """Return mean, cosine and sine parts of one face at its nodes, shape (n, 3)."""
    name = f"The temperature of {group!r}"
    if isinstance(face, AnnualWave | ReservoirTemperature):
        return np.column_stack(face.parts(points, day))
    mean = check_each(name, face(points) if callable(face) else face, len(points))
    return np.column_stack([mean, np.zeros((len(points), 2))])


def _solve(
    jointed: JointedMesh, node_values: Floats, diffusivity: float | None, through: _JointHeat
) -> Any:
    """Solve for the field with given values at some nodes (collective).

    Args:
        jointed: The mesh.
        node_values: Given temperatures, NaN at free nodes, shape (n, components).
        diffusivity: kappa of the cosine and sine parts [m^2/s]; None for a steady field.
        through: Heat flow through joints.
    """
    components = node_values.shape[1]
    space = scalar_space(jointed, components)
    t, q = ufl.TrialFunction(space), ufl.TestFunction(space)
    dx = matrix_measure(jointed.shape)
    kappa = fem.Constant(jointed.mesh, float(diffusivity or 1.0))
    form = kappa * ufl.inner(ufl.grad(t), ufl.grad(q)) * dx
    share = fem.Constant(jointed.mesh, float(diffusivity or 1.0) / through.conductivity)
    form += joint_term(jointed, through.joints, through.openings, share * t, q)
    if diffusivity is not None:
        form += FREQUENCY * (t[1] * q[0] - t[0] * q[1]) * dx
    matrix = fem_petsc.assemble_matrix(jointed.form(form))
    matrix.assemble()
    b, x = matrix.createVecLeft(), matrix.createVecRight()
    owned = node_values[: b.getLocalSize() // components].ravel()
    fixed = np.isfinite(owned)
    rows = (np.flatnonzero(fixed) + matrix.getOwnershipRange()[0]).astype(PETSc.IntType)
    boundary_values = [np.where(fixed, owned, 0.0)]
    if diffusivity is None:
        boundary_values.append(fixed.astype(np.float64))
    loads = []
    for values in boundary_values:
        x.setArray(values)
        matrix.mult(x, b)
        loads.append(np.where(fixed, values, -b.getArray()))
    matrix.zeroRowsColumns(rows, diag=1.0)
    ksp, solutions = factored(matrix), []
    for load in loads:
        b.setArray(load)
        x.set(0.0)
        ksp.solve(b, x)
        solutions.append(x.getArray().copy())
    for petsc in (ksp, matrix, b, x):
        petsc.destroy()
    comm = jointed.mesh.comm
    # If all given temperatures are 1, the solution is 1, except in blocks that are insulated.
    isolated = [float(np.abs(ones - 1.0).max(initial=0.0)) for ones in solutions[1:]]
    if not all(comm.allgather(all(error < ISOLATED for error in isolated))):
        raise ValueError(
            "A block has no face with a given temperature, and no joint conducts heat to it. Name "
            "a facet group of each block in faces, or give conductances in joints."
        )
    return field_of(space, solutions[0])


def field_of(space: Any, values: Floats) -> fem.Function:
    """Return the temperature field with values at the rank's owned nodes (collective)."""
    field = fem.Function(space, name="temperature")
    field.x.array[: len(values)] = values
    field.x.scatter_forward()
    return field
