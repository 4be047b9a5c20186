# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What Python values hold, as texts that compare equal from one run of a script to the next.

Data are taken whole: fields and attributes, arrays by their SHA-256, and of functions and classes
of the user the code with the variables it refers to. Code of installed packages, as of Python's
own, counts as the same.
"""

from __future__ import annotations

import functools
import hashlib
import sys
import types
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.kernels import cell_content, globals_read, instructions
from dolfinx_joints.common.parameters import LONGEST_SHOWN, shown
from dolfinx_joints.joints.ufl_law import PotentialJoint, TractionJoint
from dolfinx_joints.mesh.jointed_mesh import JointedMesh
from dolfinx_joints.model.model import Model

HASH = "sha256:"

_PLAIN = (bool, int, float, complex, str, bytes, types.NoneType, types.EllipsisType)
_INSTALLED = {"site-packages", "dist-packages"}
# Their values are spread over the ranks, in memory that is not Python's.
_SPREAD = ("basix", "dolfinx", "mpi4py", "petsc4py", "ufl")
_MOST_ITEMS = 50  # of a container, before one hash stands for them


class Inventory:
    """Facts of values by name.

    Attributes:
        facts: What the values hold; a name is a path such as ``law of joint_1.normal_stiffness``.
        unknown: Paths of what cannot be looked into, with its type.
    """

    def __init__(self) -> None:
        """Begin without values."""
        self.facts: dict[str, str] = {}
        self.unknown: list[str] = []
        # The values as well, so that no other takes their address.
        self._seen: dict[int, tuple[str, Any]] = {}

    def add(self, name: str, value: Any) -> None:
        """Add what a value holds, and what the values hold that it holds."""
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, _PLAIN):
            self.facts[name] = _text(repr(value))
        elif isinstance(value, np.ndarray) and value.dtype != object:
            content = np.ascontiguousarray(value).tobytes()
            self.facts[name] = _hash(f"{value.dtype.str} {value.shape}".encode(), content)
        elif isinstance(value, PotentialJoint | TractionJoint):
            self.facts[name] = _text(repr(value))  # all its expressions and numbers
        elif isinstance(value, types.ModuleType):
            self.facts[name] = value.__name__
        elif id(value) in self._seen:
            self.facts[name] = f"that of {self._seen[id(value)][0]}"
        else:
            # Whether equal constants are one object, differs from one start of Python to the next.
            if not isinstance(value, tuple | frozenset):
                self._seen[id(value)] = name, value
            self._look_into(name, value)

    def _look_into(self, name: str, value: Any) -> None:
        if isinstance(value, types.FunctionType):
            self._function(name, value)
        elif isinstance(value, types.MethodType):
            self.add(name, value.__func__)
            self.add(f"{name}.self", value.__self__)
        elif isinstance(value, type):
            self._class(name, value)
        elif isinstance(value, dict | list | tuple | np.ndarray):
            self._container(name, value)
        elif isinstance(value, set | frozenset):
            self._container(name, sorted(value, key=repr))
        else:
            self._object(name, value)

    def _container(self, name: str, items: Any) -> None:
        inner = Inventory()
        inner._seen = self._seen
        pairs = items.items() if isinstance(items, Mapping) else enumerate(items)
        for key, item in pairs:
            inner.add(f"{name}[{shown(key)}]", item)
        self.unknown += inner.unknown
        self.facts[name] = f"{type(items).__name__} of {len(items)}"
        if len(inner.facts) > _MOST_ITEMS:
            self.facts[name] = hashed(sorted(inner.facts.items()))
        else:
            self.facts |= inner.facts

    def _function(self, name: str, function: types.FunctionType) -> None:
        """Code, and the values of variables from outside and defaults."""
        code, known = function.__code__, _installed(function.__module__)
        self.facts[name] = (
            f"{function.__module__}.{function.__qualname__}"
            if known
            else _hash(instructions(code).encode())
        )
        outside = dict(zip(code.co_freevars, function.__closure__ or (), strict=True))
        values = {variable: cell_content(cell) for variable, cell in outside.items()}
        if not known:
            used = sorted(set(globals_read(code)) & function.__globals__.keys())
            values |= {variable: function.__globals__[variable] for variable in used}
        values |= {"defaults": function.__defaults__} if function.__defaults__ else {}
        values |= function.__kwdefaults__ or {}
        for variable, value in (values | vars(function)).items():
            self.add(f"{name}.{variable}", value)

    def _class(self, name: str, kind: type) -> None:
        """Its name; of a class of the user what it and its bases define too."""
        self.facts[name] = kind.__qualname__
        own = [base for base in kind.__mro__ if not _installed(base.__module__)]
        defined = {key: item for base in reversed(own) for key, item in vars(base).items()}
        for key, item in defined.items():
            if (key.startswith("__") and key != "__call__") or key == "_abc_impl":
                continue
            for inside in ("__func__", "fget", "func"):
                item = getattr(item, inside, item)
            if not isinstance(item, types.MemberDescriptorType | types.GetSetDescriptorType):
                self.add(f"{name}.{key}", item)

    def _object(self, name: str, value: Any) -> None:
        """Its class, and its state as copies of it would be given."""
        kind = type(value)
        inner = getattr(value, "py_func", None)  # what Numba compiled
        if isinstance(value, functools._lru_cache_wrapper):
            inner = value.__wrapped__
        if isinstance(inner, types.FunctionType | types.MethodType):
            self.add(name, inner)
            return
        spread = kind.__module__.split(".")[0] in _SPREAD or isinstance(value, Model | JointedMesh)
        try:
            state = None if spread else value.__reduce_ex__(4)
        except Exception:  # whatever a class that cannot be copied raises
            state = None
        if state is None:
            self.facts[name] = kind.__qualname__
            self.unknown.append(f"{name} ({kind.__qualname__})")
        elif isinstance(state, str):
            self.facts[name] = f"{kind.__module__}.{state}"
        else:
            if id(kind) not in self._seen:
                self._seen[id(kind)] = name, kind
                self._class(name, kind)
            self.facts[name] = kind.__qualname__
            for key, item in _parts(state):
                # What an object has worked out of itself so far tells nothing new.
                if not isinstance(getattr(kind, key, None), functools.cached_property):
                    self.add(f"{name}.{key}", item)


def _parts(state: tuple[Any, ...]) -> Iterator[tuple[str, Any]]:
    """Names and values in what ``__reduce_ex__`` returned."""
    _, arguments, attributes, items, pairs = (*state, None, None, None)[:5]
    made_of = [a for a in arguments if not isinstance(a, type)]
    if made_of:
        yield "arguments", made_of
    dicts = attributes if isinstance(attributes, tuple) else (attributes,)  # and slots
    for each in dicts:
        if isinstance(each, Mapping):
            yield from each.items()
        elif each is not None:
            yield "state", each
    if items is not None:
        yield "items", list(items)
    if pairs is not None:
        yield "items", dict(pairs)


@functools.cache
def _installed(module: str | None) -> bool:
    """Whether a module is Python's, this package's, or of an installed package."""
    root = (module or "").split(".")[0]
    if root in sys.stdlib_module_names or root == __name__.split(".")[0]:
        return True
    file = getattr(sys.modules.get(root), "__file__", None)
    return file is not None and not _INSTALLED.isdisjoint(Path(file).parts)


def _text(text: str) -> str:
    return text if len(text) <= LONGEST_SHOWN else _hash(text.encode())


def hashed(value: Any) -> str:
    """SHA-256 of the text that stands for a value of plain ones."""
    return _hash(repr(value).encode())


def _hash(*parts: bytes) -> str:
    return HASH + hashlib.sha256(b"\0".join(parts)).hexdigest()
