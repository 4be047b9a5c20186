# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""All declared parameters: bad values, derived from each declaration, raise."""

import math
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from os import PathLike
from pkgutil import walk_packages
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import annotated_types as at
import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints
from dolfinx_joints import Elastic, spectra
from dolfinx_joints.common.declared import CHECKED, Declaration, declarations
from dolfinx_joints.report.parameter_sections import unit

for module in walk_packages(dolfinx_joints.__path__, "dolfinx_joints."):
    if not module.name.endswith("__main__"):
        import_module(module.name)

TINY = 1e-9
SHAPES = (Literal, Sequence, tuple, Callable, PathLike)


def limits(each: Declaration, step: float) -> Iterator[float]:
    """Numbers on the wrong side of each bound, ``step`` beyond those that may be reached."""
    for bound in each.bounds:
        if isinstance(bound, at.Gt | at.Lt):
            yield bound.gt if isinstance(bound, at.Gt) else bound.lt
        elif isinstance(bound, at.Ge | at.Le):
            yield bound.ge - step if isinstance(bound, at.Ge) else bound.le + step


def bad_values(each: Declaration) -> list[Any]:
    """Values of a wrong kind, and numbers that are none or out of range."""
    kinds = get_args(each.kind) if get_origin(each.kind) not in SHAPES else ()
    kinds = [kind for kind in kinds or (each.kind,) if kind is not NoneType]
    if len(kinds) > 1:
        return [object()]
    kind, origin = kinds[0], get_origin(kinds[0]) or kinds[0]
    bad: list[Any] = [object(), *([] if each.optional else [None])]
    if kind is float:
        return [*bad, "1.0", True, math.nan, math.inf, *limits(each, TINY)]
    if kind is int:
        return [*bad, "1", 1.5, *map(round, limits(each, 1))]
    if origin in (Sequence, tuple) and set(get_args(kind)) <= {float, int, Ellipsis}:
        count = len(get_args(kind)) if origin is tuple and Ellipsis not in get_args(kind) else 3
        return [*bad, "text", 1.0, *([value] * count for value in limits(each, TINY))]
    return [*bad, "no such" if origin is Literal else 1.5]


CASES = [(of, each) for of in CHECKED for each in declarations(of)]


@pytest.mark.parametrize(
    ("of", "each"), CASES, ids=[f"{of.__qualname__}.{each.name}" for of, each in CASES]
)
def test_bad_values_raise_and_say_what_may_be_given(of, each):
    for value in bad_values(each):
        with pytest.raises(ValueError, match=f"^{of.__name__}: {each.name} is ") as error:
            each.check(value, of.__name__)
        assert str(error.value).endswith(f"it must be {each.allowed}.")


# What a model is made of but for what is only a part of such a thing, which reports show as text.
PARTS = {"AnnualWave", "JointConductance", "ReservoirTemperature", "RockLayer", "SeepageLine"}
OF_MODELS = [
    (of, each)
    for of, each in CASES
    if of.__module__.split(".")[1] in ("body", "joints", "laws", "loads", "materials")
    and isinstance(of, type)
    and of.__name__ not in PARTS
    and each.unit
]


@pytest.mark.parametrize(
    ("of", "each"), OF_MODELS, ids=[f"{of.__qualname__}.{each.name}" for of, each in OF_MODELS]
)
def test_reports_show_a_parameter_in_a_unit(of, each):
    title, factor = unit(of.__name__, each.name)
    prefix = {1.0: "", 1e-6: "M", 1e-9: "G"}[factor]
    si = each.unit.replace("^2", "²").replace("^3", "³").replace("degrees", "°")
    assert title.endswith(f"[{prefix}{si}]")


def test_classes_and_functions_are_checked_on_use():
    solid = Elastic(young=np.float32(2.0), poisson=0, density=1)
    assert [type(value) for value in (solid.young, solid.poisson, solid.density)] == [float] * 3
    said = r"^Elastic: young is -1\.0 Pa; it must be positive and finite\.$"
    with pytest.raises(ValueError, match=said):
        Elastic(young=-1.0, poisson=0.2, density=2400.0)
    said = r"^fourier_amplitude: dt is 0\.0 s; it must be positive and finite\.$"
    with pytest.raises(ValueError, match=said):
        spectra.fourier_amplitude(np.zeros(9), 0.0)
