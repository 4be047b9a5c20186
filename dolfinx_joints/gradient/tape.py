# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record of a run for its gradients: joint states of all accepted steps, and observed values.

The tape stores 41 bytes per joint point and step with Newmark's method and in statics, 81 bytes
with `EnergyConsistent`. It stores no field of the body; static increments with partial loads also
store these loads. The solvers of the stages, with their factors, stay in memory with the tape.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import of_ranks, summed
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.gradient.law_slopes import SUPPORTED
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.mesh.joint_pairs import no_such_joint
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.probes import PointProbe, Probe, check_points
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord
from dolfinx_joints.solvers.interface.solver import InterfaceSolver
from dolfinx_joints.solvers.step_solver import SolverAround, StepSolver
from dolfinx_joints.time_integration.midpoint import EnergyConsistent
from dolfinx_joints.time_integration.newmark import Newmark


@dataclass(frozen=True, kw_only=True)
class Step:
    """Accepted static increment or time step.

    Attributes:
        solver: Condensed solver of the stage.
        scheme: Time scheme, None in statics.
        times: Start and end [s].
        dt: Length of the step [s], 0 in statics.
        rate: 2 / dt as used by `EnergyConsistent`, 0 otherwise [1/s].
        rate_before: The same for the last step, 0 at the start.
        loads: Loads at the end of an increment with partial loads, by name [N]; else None.
    """

    solver: InterfaceSolver
    scheme: EnergyConsistent | Newmark | None
    times: tuple[float, float]
    dt: float = 0.0
    rate: float = 0.0
    rate_before: float = 0.0
    loads: Mapping[str, PETSc.Vec] | None = None


@dataclass(frozen=True, kw_only=True)
class History:
    """Observed values after each accepted step of a run.

    Attributes:
        times: Times [s], shape (steps,); in static stages the time of the loads.
        static: Number of static increments, which come before the time steps.
        values: Displacements (x, y, z) of the points and gaps (n, s1, s2) in the joints by name,
            each of shape (steps, 3), [m].
    """

    times: Floats
    static: int
    values: Mapping[str, Floats]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Smooth function of a `History`, with its derivative.

    Attributes:
        value: Function that returns the quantity.
        derivative: Function that returns the derivatives of the quantity by the observed values,
            arrays of shape (steps, 3) by name.
    """

    value: Callable[[History], float]
    derivative: Callable[[History], Mapping[str, Floats]]

    @classmethod
    def at_end(cls, name: str, component: int) -> Quantity:
        """Return a component of an observed value at the end of the run, such as residual slip."""
        if component not in (0, 1, 2):
            raise ValueError(f"component is {shown(component)}; it must be 0, 1 or 2.")

        def derivative(history: History) -> dict[str, Floats]:
            weights = np.zeros_like(history.values[name])
            weights[-1, component] = 1.0
            return {name: weights}

        return cls(value=lambda h: float(h.values[name][-1, component]), derivative=derivative)


@dataclass(eq=False, repr=False)
class Tape(Monitor):
    """Monitor that records a run for `gradient_of`: static stages, then at most one dynamic stage.

    Args:
        points: Points whose displacements are observed, by name: coordinates [m] or a `Probe`.
        gaps: Gaps that are observed, by name: a joint name for the mean over the area of the joint,
            or a joint name and coordinates [m] for its nearest point.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.0, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e9)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> tape = dj.Tape(gaps={"gap": "joint_1"})
        >>> state = dj.Simulation(model, monitors=[tape]).statics()
        >>> gradient = dj.gradient_of(tape, dj.Quantity.at_end("gap", 0))
        >>> change = gradient.by_joint["normal_stiffness"]["joint_1"]  # weight / k_n^2 [m^2/Pa]
        >>> bool(abs(1e9 * change / -gradient.value - 1.0) < 1e-8)
        True
    """

    points: Mapping[str, Any] | None = None
    _: KW_ONLY
    gaps: Mapping[str, Any] | None = None
    steps: list[Step] = field(default_factory=list, init=False)
    states: list[Floats] = field(default_factory=list, init=False)
    status: list[NDArray[np.int8]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        """Check the observed values; they are located when a simulation is created."""
        self._probes: dict[str, Probe] = check_points(self.points) if self.points else {}
        given = {} if self.gaps is None else self.gaps
        check_kind_of("gaps", given, isinstance(given, Mapping), "joints by name")
        self._places = {name: _joint_and_place(name, joint) for name, joint in given.items()}
        if both := self._probes.keys() & self._places.keys():
            raise ValueError(f"{both.pop()!r} is the name of a point and of a gap; choose another.")
        if not (self._probes or self._places):
            raise ValueError("A Tape observes nothing; give points= or gaps=.")
        self.model: Model | None = None
        self._last: JointState | None = None
        self._local: list[Floats] = []
        self._ended = False

    def check(self, model: Model) -> None:
        """Check that the model is supported, and locate the observed values (collective)."""
        if self.model is not None:
            raise JointsError("A Tape records one run; give each Simulation a new Tape.")
        self.model, self.contact = model, _supported_contact(model)
        nodes, self.observed_points = NodeNumbering(model.V), tuple(self._probes)
        self.probe = PointProbe(model, list(self._probes.values()), nodes)
        self.weights = {n: _weights(self.contact, *place) for n, place in self._places.items()}

    def increment(self, equilibrium: Any, solved: Any, increment: Any) -> None:
        """Record an increment of a static stage (collective)."""
        if self._ended:
            raise JointsError(f"A static stage follows a dynamic stage; {NOT_RECORDED}")
        if solved.before is None or solved.after is None:
            raise JointsError(f"No joint acts in the stage; {NOT_RECORDED}")
        self._begin(solved.before, partial=increment.share < 1.0)
        time = increment.time or 0.0
        step = Step(
            solver=_condensed(equilibrium.solver),
            scheme=None,
            times=(time, time),
            loads=solved.loads[1] if increment.share < 1.0 else None,
        )
        self._end(step, solved.after, equilibrium.displacement)

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Refuse grouting and construction stages."""
        state = stages[-1].state
        if state.joints is None or state.joints.state is not self._last:
            raise JointsError(f"Grouting changes joint states; {NOT_RECORDED}")
        if [*state.inactive, *state.absent]:
            raise JointsError(f"Joints are inactive or blocks are absent; {NOT_RECORDED}")
        if state.jumps:
            raise JointsError(
                f"The structure jumps, so its state is no smooth function; {NOT_RECORDED}"
            )

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Refuse a second dynamic stage, and support forces that depend on the static state."""
        if self._ended:
            raise JointsError(f"A second dynamic stage follows; {NOT_RECORDED}")
        if model.absorbing:
            raise JointsError(f"Viscous boundaries carry static reactions; {NOT_RECORDED}")
        self._ended = True

    def resume(self, *_: Any) -> None:
        """Refuse a restarted run."""
        raise JointsError(f"The run continues from a checkpoint; {NOT_RECORDED}")

    def substep(self, stepper: Any, before: Any, after: Any, report: Any) -> None:
        """Record an accepted time step (collective)."""
        scheme, system = stepper.scheme, stepper.solver.system
        exact = getattr(scheme, "exact_modes", 0)
        if type(scheme) not in (EnergyConsistent, Newmark) or exact:
            raise JointsError(
                f"The time scheme is {shown(scheme)}; gradients need EnergyConsistent without "
                "exact modes, or Newmark."
            )
        if system.shared is not None:
            raise JointsError(f"The run shares its matrices with others; {NOT_RECORDED}")
        newmark = isinstance(scheme, Newmark)
        self._begin(before.joints, partial=newmark)
        step = Step(
            solver=_condensed(stepper.solver),
            scheme=scheme,
            times=(before.time, after.time),
            dt=report.dt,
            rate=0.0 if newmark else after.rate,
            rate_before=before.rate,
        )
        self._end(step, after.joints, after.displacement)

    def _begin(self, before: Any, *, partial: bool) -> None:
        """Check that a step starts from the last recorded state (collective)."""
        comm = self.contact.operator.comm
        if self.states:
            if before.state is not self._last:
                raise JointsError(f"A stage does not start from the last one; {NOT_RECORDED}")
            return
        state, gap = before.state, self.contact.initial_gap
        moved = not np.array_equal(state.gap, gap) or state.elastic_slip.any()
        flags = of_ranks(comm, np.array([moved, before.traction.any()], dtype=float)).max(axis=0)
        if flags[0]:
            raise JointsError(
                f"The first stage does not start from the unloaded body; {NOT_RECORDED}"
            )
        if flags[1] and partial:
            raise JointsError(
                "Joints have tractions at the start, because of initial overlaps: gradients then "
                "need a first static stage with one step."
            )
        self.states.append(_columns(state))

    def _end(self, step: Step, joints: Response, displacement: PETSc.Vec) -> None:
        self.steps.append(step)
        self.states.append(_columns(joints.state))
        self.status.append(joints.status)
        self._local.append(self.probe.local(displacement))
        self._last = joints.state

    def history(self) -> History:
        """Return the observed values of all steps (collective)."""
        steps = len(self.steps)
        if not steps:
            raise JointsError("The tape is empty; pass it to Simulation(monitors=[...]), then run.")
        shape = (steps, *self.probe.dofs.shape)
        displacements = self.probe.of_all_ranks(np.array(self._local).reshape(shape))
        values = {name: displacements[:, i] for i, name in enumerate(self._probes)}
        for name, weights in self.weights.items():
            local = np.array([weights @ state[:, :3] for state in self.states[1:]])
            values[name] = summed(self.contact.operator.comm, local)
        static = sum(step.scheme is None for step in self.steps)
        times = np.array([step.times[1] for step in self.steps])
        return History(times=times, static=static, values=values)


NOT_RECORDED = "gradients do not include this case."


def _columns(state: JointState) -> Floats:
    """Return gap, elastic slip and slips, shape (n, 5 or 10)."""
    slips = [state.slips] if len(state.slips) else []
    return np.hstack([state.gap, state.elastic_slip, *slips])


def _supported_contact(model: Model) -> Contact:
    """Return the joints of a model; refuse models whose gradients are not implemented."""
    contact, system = model.contact, model.system()
    refused = {
        "Plastic cells": model.bulk is not None,
        "Waves in a reservoir": model.coupled is not None,
        "Water that follows the openings of joints": system.water is not None,
        "Damping ratios of modes": model.damped_modes is not None,
        "Unsymmetric matrices": not system.symmetric,
    }
    for name, given in refused.items():
        if given:
            raise JointsError(f"{name} are not supported by gradients; remove the Tape.")
    if contact is None:
        raise JointsError("The model has no joints; a Tape records joints.")
    for name, law in contact.laws.items():
        if type(law) not in SUPPORTED:
            names = " and ".join(kind.__name__ for kind in SUPPORTED)
            raise JointsError(
                f"Joint {name!r} has the law {type(law).__name__}; gradients support {names}."
            )
    return contact


def _condensed(solver: StepSolver) -> InterfaceSolver:
    """Return the condensed solver inside wrappers."""
    while isinstance(solver, SolverAround):
        solver = solver.inner
    if not isinstance(solver, InterfaceSolver):
        raise JointsError(
            f"The solver is {solver.name!r}; gradients need Simulation(solver='condensed')."
        )
    return solver


def _joint_and_place(name: str, given: Any) -> tuple[str, Floats | None]:
    """Check an observed gap; return its joint, and its coordinates if they are given."""
    if isinstance(given, str):
        return given, None
    pair = isinstance(given, Sequence) and len(given) == 2 and isinstance(given[0], str)
    check_kind_of(f"The gap {shown(name)}", given, pair, "a joint, or a joint and coordinates")
    place, (joint, coordinates) = np.zeros(3), given
    numbers = check_vector(f"The gap {shown(name)}", coordinates, (2, 3))
    place[: len(numbers)] = numbers
    return joint, place


def _weights(contact: Contact, joint: str, place: Floats | None) -> Floats:
    """Return the weights of the local points in an observed gap, shape (n,) (collective)."""
    operator = contact.operator
    if joint not in operator.names:
        raise JointsError(no_such_joint(joint, operator.names))
    in_joint = (operator.joint == operator.names.index(joint)) & ~contact.tied
    if place is None:
        areas = np.where(in_joint, operator.areas, 0.0)
        return areas / operator.comm.allreduce(float(areas.sum()))
    assert operator.points is not None
    distance = np.where(in_joint, np.linalg.norm(operator.points - place, axis=1), np.inf)
    nearest = int(np.argmin(distance)) if len(distance) else 0
    smallest = float(distance.min(initial=np.inf))
    _, rank = min((d, r) for r, d in enumerate(operator.comm.allgather(smallest)))
    weights = np.zeros(len(distance))
    if rank == operator.comm.rank:
        weights[nearest] = 1.0
    return weights
