# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reverse sweep over recorded steps: adjoint equations (41) to (45) of docs/theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.common.summary import Rows, Summarised, names
from dolfinx_joints.gradient.law_slopes import GAP, SLIP, SLIPS, parameters_of, slopes_of
from dolfinx_joints.gradient.model_slopes import ModelSlopes
from dolfinx_joints.gradient.parametric import ParametricModel
from dolfinx_joints.gradient.quantity import Quantity
from dolfinx_joints.gradient.tape import LoadsAt, Step, Tape
from dolfinx_joints.gradient.transposed_step import TransposedStep
from dolfinx_joints.time_integration.initial_state import balancing_acceleration
from dolfinx_joints.time_integration.midpoint import rescaled_slips
from dolfinx_joints.time_integration.newmark import Newmark

# Points of all steps that are linearised together: many points share the cost of a branch, and the
# arrays stay small.
BATCH_POINTS = 16384

# Largest difference between recorded elastic slips and those of the law, relative to the largest
# slip, and its rounding error relative to the largest gap.
REPLAYED, ROUNDING = 1e-6, 1e-10


@dataclass(frozen=True, kw_only=True, repr=False)
class Gradient(Summarised):
    """Derivatives of a quantity.

    The parameters are those of the laws, and ``initial_gap``. At points without shear stiffness,
    the derivative by ``shear_stiffness`` is not computed and given as zero. Where a parameter is at
    its limit of zero, the derivative is one-sided: friction and adhesion grow, and the initial gap
    becomes an overlap.

    Attributes:
        value: The quantity.
        by_point: Derivatives by the parameters at the local joint points, shape (n,), by parameter.
        by_joint: Their sums: derivatives by the parameters of whole joints, by parameter and joint.
        by_load: Derivatives by a factor of each load, or of the motion, by name.
        by_parameter: Derivatives by the parameters of the parametric model, by name.
        tape: Tape of the run.
        parametric: The parametric model, or None.
    """

    value: float
    by_point: Mapping[str, Floats]
    by_joint: Mapping[str, Mapping[str, float]]
    by_load: Mapping[str, float]
    by_parameter: Mapping[str, float]
    tape: Tape
    parametric: ParametricModel | None

    def _summary(self) -> Rows:
        yield "quantity", f"{self.value:.6g}"
        yield "parameters of points", names(list(self.by_point))
        yield "loads", names(list(self.by_load))
        for name, slope in self.by_parameter.items():
            yield name, f"{slope:.6g}"


def gradient_of(
    tape: Tape, quantity: Quantity, parametric: ParametricModel | None = None
) -> Gradient:
    """Return the gradient of a quantity by all joint parameters and load factors (collective).

    Args:
        tape: Tape of a run.
        quantity: The quantity, a smooth function of the observed values.
        parametric: Parametric model that built the model of the run, for the derivatives by its
            parameters.

    Raises:
        JointsError: A step is not one step of the joint laws, or a step has no derivative, because
            a block moves freely.
        ValueError: The derivative of the quantity has a wrong name or shape.
    """
    check_kind_of("tape", tape, isinstance(tape, Tape), "a Tape")
    check_kind_of("quantity", quantity, isinstance(quantity, Quantity), "a Quantity")
    is_parametric = isinstance(parametric, ParametricModel | None)
    check_kind_of("parametric", parametric, is_parametric, "a ParametricModel")
    return ReverseSweep(tape, quantity, parametric).run()


class ReverseSweep:
    """One reverse sweep for one quantity; the attributes ending in ``_bar`` are derivatives of it.

    Args:
        tape: The recorded run.
        quantity: The quantity.
        parametric: The parametric model, or None.
    """

    def __init__(self, tape: Tape, quantity: Quantity, parametric: ParametricModel | None) -> None:
        """Evaluate the quantity and its derivative by the observed values (collective)."""
        history = tape.history()
        self._tape, self._operator = tape, tape.contact.operator
        self._parametric = parametric
        self._value = quantity.value_of(history)
        self._weights = quantity.derivative_of(history)
        system = tape.steps[-1].solver.system
        self._u_bar, self._v_bar, self._a_bar = (system.vector() for _ in range(3))
        count = len(self._operator.areas)
        self._joint_bar = np.zeros((count, max(state.shape[1] for state in tape.states)))
        names = {n for part in tape.contact.parts for n in parameters_of(part.law)}
        self._parameters = {name: np.zeros(count) for name in sorted(names)}
        self._by_load: dict[str, float] = {}
        self._transposed = cache(TransposedStep)
        self._work = self._u_bar.duplicate()
        self._slopes: dict[str, ModelSlopes] = {}
        if parametric is not None and tape.model is not None:
            if tape.fields is None:
                raise JointsError("Derivatives by parameters of a model need Tape(..., body=True).")
            self._slopes = {
                name: ModelSlopes(parametric, name, tape.model, tape.steps)
                for name in parametric.parameters
            }
        self._by_parameter = dict.fromkeys(self._slopes, 0.0)

    def run(self) -> Gradient:
        """Return the gradient (collective)."""
        steps, first = self._tape.steps, len(self._tape.steps)
        for k in reversed(range(len(steps))):
            if k < first:
                first, laws = self._linearised(k)
            self._reverse(k, [(law, points, slopes[k - first]) for law, points, slopes in laws])
            if steps[k].scheme is not None and (k == 0 or steps[k - 1].scheme is None):
                self._leave_dynamics(k)
        by_point = self._parameters | {"initial_gap": self._joint_bar[:, 0].copy()}
        joints, number = self._operator.names, self._operator.joint
        rows = np.array([np.bincount(number, v, len(joints)) for v in by_point.values()])
        sums: Any = summed(self._operator.comm, rows).tolist()
        by_joint = {
            name: dict(zip(joints, row, strict=True))
            for name, row in zip(by_point, sums, strict=True)
        }
        for name, slopes in self._slopes.items():
            local = sum(float(by_point[n] @ slope) for n, slope in slopes.joints.items())
            self._by_parameter[name] += float(summed(self._operator.comm, np.array([local]))[0])
        return Gradient(
            value=self._value,
            by_point=by_point,
            by_joint=by_joint,
            by_load=self._by_load,
            by_parameter=self._by_parameter,
            tape=self._tape,
            parametric=self._parametric,
        )

    def _linearised(self, last: int) -> tuple[int, list[tuple[Any, Ints, Floats]]]:
        """Return the derivatives of the laws in a batch of steps that ends with step ``last``.

        The result is the number of the first step, and law, points and derivatives of each law.
        """
        tape, laws = self._tape, []
        # The same batches on all ranks: the ranks compare the replayed steps.
        count = 1 + self._operator.num_points // self._operator.comm.size
        first, rule, replayed = last, tape.steps[last].rule, True
        fitting = max(0, last + 1 - BATCH_POINTS // count)
        while first > fitting and tape.steps[first - 1].rule == rule:
            first -= 1
        steps = range(first, last + 1)
        before = np.array([_start_state(tape, k) for k in steps])
        after = np.array([tape.states[k + 1] for k in steps])
        for part in tape.contact.parts:
            end = after[:, part.points]
            answer, slopes = slopes_of(part.law, rule, before[:, part.points], end[:, :, :3])
            error = np.abs(answer[3:5] - end[:, :, 3:5].transpose(2, 0, 1)).max(initial=0.0)
            slip, gap = (np.abs(end[:, :, c]).max(initial=0.0) for c in (SLIP, GAP))
            replayed &= bool(error <= REPLAYED * slip + ROUNDING * gap)
            laws.append((part.law, part.points, slopes))
        if not all(self._operator.comm.allgather(replayed)):
            raise JointsError(
                f"A step up to t = {tape.steps[last].times[1]:.6g} s is not one step of the joint "
                "laws, because another solver completed it; gradients do not include this case."
            )
        return first, laws

    def _reverse(self, k: int, laws: Sequence[tuple[Any, Ints, Floats]]) -> None:
        """Pass the derivatives by the state after step ``k`` to the state before (collective)."""
        step, joint_bar = self._tape.steps[k], self._joint_bar
        self._add_weights(k)
        columns = step.columns
        gap_bar, history_bar = joint_bar[:, GAP].copy(), joint_bar[:, 3:columns].T
        tangent = np.zeros((len(gap_bar), 3, 3))
        for _, points, slopes in laws:
            tangent[points] = slopes[:3, :3].transpose(2, 1, 0)
            gap_bar[points] += _product(slopes[3:, :3], history_bar[:, points])
        z, adjoint_gap = self._solve(step, gap_bar, tangent)
        traction_bar = -self._operator.areas * adjoint_gap.T
        start_bar = np.zeros((len(gap_bar), columns))
        start_bar[:, GAP] = gap_bar + np.einsum("nij,jn->ni", tangent, traction_bar)
        for law, points, slopes in laws:
            answer_bar = np.vstack([traction_bar[:, points], history_bar[:, points]])
            by_input = _product(slopes[:, 3:], answer_bar)
            start_bar[points] += by_input[:, :columns]
            for column, name in enumerate(parameters_of(law), columns):
                self._parameters[name][points] += by_input[:, column]
        if step.slip_scale != 1.0:
            start_bar[:, SLIPS] @= rescaled_slips(np.eye(5), step.slip_scale).T
        joint_bar[:] = 0.0
        joint_bar[:, :columns] = start_bar
        self._add_loads(step.loads, z)
        if self._slopes and self._tape.fields is not None:
            self._subtract_forces(z, self._tape.fields.read(k, z))

    def _solve(self, step: Step, gap_bar: Floats, tangent: Floats) -> tuple[PETSc.Vec, Floats]:
        """Solve (42), and pass u, v, a to the start of the step by (45) (collective)."""
        u, v, a, system = self._u_bar, self._v_bar, self._a_bar, step.solver.system
        b, transposed = u.copy(), self._transposed(step.solver)
        transposed.add_gaps(gap_bar, b)
        coefficients, scheme = step.coefficients, step.scheme
        if scheme is not None:
            b.axpy(step.rate or coefficients.damping, v)
        if isinstance(scheme, Newmark):
            b.axpy(coefficients.mass, a)
        z, gaps = transposed.solve(step, tangent, b)
        inertia, stiff = z.duplicate(), z.duplicate()
        if scheme is None:
            system.stiffness.mult(z, stiff)
        else:
            system.multiply(z, inertia, stiff)
        u.axpy(-1.0, stiff)
        if isinstance(scheme, Newmark):
            beta, gamma, dt = scheme.beta, scheme.gamma, step.dt
            a.axpy(-1.0, inertia)
            v.axpy(-1.0, system.damping_force(z, stiff))
            old_a = a.copy()
            a.scale(1.0 - 0.5 / beta)
            a.axpy(dt * (1.0 - 0.5 * gamma / beta), v)
            v.scale(1.0 - gamma / beta)
            v.axpy(-1.0 / (beta * dt), old_a)
        elif scheme is not None:
            v.scale(-1.0)
            v.axpy(step.rate, inertia)
        return z, gaps

    def _add_weights(self, k: int) -> None:
        """Add the derivatives of the quantity by the values observed after step ``k``."""
        tape = self._tape
        for name, values in self._weights.items():
            if name in tape.weights:
                self._joint_bar[:, :3] += tape.weights[name][:, None] * values[k]
            else:
                tape.probe.add(self._u_bar, list(tape.probes).index(name), values[k])

    def _add_loads(self, loads: Sequence[LoadsAt], z: PETSc.Vec) -> None:
        """Add the products of z with loads, and their derivatives (collective)."""
        factors: dict[int, Any] = {}
        for system, time, weight in loads:
            factors[id(system)] = factors.get(id(system), 0.0) + weight * system.factors(time)
        for system in {id(at.system): at.system for at in loads}.values():
            vectors = [vector for vector, _ in system.patterns]
            products = np.array(z.mDot(vectors)) if vectors else np.empty(0)
            named = zip(system.names_of_patterns, factors[id(system)] * products, strict=True)
            for name, product in named:
                self._by_load[name] = self._by_load.get(name, 0.0) + float(product)
        for name, slopes in self._slopes.items():
            self._by_parameter[name] += slopes.of_loads(loads, z)

    def _subtract_forces(self, z: PETSc.Vec, fields: Sequence[PETSc.Vec]) -> None:
        """Subtract the derivatives of z.(K u + C v + M a) (collective)."""
        for name, slopes in self._slopes.items():
            self._by_parameter[name] -= slopes.of_forces(fields, z, self._work)

    def _leave_dynamics(self, k: int) -> None:
        """Pass the derivative by the first acceleration to the loads that cause it (collective).

        The static state balances its loads. So M a0 is the difference of dynamic and static loads
        and does not depend on the joints.
        """
        step = self._tape.steps[k]
        if isinstance(step.scheme, Newmark):
            system = step.solver.system
            z = balancing_acceleration(system, self._a_bar)
            static = self._tape.steps[k - 1].loads if k else ()
            self._add_loads([LoadsAt(system, step.times[0], 1.0)], z)
            self._add_loads([at._replace(weight=-at.weight) for at in static], z)
            zero = self._work.duplicate()
            zero.set(0.0)
            self._subtract_forces(z, [zero, *self._tape.first_motion])
        self._v_bar.set(0.0)
        self._a_bar.set(0.0)


def _state(tape: Tape, number: int, columns: int) -> Floats:
    """Return a recorded state with some columns; missing slips are zero."""
    state = tape.states[number][:, :columns]
    return np.pad(state, ((0, 0), (0, columns - state.shape[1])))


def _start_state(tape: Tape, k: int) -> Floats:
    """Return the state at the start of step ``k`` as the laws receive it, shape (n, columns)."""
    step = tape.steps[k]
    state = _state(tape, k, step.columns)
    if step.slip_scale != 1.0:
        state[:, SLIPS] = rescaled_slips(state[:, SLIPS], step.slip_scale)
    return state


def _product(slopes: Floats, answer_bar: Floats) -> Floats:
    """Return the derivatives by the inputs, shape (n, inputs), from those by the outputs."""
    return np.einsum("oin,on->ni", slopes, answer_bar)
