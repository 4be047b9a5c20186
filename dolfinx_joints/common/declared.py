# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters declared once, in the annotation: kind, range and unit.

``normal_stiffness: Annotated[float, Gt(0), Unit("Pa/m")]`` is all there is to write. `checked`
raises one clear error for anything else, `declarations` gives the same lines to the reference page
and to the tests. Bounds are those of the package annotated-types.
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

# What each bound compares, and how it reads: in general, and with zero.
_RANGES: dict[type, tuple[str, Callable[[Any, Any], Any], str, str]] = {
    at.Gt: ("gt", operator.gt, "above", "positive"),
    at.Ge: ("ge", operator.ge, "at least", "zero or more"),
    at.Lt: ("lt", operator.lt, "below", ""),
    at.Le: ("le", operator.le, "at most", ""),
}

# All classes and functions that `checked` has seen: for the reference and the tests.
CHECKED: list[Any] = []


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """One declared parameter.

    Attributes:
        name: Its name.
        kind: The annotation without bounds and unit: ``float``, ``Literal["a", "b"]``, ...
        bounds: The bounds of annotated-types, intervals and lengths taken apart.
        unit: SI unit, empty for a pure number.
        default: Default value, `REQUIRED` if there is none.
    """

    name: str
    kind: Any
    bounds: tuple[Any, ...] = ()
    unit: str = ""
    default: Any = REQUIRED

    @property
    def optional(self) -> bool:
        """Whether None may be given."""
        return type(None) in _alternatives(self.kind)

    @property
    def allowed(self) -> str:
        """What may be given, as it stands in an error message."""
        kinds = [k for k in _alternatives(self.kind) if k is not type(None)]
        texts = [_allowed(kind, self.bounds) for kind in kinds]
        return " or ".join(dict.fromkeys([*texts, *(["None"] if self.optional else [])]))

    def check(self, value: Any, where: str) -> Any:
        """The value in the kind that is declared.

        Raises:
            ValueError: It is of another kind, or outside of the bounds.
        """
        if value is None and self.optional:
            return value
        for kind in _alternatives(self.kind):
            fits, converted = _convert(kind, value)
            if fits and all(_holds(b, converted) for b in self.bounds):
                return converted
        is_number = not math.isnan(real(value)) or isinstance(value, float)
        given = f"{shown(value, str)} {self.unit}".rstrip() if is_number else shown(value)
        raise ValueError(f"{where}: {self.name} is {given}; it must be {self.allowed}.")


def checked(of: T) -> T:
    """Check what a dataclass or a function is given against its annotations.

    Below ``@dataclass``, above a function. A dataclass is checked before its own
    ``__post_init__``, and numbers of other kinds become floats or ints there. Annotations of other
    classes are left to mypy.

    Raises:
        ValueError: On use: a parameter is of another kind, or outside of its bounds.
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
        for each in declarations(of):
            if each.name in given.arguments:
                value = given.arguments[each.name]
                given.arguments[each.name] = each.check(value, of.__name__)
        return of(*given.args, **given.kwargs)

    CHECKED.append(call)
    return call  # type: ignore[return-value]


def _checking_init(of: type) -> Callable[..., None]:
    own = getattr(of, "__post_init__", None)

    def check(self: Any) -> None:
        """Check the parameters."""
        for each in declarations(of):
            value = getattr(self, each.name)
            converted = each.check(value, type(self).__name__)
            if converted is not value:
                object.__setattr__(self, each.name, converted)
        if own is not None:
            own(self)

    return check


@functools.cache
def declarations(of: Any) -> tuple[Declaration, ...]:
    """The declared parameters of a dataclass or function, in their order."""
    of = inspect.unwrap(of)
    names = vars(sys.modules[of.__module__])
    return tuple(
        Declaration(name=name, kind=kind, bounds=bounds, unit=unit, default=default)
        for name, annotation, default in _parameters(of)
        for kind, bounds, unit in [_parsed(annotation, names)]
        if kind is not None
    )


def parameters(of: Any) -> dict[str, Any] | None:
    """Return the values of the declared parameters of an object by name.

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
    """Kind, bounds and unit of an annotation; the kind is None where there is nothing to check."""
    if isinstance(annotation, str):
        try:
            annotation = eval(annotation, dict(names))
        except NameError:  # of a class that only type checkers import
            return None, (), ""
    kinds: list[Any] = []
    notes: list[Any] = []
    for each in _alternatives(annotation):
        annotated = get_origin(each) is Annotated
        kinds += _alternatives(get_args(each)[0] if annotated else each)
        notes += get_args(each)[1:] if annotated else ()
    unit = next((note.unit for note in notes if isinstance(note, at.Unit)), "")
    groups = (note if isinstance(note, at.GroupedMetadata) else [note] for note in notes)
    bounds = tuple(b for group in groups for b in group if not isinstance(b, at.Unit))
    known = annotation != ArrayLike and any(_is_known(each) for each in kinds)
    return (Union[tuple(kinds)] if known else None), bounds, unit  # noqa: UP007


def _alternatives(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)


def _is_known(kind: Any) -> bool:
    plain = (float, int, bool, str, PathLike)
    return kind in plain or get_origin(kind) in (Literal, Sequence, tuple, Callable, PathLike)


def _convert(kind: Any, value: Any) -> tuple[bool, Any]:
    """Whether a value is of a kind, and the value as such."""
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


def _holds(bound: Any, value: Any) -> bool:
    if isinstance(bound, at.MinLen):
        return len(value) >= bound.min_length
    if isinstance(bound, at.MaxLen):
        return len(value) <= bound.max_length
    name, compare, _, _ = _RANGES[type(bound)]
    return bool(np.all(compare(np.asarray(value), getattr(bound, name))))


def _allowed(kind: Any, bounds: Sequence[Any]) -> str:
    """A kind and its bounds as text."""
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
        what = f"{_count(kind, bounds)} {'finite numbers' if numbers else 'values'}"
        return f"{what}, each {range_of}" if range_of else what
    if origin is Callable:
        return "a function"
    if origin in (PathLike, Path):
        return "the path of a file"
    return {bool: "True or False", str: "a name"}.get(origin) or f"of type {origin.__name__}"


def _count(kind: Any, bounds: Sequence[Any]) -> str:
    """How many values a sequence may have."""
    if get_origin(kind) is tuple and Ellipsis not in get_args(kind):
        return str(len(get_args(kind)))
    least = next((b.min_length for b in bounds if isinstance(b, at.MinLen)), 0)
    most = next((b.max_length for b in bounds if isinstance(b, at.MaxLen)), None)
    if most is None:
        return f"{least} or more" if least else "a sequence of"
    return f"{least}" if least == most else f"{least} to {most}"
