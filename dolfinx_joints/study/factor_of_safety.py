# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factor of safety of a static state, by reduced strength of joints or by multiplied loads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from mpi4py import MPI

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.common.summary import Rows, Summarised, names
from dolfinx_joints.laws.law import variables_of
from dolfinx_joints.loads.load import FollowsJoints, Load, load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.resultants import JointForces
from dolfinx_joints.postprocessing.joints.resultants import JointResultants
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import stage_name, stage_record
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.simulation.statics.stage import check_acting
from dolfinx_joints.simulation.statics.stage_start import state_at_rest
from dolfinx_joints.simulation.statics.trials import FailureTrials, Trial
from dolfinx_joints.simulation.statics.unfinished import check_grouted, check_joints
from dolfinx_joints.solvers.step_solver import SolverOptions
from dolfinx_joints.time_integration.states import DynamicState

# Smallest factor that is tried: the strength is then 64 times the given one.
SMALLEST = 1.0 / 64.0


@dataclass(frozen=True, kw_only=True, repr=False)
class FactorOfSafety(Summarised):
    """Factor of safety F, its last equilibrium, and the mechanism of failure.

    Attributes:
        factor: F, the largest factor with an equilibrium.
        upper: Smallest factor without an equilibrium; infinite if there is none up to ``largest``.
        method: ``strength`` or ``load``.
        of: Names of the joints or loads to which F applies.
        trials: All trials in their order.
        state: Equilibrium at F.
        resultants: Resultants of the joints at F, by name; their ``friction`` is that at F = 1.
        acceleration: Mechanism: acceleration of the body at ``upper``, from rest at the last
            equilibrium [m/s^2]. None without a failure, for a body without mass, or if the step of
            the motion did not converge.
    """

    factor: float
    upper: float
    method: str
    of: tuple[str, ...]
    trials: tuple[Trial, ...]
    state: StaticState
    resultants: Mapping[str, JointResultants]
    acceleration: PETSc.Vec | None

    def _summary(self) -> Rows:
        yield "factor of safety", f"{self.factor:.4g}, fails at {self.upper:.4g}"
        yield {"strength": "joints", "load": "loads"}[self.method], names(self.of)
        last = [trial for trial in self.trials if not trial.stable]
        yield "failure", last[-1].outcome if last else ""
        yield "trials", len(self.trials)


@checked
def factor_of_safety(
    simulation: Simulation,
    *,
    method: Literal["strength", "load"] = "strength",
    joints: Sequence[str] | None = None,
    multiplied: Sequence[Load] = (),
    loads: Sequence[Load] | None = None,
    start: StaticState | DynamicState | None = None,
    time: Annotated[float, at.Unit("s")] = 0.0,
    tolerance: Annotated[float, at.Gt(0), at.Lt(1)] = 1e-3,
    largest: Annotated[float, at.Gt(1)] = 64.0,
    name: str | None = None,
) -> FactorOfSafety:
    """Return the factor of safety of a static state (31c) (collective).

    The strength of joints is divided by F, or loads are multiplied by F, until there is no
    equilibrium or the structure jumps to a distant equilibrium (`JumpError`). F starts at 1 and is
    doubled, or halved if there is no equilibrium at F = 1. The interval is then bisected. Each
    trial starts from the equilibrium at the largest stable factor, because friction depends on the
    path. The last failure is confirmed by other starts, other solvers and pseudo-time.

    The simulation keeps its static state. It gets two further stages, NAME with the equilibrium at
    F, and "NAME, mechanism" with the displacement due to one second of the mechanism's acceleration
    in addition, which monitors record and `views.deformed` draws.

    Args:
        simulation: Simulation with a static state.
        method: ``strength`` divides strengths of ``joints``; ``load`` multiplies the loads
            ``multiplied``.
        joints: Names of the joints whose tan(phi), cohesion and tensile strength are divided; by
            default all joints.
        multiplied: Loads of the model that are multiplied, other than water in joints that follows
            the openings.
        loads: Loads of the model that act, such as changed uplift; all by default.
        start: State from which the first trial starts: a static state, or the last state of a
            dynamic stage at rest, also of another model on the same mesh with joints of the same
            stiffness, such as before the loss of strength in an earthquake. By default the
            simulation's static state.
        time: Time at which the loads are evaluated [s].
        tolerance: Relative width of the interval of F.
        largest: Largest factor that is tried.
        name: Name of the stages in results, "factor of safety 1" and so on by default.

    Raises:
        JointsError: The model has no joints, there is no state, or there is no equilibrium even
            with 64 times the strength.
        ValueError: A joint has no strength, or a load cannot be multiplied.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> loads = [dj.Gravity(), dj.Gravity(acceleration=(3.0, 0.0, 0.0))]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=loads)
        >>> run = dj.Simulation(model)
        >>> state = run.statics()
        >>> round(dj.factor_of_safety(run).factor, 2)  # the upper block slides: 9.81 / 3
        3.27
    """
    model = simulation.model
    acting = model.loads if loads is None else loads
    check_acting(model, [*acting, *multiplied])
    of = _names_of(model, method, joints, multiplied, acting)
    before = simulation.static if start is None else start
    check_kind_of("start", before, before is not None, "a static or dynamic state")
    if isinstance(before, DynamicState):
        before = state_at_rest(model, before)
    assert isinstance(before, StaticState)
    _check_start(model, before)
    name = stage_name(name, "factor of safety", simulation.stages)
    trials = FailureTrials(
        model,
        before,
        acting,
        time=time,
        joints=of if method == "strength" else (),
        multiplied=multiplied,
        options=simulation.options or SolverOptions(),
        kind=simulation.solver,
    )
    lower, upper = _bracket(trials, tolerance, largest)
    state = trials.state
    acceleration = trials.acceleration(upper) if upper < math.inf else None
    simulation.add_stage(stage_record(model, name, time, state, acting))
    if acceleration is not None:
        moved = replace(state, displacement=state.displacement + 0.5 * acceleration)  # after 1 s
        record = stage_record(model, f"{name}, mechanism", time, moved, acting)
        simulation.add_stage(record)
    assert state.joints is not None
    return FactorOfSafety(
        factor=lower,
        upper=upper,
        method=method,
        of=of,
        trials=tuple(trials.rows),
        state=state,
        resultants=JointForces(model)(state.joints),
        acceleration=acceleration,
    )


def _check_start(model: Model, start: StaticState) -> None:
    """Check that a state belongs to the mesh and the joints of a model (collective)."""
    check_grouted(start)
    if start.absent:
        raise JointsError(f"{', '.join(start.absent)} is absent in the static state.")
    assert model.contact is not None
    sizes = start.displacement.getSizes(), len(model.contact.initial_gap)
    internal = max(len(variables_of(law)) for law in model.contact.laws.values())
    joints = None if start.joints is None else start.joints.state
    fits = sizes[0] == model.stiffness.createVecRight().getSizes()
    if joints is not None:
        fits &= len(joints.gap) == sizes[1] and joints.internal.shape[1] >= internal
    if not model.jointed.mesh.comm.allreduce(fits, MPI.LAND):
        raise ValueError(
            "start is a state of another mesh, or of joints whose laws have other internal "
            "variables; it must be a state of this mesh."
        )


def _bracket(trials: FailureTrials, tolerance: float, largest: float) -> tuple[float, float]:
    """Return the largest stable and the smallest unstable factor (collective)."""
    factor, upper, growth = 1.0, math.inf, 2.0
    while not trials.run(factor, all_solvers=True):
        factor, upper = 0.5 * factor, factor
        if factor < SMALLEST:
            raise JointsError(
                f"There is no equilibrium at the factors from {2.0 * factor:g} to 1: the loads "
                "exceed the strength by far, or a block has no support."
            )
    lower = factor
    while True:
        if upper - lower <= tolerance * lower:
            # Confirm the failure from the nearest equilibrium: an earlier trial was further away.
            if not trials.run(upper, all_solvers=True):
                return lower, upper
            lower, upper, growth = upper, math.inf, 1.0 + 2.0 * tolerance
        factor = 0.5 * (lower + upper) if upper < math.inf else min(growth * lower, largest)
        if trials.run(factor, all_solvers=False):
            lower, growth = factor, growth**2 if growth < 2.0 else growth
            if lower >= largest:
                return lower, math.inf
        else:
            upper = factor


def _names_of(
    model: Model,
    method: str,
    joints: Sequence[str] | None,
    multiplied: Sequence[Load],
    acting: Sequence[Load],
) -> tuple[str, ...]:
    """Return the names of the joints or loads to which the factor applies."""
    if model.contact is None:
        raise JointsError("The model has no joints, so it has no factor of safety.")
    if method == "strength":
        if multiplied:
            raise ValueError("multiplied is given; use method='load', or omit it.")
        chosen = tuple(model.jointed.joint_names if joints is None else joints)
        check_joints(model, chosen)
        if not chosen:
            raise ValueError("joints is empty; name at least one joint.")
        return chosen
    if joints is not None:
        raise ValueError("joints is given; use method='strength', or omit it.")
    if not multiplied:
        raise ValueError("multiplied is empty; method='load' needs at least one load.")
    for load in multiplied:
        if isinstance(load, FollowsJoints) or not any(load is one for one in acting):
            raise ValueError(
                f"The load {type(load).__name__} cannot be multiplied; it must act and must not "
                "be water that follows the openings of joints."
            )
    named = zip(load_names(model.loads), model.loads, strict=True)
    return tuple(name for name, load in named if any(load is one for one in multiplied))
