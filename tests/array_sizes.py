# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays in attributes of this package's objects and in local variables of its functions."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_joints

PACKAGE = str(Path(dolfinx_joints.__file__).parent)

# Arrays of matrix entries; by chance they may be as long as the number of unknowns.
ENTRIES = ("_rows", "_columns", "_sends", "_adds")


def arrays(thing: Any, seen: set[int], path: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays that an object of this package refers to, with their attribute paths."""
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        yield path, thing
    elif isinstance(thing, dict):
        for key, value in thing.items():
            yield from arrays(value, seen, f"{path}[{key!r}]")
    elif isinstance(thing, list | tuple | set):
        for i, value in enumerate(thing):
            yield from arrays(value, seen, f"{path}[{i}]")
    elif type(thing).__module__.startswith("dolfinx_joints"):
        for name, value in vars(thing).items() if hasattr(thing, "__dict__") else ():
            if name not in ENTRIES:
                yield from arrays(value, seen, f"{path}.{name}")


def of_functions(call: Callable[[], Any], seen: dict[str, set[tuple[int, ...]]]) -> Any:
    """Call a function and collect the shapes of arrays in local variables of the package.

    Variables are examined when a function of the package returns, lists and dictionaries included.
    Shapes are added to ``seen`` by the name of the function and of the variable.
    """

    def look(frame: Any, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "return" or not code.co_filename.startswith(PACKAGE):
            return
        for name, value in frame.f_locals.items():
            if isinstance(value, np.ndarray | dict | list | tuple):
                where = f"{Path(code.co_filename).stem}.{code.co_qualname}: {name}"
                shapes = {a.shape for _, a in plain_arrays(value) if a.ndim}
                seen.setdefault(where, set()).update(shapes)

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        return call()
    finally:
        sys.setprofile(before)


def plain_arrays(thing: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield arrays in dictionaries and sequences, but not in attributes of objects."""
    if isinstance(thing, np.ndarray):
        yield "", thing
    elif isinstance(thing, dict):
        for value in thing.values():
            yield from plain_arrays(value)
    elif isinstance(thing, list | tuple):
        for value in thing:
            yield from plain_arrays(value)
