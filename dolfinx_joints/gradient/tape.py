# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record of a run for its gradients: joint states of all accepted steps, and observed values.

The tape stores 41 bytes per joint point and step with Newmark's method and in statics, 81 bytes
with `EnergyConsistent`. It stores fields of the body only for derivatives by parameters of the
model, and these in a temporary file. The solvers of the stages, with their factors, stay in memory
with the tape.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import of_ranks, summed
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.gradient.law_slopes import SLIP, SLIPS, SUPPORTED
from dolfinx_joints.gradient.quantity import History
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    JointState,
    Response,
    Rule,
)
from dolfinx_joints.mesh.joint_pairs import no_such_joint
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.monitors.probes import PointProbe, Probe, check_points
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord
from dolfinx_joints.solvers.effective_matrix import STATIC, MatrixCoefficients
from dolfinx_joints.solvers.interface.solver import InterfaceSolver
from dolfinx_joints.solvers.step_solver import SolverAround, StepSolver
from dolfinx_joints.time_integration.midpoint import EnergyConsistent
from dolfinx_joints.time_integration.newmark import Newmark
from dolfinx_joints.time_integration.products import combination
from dolfinx_joints.time_integration.states import DynamicState


class LoadsAt(NamedTuple):
    """Loads of a system at a time [s], with a weight."""

    system: MatrixSystem
    time: float
    weight: float


@dataclass(frozen=True, kw_only=True)
class Step:
    """Accepted static increment or time step.

    Attributes:
        solver: Condensed solver of the stage.
        scheme: Time scheme, None in statics.
        times: Start and end [s].
        loads: The loads of the step are the sum of these loads times their weights.
        dt: Length of the step [s], 0 in statics.
        rate: 2 / dt as used by `EnergyConsistent`, 0 otherwise [1/s].
        rate_before: The same for the last step, 0 at the start.
    """

    solver: InterfaceSolver
    scheme: EnergyConsistent | Newmark | None
    times: tuple[float, float]
    loads: Sequence[LoadsAt]
    dt: float = 0.0
    rate: float = 0.0
    rate_before: float = 0.0

    @property
    def rule(self) -> Rule:
        """Rule by which the laws are evaluated."""
        return DISCRETE_GRADIENT if isinstance(self.scheme, EnergyConsistent) else BACKWARD_EULER

    @property
    def columns(self) -> int:
        """Number of columns of a joint state: gap and elastic slip, and slips over whole steps."""
        return SLIPS.stop if self.rule == DISCRETE_GRADIENT else SLIP.stop

    @property
    def coefficients(self) -> MatrixCoefficients:
        """Coefficients of the matrix."""
        if self.scheme is None:
            return STATIC
        if isinstance(self.scheme, Newmark):
            beta, gamma, dt = self.scheme.beta, self.scheme.gamma, self.dt
            mass, damping = 1.0 / (beta * dt**2), gamma / (beta * dt)
            return MatrixCoefficients(mass=mass, damping=damping, stiffness=1.0)
        return MatrixCoefficients(mass=0.5 * self.rate**2, damping=0.5 * self.rate, stiffness=0.5)

    def fields(self, before: DynamicState, after: DynamicState) -> tuple[PETSc.Vec, ...]:
        """Return the u, v, a that K, C and M multiply in the equation of a time step."""
        ends = (after.displacement, after.velocity, after.acceleration)
        if isinstance(self.scheme, Newmark):
            return ends
        half, rate = 0.5, 0.5 * self.rate
        return (
            combination((half, before.displacement), (half, after.displacement)),
            combination((-rate, before.displacement), (rate, after.displacement)),
            combination((-rate, before.velocity), (rate, after.velocity)),
        )

    @property
    def slip_scale(self) -> float:
        """Factor of the step length by which the step rescales the last slips; 1 if it does not."""
        return self.rate_before / self.rate if self.rate_before else 1.0


class BodyFields:
    """Fields of the body in the steps of a run, in a temporary file of this rank."""

    def __init__(self) -> None:
        """Open the file."""
        self._file, self._starts = TemporaryFile(), [0]  # noqa: SIM115 - open as long as the tape
        self._counts: list[int] = []

    def append(self, fields: Sequence[PETSc.Vec]) -> None:
        """Store the fields of a step."""
        self._file.seek(self._starts[-1])
        for vector in fields:
            self._file.write(vector.getArray(readonly=True).tobytes())
        self._starts.append(self._file.tell())
        self._counts.append(len(fields))

    def read(self, step: int, like: PETSc.Vec) -> list[PETSc.Vec]:
        """Return the fields of a step as new vectors."""
        self._file.seek(self._starts[step])
        stored = self._file.read(self._starts[step + 1] - self._starts[step])
        rows = np.array(bytearray(stored)).view(float).reshape(self._counts[step], -1)
        vectors = [like.duplicate() for _ in rows]
        for vector, row in zip(vectors, rows, strict=True):
            vector.setArray(row)
        return vectors


@dataclass(eq=False, repr=False)
class Tape(Monitor):
    """Monitor that records a run for `gradient_of`: static stages, then at most one dynamic stage.

    Args:
        points: Points whose displacements are observed, by name: coordinates [m] or a `Probe`.
        gaps: Gaps that are observed, by name: a joint name for the mean over the area of the joint,
            or a joint name and coordinates [m] for its nearest point.
        body: Also store the fields of the body, for derivatives by parameters of the model.

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
    body: bool = False
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
        self._loads: Sequence[LoadsAt] = ()  # of the last increment, and of the last load step
        self._loads_before: Sequence[LoadsAt] = ()
        self._load_step: Any = None
        self.first_motion: list[PETSc.Vec] = []  # velocity and acceleration (Newmark)
        self.fields = BodyFields() if self.body else None

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
        self.weights = {n: _weights(model, n, *place) for n, place in self._places.items()}

    def increment(self, equilibrium: Any, solved: Any, increment: Any) -> None:
        """Record an increment of a static stage (collective)."""
        _refuse("A static stage follows a dynamic stage", self._ended)
        _refuse("No joint acts in the stage", solved.before is None or solved.after is None)
        self._begin(solved.before, needs_balance=increment.share < 1.0)
        time, share = increment.time or 0.0, increment.share
        solver = _condensed(equilibrium.solver)
        # A ramp is one load step. Loads vary linearly over a load step.
        load_step = solver, None if increment.time is None else increment.step
        if load_step != self._load_step:
            self._load_step, self._loads_before = load_step, self._loads
        loads = [LoadsAt(solver.system, time, share)]
        loads += [at._replace(weight=(1.0 - share) * at.weight) for at in self._loads_before]
        self._loads = [at for at in loads if at.weight]
        step = Step(solver=solver, scheme=None, times=(time, time), loads=self._loads)
        u = equilibrium.displacement
        self._end(step, solved.after, u, [u])

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Refuse all stages but `statics` and `quasi_statics`, construction stages and jumps."""
        name, state = stages[-1].name, stages[-1].state
        same = state.joints is not None and state.joints.state is self._last
        _refuse("Joints are inactive or blocks are absent", bool(state.inactive or state.absent))
        _refuse(f"The stage {name!r} is not one of statics() or quasi_statics()", not same)
        _refuse("The structure jumps, so its state is no smooth function", bool(state.jumps))

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Refuse a second dynamic stage, viscous boundaries, and motions that differ."""
        _refuse("A second dynamic stage follows", self._ended)
        _refuse("Viscous boundaries carry static reactions", bool(model.absorbing))
        _refuse("The motion differs between supports", first.static_part is not None)
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
        if newmark and (not self.steps or self.steps[-1].scheme is None):
            self.first_motion = [before.velocity.copy(), before.acceleration.copy()]
        solver, times = _condensed(stepper.solver), (before.time, after.time)
        shares = (0.0, 1.0) if newmark else (0.5, 0.5)
        step = Step(
            solver=solver,
            scheme=scheme,
            times=times,
            loads=[LoadsAt(solver.system, *at) for at in zip(times, shares, strict=True) if at[1]],
            dt=report.dt,
            rate=after.rate,
            rate_before=before.rate,
        )
        fields = [] if self.fields is None else step.fields(before, after)
        self._end(step, after.joints, after.displacement, fields)

    def _begin(self, before: Response, *, needs_balance: bool) -> None:
        """Check that a step starts from the last recorded state (collective)."""
        if self.model is None:
            raise JointsError(
                "A Tape was added to a simulation; give it to Simulation(monitors=[tape])."
            )
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

    def _end(
        self, step: Step, joints: Response, displacement: PETSc.Vec, fields: Sequence[PETSc.Vec]
    ) -> None:
        """Store an accepted step, and the displacement at its end."""
        self.steps.append(step)
        self.states.append(_columns(joints.state))
        self.status.append(joints.status)
        self._local.append(self.probe.local(displacement))
        if self.fields is not None:
            self.fields.append(fields)
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
    return given[0], check_vector(f"The gap {shown(name)}", given[1], (2, 3))


def _weights(model: Model, name: str, joint: str, place: Floats | None) -> Floats:
    """Return the weights of the local points in an observed gap, shape (n,) (collective)."""
    assert model.contact is not None
    operator, tied = model.contact.operator, model.contact.tied
    if joint not in operator.names:
        raise JointsError(no_such_joint(joint, operator.names))
    in_joint = (operator.joint == operator.names.index(joint)) & ~tied
    weights = np.where(in_joint, operator.areas, 0.0)
    if place is not None:
        assert operator.points is not None
        position = np.zeros(3)
        position[: model.gdim] = check_vector(f"The gap {shown(name)}", place, (model.gdim,))
        distance = np.where(in_joint, np.linalg.norm(operator.points - position, axis=1), np.inf)
        shortest = operator.comm.allgather(float(distance.min(initial=np.inf)))
        weights[:] = 0.0
        if operator.comm.rank == int(np.argmin(shortest)):
            weights[int(np.argmin(distance))] = 1.0
    return weights / operator.comm.allreduce(float(weights.sum()))
