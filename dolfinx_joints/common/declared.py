# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters whose type, range and unit are declared in the annotation.

A declaration is ``normal_stiffness: Annotated[float, Gt(0), Unit("Pa/m")]``, with bounds of the
package annotated-types. `checked` raises an error for any other value. `declarations` returns the
declarations for the reference page and the tests.
"""

from __future__ import annotations

import functools
import inspect
import math
import operator
import sys
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.parameters import numbers_of, real, shown, whole_number

T = TypeVar("T", bound=Callable[..., Any])
REQUIRED = inspect.Parameter.empty

# Attribute, comparison and text of each bound, and its text if the bound is zero.
_RANGES: dict[type, tuple[str, Callable[[Any, Any], Any], str, str]] = {
    at.Gt: ("gt", operator.gt, "above", "positive"),
    at.Ge: ("ge", operator.ge, "at least", "zero or more"),
    at.Lt: ("lt", operator.lt, "below", ""),
    at.Le: ("le", operator.le, "at most", ""),
}

# All classes and functions with `checked`, for the reference page and the tests.
CHECKED: list[Any] = []


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """Declared parameter.

    Attributes:
        name: Name of the parameter.
        kind: The annotation without bounds and unit: ``float``, ``Literal["a", "b"]``, ...
        bounds: Bounds of annotated-types; intervals and lengths are split into single bounds.
        unit: SI unit, empty for a pure number.
        default: Default value, `REQUIRED` without a default.
    """

    name: str
    kind: Any
    bounds: tuple[Any, ...] = ()
    unit: str = ""
    default: Any = REQUIRED

    @property
    def optional(self) -> bool:
        """True if None is allowed."""
        return type(None) in _alternatives(self.kind)

    @property
    def allowed(self) -> str:
        """Allowed values, as text for an error message."""
        kinds = [k for k in _alternatives(self.kind) if k is not type(None)]
        texts = [_allowed(kind, self.bounds) for kind in kinds]
        return " or ".join(dict.fromkeys([*texts, *(["None"] if self.optional else [])]))

    def check(self, value: Any, where: str) -> Any:
        """Return the value, converted to the declared type.

        Raises:
            ValueError: The value is of another type or out of its bounds.
        """
        if value is None and self.optional:
            return value
        for kind in _alternatives(self.kind):
            fits, converted = _convert(kind, value)
            if fits and all(_satisfies(b, converted) for b in self.bounds):
                return converted
        is_number = not math.isnan(real(value)) or isinstance(value, float)
        given = f"{shown(value, str)} {self.unit}".rstrip() if is_number else shown(value)
        raise ValueError(f"{where}: {self.name} is {given}; it must be {self.allowed}.")


def checked(of: T) -> T:
    """Check the arguments of a dataclass or a function against its annotations.

    Put the decorator below ``@dataclass`` of a class. A dataclass is checked before its own
    ``__post_init__``, which also converts numbers of other types to float or int. Annotations with
    other classes are not checked.

    Raises:
        ValueError: On use: a parameter is of another type or out of its bounds.
    """
    if isinstance(of, type):
        of.__post_init__ = _checking_init(of)  # type: ignore[attr-defined]
        CHECKED.append(of)
        return of  # type: ignore[return-value]
    signature = inspect.signature(of)

    @functools.wraps(of)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError:
            return of(*args, **kwargs)  # Python's own error names the function
        for parameter in declarations(of):
            if parameter.name in given.arguments:
                value = given.arguments[parameter.name]
                given.arguments[parameter.name] = parameter.check(value, of.__name__)
        return of(*given.args, **given.kwargs)

    CHECKED.append(call)
    return call  # type: ignore[return-value]


def _checking_init(of: type) -> Callable[..., None]:
    post_init = getattr(of, "__post_init__", None)

    def check(self: Any) -> None:
        """Check the parameters."""
        for parameter in declarations(of):
            value = getattr(self, parameter.name)
            converted = parameter.check(value, type(self).__name__)
            if converted is not value:
                object.__setattr__(self, parameter.name, converted)
        if post_init is not None:
            post_init(self)

    return check


@functools.cache
def declarations(of: Any) -> tuple[Declaration, ...]:
    """Return the declared parameters of a dataclass or function, in their order."""
    of = inspect.unwrap(of)
    names = vars(sys.modules[of.__module__])
    return tuple(
        Declaration(name=name, kind=kind, bounds=bounds, unit=unit, default=default)
        for name, annotation, default in _parameters(of)
        for kind, bounds, unit in [_parsed(annotation, names)]
        if kind is not None
    )


def parameters(of: Any) -> dict[str, Any] | None:
    """Return an object's declared parameters by name, or None.

    The result is None unless the object is of a dataclass of this package.
    """
    kind = type(of)
    if not is_dataclass(kind) or kind.__module__.split(".")[0] != __name__.split(".")[0]:
        return None
    return {field.name: getattr(of, field.name) for field in fields(kind) if field.init}


def _parameters(of: Any) -> Iterator[tuple[str, Any, Any]]:
    if is_dataclass(of):
        for field in fields(of):
            if field.init:
                made = REQUIRED if field.default_factory is MISSING else field.default_factory()
                yield field.name, field.type, made if field.default is MISSING else field.default
        return
    for name, parameter in inspect.signature(of).parameters.items():
        yield name, parameter.annotation, parameter.default


def _parsed(annotation: Any, names: Mapping[str, Any]) -> tuple[Any, tuple[Any, ...], str]:
    """Return type, bounds and unit of an annotation; the type is None if it is not checked."""
    if isinstance(annotation, str):
        try:
            annotation = eval(annotation, dict(names))
        except NameError:  # a class that is imported for type checkers only
            return None, (), ""
    kinds: list[Any] = []
    notes: list[Any] = []
    for part in _alternatives(annotation):
        annotated = get_origin(part) is Annotated
        kinds += _alternatives(get_args(part)[0] if annotated else part)
        notes += get_args(part)[1:] if annotated else ()
    unit = next((note.unit for note in notes if isinstance(note, at.Unit)), "")
    groups = (note if isinstance(note, at.GroupedMetadata) else [note] for note in notes)
    bounds = tuple(b for group in groups for b in group if not isinstance(b, at.Unit))
    is_checked = annotation != ArrayLike and any(_is_checked(kind) for kind in kinds)
    return (Union[tuple(kinds)] if is_checked else None), bounds, unit  # noqa: UP007


def _alternatives(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)


def _is_checked(kind: Any) -> bool:
    plain = (float, int, bool, str, PathLike)
    return kind in plain or get_origin(kind) in (Literal, Sequence, tuple, Callable, PathLike)


def _convert(kind: Any, value: Any) -> tuple[bool, Any]:
    """Return True and the converted value if it is of this type, else False and the value."""
    if kind is float:
        number = real(value)
        return math.isfinite(number), value if type(value) is float else number
    if kind is int:
        whole = whole_number(value)
        return whole is not None, whole
    if kind is bool:
        return isinstance(value, bool | np.bool_), value
    origin = get_origin(kind) or kind
    if origin is Literal:
        return isinstance(value, str | int) and value in get_args(kind), value
    if origin is PathLike:
        return isinstance(value, str | PathLike) and bool(str(value).strip()), value
    if origin is Callable:
        return callable(value), value
    if origin in (Sequence, tuple) and set(get_args(kind)) - {Ellipsis} <= {float, int}:
        numbers = numbers_of(value)
        fits = numbers is not None and numbers.ndim == 1 and bool(np.isfinite(numbers).all())
        if origin is tuple and Ellipsis not in get_args(kind):
            fits = fits and len(value) == len(get_args(kind))
        return fits, value
    if origin in (Sequence, tuple):
        return isinstance(value, Sequence) and not isinstance(value, str), value
    return isinstance(origin, type) and isinstance(value, origin), value


def _satisfies(bound: Any, value: Any) -> bool:
    if isinstance(bound, at.DocInfo):
        return True
    if isinstance(bound, at.MinLen):
        return len(value) >= bound.min_length
    if isinstance(bound, at.MaxLen):
        return len(value) <= bound.max_length
    name, compare, _, _ = _RANGES[type(bound)]
    return bool(np.all(compare(np.asarray(value), getattr(bound, name))))


def _allowed(kind: Any, bounds: Sequence[Any]) -> str:
    """Return the text of a type and its bounds, or the declared text."""
    for bound in bounds:
        if isinstance(bound, at.DocInfo):
            return bound.documentation
    ranges = [_RANGES[type(b)] + (b,) for b in bounds if type(b) in _RANGES]
    limits = [(getattr(b, name), text, zero) for name, _, text, zero, b in ranges]
    range_of = " and ".join(zero if zero and not v else f"{text} {v:g}" for v, text, zero in limits)
    origin = get_origin(kind) or kind
    if kind is float:
        bounded = any(isinstance(b, at.Lt | at.Le) for b in bounds)
        return range_of + ("" if bounded else " and finite") if range_of else "a finite number"
    if kind is int:
        return f"a whole number, {range_of}" if range_of else "a whole number"
    if origin is Literal:
        return f"one of {', '.join(map(str, get_args(kind)))}"
    if origin in (Sequence, tuple):
        numbers = set(get_args(kind)) - {Ellipsis} <= {float, int}
        sequence = f"{_count(kind, bounds)} {'finite numbers' if numbers else 'values'}"
        return f"{sequence}, each {range_of}" if range_of else sequence
    if origin is Callable:
        return "a function"
    if origin in (PathLike, Path):
        return "the path of a file"
    return {bool: "True or False", str: "a name"}.get(origin) or f"of type {origin.__name__}"


def _count(kind: Any, bounds: Sequence[Any]) -> str:
    """Return the allowed number of values of a sequence, as text."""
    if get_origin(kind) is tuple and Ellipsis not in get_args(kind):
        return str(len(get_args(kind)))
    lowest = next((b.min_length for b in bounds if isinstance(b, at.MinLen)), 0)
    highest = next((b.max_length for b in bounds if isinstance(b, at.MaxLen)), None)
    if highest is None:
        return f"{lowest} or more" if lowest else "a sequence of"
    return f"{lowest}" if lowest == highest else f"{lowest} to {highest}"
