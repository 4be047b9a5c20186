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
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import annotated_types as at
import numpy as np

from dolfinx_joints.common.parameters import is_path, numbers_of, real, shown

T = TypeVar("T", bound=Callable[..., Any])
REQUIRED = inspect.Parameter.empty


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """One declared parameter.

    Attributes:
        name: Its name.
        kind: The annotation without bounds and unit: ``float``, ``Literal["a", "b"]``, ...
        bounds: The bounds of annotated-types.
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
            if fits and all(_holds(b, converted) for b in _single(self.bounds)):
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
        return of  # type: ignore[return-value]
    signature = inspect.signature(of)

    @functools.wraps(of)
    def call(*args: Any, **kwargs: Any) -> Any:
        given = signature.bind(*args, **kwargs)
        for each in declarations(of):
            if each.name in given.arguments:
                value = given.arguments[each.name]
                given.arguments[each.name] = each.check(value, of.__name__)
        return of(*given.args, **given.kwargs)

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
    bounds = tuple(note for note in notes if not isinstance(note, at.Unit | str))
    known = any(_is_known(each) for each in kinds)
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
        try:
            whole = None if isinstance(value, bool | np.bool_) else operator.index(value)
        except TypeError:
            whole = None
        return whole is not None, whole
    if kind is bool:
        return isinstance(value, bool | np.bool_), value
    origin = get_origin(kind) or kind
    if origin is Literal:
        return isinstance(value, str | int) and value in get_args(kind), value
    if origin is PathLike:
        return is_path(value), value
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
    if isinstance(bound, at.Predicate):
        return bool(bound.func(value))
    values = np.asarray(value)
    if isinstance(bound, at.Gt):
        return bool((values > bound.gt).all())
    if isinstance(bound, at.Ge):
        return bool((values >= bound.ge).all())
    if isinstance(bound, at.Lt):
        return bool((values < bound.lt).all())
    if isinstance(bound, at.Le):
        return bool((values <= bound.le).all())
    return True


def _single(bounds: Sequence[Any]) -> list[Any]:
    """Bounds with intervals and lengths taken apart."""
    return [
        one
        for bound in bounds
        for one in (bound if isinstance(bound, at.Interval | at.Len) else [bound])
    ]


def _allowed(kind: Any, bounds: Sequence[Any]) -> str:
    """A kind and its bounds in words."""
    flat = [
        b for each in bounds for b in (each if isinstance(each, at.Interval | at.Len) else [each])
    ]
    words = []
    for b in flat:
        if isinstance(b, at.Gt):
            words.append("positive" if b.gt == 0 else f"above {b.gt:g}")
        elif isinstance(b, at.Ge):
            words.append("zero or more" if b.ge == 0 else f"at least {b.ge:g}")
        elif isinstance(b, at.Lt):
            words.append(f"below {b.lt:g}")
        elif isinstance(b, at.Le):
            words.append(f"at most {b.le:g}")
    range_of = " and ".join(words)
    bounded = any(isinstance(b, at.Lt | at.Le) for b in flat)
    origin = get_origin(kind) or kind
    if kind is float:
        return (range_of if bounded else f"{range_of} and finite") if words else "a finite number"
    if kind is int:
        return f"a whole number, {range_of}" if range_of else "a whole number"
    if kind is bool:
        return "True or False"
    if origin is Literal:
        return f"one of {', '.join(map(str, get_args(kind)))}"
    if origin in (Sequence, tuple):
        least = max((b.min_length for b in flat if isinstance(b, at.MinLen)), default=0)
        most = min((b.max_length for b in flat if isinstance(b, at.MaxLen)), default=None)
        if origin is tuple and Ellipsis not in get_args(kind):
            least = most = len(get_args(kind))
        count = (
            f"{least}"
            if least == most
            else f"{least} to {most}"
            if most
            else f"{least} or more"
            if least
            else ""
        )
        what = "finite numbers" if set(get_args(kind)) - {Ellipsis} <= {float, int} else "values"
        return " ".join(
            filter(None, [count or "a sequence of", what, range_of and f", each {range_of}"])
        )
    named = {str: "a name", PathLike: "the path of a file", Callable: "a function"}
    return named.get(origin, f"of type {getattr(origin, '__name__', origin)}")
