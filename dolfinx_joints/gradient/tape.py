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

        def value(history: History) -> float:
            if name not in history.values:
                raise ValueError(not_observed(name, history))
            return float(history.values[name][-1, component])

        def derivative(history: History) -> dict[str, Floats]:
            weights = np.zeros_like(history.values[name])
            weights[-1, component] = 1.0
            return {name: weights}

        return cls(value=value, derivative=derivative)


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
        self.probes: dict[str, Probe] = check_points(self.points) if self.points else {}
        given = {} if self.gaps is None else self.gaps
        check_kind_of("gaps", given, isinstance(given, Mapping), "joints by name")
        self._places = {name: _joint_and_place(name, joint) for name, joint in given.items()}
        if both := self.probes.keys() & self._places.keys():
            raise ValueError(f"{both.pop()!r} is the name of a point and of a gap; choose another.")
        if not (self.probes or self._places):
            raise ValueError("A Tape observes nothing; give points= or gaps=.")
        self.model: Model | None = None
        self._last: JointState | None = None
        self._local: list[Floats] = []
        self._ended = False

    def check(self, model: Model) -> None:
        """Check that the laws are supported, and locate the observed values (collective)."""
        if self.model is not None:
            raise JointsError("A Tape records one run; give each Simulation a new Tape.")
        if model.contact is None:
            raise JointsError("The model has no joints; a Tape records joints.")
        for name, law in model.contact.laws.items():
            if type(law) not in SUPPORTED:
                names = " and ".join(kind.__name__ for kind in SUPPORTED)
                raise JointsError(
                    f"Joint {name!r} has the law {type(law).__name__}; gradients support {names}."
                )
        self.model, self.contact = model, model.contact
        self.probe = PointProbe(model, list(self.probes.values()), NodeNumbering(model.V))
        self.weights = {n: _weights(self.contact, *place) for n, place in self._places.items()}

    def increment(self, equilibrium: Any, solved: Any, increment: Any) -> None:
        """Record an increment of a static stage (collective)."""
        _refuse("A static stage follows a dynamic stage", self._ended)
        _refuse("No joint acts in the stage", solved.before is None or solved.after is None)
        self._begin(solved.before, needs_balance=increment.share < 1.0)
        time = increment.time or 0.0
        loads = solved.loads[1] if increment.share < 1.0 else None
        solver = _condensed(equilibrium.solver)
        step = Step(solver=solver, scheme=None, times=(time, time), loads=loads)
        self._end(step, solved.after, equilibrium.displacement)

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Refuse grouting, construction stages and jumps."""
        state = stages[-1].state
        same = state.joints is not None and state.joints.state is self._last
        _refuse("Joints are inactive or blocks are absent", bool(state.inactive or state.absent))
        _refuse("Grouting changes joint states", not same)
        _refuse("The structure jumps, so its state is no smooth function", bool(state.jumps))

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Refuse a second dynamic stage, and support forces that depend on the static state."""
        _refuse("A second dynamic stage follows", self._ended)
        _refuse("Viscous boundaries carry static reactions", bool(model.absorbing))
        self._ended = True

    def resume(self, *_: Any) -> None:
        """Refuse a restarted run."""
        _refuse("The run continues from a checkpoint", True)

    def substep(self, stepper: Any, before: Any, after: Any, report: Any) -> None:
        """Record an accepted time step (collective)."""
        scheme, newmark = stepper.scheme, isinstance(stepper.scheme, Newmark)
        if type(scheme) not in (EnergyConsistent, Newmark) or getattr(scheme, "exact_modes", False):
            raise JointsError(
                f"The time scheme is {shown(scheme)}; gradients need EnergyConsistent without "
                "exact modes, or Newmark."
            )
        self._begin(before.joints, needs_balance=newmark)
        step = Step(
            solver=_condensed(stepper.solver),
            scheme=scheme,
            times=(before.time, after.time),
            dt=report.dt,
            rate=after.rate,
            rate_before=before.rate,
        )
        self._end(step, after.joints, after.displacement)

    def _begin(self, before: Response, *, needs_balance: bool) -> None:
        """Check that a step starts from the last recorded state (collective)."""
        state = before.state
        if self.states:
            _refuse("A stage does not start from the last one", state is not self._last)
            return
        moved = not np.array_equal(state.gap, self.contact.initial_gap) or state.elastic_slip.any()
        flags = np.array([moved, needs_balance and before.traction.any()], dtype=float)
        moved, overlaps = of_ranks(self.contact.operator.comm, flags).max(axis=0)
        _refuse("The first stage does not start from the unloaded body", bool(moved))
        _refuse("Initial overlaps load the body before a static stage of one step", bool(overlaps))
        self.states.append(_columns(state))

    def _end(self, step: Step, joints: Response, displacement: PETSc.Vec) -> None:
        self.steps.append(step)
        self.states.append(_columns(joints.state))
        self.status.append(joints.status)
        self._local.append(self.probe.local(displacement))
        self._last = joints.state

    def history(self) -> History:
        """Return the observed values of all steps (collective)."""
        if not self.steps:
            raise JointsError("The tape is empty; pass it to Simulation(monitors=[...]), then run.")
        shape = (len(self.steps), *self.probe.dofs.shape)
        displacements = self.probe.of_all_ranks(np.array(self._local).reshape(shape))
        values = {name: displacements[:, i] for i, name in enumerate(self.probes)}
        for name, weights in self.weights.items():
            local = np.array([weights @ state[:, :3] for state in self.states[1:]])
            values[name] = summed(self.contact.operator.comm, local)
        static = sum(step.scheme is None for step in self.steps)
        times = np.array([step.times[1] for step in self.steps])
        return History(times=times, static=static, values=values)


def not_observed(name: str, history: History) -> str:
    """Return the message for a name that is not observed."""
    return f"{name!r} is not observed; the names are {', '.join(history.values)}."


def _refuse(case: str, given: bool) -> None:
    """Raise the error for a case that gradients do not include."""
    if given:
        raise JointsError(f"{case}; gradients do not include this case.")


def _columns(state: JointState) -> Floats:
    """Return gap, elastic slip and slips, shape (n, 5 or 10)."""
    slips = [state.slips] if len(state.slips) else []
    return np.hstack([state.gap, state.elastic_slip, *slips])


def _condensed(solver: StepSolver) -> InterfaceSolver:
    """Return the condensed solver inside wrappers; refuse systems that are not supported."""
    while isinstance(solver, SolverAround):
        solver = solver.inner
    system = solver.system
    _refuse("Water follows the openings of joints", system.water is not None)
    _refuse("A reservoir has waves", system.coupled is not None)
    _refuse("The body has nonlinear cells", system.bulk is not None)
    _refuse("The damping has ratios of modes", system.damped_modes is not None)
    _refuse("Matrices are unsymmetric", not system.symmetric)
    _refuse("Several runs share their matrices", system.shared is not None)
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
    place = np.zeros(3)
    numbers = check_vector(f"The gap {shown(name)}", given[1], (2, 3))
    place[: len(numbers)] = numbers
    return given[0], place


def _weights(contact: Contact, joint: str, place: Floats | None) -> Floats:
    """Return the weights of the local points in an observed gap, shape (n,) (collective)."""
    operator = contact.operator
    if joint not in operator.names:
        raise JointsError(no_such_joint(joint, operator.names))
    in_joint = (operator.joint == operator.names.index(joint)) & ~contact.tied
    weights = np.where(in_joint, operator.areas, 0.0)
    if place is not None:
        assert operator.points is not None
        distance = np.where(in_joint, np.linalg.norm(operator.points - place, axis=1), np.inf)
        shortest = operator.comm.allgather(float(distance.min(initial=np.inf)))
        weights[:] = 0.0
        if operator.comm.rank == int(np.argmin(shortest)):
            weights[int(np.argmin(distance))] = 1.0
    return weights / operator.comm.allreduce(float(weights.sum()))
