# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fingerprint of a run: declared parameters, and sums of the assembled matrices and vectors."""

from __future__ import annotations

import copyreg
import functools
import hashlib
import sys
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import parameters
from dolfinx_joints.common.kernels import cell_content, globals_read, instructions
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.common.parameters import LONGEST_SHOWN, number_at, numbers_of, shown
from dolfinx_joints.loads.load import Load, load_names
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.jointed_mesh import JointedMesh
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem

HASH = "sha256:"
SAME = 1e-9  # Relative tolerance: sums on different numbers of ranks differ by rounding.
PARTS = 1021  # Number of sums that represent a vector; shorter vectors are compared by entry.

_PLAIN = (bool, int, float, complex, str, bytes, types.NoneType, types.EllipsisType)
_INSTALLED = {"site-packages", "dist-packages"}
_DISTRIBUTED = ("basix", "dolfinx", "mpi4py", "petsc4py", "ufl")


def fingerprint(
    model: Model,
    system: MatrixSystem,
    nodes: NodeNumbering,
    settings: Mapping[str, Any],
    loads: Sequence[Load],
    times: Floats,
) -> tuple[dict[str, Any], list[str]]:
    """Return the facts of a run by name, and the objects that cannot be compared (collective).

    Facts do not depend on the number of ranks; the facts of rank 0 are used. ``settings`` may
    contain nodal vectors. ``loads`` act in addition to the loads of the model. For a static state,
    with a single time [s], functions of time are compared by their value at that time.
    """
    of_run, assembled = Parameters(), Parameters(assembled=True, functions=len(times) > 1)
    vectors = {name: value for name, value in settings.items() if isinstance(value, PETSc.Vec)}
    laws = {} if model.contact is None else model.contact.laws
    for name, value in {**settings, **{f"law of {n}": law for n, law in laws.items()}}.items():
        if name not in vectors:
            of_run.add(name, value)
    # A law may contain arrays for the points of its rank.
    of_ranks = model.jointed.mesh.comm.allgather(_hash(sorted(of_run.facts.items())))
    if len(set(of_ranks)) > 1:
        of_run.facts["laws as each rank holds them"] = _hash(of_ranks)
    acting = [*model.loads, *loads]
    named = {f"load {n}": load for n, load in zip(load_names(acting), acting, strict=True)}
    joints = model.parameters["joints"]
    named |= {f"joints.{n}": getattr(joints, n) for n in ("initial_gaps", "quadrature")}
    for name, value in (model.parameters | named).items():
        if name not in ("joints", "loads"):
            assembled.add(name, value)
    numbers = _numbers(model, system, nodes, vectors, times)
    return of_run.facts | assembled.facts | numbers, of_run.unknown + assembled.unknown


class Parameters:
    """Parameters of objects as texts by path, such as ``law of joint_1.normal_stiffness``.

    The texts are the same each time a script is started. They contain the class of an object and
    its parameters, and the SHA-256 of arrays. User-defined functions and classes are described by
    their code and the variables that the code reads. Installed packages are assumed to be
    unchanged. If ``assembled`` is true, fields and forms of DOLFINx are omitted, because matrices
    and vectors are compared separately. If ``functions`` is false, functions are not compared.
    Results are ``facts``, texts by path, and ``unknown``, paths and classes of objects that cannot
    be compared.
    """

    def __init__(self, *, assembled: bool = False, functions: bool = True) -> None:
        self.facts: dict[str, str] = {}
        self.unknown: list[str] = []
        self._assembled, self._functions = assembled, functions
        # Keep the objects as well, so that their addresses are not reused.
        self._paths: dict[int, tuple[str, Any]] = {}

    def add(self, path: str, value: Any) -> None:
        """Add an object and its parameters."""
        parts: dict[str, Any] = {}
        value = value.item() if isinstance(value, np.generic) else value
        numbers = numbers_of(value) if isinstance(value, list | tuple) else None
        if isinstance(value, _PLAIN):
            text = repr(value)
        elif numbers is not None and numbers.size:
            text = repr(numbers.tolist())
        elif isinstance(value, np.ndarray) and value.dtype != object:
            content = hashlib.sha256(value.tobytes()).digest()
            text = _hash((value.dtype.str, value.shape, content))
        elif callable(value) and not (self._functions or isinstance(value, type)):
            text = "a function"
        elif self._assembled and _is_distributed(value):
            text = type(value).__qualname__
        elif id(value) in self._paths:
            text = f"that of {self._paths[id(value)][0]}"
        else:
            # Do not register constants and declared objects: equal values may be several objects.
            if not isinstance(value, tuple | frozenset) and parameters(value) is None:
                self._paths[id(value)] = path, value
            try:
                text, parts = _describe(value)
            except Exception:  # Classes that cannot be copied raise any error.
                text = type(value).__qualname__
                self.unknown.append(f"{path} ({text})")
        self.facts[path] = text if len(text) <= LONGEST_SHOWN else _hash(text)
        for key, part in parts.items():
            self.add(path + key, part)


def _describe(value: Any) -> tuple[str, dict[str, Any]]:
    """Return the text of an object, and the parts of the object by the ending of their path.

    Raises:
        TypeError: The object is distributed over the ranks.
        Exception: Any error, if the object cannot be copied.
    """
    kind = type(value)
    if _is_distributed(value):
        raise TypeError
    if isinstance(value, set | frozenset):
        value = sorted(value, key=repr)
    if isinstance(value, dict | list | tuple | np.ndarray):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return f"{kind.__name__} of {len(value)}", {f"[{shown(k)}]": item for k, item in pairs}
    function = value
    if not isinstance(value, types.FunctionType):  # A function wrapped by Numba or a cache.
        function = getattr(value, "py_func", getattr(value, "__wrapped__", None))
    parts: dict[str, Any] = {}
    if isinstance(value, types.ModuleType):
        text = value.__name__
    elif isinstance(function, types.FunctionType):
        text, parts = _function(function)
    elif isinstance(value, types.MethodType):
        text, parts = "method", {"function": value.__func__, "self": value.__self__}
    elif isinstance(value, type):
        text, parts = value.__qualname__, _members(value)
    else:
        declared = parameters(value)
        text, parts = kind.__qualname__, _state(value) if declared is None else declared
    return text, {f".{key}": part for key, part in parts.items()}


def _function(function: types.FunctionType) -> tuple[str, dict[str, Any]]:
    """Return the code of a function, and the outer variables and defaults that the code reads."""
    code, outside = function.__code__, function.__globals__
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    read = {name: cell_content(cell) for name, cell in cells} | vars(function)
    read |= {"__defaults__": function.__defaults__, "__kwdefaults__": function.__kwdefaults__}
    if _is_installed(function.__module__):
        return f"{function.__module__}.{function.__qualname__}", read
    names = sorted(outside.keys() & globals_read(code))
    return _hash(instructions(code)), read | {name: outside[name] for name in names}


def _members(kind: type) -> dict[str, Any]:
    """Return the members defined by a class and by its base classes that are not installed."""
    bases = [base for base in reversed(kind.__mro__) if not _is_installed(base.__module__)]
    members = {key: item for base in bases for key, item in vars(base).items()}
    return {
        key: getattr(item, "func" if isinstance(item, functools.cached_property) else "fget", item)
        for key, item in members.items()
        if key == "__call__" or not key.startswith(("__", "_abc_"))
    }


def _state(value: Any) -> dict[str, Any]:
    """Return the class of an object and the data from which Python would copy the object."""
    kind, registered = type(value), copyreg.dispatch_table.get(type(value))
    reduced = registered(value) if registered else value.__reduce_ex__(4)
    parts = [*reduced] if isinstance(reduced, tuple) else [reduced]
    parts = [[*part] if isinstance(part, Iterator) else part for part in parts]
    attributes = parts.pop(2) if len(parts) > 2 and isinstance(parts[2], dict) else {}
    state = {"__class__": kind, "__reduce__": parts}
    for name, attribute in attributes.items():  # Cached properties follow from other attributes.
        if not isinstance(getattr(kind, name, None), functools.cached_property):
            state[name] = attribute
    return state


def _is_distributed(value: Any) -> bool:
    """Return True if the values are distributed over ranks, in memory outside Python."""
    root = type(value).__module__.split(".")[0]
    return root in _DISTRIBUTED or isinstance(value, Model | JointedMesh)


@functools.cache
def _is_installed(module: str | None) -> bool:
    """Return True for a module of Python, of this package or of an installed package."""
    root = (module or "").split(".")[0]
    if root in sys.stdlib_module_names or root == __name__.split(".")[0]:
        return True
    file = getattr(sys.modules.get(root), "__file__", None)
    return file is not None and not _INSTALLED.isdisjoint(Path(file).parts)


def _hash(value: Any) -> str:
    """Return the SHA-256 of plain values."""
    return HASH + hashlib.sha256(repr(value).encode()).hexdigest()


def _numbers(
    model: Model,
    system: MatrixSystem,
    nodes: NodeNumbering,
    vectors: Mapping[str, PETSc.Vec],
    times: Floats,
) -> dict[str, Floats]:
    """Return sums of mesh, joint points, functions of time, matrices and vectors (collective).

    A matrix is represented by its product with a vector of weights at the unconstrained dofs.
    """
    comm, owned = model.jointed.mesh.comm, nodes.number[: model.V.dofmap.index_map.size_local]
    dofs = (model.gdim * owned[:, None] + np.arange(model.gdim)).ravel()
    if system.coupled is not None:
        dofs = np.append(dofs, model.num_dofs + system.coupled.numbers)
    weights, free = _weights(dofs), system.stiffness.createVecRight()
    free.setArray(weights)
    free.getArray()[system.constrained] = 0.0
    matrices = {"mass": system.mass, "stiffness": system.stiffness, "dashpots": system.dashpots}
    named = list(zip(system.names_of_patterns, system.patterns, strict=True))
    start = system.loads_by_name(float(times[0]), 1.0)
    vectors = {
        **{f"{name} matrix": m * free for name, m in matrices.items() if m is not None},
        **{f"pattern {i} of the loads": pattern for i, (_, (pattern, _)) in enumerate(named, 1)},
        **{f"load {name} at the start": force for name, force in start.items()},
        **vectors,
    }
    rows: dict[str, tuple[int, Any]] = {"node coordinates": (nodes.first, nodes.positions)}
    if (contact := system.contact) is not None:
        first = contact.operator.matrix.getOwnershipRange()[0] // 3
        points = {"areas": contact.operator.areas, "joints": contact.operator.joint}
        points["initial gaps"] = contact.initial_gap
        rows |= {f"{name} of the joint points": (first, part) for name, part in points.items()}
    local = {
        name: (np.arange(part.size) + first * np.prod(part.shape[1:], dtype=int), part)
        for name, (first, part) in rows.items()
    }
    for name, vector in vectors.items():  # Vectors of the body have no dofs of the water.
        local[name] = dofs[: vector.getLocalSize()], vector.getArray(readonly=True)
    numbers = {name: summed(comm, _sums(*part)) for name, part in local.items()}
    # Evaluate all functions at one time before the next: one call computes all motion components.
    factors = [[number_at(n, f, float(t)) for n, (_, f) in named] for t in times]
    supports = [system.prescribed(float(t)) @ weights[system.constrained] for t in times]
    histories = [*np.transpose(factors), summed(comm, np.array(supports))]
    numbers["functions of time"] = np.array([_sums(np.arange(len(h)), h) for h in histories])
    return numbers


def _weights(numbers: Ints) -> Floats:
    return np.asarray(1.5 + np.sin(numbers.astype(np.float64)))


def _sums(numbers: Ints, values: NDArray[Any]) -> Floats:
    """Return PARTS weighted sums; the value with number i is in the sum i % PARTS."""
    weighted = _weights(numbers) * values.ravel()
    return np.bincount(numbers % PARTS, weighted, minlength=PARTS).astype(np.float64)


def first_difference(saved: Mapping[str, Any], current: Mapping[str, Any]) -> str | None:
    """Return a text on the first difference between two runs, None if the runs agree."""
    facts = {**current, **saved}
    for name in sorted(facts, key=lambda name: not isinstance(facts[name], str)):
        old, new = saved.get(name), current.get(name)
        if old is None or new is None:
            return f"{name}: missing in {'the checkpoint' if old is None else 'this run'}"
        if isinstance(old, str) and old != new:
            text = f"{old} in the checkpoint, {new} in this run"
            return f"{name}: {'different' if HASH in text else text}"
        if not isinstance(old, str) and not _nearly_equal(np.asarray(old), np.asarray(new)):
            return f"{name}: the numbers differ"
    return None


def _nearly_equal(old: Floats, new: Floats) -> bool:
    """Return True if numbers are equal up to rounding errors, relative to the largest in a row."""
    largest = np.abs(old).max(axis=-1, keepdims=True)
    return old.shape == new.shape and bool((np.abs(old - new) <= SAME * largest).all())
