# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops whose machine code is cached on disk by everything that it depends on.

numba's cache depends on the date of one file only: it misses changes of functions and constants in
other files. Here the key is the `CallGraph` of a loop, read from the functions in memory. An edit
therefore recompiles exactly the loops that use the edited code.
"""

from __future__ import annotations

import builtins
import dis
import hashlib
import logging
import os
import pickle
import secrets
import sys
from collections.abc import Iterator
from functools import partial
from inspect import CO_GENERATOR, CO_VARARGS, CO_VARKEYWORDS
from itertools import count
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import CellType, CodeType, EllipsisType, FunctionType, ModuleType, NoneType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import config, event, sigutils
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.extending import register_jitable

from dolfinx_joints.common.progress import LOGGER

_PLAIN = (bool, int, float, complex, str, bytes, NoneType, EllipsisType, range)
# Types of arguments whose name determines the compiled code.
_NAMED = (types.Array, types.Boolean, types.NoneType, types.Number, types.UnicodeType)
# Modules whose code changes only with the versions, which are part of the key.
_VERSIONED = {*sys.stdlib_module_names, "llvmlite", "numba", "numpy"}
_FOLDERS = tuple(str(Path(str(m.__file__)).parent) for m in (os, llvmlite, numba, np))
_VERSIONS = (sys.version, numba.__version__, llvmlite.__version__, np.__version__)


class UnknownValueError(Exception):
    """Error for a loop that uses a value whose changes cannot be detected."""


class CallGraph:
    """Everything that machine code depends on: functions, constants, fields of named tuples.

    Attributes:
        facts: Descriptions in the order in which the values are visited. They are equal in two
            processes if and only if the code is equal.
    """

    def __init__(self) -> None:
        self.facts: list[str] = []
        # Store the values too, so that no other object gets the same address.
        self._numbers: dict[int, tuple[int, Any]] = {}

    def add(self, value: Any) -> None:
        """Add a value and everything that it refers to.

        Raises:
            UnknownValueError: The value is of an unsupported type.
        """
        if isinstance(value, _PLAIN):
            self._fact(type(value).__name__, value)
        elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
            layout = value.flags.c_contiguous, value.flags.f_contiguous, value.flags.aligned
            content = hashlib.sha256(value.tobytes()).hexdigest()
            self._fact("array", value.dtype, value.shape, layout, content)
        elif isinstance(value, tuple | list):
            self._tuple(value)
        elif isinstance(value, dict):
            self._tuple([item for key in sorted(value) for item in (key, value[key])])
        elif isinstance(value, set | frozenset):
            self._tuple(sorted(value, key=repr))
        elif id(value) in self._numbers:
            self._fact("as", self._numbers[id(value)][0])
        else:
            self._numbers[id(value)] = len(self._numbers), value
            self._describe(value)

    def _fact(self, *parts: Any) -> None:
        self.facts.append(repr(parts))

    def _tuple(self, values: Any) -> None:
        self._fact(type(values).__name__, len(values))
        if isinstance(values, tuple) and type(values) is not tuple:
            self.add(type(values))
        for each in values:
            self.add(each)

    def _describe(self, value: Any) -> None:
        if isinstance(value, Dispatcher):
            self._fact("compiled")
            self.add(value.targetoptions)
            self.add(value.py_func)
        elif isinstance(value, types.Type):
            self._type(value)
        elif isinstance(value, ModuleType):
            self._fact("module", value.__name__)
        elif isinstance(value, FunctionType):
            self._function(value)
        elif isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields"):
            self._fact(value.__module__, value.__qualname__, value._fields)
            self.add(vars(value)["_field_defaults"])
        elif isinstance(value, type) and issubclass(value, BaseException):
            self._fact(value.__module__, value.__qualname__)  # compiled code raises it by name
        elif _is_versioned(value):
            self._fact(value.__module__, value.__qualname__)
        elif isinstance(value, np.ufunc) and getattr(np, value.__name__, None) is value:
            self._fact("numpy", value.__name__)
        else:
            raise UnknownValueError(f"{value!r} ({type(value).__qualname__})")

    def _type(self, kind: types.Type) -> None:
        """Add the type of an argument, or a function of a library."""
        self._fact(type(kind).__name__, str(kind) if isinstance(kind, _NAMED) else "")
        if isinstance(kind, types.BaseTuple):
            self.add(getattr(kind, "instance_class", None))
            for each in kind:
                self.add(each)
        elif isinstance(kind, types.Dispatcher):
            self.add(kind.dispatcher)
        elif isinstance(kind, types.ExternalFunction):
            self._fact(kind.symbol, str(kind.sig))
        elif isinstance(kind, types.Function):
            self.add(kind.typing_key)
        elif isinstance(kind, types.Literal):
            self.add(kind.literal_value)
        elif isinstance(kind, types.Omitted):
            self.add(kind.value)
        elif not isinstance(kind, _NAMED):
            raise UnknownValueError(f"an argument of the type {kind}")

    def _function(self, function: FunctionType) -> None:
        """Add code, global and enclosing variables, defaults, and overloads of a function."""
        self._fact(function.__module__, function.__qualname__)
        code, outside = function.__code__, function.__globals__
        if _is_versioned(function) and code.co_filename.startswith((*_FOLDERS, "<frozen ")):
            return
        self._fact(instructions(code))
        for name in dict.fromkeys(globals_read(code)):
            self._fact(name, name in outside or hasattr(builtins, name))
            if name in outside:
                self._variable(outside[name], code)
        self.add([cell_content(cell) for cell in function.__closure__ or ()])
        self.add([function.__defaults__, function.__kwdefaults__])
        typing = cpu_target.typing_context
        typing.refresh()
        for template in getattr(typing._lookup_global(function), "templates", ()):
            self.add([template._overload_func, template._jit_options])

    def _variable(self, value: Any, code: CodeType) -> None:
        """Add a variable; for a module, add the attributes that the code may read."""
        self.add(value)
        if isinstance(value, ModuleType) and not _is_versioned_module(value):
            for name in code.co_names:
                if hasattr(value, name):
                    self._fact(name)
                    self._variable(getattr(value, name), code)


def _is_versioned(value: Any) -> bool:
    """Return True for a function or class of a module of `_VERSIONED`."""
    module = getattr(value, "__module__", None) or ""
    return module.split(".")[0] in _VERSIONED and hasattr(value, "__qualname__")


def _is_versioned_module(module: ModuleType) -> bool:
    """Return True for a module of `_VERSIONED` unless a user's file has its name."""
    file = getattr(module, "__file__", None) or _FOLDERS[0]  # built-in modules have no file
    return module.__name__.split(".")[0] in _VERSIONED and file.startswith(_FOLDERS)


def instructions(code: CodeType) -> str:
    """Return the bytecode of a function as text, without docstrings and line numbers."""
    constants = []
    for instruction in dis.get_instructions(code):
        if instruction.opcode in dis.hasconst:
            value = instruction.argval
            if isinstance(value, frozenset):  # its order changes from run to run
                value = sorted(value, key=repr)
            constants.append(instructions(value) if isinstance(value, CodeType) else value)
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount
    flags = code.co_flags & (CO_VARARGS | CO_VARKEYWORDS | CO_GENERATOR)
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    return repr((constants, counts, flags, names, code.co_code, code.co_exceptiontable))


def globals_read(code: CodeType) -> Iterator[str]:
    """Yield names of the global variables that a function and its inner functions read."""
    yield from (i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL")
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from globals_read(constant)


def cell_content(cell: CellType) -> Any:
    """Return the value of a variable of an enclosing function, None if not yet set."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


class _Cache(NullCache):  # type: ignore[misc]
    """Cache of the machine code of a loop, one file per key."""

    def __init__(self, loop: Dispatcher) -> None:
        self._loop = loop

    @property
    def cache_path(self) -> str:
        """Folder of the cache."""
        root = config.CACHE_DIR or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return str(Path(root) / "dolfinx_joints" / "loops")

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the compiled loop for arguments of these types, None if it is not cached."""
        target_context.refresh()
        try:
            parts = pickle.loads(self._path(sig).read_bytes())
        except (OSError, RuntimeError, UnknownValueError):  # RuntimeError: no home folder
            return None
        except (EOFError, pickle.UnpicklingError):  # truncated by a system crash
            return None
        result = CompileResult._rebuild(target_context, *parts)
        arguments, _ = sigutils.normalize_signature(sig)
        return result._replace(signature=result.signature.replace(args=arguments))

    def save_overload(self, sig: Any, result: CompileResult) -> None:
        """Save a compiled loop, unless it has addresses of this process or unknown values."""
        if result.library.has_dynamic_globals:
            return
        try:
            path = self._path(sig)
            path.parent.mkdir(parents=True, exist_ok=True)
            with NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
                file.write(dumps(result._reduce()))
            os.replace(file.name, path)  # atomic: never a partial file
        except UnknownValueError as unknown:
            LOGGER.info("%s is compiled in each run: it uses %s", self._loop, unknown)
        except (OSError, RuntimeError):  # no home folder, or a full disk
            pass

    def _path(self, sig: Any) -> Path:
        """Return the cache file for arguments of these types."""
        graph = CallGraph()
        graph.add([self._loop, *sigutils.normalize_signature(sig)])
        machine = cpu_target.target_context.codegen().magic_tuple()
        settings = config.OPT, config.BOUNDSCHECK, config.DEBUGINFO_DEFAULT
        content = repr((_VERSIONS, machine, settings, graph.facts)).encode()
        name = self._loop.py_func.__qualname__.rpartition(".")[2]
        return Path(self.cache_path) / f"{name}-{hashlib.sha256(content).hexdigest()[:32]}.nbc"


def njit(function: Any = None, *, cache: bool = False, **options: Any) -> Any:
    """Compile like `numba.njit`; with ``cache`` save machine code in the user's cache folder."""
    if function is None:
        return partial(njit, cache=cache, **options)
    loop = numba.njit(**options)(function)
    if cache:
        loop._cache = _Cache(loop)
    return loop


def _number_functions() -> None:
    """Start numba's function numbers, part of the symbols, at a random value.

    Otherwise two processes may give the same symbol to different functions of one name, such as
    closures, and a third process that links both would confuse them.
    """
    FunctionIdentity._unique_ids = count(secrets.randbits(62))


_number_functions()
os.register_at_fork(after_in_child=_number_functions)

# For functions that only other loops call. Without an entry point for Python they compile faster.
part = njit(cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)

# For functions that only other loops call and that neither create nor return arrays. numba does not
# count references to their array arguments; counting takes 2.5 times as long per joint point.
inline = register_jitable(forceinline=True, _nrt=False)


class _CompilationNotice(event.Listener):  # type: ignore[misc]
    """Listener that logs once per run that loops of this package are being compiled."""

    logged = False

    def on_start(self, event: Any) -> None:
        """Log the first compilation."""
        module = event.data["dispatcher"].py_func.__module__ or ""  # None for code from exec
        ours = module.startswith("dolfinx_joints.")
        if ours and not self.logged and LOGGER.isEnabledFor(logging.INFO):
            LOGGER.info("compiling new or changed loops: takes up to a minute")
            self.logged = True

    def on_end(self, event: Any) -> None:
        """Do nothing."""


_LISTENER = _CompilationNotice()
event.register("numba:compile", _LISTENER)
