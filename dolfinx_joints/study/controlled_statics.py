# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages with an unknown load factor, controlled by a gap or a displacement (28f)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.places import SAME_PLACE, extent, node_at, nodes_of_group
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JumpError, MeshError
from dolfinx_joints.common.mpi import free_petsc_garbage, summed
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.loads.load import FollowsJoints, JointLoad, Load, load_names
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.monitor import report_failures
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import stage_name, stage_record
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.simulation.start_checks import check_built
from dolfinx_joints.simulation.statics.jumps import Jumps
from dolfinx_joints.simulation.statics.load_increments import Increment, LoadIncrements
from dolfinx_joints.simulation.statics.stage import Equilibrium, check_acting, solve_increments
from dolfinx_joints.simulation.statics.stage_start import (
    carried_loads,
    start_of_stage,
    unloaded_state,
)
from dolfinx_joints.simulation.statics.unfinished import check_joints, points_of
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.step_solver import SolverOptions
from dolfinx_joints.time_integration.products import Products
from dolfinx_joints.time_integration.substeps import locate


@dataclass(frozen=True, kw_only=True)
@checked
class ControlledGap:
    """Mean gap of a joint over its area, or the gap at a point of the joint.

    Attributes:
        joint: Name of the joint.
        component: ``opening``, or tangential gap along the axis ``s1`` or ``s2``.
        point: Coordinates [m], of which the nearest joint point is used; None for the mean.
    """

    joint: str
    component: Literal["opening", "s1", "s2"] = "opening"
    point: Annotated[Sequence[float], at.Len(2, 3), at.Unit("m")] | None = None

    def at(self, model: Model, u: PETSc.Vec, gap: Floats) -> tuple[PETSc.Vec, float]:
        """Return the derivative c by the displacement, and the value at gaps (n, 3) [m]."""
        check_joints(model, [self.joint])
        operator, axis = model.operator, ("opening", "s1", "s2").index(self.component)
        assert operator is not None
        chosen = points_of(model, [self.joint])
        if self.point is not None:
            place = np.pad(check_vector("point", self.point, (model.gdim,)), (0, 3 - model.gdim))
            distance = np.where(chosen, np.linalg.norm(operator.points - place, axis=1), np.inf)
            nearest = min(operator.comm.allgather(float(distance.min(initial=np.inf))))
            assert operator.sizes is not None
            size = float(operator.sizes[chosen].max(initial=0.0))
            if nearest > max(operator.comm.allgather(size)):
                where = f"{nearest:.3g} m from the joint {self.joint!r}"
                raise MeshError(f"The point {shown(self.point)} is {where}; give a point on it.")
            chosen = distance <= nearest + SAME_PLACE * extent(model.V)
        density = np.zeros_like(gap)
        density[chosen, axis] = 1.0 / summed(operator.comm, operator.areas @ chosen)
        value = summed(operator.comm, operator.areas @ (density * gap).sum(axis=1))
        return operator.force(density, u.duplicate()), float(value)


@dataclass(frozen=True, kw_only=True)
@checked
class ControlledDisplacement:
    """Displacement of a place along a direction, or relative displacement of two places.

    A place is a node, given by its coordinates [m], or a group, of whose nodes the mean counts. The
    crack mouth opening of a notch is the relative displacement of its faces.

    Attributes:
        along: Vector of the direction, of any length, (gdim,).
        place: Coordinates of a node, or name of a group.
        relative_to: Place whose displacement is subtracted, or None.
    """

    along: Annotated[Sequence[float], at.Len(2, 3)]
    place: Annotated[Sequence[float] | str, at.Unit("m")]
    relative_to: Annotated[Sequence[float] | str | None, at.Unit("m")] = None

    def at(self, model: Model, u: PETSc.Vec, gap: Floats) -> tuple[PETSc.Vec, float]:
        """Return the derivative c by the displacement, and the value at a displacement u [m]."""
        vector = check_vector("along", self.along, (model.gdim,))
        check_kind_of("along", self.along, bool(vector.any()), "a vector of a length above zero")
        derivative = 0.0 * u
        for sign, place in ((1.0, self.place), (-1.0, self.relative_to)):
            if place is None:
                continue
            if isinstance(place, str):
                nodes = nodes_of_group(model.jointed, model.V, place)
            else:
                point = [float(x) for x in check_vector("A place", place, (model.gdim,))]
                label, remedy = f"The place {shown(tuple(point))}", "give another node or a group"
                nodes = node_at(model.jointed, model.V, label, point, remedy=remedy)
            count = sum(model.jointed.mesh.comm.allgather(len(nodes)))
            share = sign / (count * np.linalg.norm(vector))
            derivative.getArray().reshape(-1, model.gdim)[nodes] += share * vector
        return derivative, float(derivative.dot(u))


@checked
def controlled_statics(
    simulation: Simulation,
    values: Annotated[Sequence[float], at.MinLen(1), at.Unit("m")],
    *,
    loads: Annotated[Sequence[Load], at.MinLen(1)],
    quantity: ControlledGap | ControlledDisplacement,
    name: str | None = None,
) -> StaticState:
    """Follow the equilibrium through values of a gap or displacement (collective).

    The loads, at the time of the last static stage or at zero, are multiplied by an unknown factor,
    which falls while bonds soften. Other loads of the last static stage and the positions of the
    supports stay constant. Each value is a separate stage, "NAME, 1" and so on, whose state has the
    ``load_factor``.

    Args:
        simulation: Simulation of a model with joints; its last static stage is the start.
        values: Values of the quantity at the ends of the steps [m].
        loads: Loads of the model with the unknown factor, except water in joints and temperatures.
        quantity: The controlled quantity.
        name: Name in results, "controlled statics 1" and so on by default.

    Raises:
        JumpError: The next equilibrium is distant: the path turns back in the quantity (snap-back).
        ConvergenceError: No equilibrium was found, for example because of a snap-back.
        JointsError: The loads do not change the quantity, or the solver is not the condensed one.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=20e9, poisson=0.0, density=2400.0)
        >>> law = dj.CohesiveJoint(
        ...     normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=35.0,
        ...     tensile_strength=1e5, cohesion=1e5, fracture_energy=50.0,
        ...     shear_fracture_energy=50.0, softening="linear",
        ... )
        >>> pull, base = dj.Traction(group="top", value=(0.0, 0.0, 1e5)), dj.Fixed(group="base")
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[base], loads=[pull])
        >>> run, gap = dj.Simulation(model), dj.ControlledGap(joint="joint_1")
        >>> state = dj.controlled_statics(run, [1e-6, 5e-4], loads=[pull], quantity=gap)
        >>> [round(s.state.load_factor, 2) for s in run.stages]  # strength, half of it at G_I / f_t
        [1.0, 0.5]
    """
    model, monitors, stages = simulation.model, simulation.monitors, simulation.stages
    check_acting(model, loads)
    for load in loads:
        # Results evaluate pressures in joints and thermal stresses without the load factor.
        scales = not isinstance(load, JointLoad | Temperature)
        check_kind_of(
            "A controlled load", load, scales, "a load other than Temperature and water in joints"
        )
    kinds = ControlledGap | ControlledDisplacement
    check_kind_of("quantity", quantity, isinstance(quantity, kinds), "a controlled quantity")
    check_built(simulation.static)
    before = simulation.static or unloaded_state(model)
    named = dict(zip(load_names(model.loads), model.loads, strict=True))
    names = [n for n, m in named.items() if n in before.loads or any(m is x for x in loads)]
    acting, missing = [named[n] for n in names], tuple(n for n in named if n not in names)
    for load in acting:
        constant = not isinstance(load, FollowsJoints)
        check_kind_of("A load", load, constant, "independent of the joints in controlled statics")
    name = stage_name(name, "controlled statics", stages)
    stage_name(f"{name}, 1", "", stages)  # Raises an error if an earlier path has this name.
    time = stages[-1].time if stages else 0.0
    with simulation.phase("static"), report_failures(name, model, monitors, stages):
        path = ControlledPath(simulation, before, loads, quantity, time)
        for step, state in enumerate(path.follow(values), start=1):
            simulation.static = state = replace(state, missing=missing)
            simulation.add_stage(stage_record(model, f"{name}, {step}", time, state, acting))
    free_petsc_garbage(model.jointed.mesh.comm)  # Matrices of the stage's solver.
    return state


class ControlledPath(Equilibrium):
    """Equilibria at values of a controlled quantity, with the loads at a time [s]."""

    def __init__(
        self,
        simulation: Simulation,
        before: StaticState,
        loads: Sequence[Load],
        quantity: ControlledGap | ControlledDisplacement,
        time: float,
    ) -> None:
        """Prepare the system and its solver (collective)."""
        self._model = simulation.model
        system = self._model.system(only=loads, static=True)
        start = start_of_stage(system, before)
        carried = carried_loads(system, before, start)
        self._controlled = system.loads_by_name(time, 1.0)
        self._constant_loads = {n: v for n, v in carried.items() if n not in self._controlled}
        gap = np.zeros((0, 3)) if start is None else start.state.gap
        self._direction, self._start_value = quantity.at(self._model, before.displacement, gap)
        self._load, self._factor, self.factor = system.vector(), 0.0, 0.0
        for force in self._controlled.values():
            self._load.axpy(1.0, force)
        self._free_load = self._load.copy()
        for vector in (self._free_load, self._direction):
            vector.getArray()[system.constrained] = 0.0
        fixed = before.displacement.getArray()[system.constrained]
        control = self._free_load, self._direction
        system = replace(system, values=lambda _: fixed, control=control)
        options, kind = simulation.options or SolverOptions(), simulation.solver
        solver = make_solver(system, options, kind, static_steps=1)
        super().__init__(system, solver, before, start, carried, constant=True)

    def follow(self, values: Sequence[float]) -> Iterator[StaticState]:
        """Yield the equilibrium at each value of the quantity [m] (collective)."""
        increments = LoadIncrements([(None, float(value)) for value in values], self._start_value)
        jumps = Jumps(self.ledger, self._model, False)
        watch = SmallDisplacements(self._model.contact)
        try:
            for increment, _ in solve_increments(self, increments, jumps, "condensed", watch):
                self.factor = self._factor
                if increment.whole:
                    facts = {"load_factor": self.factor, "controlled": increment.share}
                    yield self.state({"cuts": increments.cuts, **facts})
        except ConvergenceError as failure:
            if failure.law is None:
                failure = locate(failure, reached=self.factor, remedy=_remedy(failure))
            raise failure from None
        watch.warn("in a static stage")
        self.ledger.warn()

    def _set_up(self, increment: Increment) -> None:
        """Set b without the controlled loads, and x with the change of the quantity."""
        self._factor = 0.0
        super()._set_up(increment)
        change = (increment.share - increment.start) / (self._direction.norm() ** 2 or 1.0)
        self._direction.copy(self._x)
        self._x.scale(change)

    def _products(self, response: Response | None) -> Products:
        """Return the products with the factor that balances the solution (collective)."""
        unbalanced = super()._products(response).remainder
        self._factor = float(unbalanced.dot(self._free_load)) / float(self._free_load.norm()) ** 2
        self._b.axpy(self._factor, self._load)
        return super()._products(response)

    def _loads(self, increment: Increment) -> dict[str, PETSc.Vec]:
        """Return the loads by name at the end of an increment [N] (collective)."""
        return self._constant_loads | {n: self._factor * v for n, v in self._controlled.items()}


def _remedy(failure: ConvergenceError) -> str:
    """Return the value of the quantity at the start of the failed increment, and what to do."""
    last = f"At the last equilibrium the controlled quantity is {failure.reached:.6g} m."
    remedy = "control a quantity that grows along the whole path, such as the opening of"
    if isinstance(failure, JumpError):
        joint = f"the joint {failure.joints[0]!r}" if failure.joints else "a joint that breaks"
        return f"{last} Beyond it the path turns back (snap-back): {remedy} {joint}."
    return (
        f"{last} If the path turns back beyond it (snap-back), {remedy} the joint that breaks. "
        "If all bonds are broken, no force remains to be followed. The values must be in metres."
    )
