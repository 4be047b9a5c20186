# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Transient heat conduction with given face temperatures and heat flow through joints.

    \int (rho c dT/dt v + k grad T . grad v) dx + \int_joints h [T] [v] dA = 0

Each step has two implicit stages with the same matrix, gamma = 1 - 1/sqrt(2) (Alexander 1977). The
scheme is of second order and does not oscillate after a sudden change of a face temperature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from dolfinx_joints.body.quadrature import matrix_measure
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.loads.temperature.fields import (
    FREQUENCY,
    Day,
    Face,
    face_values,
    factored,
    field_of,
    scalar_space,
)
from dolfinx_joints.loads.temperature.joint_conductance import Joints, Openings, joint_term
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

GAMMA = 1.0 - math.sqrt(0.5)


@checked
def transient_temperatures(
    jointed: JointedMesh,
    faces: Mapping[str, Face],
    *,
    times: Sequence[float],
    initial: Any,
    conductivity: Annotated[float, at.Gt(0), at.Unit("W/(m K)")] = 2.5,
    heat_capacity: Annotated[float, at.Gt(0), at.Unit("J/(m^3 K)")] = 2.5e6,
    joints: Joints | None = None,
    openings: Openings | None = None,
    day: Day = 15.0,
) -> list[Any]:
    """Compute the temperatures of a body at given times from an initial field (collective).

    Successive equal steps share a factor. To change openings, call again with the last field.

    Args:
        jointed: The mesh.
        faces: As in `steady_temperature`, with the annual variation; may be empty.
        times: Ends of the steps, increasing and positive [s].
        initial: Temperature at t = 0, a number or an earlier field [degrees C].
        conductivity: k.
        heat_capacity: Volumetric heat capacity rho c.
        joints: Conductance of the joints that conduct heat.
        openings: Normal gaps of these joints [m], numbers or UFL scalars; zero by default.
        day: Day of the year at t = 0.

    Returns:
        DOLFINx function of the degree of the mesh for each time, for `Temperature.value`.

    Raises:
        ValueError: Times, faces, conductances, openings or the initial field are not valid.
        MeshError: A group or joint does not exist.
    """
    ends = numbers_of(times)
    rising = ends is not None and ends.ndim == 1 and ends.size and np.isfinite(ends).all()
    if ends is None or not rising or not (np.diff(ends, prepend=0.0) > 0.0).all():
        raise ValueError(f"times is {shown(times)}; it must be increasing, positive times [s].")
    space = scalar_space(jointed)
    parts = face_values(jointed, faces, day) if faces else None
    stepper = _Stepper(jointed, space, parts, (conductivity, heat_capacity), (joints, openings))
    now, time, fields = _initial_values(space, initial), 0.0, []
    for end in ends:
        now = stepper.step(now, time, float(end) - time)
        time = float(end)
        fields.append(field_of(space, now))
    stepper.destroy()
    return fields


def _initial_values(space: Any, initial: Any) -> Floats:
    """Return the initial temperature at the rank's owned nodes."""
    size = space.dofmap.index_map.size_local
    if isinstance(initial, fem.Function):
        source = initial.function_space
        if source.mesh is not space.mesh or source.ufl_element() != space.ufl_element():
            raise ValueError("initial is in another function space; it must be on this mesh.")
        return np.array(initial.x.array[:size])
    return np.full(size, float(initial))


class _Stepper:
    """Time integration of the temperatures at the rank's owned nodes.

    ``parts`` are the mean, cosine and sine parts of given temperatures, (n, 3), NaN at free nodes;
    ``material`` are k and rho c; ``through`` are the conductances and openings of joints.
    """

    def __init__(
        self,
        jointed: JointedMesh,
        space: Any,
        parts: Floats | None,
        material: tuple[float, float],
        through: tuple[Joints | None, Openings | None],
    ) -> None:
        """Assemble the matrices (collective)."""
        t, q = ufl.TrialFunction(space), ufl.TestFunction(space)
        dx = matrix_measure(jointed.shape)
        k, capacity = (fem.Constant(jointed.mesh, value) for value in material)
        conducts = k * ufl.inner(ufl.grad(t), ufl.grad(q)) * dx
        conducts += joint_term(jointed, *through, t, q)
        self._stiff = fem_petsc.assemble_matrix(jointed.form(conducts))
        self._mass = fem_petsc.assemble_matrix(fem.form(capacity * ufl.inner(t, q) * dx))
        for matrix in (self._stiff, self._mass):
            matrix.assemble()
        self._b, self._x = self._stiff.createVecLeft(), self._stiff.createVecRight()
        size = self._b.getLocalSize()
        self._parts = np.full((size, 3), np.nan) if parts is None else parts[:size]
        self._fixed = np.isfinite(self._parts[:, 0])
        self._dt = 0.0
        self._matrix: Any = None
        self._ksp: Any = None

    def step(self, start: Floats, time: float, dt: float) -> Floats:
        """Return the temperatures after a step of length dt that starts at a time [s]."""
        if self._ksp is None or not math.isclose(dt, self._dt, rel_tol=1e-12):
            self._factor(dt)
        start = self._with_faces(start, time)
        stage_end = self._stage(start, time + GAMMA * dt)
        return self._stage(start + (1.0 - GAMMA) / GAMMA * (stage_end - start), time + dt)

    def _with_faces(self, values: Floats, time: float) -> Floats:
        """Return the values with the face temperatures at a time inserted."""
        phase = FREQUENCY * time
        swing = self._parts @ np.array([1.0, math.cos(phase), math.sin(phase)])
        return np.where(self._fixed, swing, values)

    def _stage(self, start_values: Floats, time: float) -> Floats:
        """Solve (M + gamma dt A) T = M T_start, with the face temperatures at a time."""
        at_faces = self._with_faces(np.zeros_like(start_values), time)
        self._x.setArray(start_values)
        self._mass.mult(self._x, self._b)
        load = self._b.getArray().copy()
        self._x.setArray(at_faces)
        self._matrix.mult(self._x, self._b)
        self._b.setArray(np.where(self._fixed, at_faces, load - self._b.getArray()))
        self._ksp.solve(self._b, self._x)
        return self._x.getArray().copy()

    def _factor(self, dt: float) -> None:
        """Assemble and factor M + gamma dt A (collective)."""
        self._drop()
        self._matrix = self._stiff.copy()
        self._matrix.scale(GAMMA * dt)
        self._matrix.axpy(1.0, self._mass, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        matrix = self._matrix.copy()
        first = matrix.getOwnershipRange()[0]
        matrix.zeroRowsColumns((np.flatnonzero(self._fixed) + first).astype(PETSc.IntType))
        self._ksp = factored(matrix)
        matrix.destroy()
        self._dt = dt

    def _drop(self) -> None:
        for petsc in (self._ksp, self._matrix):
            if petsc is not None:
                petsc.destroy()

    def destroy(self) -> None:
        """Free the matrices, vectors and factor."""
        self._drop()
        for petsc in (self._stiff, self._mass, self._b, self._x):
            petsc.destroy()
