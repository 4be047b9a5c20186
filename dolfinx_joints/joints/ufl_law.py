# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws in UFL: a stored energy or a traction as a function of the gap vector.

The gap (n, s1, s2) consists of the normal gap, including the initial gap, and the slip relative to
the state at rest. UFL computes the derivatives, FFCx generates the C code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Annotated, Any

from mpi4py import MPI

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import NDArray
from ufl.algorithms import strip_variables
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.renumbering import renumber_indices
from ufl.classes import Constant, FormArgument, GeometricQuantity
from ufl.corealg.traversal import traverse_unique_terminals

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import real, shown
from dolfinx_joints.laws.law import Floats, JointState, Losses, Response, Status
from dolfinx_joints.laws.losses import work
from dolfinx_joints.laws.path_mean import path_mean

_BLOCK = 1024  # points evaluated at a time
_JIT = {"timeout": 60}  # longest time that a rank waits for another rank to compile [s]
_OF_A_MESH = (Constant, FormArgument, GeometricQuantity)


class UflPoints:
    """UFL expressions of gap and internal variables, evaluated for arrays of points.

    The evaluation uses a private mesh with one cell per point; gap and variables are constant in
    each cell.

    Args:
        owner: Name of the law, for messages.
        names: Names of the internal variables.

    Attributes:
        gap: The gap as a UFL variable of three components.
        internal: The internal variables as scalar functions.
    """

    def __init__(self, owner: str, names: Sequence[str] = ()) -> None:
        self._owner = owner
        self._texts: list[str] = []
        self._mesh = mesh.create_interval(MPI.COMM_SELF, _BLOCK, [0.0, 1.0])
        spaces = [fem.functionspace(self._mesh, ("DG", 0, shape)) for shape in ((3,), ())]
        self._gap = fem.Function(spaces[0], name="gap")
        self.gap = ufl.variable(self._gap)
        self.internal = [fem.Function(spaces[1], name=name) for name in names]
        self._compiled: dict[str, tuple[fem.Expression, int]] = {}

    def expression(self, label: str, function: Callable[..., Any], size: int = 1) -> Any:
        """Return the UFL expression of a function of gap and internal variables.

        Raises:
            ValueError: The function fails, or the expression has another size or other arguments.
        """
        kind = "a UFL scalar" if size == 1 else f"a UFL vector of {size} components"
        wanted = f"it must be {kind} that depends on gap and internal variables only."
        try:
            result = function(self.gap, *self.internal)
            result = (
                ufl.as_vector(result) if isinstance(result, list | tuple) else ufl.as_ufl(result)
            )
        except Exception as error:
            raise ValueError(
                f"{self._owner}: {label} fails, {shown(error, str)}; {wanted}"
            ) from error
        allowed = (self._gap, *self.internal)
        terminals = traverse_unique_terminals(result)
        foreign = [t for t in terminals if isinstance(t, _OF_A_MESH) and t not in allowed]
        shape = result.ufl_shape
        valid = shape == (() if size == 1 else (size,)) and not result.ufl_free_indices
        if foreign or not valid:
            fault = f"contains {shown(foreign[0], str)}" if foreign else f"has shape {shape}"
            raise ValueError(f"{self._owner}: {label} {fault}; {wanted}")
        text = str(renumber_indices(strip_variables(result)))
        self._texts.append(f"{label.removeprefix('the ')}={text}")
        return result

    def compile(self, name: str, *expressions: Any) -> None:
        """Compile the components of expressions as one vector, for `evaluate`.

        Raises:
            ValueError: FFCx cannot compile the vector.
        """
        parts = [e[i] if i else e for e in expressions for i in np.ndindex(e.ufl_shape)]
        # Append the gap, because an expression that contains only constants has no mesh.
        vector = ufl.as_vector([*parts, self._gap[0]])
        middle = np.array([[0.5]])
        try:
            compiled = fem.Expression(vector, middle, jit_options=_JIT, dtype=np.float64)
        except Exception as error:
            raise ValueError(
                f"{self._owner}: FFCx cannot compile the expression, {shown(error, str)}."
            ) from error
        self._compiled[name] = compiled, len(parts)

    def evaluate(self, name: str, gap: Floats, internal: Floats | None = None) -> Floats:
        """Return the values of compiled expressions, shape (n, number of components).

        Args:
            name: Name given to `compile`.
            gap: Gap, shape (n, 3), [m].
            internal: Internal variables, shape (n, number of variables), or None.
        """
        compiled, size = self._compiled[name]
        values = np.empty((len(gap), size))
        arguments = gap if internal is None or not self.internal else np.hstack([gap, internal])
        for first in range(0, len(gap), _BLOCK):
            block = arguments[first : first + _BLOCK]
            cells = np.arange(len(block), dtype=np.int32)
            _fill(self._gap, cells, block[:, :3])
            for k, variable in enumerate(self.internal, start=3):
                _fill(variable, cells, block[:, k : k + 1])
            result = compiled.eval(self._mesh, cells).reshape(len(block), -1)
            values[first : first + _BLOCK] = result[:, :size]
        return values

    def as_text(self, **values: float) -> str:
        """Return the law as text, with its expressions and the given values by name."""
        numbers = [f"{name}={value!r}" for name, value in values.items()]
        return f"{self._owner}({', '.join([*self._texts, *numbers])})"


def _fill(function: Any, cells: NDArray[np.int32], values: Floats) -> None:
    """Set the values of a cellwise constant function, shape (cells, components)."""
    dofs = function.function_space.dofmap.list[cells, 0]
    function.x.array.reshape(-1, values.shape[1])[dofs] = values


@dataclass(frozen=True, eq=False, repr=False)
@checked
class PotentialJoint:
    """Reversible joint law with the traction t = d psi / d gap of a stored energy psi(gap).

    Example::

        law = PotentialJoint(
            lambda g: 0.5 * k_n * ufl.min_value(g[0], 0.0) ** 2,
            normal_stiffness=k_n,
            shear_stiffness=0.0,
        )

    The traction may have kinks, as here at g[0] = 0, but no jumps. The energy-consistent scheme
    uses the mean traction over the path of a step (`path_mean`).

    Attributes:
        energy: Function of the gap (a UFL vector) that returns psi [J/m^2] (a UFL scalar).
        normal_stiffness: k_n of the closed joint, for modes and singular tangents.
        shear_stiffness: k_s of the closed joint, for modes and singular tangents.

    Raises:
        ValueError: ``energy`` does not return a scalar expression that depends only on the gap.
    """

    energy: Callable[[Any], Any]
    _: KW_ONLY
    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]
    _points: UflPoints = field(init=False)

    def __post_init__(self) -> None:
        points = UflPoints(type(self).__name__)
        psi = points.expression("energy", self.energy)
        traction = ufl.diff(psi, points.gap)
        points.compile("energy", psi)
        points.compile("traction", traction, ufl.diff(traction, points.gap))
        object.__setattr__(self, "_points", points)

    def __repr__(self) -> str:
        """Return the energy as UFL text, and the stiffness."""
        return self._points.as_text(**_stiffness(self))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Return psi of each point, shape (n,), [J/m^2]."""
        return self._points.evaluate("energy", _gap_of(state))[:, 0]

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return the response at a gap of shape (n, 3), [m], which does not depend on history."""
        after = _after(gap, state)
        return _response(after, *self._tractions(_gap_of(after)))

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Return the mean traction of a step; its work equals the change of psi (`path_mean`)."""
        after = _after(gap, state)
        return _response(after, *path_mean(self._tractions, _gap_of(state), _gap_of(after)))

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses: work of (traction - mean traction over the path)."""
        start, end = _gap_of(before), _gap_of(answer.state)
        mean, _ = path_mean(self._tractions, start, end)
        return Losses(answer.dissipation, work(traction - mean, end - start))

    def _tractions(self, gap: Floats) -> tuple[Floats, Floats]:
        values = self._points.evaluate("traction", gap)
        return values[:, :3], values[:, 3:].reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False, repr=False)
@checked
class TractionJoint:
    """Joint law with a traction t(gap, internal variables) at the end of a step.

    Example::

        law = TractionJoint(
            lambda g, kappa: ufl.as_vector([k_n * ufl.exp(-kappa / length) * g[0], 0.0, 0.0]),
            internal={"kappa": (0.0, lambda g, kappa: ufl.max_value(kappa, g[0]))},
            normal_stiffness=k_n,
            shear_stiffness=0.0,
        )

    Internal variables are scalars. Update functions receive the gap at the end of the step and the
    variables at the start of the step. Traction and energy receive gap and variables of the same
    time. In ``traction``, ``ufl.diff(psi(g, kappa), g)`` keeps the variables fixed.

    All schemes use the traction at the end of the step (backward Euler). The dissipation is the
    work of the mean of start and end traction minus the change of the stored energy. The numerical
    loss is obtained by difference, so the energy balance does not check the law (`LawWithLosses`).
    Without ``energy`` all work counts as dissipation, so an elastic joint that returns energy has
    negative dissipation.

    Attributes:
        traction: Function of the gap (n, s1, s2) and the internal variables in their order that
            returns t [Pa], a UFL vector of three components.
        internal: Initial value and update function of each internal variable by name.
        energy: Function of the same arguments that returns the stored energy [J/m^2], or None.
        normal_stiffness: k_n of the closed joint, for modes and singular tangents.
        shear_stiffness: k_s of the closed joint, for modes and singular tangents.

    Raises:
        ValueError: A function does not return a UFL expression of its arguments of correct shape.
    """

    traction: Callable[..., Any]
    _: KW_ONLY
    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]
    internal: Mapping[str, tuple[float, Callable[..., Any]]] = field(default_factory=dict)
    energy: Callable[..., Any] | None = None
    _points: UflPoints = field(init=False)

    def __post_init__(self) -> None:
        owner, internal = type(self).__name__, self.internal
        _check_internal(owner, internal)
        points = UflPoints(owner, tuple(internal))
        traction = points.expression("traction", self.traction, size=3)
        psi = points.expression("energy", self.energy or (lambda *_: 0.0))
        updates = [
            points.expression(f"the update of {name}", update)
            for name, (_, update) in internal.items()
        ]
        points.compile("state", psi, traction)
        # Evaluate derivatives in the traction before the variables become functions of the gap.
        ended = apply_derivatives(apply_algebra_lowering(traction))
        ended = ufl.replace(ended, dict(zip(points.internal, updates, strict=True)))
        points.compile("end", ended, ufl.diff(ended, points.gap), *updates)
        object.__setattr__(self, "_points", points)

    def __repr__(self) -> str:
        """Return the expressions as UFL text, initial values and stiffness."""
        first = {name: float(value) for name, (value, _) in self.internal.items()}
        return self._points.as_text(**first, **_stiffness(self))

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables."""
        return tuple(self.internal)

    def initial_variables(self, gap: Floats) -> Floats:
        """Return the internal variables at rest, shape (n, number of variables)."""
        return np.tile([float(value) for value, _ in self.internal.values()], (len(gap), 1))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Return the energy of each point, zero without ``energy``, shape (n,), [J/m^2]."""
        return self._points.evaluate("state", _gap_of(state), state.internal)[:, 0]

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return traction and new variables at the end of a step at a gap (n, 3), [m]."""
        before, after = _gap_of(state), _after(gap, state)
        values = self._points.evaluate("end", _gap_of(after), state.internal)
        traction, tangent = values[:, :3], values[:, 3:12].reshape(-1, 3, 3)
        after = replace(after, internal=values[:, 12:])
        start = self._points.evaluate("state", before, state.internal)
        mean = 0.5 * (start[:, 1:] + traction)
        lost = np.einsum("ij,ij->i", mean, _gap_of(after) - before)
        lost -= self.stored_energy(after) - start[:, 0]
        return replace(_response(after, traction, tangent), dissipation=lost)


def _stiffness(law: PotentialJoint | TractionJoint) -> dict[str, float]:
    return {"normal_stiffness": law.normal_stiffness, "shear_stiffness": law.shear_stiffness}


def _check_internal(owner: str, internal: Any) -> None:
    wanted = 'it must be {"name": (initial value, update function), ...}.'
    if not isinstance(internal, Mapping):
        raise ValueError(f"{owner}: internal is {shown(internal)}; {wanted}")
    for name, item in internal.items():
        valid = isinstance(name, str) and bool(name.strip())
        valid = valid and isinstance(item, tuple) and len(item) == 2
        if not (valid and math.isfinite(real(item[0])) and callable(item[1])):
            raise ValueError(f"{owner}: internal has {shown(name)}: {shown(item)}; {wanted}")


def _gap_of(state: JointState) -> Floats:
    """Return the gap passed to expressions: normal gap and slip since rest, (n, 3), [m].

    A tiny negative value replaces a zero normal gap, which counts as closed: UFL has no derivative
    of ``min_value(g[0], 0.0)`` at zero.
    """
    normal = np.where(state.gap[:, 0] == 0.0, -np.finfo(float).tiny, state.gap[:, 0])
    return np.column_stack([normal, state.elastic_slip])


def _after(gap: Floats, state: JointState) -> JointState:
    """Return the state at a gap; all slip is elastic."""
    slip = state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]
    return JointState(gap=gap.copy(), elastic_slip=slip)


def _response(after: JointState, traction: Floats, tangent: Floats) -> Response:
    """Return the response of a law without dissipation; the normal gap determines the status.

    Closed points without shear traction and shear tangent are frictionless.
    """
    # Remove the traction due to the tiny negative gap of `_gap_of`.
    threshold = 2.0 * np.finfo(float).tiny * np.abs(tangent).max(axis=(1, 2))
    traction = np.where(np.abs(traction) <= threshold[:, None], 0.0, traction)
    sheared = (traction[:, 1:] != 0.0).any(axis=1) | (tangent[:, 1:] != 0.0).any(axis=(1, 2))
    closed = np.where(sheared, Status.STICK, Status.FRICTIONLESS)
    return Response(
        traction=np.ascontiguousarray(traction),
        tangent=np.ascontiguousarray(tangent),
        state=after,
        dissipation=np.zeros(len(after.gap)),
        status=np.where(after.gap[:, 0] > 0.0, Status.OPEN, closed).astype(np.int8),
    )
