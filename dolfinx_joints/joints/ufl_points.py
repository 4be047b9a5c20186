# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL expressions of the gap, evaluated for arrays of points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import NDArray
from ufl.algorithms import strip_variables
from ufl.algorithms.renumbering import renumber_indices
from ufl.classes import Constant, FormArgument, GeometricQuantity
from ufl.corealg.traversal import traverse_unique_terminals

from dolfinx_joints.common.parameters import shown
from dolfinx_joints.laws.law import Floats

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
