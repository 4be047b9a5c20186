# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Taylor test of a gradient, and the range of parameter changes in which it predicts a quantity."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import of_ranks, raised_together, summed
from dolfinx_joints.common.parameters import (
    check_each,
    check_kind_of,
    check_named,
    check_number,
    numbers_of,
    shown,
)
from dolfinx_joints.common.summary import Rows, Summarised
from dolfinx_joints.gradient.law_slopes import DERIVED, parameters_of
from dolfinx_joints.gradient.parametric import ParametricModel
from dolfinx_joints.gradient.quantity import Quantity
from dolfinx_joints.gradient.reverse_sweep import Gradient, gradient_of
from dolfinx_joints.gradient.tape import Tape
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.mesh.joint_pairs import no_such_joint
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem

# Sizes of the changes, as parts of the given change, and the error that ends the linear range.
SIZES = tuple(2.0**-k for k in range(11))
LINEAR = 0.1


@dataclass(frozen=True, kw_only=True, repr=False)
class TaylorTest(Summarised):
    """Changes of a quantity in repeated runs with changed parameters, and their linear prediction.

    Attributes:
        sizes: Sizes h of the changes, descending, as parts of the given change, shape (m,).
        changes: J(h) - J(0), shape (m,).
        linear: Derivative of the quantity along the given change; h times it is the prediction.
        flipped: Number of pairs of steps and joint points whose `Status` differs, shape (m,); -1 if
            the number of steps differs.
    """

    sizes: Floats
    changes: Floats
    linear: float
    flipped: Floats

    def _summary(self) -> Rows:
        yield "slope", f"{self.linear:.6g}"
        yield "orders", ", ".join(f"{order:.2f}" for order in self.orders)
        yield "no flips up to", f"{self.range_without_flips:g}"
        yield "within 10 % up to", f"{self.linear_range:g}"

    @property
    def remainders(self) -> Floats:
        """|J(h) - J(0) - h J'|, shape (m,)."""
        return np.abs(self.changes - self.sizes * self.linear)

    @property
    def orders(self) -> Floats:
        """Orders of the remainders of subsequent sizes; 2 if the gradient is exact, (m - 1,)."""
        remainders = np.maximum(self.remainders, np.finfo(float).tiny)
        return np.log(remainders[:-1] / remainders[1:]) / np.log(self.sizes[:-1] / self.sizes[1:])

    @property
    def range_without_flips(self) -> float:
        """Largest size up to which no `Status` differs, 0 without such a size."""
        return self._range(self.flipped == 0)

    @property
    def linear_range(self) -> float:
        """Largest size up to which the prediction is at most 10 % off, 0 without such a size."""
        return self._range(self.remainders <= LINEAR * np.abs(self.sizes * self.linear))

    def _range(self, valid: Any) -> float:
        """Return the largest size up to which all sizes are valid."""
        all_smaller_valid = np.logical_and.accumulate(valid[::-1])[::-1]
        return float(self.sizes[all_smaller_valid].max(initial=0.0))


def taylor_test(
    run: Callable[[Model, Tape], Any],
    tape: Tape,
    quantity: Quantity,
    change: Mapping[str, Any],
    *,
    gradient: Gradient | None = None,
    parametric: ParametricModel | None = None,
    sizes: Sequence[float] = SIZES,
) -> TaylorTest:
    """Repeat a recorded run with changed parameters, and compare it with the gradient (collective).

    Args:
        run: Function of a model and a tape that repeats the recorded run, with the tape among the
            monitors of the simulation.
        tape: Tape of the recorded run.
        quantity: The quantity.
        change: Change of each parameter by name: a number for all points, numbers by joint name,
            or values of the local points, shape (n,). A number changes the factor of a load, or
            a parameter of ``parametric``.
        gradient: Gradient of the quantity, if it is known; computed by default.
        parametric: Parametric model that built the model of the run.
        sizes: Sizes h of the changes, descending, as parts of ``change``.
    """
    check_named("change", change, "changes by name of a parameter or load")
    numbers = numbers_of(sizes)
    descend = numbers is not None and numbers.ndim == 1 and (np.diff([*numbers, 0.0]) < 0.0).all()
    good = bool(descend) and len(sizes) > 1 and np.isfinite(sizes[0])
    check_kind_of("sizes", sizes, good, "two or more descending positive numbers")
    gradient = gradient_of(tape, quantity, parametric) if gradient is None else gradient
    assert tape.model is not None
    parametric = gradient.parametric
    fields, loads = _split(tape, gradient, change)
    by_name = {name: loads.pop(name) for name in gradient.by_parameter if name in loads}
    comm = tape.contact.operator.comm
    of_points = [float(gradient.by_point[name] @ values) for name, values in fields.items()]
    linear = float(summed(comm, np.array([sum(of_points)]))[0])
    linear += sum(gradient.by_load[name] * factor for name, factor in loads.items())
    linear += sum(gradient.by_parameter[name] * d for name, d in by_name.items())
    changes, flipped = [], []
    for size in map(float, sizes):
        again = Tape(tape.points, gaps=tape.gaps)
        model = tape.model
        if by_name and parametric is not None:
            values = parametric.values_of(model)
            changed = {name: values[name] + size * d for name, d in by_name.items()}
            model = parametric.model(values | changed)
        run(_with_changes(model, fields, loads, size) if fields or loads else model, again)
        changes.append(quantity.value_of(again.history()) - gradient.value)
        if len(again.steps) != len(tape.steps):
            flipped.append(-1)
            continue
        differing = np.count_nonzero(np.array(again.status) != np.array(tape.status))
        flipped.append(int(of_ranks(comm, np.array([differing])).sum()))
    return TaylorTest(
        sizes=np.array(sizes), changes=np.array(changes), linear=linear, flipped=np.array(flipped)
    )


def _with_changes(
    model: Model, fields: Mapping[str, Floats], loads: Mapping[str, float], size: float
) -> Model:
    """Return a copy of a model with changed parameters (collective).

    Args:
        model: The model, which does not change.
        fields: Change of each parameter at the local points, shape (n,).
        loads: Change of the factor of each load by name.
        size: Factor of all changes.
    """
    assert model.contact is not None
    changed = copy(model)
    contact = changed.contact = model.contact.with_own_laws()
    parts: list[LawPoints] = []
    with raised_together(contact.operator.comm):  # The values may be wrong on one rank only.
        for part in model.contact.parts:
            law: Any = part.law
            names = [name for name in parameters_of(law) if name in fields]
            given = [fields[name][part.points] for name in names]
            rows: Any = np.array(given).reshape(len(names), len(part.points))
            values, number = np.unique(rows, axis=1, return_inverse=True)
            for i, row in enumerate(values.T):
                new = {n: getattr(law, n) + size * d for n, d in zip(names, row, strict=True)}
                new |= {DERIVED: None} if "friction_coefficient" in new else {}
                parts.append(LawPoints(replace(law, **new), part.points[number.ravel() == i]))
    contact.set_parts(parts)
    if "initial_gap" in fields:
        contact.initial_gap = contact.initial_gap.copy()
        contact.initial_gap[:, 0] += size * fields["initial_gap"]

    def system(*arguments: Any, **options: Any) -> MatrixSystem:
        made = Model.system(changed, *arguments, **options)
        named = zip(made.names_of_patterns, made.patterns, strict=True)
        scaled = [
            ((1.0 + size * loads.get(n, 0.0)) * force, factor) for n, (force, factor) in named
        ]
        return replace(made, patterns=scaled)

    changed.system = system  # type: ignore[method-assign]
    return changed


def _split(
    tape: Tape, gradient: Gradient, change: Mapping[str, Any]
) -> tuple[dict[str, Floats], dict[str, float]]:
    """Return the changes of joint parameters at the local points, and those of load factors."""
    operator, joints = tape.contact.operator, tape.contact.operator.names
    fields: dict[str, Floats] = {}
    loads: dict[str, float] = {}
    for name, values in change.items():
        label = f"The change of {name!r}"
        if name in gradient.by_load or name in gradient.by_parameter:
            check_number(label, values, lambda _: True, "a finite number")
            loads[name] = float(values)
        elif name in gradient.by_point and isinstance(values, Mapping):
            if wrong := [joint for joint in values if joint not in joints]:
                raise JointsError(no_such_joint(wrong[0], joints))
            for joint, value in values.items():
                check_number(f"{label} of {joint!r}", value, lambda _: True, "a finite number")
            by_joint = np.array([float(values.get(joint, 0.0)) for joint in joints])
            fields[name] = by_joint[operator.joint]
        elif name in gradient.by_point:
            with raised_together(operator.comm):
                fields[name] = check_each(label, values, len(operator.joint))
        else:
            names = ", ".join([*gradient.by_point, *gradient.by_load, *gradient.by_parameter])
            raise ValueError(f"{shown(name)} is not a parameter; the gradient contains {names}.")
    return fields, loads
