# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL expressions of the gap or of the strain, evaluated for arrays of points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import NDArray
from ufl.algorithms import strip_variables
from ufl.algorithms.analysis import has_type
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.renumbering import renumber_indices
from ufl.classes import Constant, Derivative, FormArgument, GeometricQuantity
from ufl.corealg.traversal import traverse_unique_terminals

from dolfinx_joints.common.parameters import shown
from dolfinx_joints.laws.law import Floats

_BLOCK = 1024  # points evaluated at a time
_JIT = {"timeout": 60}  # longest time that a rank waits for another rank to compile [s]
_OF_A_MESH = (Constant, FormArgument, GeometricQuantity)


class UflPoints:
    """UFL expressions of an argument and variables, evaluated for arrays of points.

    The evaluation uses a private mesh with one cell per point; argument and variables are constant
    in each cell.

    Args:
        owner: Name of the law, for messages.
        shapes: Shapes of the internal variables by name.
        argument: Name of the argument.
        size: Number of components of the argument.

    Attributes:
        gap: The argument as a UFL variable, the gap of joint laws.
        internal: The variables as functions.
    """

    def __init__(
        self,
        owner: str,
        shapes: Mapping[str, tuple[int, ...]] | None = None,
        argument: str = "gap",
        size: int = 3,
    ) -> None:
        self._owner, self._argument = owner, argument
        self._texts: list[str] = []
        self._mesh = mesh.create_interval(MPI.COMM_SELF, _BLOCK, [0.0, 1.0])
        self._gap, *self.internal = (
            fem.Function(fem.functionspace(self._mesh, ("DG", 0, shape)), name=name)
            for name, shape in [(argument, (size,)), *(shapes or {}).items()]
        )
        self.gap = ufl.variable(self._gap)
        self._compiled: dict[str, tuple[fem.Expression, int]] = {}

    def expression(
        self,
        label: str,
        function: Callable[..., Any],
        shape: tuple[int, ...] = (),
        arguments: Sequence[Any] | None = None,
    ) -> Any:
        """Return the UFL expression of a function, by default of gap and internal variables.

        Raises:
            ValueError: The function fails, or the expression has another shape or other arguments.
        """
        kind = f"a UFL expression of shape {shape}" if shape else "a UFL scalar"
        wanted = f"it must be {kind} that depends on {self._argument} and internal variables only."
        try:
            result = function(*([self.gap, *self.internal] if arguments is None else arguments))
            result = (
                ufl.as_tensor(result) if isinstance(result, list | tuple) else ufl.as_ufl(result)
            )
        except Exception as error:
            raise ValueError(
                f"{self._owner}: {label} fails, {shown(error, str)}; {wanted}"
            ) from error
        allowed, returned = (self._gap, *self.internal), result.ufl_shape
        terminals = traverse_unique_terminals(result)
        foreign = [t for t in terminals if isinstance(t, _OF_A_MESH) and t not in allowed]
        if foreign or returned != shape or result.ufl_free_indices:
            fault = f"contains {shown(foreign[0], str)}" if foreign else f"has shape {returned}"
            raise ValueError(f"{self._owner}: {label} {fault}; {wanted}")
        if has_type(result, Derivative):  # strip_variables cannot rebuild the user's ufl.diff
            result = apply_derivatives(apply_algebra_lowering(result))
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

    def evaluate(self, name: str, *arguments: Floats) -> Floats:
        """Return the values of compiled expressions, shape (n, number of components).

        Args:
            name: Name given to `compile`.
            arguments: Values of the argument and of variables, each of shape (n, components) for
                one or more of them in their order; the expression must not depend on others.
        """
        compiled, size = self._compiled[name]
        columns = np.hstack([values for values in arguments if values.shape[1]])
        values = np.empty((len(columns), size))
        for first in range(0, len(columns), _BLOCK):
            block = columns[first : first + _BLOCK]
            cells = np.arange(len(block), dtype=np.int32)
            for function in (self._gap, *self.internal):
                size_of_one = function.function_space.dofmap.bs
                if block.shape[1]:
                    _fill(function, cells, block[:, :size_of_one])
                block = block[:, size_of_one:]
            result = compiled.eval(self._mesh, cells).reshape(len(cells), -1)
            values[first : first + _BLOCK] = result[:, :size]
        return values

    def as_text(self, **values: Any) -> str:
        """Return the law as text, with its expressions and the given values by name."""
        numbers = [f"{name}={value!r}" for name, value in values.items()]
        return f"{self._owner}({', '.join([*self._texts, *numbers])})"


def _fill(function: Any, cells: NDArray[np.int32], values: Floats) -> None:
    """Set the values of a cellwise constant function, shape (cells, components)."""
    dofs = function.function_space.dofmap.list[cells, 0]
    function.x.array.reshape(-1, values.shape[1])[dofs] = values
