# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial state of a dynamic stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc
from ufl.core.expr import Expr
from ufl.domain import extract_domains

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import (
    check_kind_of,
    check_vector,
    finite,
    numbers_of,
    offers,
    shown,
)
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.mesh.dolfinx_versions import interpolation_points
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.checkpoint import Checkpoints
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.exact_steps import rescale
from dolfinx_joints.time_integration.initial_state import INTERVAL, initial_state
from dolfinx_joints.time_integration.midpoint import EnergyConsistent
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepControl

NodalField: TypeAlias = PETSc.Vec | Expr | Callable[[NDArray[np.float64]], Any] | Sequence[float]


def nodal_vector(model: Model, name: str, field: NodalField) -> PETSc.Vec:
    """Return a field as a new vector of the model's unknowns (collective).

    The field may be a vector of the unknowns, or a DOLFINx function or UFL expression on the mesh
    with one component per axis. It may also be a function of the nodes (n, 3) [m] that returns
    (n, gdim), or one uniform value per axis. Otherwise a ValueError names the field by ``name``.
    """
    vector = model.stiffness.createVecRight()
    if isinstance(field, PETSc.Vec):
        fits = field.getSizes() == vector.getSizes()
        check_kind_of(name, field, fits, f"a vector of the model's {model.num_dofs} unknowns")
        field.copy(vector)
    elif isinstance(field, Expr):
        vector.setArray(_interpolated(model, name, field)[: vector.getLocalSize()])
    elif callable(field):
        vector.setArray(_at_nodes(model, name, field).ravel())
    else:
        owned = vector.getLocalSize() // model.gdim
        vector.setArray(np.tile(check_vector(name, field, (model.gdim,)), owned))
    return vector


def _interpolated(model: Model, name: str, field: Any) -> NDArray[np.float64]:
    """Return the values of an expression at the nodes, ghosts included."""
    shape, domains = field.ufl_shape, extract_domains(field)
    if shape != (model.gdim,) or list(domains) != [model.jointed.mesh.ufl_domain()]:
        raise ValueError(
            f"{name} is {shown(field, str)}, of shape {shape}; it must be a UFL expression or "
            f"function on the model's mesh (model.jointed.mesh) of shape ({model.gdim},)."
        )
    u = fem.Function(model.V)
    u.interpolate(fem.Expression(field, interpolation_points(model.V)))
    values: NDArray[np.float64] = u.x.array
    with raised_together(model.jointed.mesh.comm):
        check_kind_of(name, field, finite(values), "finite at all nodes")
    return values


def _at_nodes(model: Model, name: str, field: Callable[..., Any]) -> NDArray[np.float64]:
    """Return the values of a function at the owned nodes, shape (n, gdim)."""
    owned = model.V.dofmap.index_map.size_local
    x, shape = model.V.tabulate_dof_coordinates()[:owned], (owned, model.gdim)
    with raised_together(model.jointed.mesh.comm):
        values = numbers_of(field(x)) if owned else np.zeros(shape)
        if values is None or values.shape != shape or not finite(values):
            returned = "no numbers" if values is None else f"an array of shape {values.shape}"
            raise ValueError(
                f"{name} returned {returned} for {owned} nodes; it must return {model.gdim} finite "
                "numbers per node."
            )
    return values


# Largest difference of initial velocity and support velocity, divided by the largest velocity. The
# support velocity is a finite difference.
SAME_VELOCITY = 1e-3


@dataclass(frozen=True, kw_only=True)
class InitialFields:
    """Initial displacement and velocity of a dynamic stage, in addition to the static state.

    Possible fields: a function from nodes (n, 3) to values (n, gdim), a UFL expression, a DOLFINx
    function, a vector of the unknowns, or one number per axis.

    Args:
        velocity: Velocity [m/s], zero by default; at supports equal to the support velocity.
        displacement: Displacement from the static state [m]; the joints respond to it.
    """

    velocity: NodalField | None = None
    displacement: NodalField | None = None


def check_settings(
    scheme: Scheme | None,
    control: StepControl | None,
    start: DynamicState | InitialFields | None,
    checkpoint: Checkpoints | None,
) -> tuple[Scheme, StepControl]:
    """Check arguments of a dynamic stage; return scheme and control, or the defaults of both."""
    scheme = EnergyConsistent() if scheme is None else scheme
    control = StepControl() if control is None else control
    valid = offers(scheme, "advance", "conserves")
    check_kind_of("scheme", scheme, valid, "a time scheme, such as Newmark()")
    check_kind_of("control", control, isinstance(control, StepControl), "a StepControl")
    valid = isinstance(start, DynamicState | InitialFields | None)
    check_kind_of("start", start, valid, "InitialFields or the state of an earlier outcome")
    valid = isinstance(checkpoint, Checkpoints | None)
    check_kind_of("checkpoint", checkpoint, valid, "a Checkpoints")
    return scheme, control


def field_vectors(model: Model, start: DynamicState | InitialFields | None) -> dict[str, PETSc.Vec]:
    """Return the given initial fields as nodal vectors by name (collective).

    Raises:
        ValueError: A value cannot be used as a field.
        JointsError: A dynamic state is given for a model with waves in a reservoir, which must
            start with the ground at rest.
    """
    if isinstance(start, DynamicState) and model.coupled is not None:
        raise JointsError(
            "start= cannot be a dynamic state with waves in a reservoir, which start with the "
            "ground at rest: the ground velocity at the end of the previous stage would act on the "
            "water as an impact. Run one stage with one motion instead."
        )
    fields = vars(start).items() if isinstance(start, InitialFields) else ()
    return {name: nodal_vector(model, name, field) for name, field in fields if field is not None}


def first_state(
    solver: StepSolver,
    dt: float,
    static: StaticState | None,
    start: DynamicState | None,
    fields: Mapping[str, PETSc.Vec],
) -> DynamicState:
    """Return the first state of a dynamic stage; its acceleration balances the forces (collective).

    The stage starts from the dynamic state ``start`` or, if None, from the last static state. To
    the static state ``fields`` may add a ``velocity`` [m/s] and a ``displacement`` [m]. The length
    of the first step is dt [s].
    """
    if start is not None:
        start = rescale(solver.system, start, 0, 0.0)
        _check_displacement(solver.system, start.displacement, start.time)
        return initial_state(
            solver,
            time=start.time,
            dt=dt,
            displacement=start.displacement,
            velocity=start.velocity,
            joints=start.joints,
            water=start.water,
        )
    system, velocity, added = solver.system, fields.get("velocity"), fields.get("displacement")
    if velocity is not None:
        _check_velocity(system, velocity, dt)
    if static is None and added is None:
        return initial_state(solver, dt=dt, velocity=velocity)
    # Use the joint tractions of the static state unchanged. A point that has slid is at the
    # friction limit: at a new evaluation rounding errors would decide whether the point slides.
    joints: Response | JointState | None = None if static is None else static.joints
    u = system.unknowns(None if static is None else static.displacement)
    if added is not None:
        if system.internal_forces is not None:
            before = static.joints if static else None
            joints = before.state if before else system.internal_forces.at_rest(u)
        u.axpy(1.0, system.unknowns(added))
    _check_displacement(system, u)
    return initial_state(solver, dt=dt, displacement=u, velocity=velocity, joints=joints)


def _check_velocity(system: MatrixSystem, v: PETSc.Vec, dt: float) -> None:
    """Check that an initial velocity equals the support velocity at supports (collective)."""
    rates = system.prescribed_rates(0.0, -INTERVAL * dt)
    error = v.getArray(readonly=True)[system.constrained] - (0.0 if rates is None else rates[0])
    largest = max(v.comm.tompi4py().allgather(float(np.abs(error).max(initial=0.0))))
    if largest > SAME_VELOCITY * v.norm(PETSc.NormType.INFINITY):
        raise ValueError(
            f"The initial velocity differs by {largest:.3g} m/s from the velocity of the supports; "
            "at supports, set it to the support velocity, zero for fixed supports."
        )


def _check_displacement(system: MatrixSystem, u: PETSc.Vec, time: float = 0.0) -> None:
    """Check that the support displacements do not jump at the start (collective)."""
    at_start = system.prescribed(time)
    present = u.getArray(readonly=True)[system.constrained]
    jump = float(np.abs(at_start - present).max(initial=0.0))
    if max(u.comm.tompi4py().allgather(jump)) > 1e-9 * u.norm():
        raise ValueError(
            f"The prescribed displacements of the supports at t = {time:g} s differ from the "
            "displacements at the start of the dynamic stage, which come from the static state and "
            "InitialFields, or from start=. Change one of them so that both agree."
        )


def in_words(value: Any) -> Any:
    """Return a setting for a results file; a nodal vector as text with its largest value."""
    if not isinstance(value, PETSc.Vec):
        return value
    return f"up to {value.norm(PETSc.NormType.INFINITY):.6g} along an axis"


def dynamic_loads(motion: Any, loads: Sequence[Any]) -> dict[str, Any]:
    """Return motion and additional loads of a dynamic stage, by name for a results file."""
    acting = {f"load {i}" if len(loads) > 1 else "load": load for i, load in enumerate(loads, 1)}
    return acting if motion is None else acting | {"ground motion": getattr(motion, "name", motion)}
