# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint steps of a large body in few shapes of it, checked by the residual of the whole body."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated
from weakref import WeakKeyDictionary

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import eigh

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.laws.law import Rule
from dolfinx_joints.model.modes import whole_groups
from dolfinx_joints.model.reduced_system import Basis, Projection, as_columns, share
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.solver import InterfaceSolver
from dolfinx_joints.solvers.reduced_error import ReducedError
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.dissipation import midpoint_coefficients
from dolfinx_joints.time_integration.midpoint import EnergyConsistent, ImplicitContact, exact_square
from dolfinx_joints.time_integration.scheme import Scheme, StepReport
from dolfinx_joints.time_integration.states import DynamicState

Floats = NDArray[np.float64]

# Of the norm of a shape, what of it counts as held by the others when a basis is begun.
HELD = 1e-6


@dataclass(frozen=True, kw_only=True)
@checked
class ReducedBulk:
    """Steps in which the body moves in few shapes, where that misses little of the whole body.

    The basis begins with the displacement at the start of the stage, the lowest modes of the body
    cut at its joints, its responses to the loads, and those to the patterns of joint forces that
    move it most. A step whose error is larger than the tolerance is taken by the whole body
    instead, and what it moved by becomes one more shape.

    Attributes:
        modes: Number of lowest modes.
        joint_forces: Number of patterns of joint forces.
        tolerance: Largest error of a step, the root of its energy over that of the largest energy
            of motion so far; both kinetic and strain energy, of the part from the start.
    """

    modes: Annotated[int, at.Ge(0)] = 100
    joint_forces: Annotated[int, at.Ge(0)] = 100
    tolerance: Annotated[float, at.Gt(0), at.Lt(1)] = 1e-3


@dataclass(kw_only=True)
class ReducedCounts:
    """What became of the steps of a reduced run.

    Attributes:
        shapes: Of the basis, at the end.
        dofs: Of the whole body.
        reduced: Steps taken in the basis, attempts rejected afterwards included.
        whole: Steps taken by the whole body.
        largest_error: Of the steps taken in the basis, see `ReducedBulk.tolerance`.
    """

    shapes: int = 0
    dofs: int = 0
    reduced: int = 0
    whole: int = 0
    largest_error: float = 0.0


class ReducedSteps:
    """A midpoint scheme that steps in a basis where it can.

    Its states are coordinates, `whole` and `Expanded` give those of the body. After a step of the
    whole body both ends are in the basis: u1 = u0 + x and v1 = 2 x / dt - v0. Nothing is projected
    away, so the energies of both kinds of steps are those of one ledger.

    Args:
        options: Basis and tolerance.
        scheme: Of the steps.
        solver: Of the whole body.
        state: Of the whole body at the start.
        dt: Length of most steps [s].

    Attributes:
        counts: Steps of both kinds.
        start: The state at the start.

    Raises:
        JointsError: The system or the scheme has what a basis cannot take.
    """

    def __init__(
        self,
        options: ReducedBulk,
        scheme: Scheme,
        solver: StepSolver,
        state: DynamicState,
        dt: float,
    ) -> None:
        """Make the basis (collective)."""
        system = solver.system
        _check(system, scheme, solver)
        assert isinstance(solver, InterfaceSolver)
        self._options, self._scheme, self._solver = options, scheme, solver
        self.rule: Rule = scheme.rule
        self.basis = Basis(system)
        self._projection = Projection(system, self.basis)
        self._reduced: InterfaceSolver | None = None
        self._errors: WeakKeyDictionary[Condensed, ReducedError] = WeakKeyDictionary()
        self.counts = ReducedCounts(dofs=system.mass.getSize()[0])
        self._begin(state, dt)
        self._largest, self._go_on_whole = 0.0, False
        self.start = self._in_coordinates(state)
        self._known: list[tuple[DynamicState, DynamicState]] = [(self.start, state)]
        self._before = self.start

    def conserves(self, system: MatrixSystem) -> bool:
        """Whether the balance is exact."""
        return self._scheme.conserves(system)

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float
    ) -> tuple[DynamicState, StepReport]:
        """One step of length dt [s], of a state of coordinates (collective)."""
        if not self._go_on_whole:
            state = self._renewed(state)
            try:
                after, report = self._scheme.advance(self._in_basis(), state, dt)
            except ConvergenceError:
                return self._by_whole_body(state, dt)
            error = self._relative(self._missed(state, after), after)
            if error <= self._options.tolerance:
                self.counts.reduced += 1
                self.counts.largest_error = max(self.counts.largest_error, error)
                self._before = state
                return after, report
        return self._by_whole_body(state, dt)

    def _by_whole_body(
        self, state: DynamicState, dt: float
    ) -> tuple[DynamicState, StepReport]:
        """The step of the whole body; the basis grows by what it moved by (collective)."""
        whole = self.whole(state)
        after, report = self._scheme.advance(self._solver, whole, dt)
        x = after.displacement.copy()
        x.axpy(-1.0, whole.displacement)
        missed = self._error(self._coefficients(dt)).missed(x)
        self.basis.add(x.array_r[:, None])
        self._projection.update()
        self._reduced = None
        reduced = self._in_coordinates(after)
        self._known = [(reduced, after)]
        self._go_on_whole = self._relative(missed, reduced) > self._options.tolerance
        self.counts.whole += 1
        self.counts.shapes = self.basis.size
        return reduced, report

    # ------------------------------------------------------------ errors

    def _error(self, effective: MatrixCoefficients) -> ReducedError:
        """That of steps with some coefficients, as long as the solver keeps them (collective)."""
        condensed = self._solver.condensed(effective, self.rule)
        if condensed not in self._errors:
            factors = self._solver.system.coefficients(
                effective.mass, effective.damping, effective.stiffness
            )
            self._errors[condensed] = ReducedError(self._projection, condensed, factors)
        return self._errors[condensed]

    def _coefficients(self, dt: float) -> MatrixCoefficients:
        return midpoint_coefficients(exact_square(2.0 / dt), 1.0, 0)

    def _missed(self, before: DynamicState, after: DynamicState) -> float:
        """Energy of the error of a step in the basis [J] (collective)."""
        error = self._error(midpoint_coefficients(after.rate, 1.0, 0))
        error.update()
        contact, joints = self._solver.system.contact, after.joints
        assert contact is not None
        assert joints is not None
        mine = (contact.operator.areas[:, None] * joints.traction).ravel()
        forces = np.concatenate(contact.operator.comm.allgather(mine))
        factors = self._solver.system.mean_factors(before.time, after.time)
        velocity, displacement = self._whole_array(before.velocity), self._whole_array(before.displacement)
        return error.energy(after.rate * velocity, displacement, factors, forces)

    def _relative(self, energy: float, after: DynamicState) -> float:
        """Root of an energy over that of the largest of motion, ``after`` included."""
        moved = self._whole_array(after.displacement) - self._whole_array(self.start.displacement)
        motion = after.kinetic_energy + 0.5 * float(moved @ (self._projection.stiffness @ moved))
        largest = max(self._largest, motion)
        self._largest = largest
        return math.sqrt(max(energy, 0.0) / largest) if largest > 0.0 else 0.0

    def _in_basis(self) -> InterfaceSolver:
        """Solver of the system in the basis as it is (collective)."""
        if self._reduced is None:
            options = replace(self._solver.options, linear="direct", compliance="dense")
            self._reduced = InterfaceSolver(self._projection.reduced(), options)
        return self._reduced

    # ------------------------------------------------------------ states

    def whole(self, state: DynamicState) -> DynamicState:
        """State of the whole body, from one of coordinates (collective)."""
        for reduced, known in self._known:
            if state.displacement is reduced.displacement:
                return replace(known, time=state.time)
        system, shown = self._solver.system, Expanded(self, state)
        momentum, elastic_force = (shown.displacement.duplicate() for _ in range(2))
        system.mass.mult(shown.velocity, momentum)
        system.stiffness.mult(shown.displacement, elastic_force)
        (acceleration,) = self.expanded(state.acceleration)
        return replace(
            state,
            displacement=shown.displacement,
            velocity=shown.velocity,
            acceleration=acceleration,
            load=system.load(state.time, momentum.duplicate()),
            reaction=shown.reaction,
            momentum=momentum,
            elastic_force=elastic_force,
            remainder=None,
        )

    def expanded(self, *vectors: PETSc.Vec) -> list[PETSc.Vec]:
        """Vectors of the body, V times coordinates (collective)."""
        return self.basis.expand(np.column_stack([self._whole_array(v) for v in vectors]))

    def reaction(self, state: DynamicState) -> PETSc.Vec:
        """Mean forces of the supports over the step that led to a state [N] (collective)."""
        system, before, rate = self._solver.system, self._before, state.rate
        effective = midpoint_coefficients(rate, 1.0, 0)
        of_mass, of_stiffness = system.coefficients(
            effective.mass, effective.damping, effective.stiffness
        )
        start = self._whole_array(before.displacement)
        x = self._whole_array(state.displacement) - start
        inertia = of_mass * x - rate * self._whole_array(before.velocity)
        parts = self.basis.expand(np.column_stack([inertia, of_stiffness * x + start]))
        force, work = parts[0].duplicate(), parts[0].duplicate()
        assert system.contact is not None
        assert state.joints is not None
        system.contact.operator.force(state.joints.traction, force)
        for matrix, part in zip((system.mass, system.stiffness), parts, strict=True):
            matrix.mult(part, work)
            force.axpy(1.0, work)
        for time in (before.time, state.time):
            force.axpy(-0.5, system.load(time, work))
        there = np.zeros(force.getLocalSize())
        there[system.constrained] = force.array_r[system.constrained]
        force.setArray(there)
        return force

    def distance(self, state: DynamicState) -> float:
        """2-norm over all dofs of the displacement from the start of the stage [m] (collective)."""
        moved = self._whole_array(state.displacement) - self._whole_array(self.start.displacement)
        return float(np.linalg.norm(moved))

    def shown(self, state: DynamicState) -> DynamicState | Expanded:
        """Vectors of the body, made when they are asked for."""
        known = any(state.displacement is reduced.displacement for reduced, _ in self._known)
        return self.whole(state) if known else Expanded(self, state)

    def _renewed(self, state: DynamicState) -> DynamicState:
        """The state in the basis as it is: forces of a smaller one lack rows (collective)."""
        if state.displacement.getSize() == self.basis.size:
            return state
        return self._in_coordinates(self.whole(state))

    def _in_coordinates(self, state: DynamicState) -> DynamicState:
        """State of coordinates, from one of the body that is in the basis (collective)."""
        names = ["displacement", "velocity", "acceleration", "load", "momentum", "elastic_force"]
        if state.remainder is not None:
            names.append("remainder")
        every = self.basis.coordinates(as_columns(getattr(state, name) for name in names))
        like = self._projection.coordinate_vector
        vectors = {n: share(one, like()) for n, one in zip(names, every.T, strict=True)}
        return replace(state, **vectors, reaction=share(np.zeros(0), like()))

    def _whole_array(self, vector: PETSc.Vec) -> Floats:
        """Coordinates on every rank, with zeros for what the basis has grown by (collective)."""
        every = np.concatenate(self.basis.comm.allgather(vector.array_r))
        return np.append(every, np.zeros(self.basis.size - len(every)))

    # ------------------------------------------------------------ first basis

    def _begin(self, state: DynamicState, dt: float) -> None:
        """The basis that the run begins with (collective)."""
        options, system = self._options, self._solver.system
        for vector in (state.displacement, state.velocity, state.acceleration):
            self.basis.add(vector.array_r[:, None])
        if options.modes:
            shapes = whole_groups(replace(system, contact=None), options.modes).shapes
            self.basis.add(as_columns(shapes), HELD)
        error = self._error(self._coefficients(dt))
        self.basis.add(error.load_responses, HELD)
        if options.joint_forces:
            error.update()
            self.basis.add(error.responses(self._strongest(error, options.joint_forces)), HELD)
        self._projection.update()
        self.counts.shapes = self.basis.size

    def _strongest(self, error: ReducedError, count: int) -> Floats:
        """Patterns of joint forces whose responses the basis misses most, shape (3 points, k).

        Of those of equal square mean over the joints' areas.
        """
        contact = self._solver.system.contact
        assert contact is not None
        areas = np.concatenate(contact.operator.comm.allgather(contact.operator.areas))
        roots = np.sqrt(np.repeat(areas, 3))
        size = len(roots)
        weighted = roots[:, None] * error.of_forces * roots
        last = [max(size - count, 0), size - 1]
        patterns: Floats = roots[:, None] * eigh(weighted, subset_by_index=last)[1]
        return patterns


class Expanded:
    """Vectors of the body at a state of coordinates, each made when it is first asked for."""

    def __init__(self, steps: ReducedSteps, state: DynamicState) -> None:
        """Keep the state."""
        self._steps, self._state = steps, state

    @cached_property
    def _both(self) -> list[PETSc.Vec]:
        return self._steps.expanded(self._state.displacement, self._state.velocity)

    @property
    def displacement(self) -> PETSc.Vec:
        """u [m] (collective)."""
        return self._both[0]

    @property
    def velocity(self) -> PETSc.Vec:
        """v [m/s] (collective)."""
        return self._both[1]

    @cached_property
    def reaction(self) -> PETSc.Vec:
        """Forces of the supports on the body at constrained dofs, zero elsewhere [N] (collective).

        Before the next step is taken.
        """
        return self._steps.reaction(self._state)


def _check(system: MatrixSystem, scheme: Scheme, solver: StepSolver) -> None:
    """Check that steps of the system can be taken in a basis (collective)."""
    plain = isinstance(scheme, EnergyConsistent | ImplicitContact)
    plain = plain and not scheme.exact_modes and scheme.spectral_radius == 1.0
    comm, contact = system.mass.comm.tompi4py(), system.contact
    wrong = {
        "a scheme other than EnergyConsistent() and ImplicitContact()": not plain,
        "a solver other than the condensed one": not isinstance(solver, InterfaceSolver),
        "rigid joints": contact is not None and contact.rigid,
        "moving supports": system.values is not None,
        "dashpots": system.dashpots is not None or system.absorption is not None,
        "unsymmetric matrices": not system.symmetric,
        "water that follows the joints": system.water is not None,
        "dofs without mass": sum(comm.allgather(len(system.massless))) > 0,
    }
    for what, there in wrong.items():
        if there:
            raise JointsError(f"reduced is given, but the run has {what}, which it cannot take.")
