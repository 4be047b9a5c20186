# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small dynamic problems with known motions, and their time integration, for the benchmarks."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dolfinx_joints as dj
from benchmarks.shared.scenes import Acceleration, mesh_of
from dolfinx_joints.exact import CoulombOscillator, ImpactOscillator, SlidingBlock
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.laws.law import CondensedLaw, JointState, Law, Response
from dolfinx_joints.laws.rigid import RigidJoint
from dolfinx_joints.model.mass_redistribution import redistribute
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger, EnergyRow
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import Stepper

Floats = NDArray[np.float64]
History = Callable[[ArrayLike], Floats]

SCHEMES: dict[str, Scheme] = {
    "ec": dj.EnergyConsistent(),
    "ec_exact": dj.EnergyConsistent(exact_modes=10),
    "implicit": dj.ImplicitContact(),
    "newmark": dj.Newmark(),
    "hht": dj.HilberHughesTaylor(),
    "generalized_alpha": dj.GeneralizedAlpha(),
}

# Schemes whose traction is the mean over a step instead of the value at its end.
MIDPOINT = ("ec", "ec_exact", "implicit")


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Reference motion: functions of times (t,) [s] for the n compared dofs.

    Attributes:
        displacement: Displacements, shape (t, n), [m].
        velocity: Velocities, shape (t, n), [m/s].
        force: Joint force, shape (t,), [N].
    """

    displacement: History
    velocity: History
    force: History


def one_dof(displacement: History, velocity: History, force: History) -> Motion:
    """Return the motion of one dof from functions of shape (t,)."""
    return Motion(
        displacement=lambda time: displacement(time)[:, None],
        velocity=lambda time: velocity(time)[:, None],
        force=force,
    )


@dataclass(frozen=True, kw_only=True)
class Problem:
    """System with initial conditions and reference motion.

    Attributes:
        system: The system to integrate.
        period: Reference time; time steps are fractions of it [s].
        end: Time of the last step [s].
        displacement: Initial displacements, shape (n,), [m].
        velocity: Initial velocities, shape (n,), [m/s].
        motion: Reference motion, None without comparison.
        joints: Response of the joints at the start; by default they are at rest.
        component: Compared component of the joint force: 0 normal, 1 or 2 shear.
        compared: Dofs that are compared.
        sampling: Compare displacements and velocities only at multiples of this time [s]; else at
            all steps.
    """

    system: dj.MatrixSystem
    period: float
    end: float
    displacement: Floats
    velocity: Floats
    motion: Motion | None = None
    joints: Response | JointState | None = None
    component: int = 0
    compared: slice = slice(None)
    sampling: float | None = None


@dataclass(frozen=True, kw_only=True)
class Run:
    """Completed run: histories with one row per accepted step, and the cost.

    Attributes:
        time: Ends of the steps, shape (t,), [s].
        dt: Lengths of the steps, shape (t,), [s].
        displacement: Displacements of the compared dofs, shape (t, n), [m].
        velocity: Velocities of the compared dofs, shape (t, n), [m/s].
        force: Joint force as the scheme defines it in the step, shape (t,), [N].
        steps: Number of accepted steps.
        solves: Number of attempted steps.
        iterations: Newton iterations of the accepted steps.
        seconds: Processor time, factorizations included [s].
        energy_error: The paper's energy error.
        ledger: Largest imbalance of the energy ledger; None if the scheme does not conserve energy.
        growth: Largest stored energy over the initial energy plus the largest input.
        row: Energies at the end.
        chatter: Fraction of points that chatter, for each joint that chatters.
    """

    time: Floats
    dt: Floats
    displacement: Floats
    velocity: Floats
    force: Floats
    steps: int
    solves: int
    iterations: int
    seconds: float
    energy_error: float
    ledger: float | None
    growth: float
    row: EnergyRow
    chatter: dict[str, float]


def first_state(problem: Problem, solver: object) -> DynamicState:
    """Return the initial state of a problem."""
    u, v = problem.system.mass.createVecRight(), problem.system.mass.createVecRight()
    u.setArray(problem.displacement)
    v.setArray(problem.velocity)
    return initial_state(solver, displacement=u, velocity=v, joints=problem.joints)


def march(
    problem: Problem,
    scheme: Scheme,
    dt: float,
    control: dj.StepControl | None = None,
) -> Run:
    """Integrate a problem to its end in steps of dt [s]; ``control`` determines substeps.

    Raises:
        JointsError: A step did not converge or lost energy in all substeps allowed.
    """
    contact = problem.system.contact
    began = clock.process_time()
    stepper_solver = make_solver(problem.system)
    state = first_state(problem, stepper_solver)
    ledger = EnergyLedger(problem.system)
    first = given = ledger.start(state).stored
    stepper = Stepper(scheme, stepper_solver, ledger, control or dj.StepControl())
    rows, iterations, growth = [], 0, 1.0
    for _ in range(round(problem.end / dt)):
        for after, report, row in stepper.substeps(state, dt):
            state = after
            ledger.record(row)
            iterations += report.solve.iterations
            given = max(given, first + abs(row.input))
            growth = max(growth, row.stored / given) if given else growth
            force = contact.integral(state.joints.traction[:, problem.component])
            u, v = state.displacement.array, state.velocity.array
            compared = problem.compared
            rows.append((state.time, report.dt, u[compared].copy(), v[compared].copy(), force))
    seconds = clock.process_time() - began
    time, lengths, u, v, force = (np.array(column) for column in zip(*rows, strict=True))
    return Run(
        time=time,
        dt=lengths,
        displacement=u,
        velocity=v,
        force=force,
        steps=stepper.counts.accepted,
        solves=stepper.counts.accepted + stepper.counts.rejected,
        iterations=iterations,
        seconds=seconds,
        energy_error=ledger.relative_error,
        ledger=ledger.relative_imbalance if scheme.conserves(problem.system) else None,
        growth=growth,
        row=ledger.row,
        chatter=stepper.chatter.joints(),
    )


def errors(problem: Problem, run: Run, *, midpoint: bool) -> dict[str, float]:
    """Return the relative errors of a run.

    ``displacement`` is the largest error (2-norm over the dofs) over the largest displacement.
    ``velocity`` and ``force`` are root mean squares in time over those of the reference; velocities
    are weighted with the mass. A force that is the mean over a step is compared at its middle. The
    force error is relative to the larger of both forces, so a value near 1 means not resolved.
    """
    motion, shown = problem.motion, np.ones(len(run.time), dtype=bool)
    if problem.sampling is not None:
        cycles = run.time / problem.sampling
        shown = np.abs(cycles - np.round(cycles)) < 1e-6
    u, v = (f(run.time[shown]) for f in (motion.displacement, motion.velocity))
    off_u = np.linalg.norm(run.displacement[shown] - u, axis=1).max()
    mass = lumped_mass(problem.system)[problem.compared]
    weight = run.dt if problem.sampling is None else np.ones(shown.sum())
    off_v = weight @ ((run.velocity[shown] - v) ** 2 @ mass)
    at = run.time - 0.5 * run.dt if midpoint else run.time
    force = motion.force(at)
    largest = max(run.dt @ force**2, run.dt @ run.force**2)
    return {
        "displacement": float(off_u / np.linalg.norm(u, axis=1).max()),
        "velocity": math.sqrt(off_v / (weight @ (v**2 @ mass))),
        "force": math.sqrt(run.dt @ (run.force - force) ** 2 / largest) if largest else 0.0,
    }


def lumped_mass(system: dj.MatrixSystem) -> Floats:
    """Return the row sums of the mass matrix, shape (n,), [kg]."""
    ones, sums = system.mass.createVecRight(), system.mass.createVecLeft()
    ones.set(1.0)
    system.mass.mult(ones, sums)
    return sums.array.copy()


# ---------------------------------------------------------------- a mass on a spring and a stop


def oscillator(ratio: float, gap: float = 0.0) -> ImpactOscillator:
    """Return a mass on a spring and a stop ``ratio`` times as stiff."""
    return ImpactOscillator(
        mass=100.0, stiffness=1e4, stop_stiffness=1e4 * ratio, initial_velocity=1.0, gap=gap
    )


def impact(ratio: float, *, gap: float = 0.0, periods: float = 2.0) -> Problem:
    """Return the problem of `oscillator` over periods of the free mass."""
    exact = oscillator(ratio, gap)
    system = dj.MatrixSystem.from_arrays(
        mass=exact.mass,
        stiffness=exact.stiffness,
        gap=[[-1.0], [0.0], [0.0]],
        initial_gap=gap,
        law=dj.frictionless(normal_stiffness=exact.stop_stiffness),
    )
    return Problem(
        system=system,
        period=exact.free_period,
        end=periods * exact.free_period,
        displacement=np.zeros(1),
        velocity=np.array([exact.initial_velocity]),
        motion=one_dof(exact.displacement, exact.velocity, lambda time: -exact.force(time)),
    )


# ---------------------------------------------------------------- an elastic bar and a rigid wall


@dataclass(frozen=True, kw_only=True)
class BouncingBar:
    r"""Elastic, initially unstrained bar that falls on a rigid wall (Doyen, Ern, Piperno 2011).

    x in [0, L] is measured from the striking end, u(x, t) is the height above the undeformed bar in
    contact with the wall, and c = sqrt(E / rho):

        u_tt = c^2 u_xx - g,   u_x(L) = 0,   u(0) >= 0,   u(x, 0) = h0,   u_t(x, 0) = -v

    - Contact begins at t1 with h0 = v t1 + g t1^2 / 2 and the speed v1 = v + g t1.
    - In contact, tau = t - t1, a wave travels up the bar and back. With f(y) = v1 y + g y^2/2 for
      y > 0, u = f(tau - x/c) + f(tau - (2L - x)/c) - f(tau) (d'Alembert, even at the free end).
      The force of the wall is E f'(tau) / c = rho c (v1 + g tau), until the wave returns at
      tau = 2L/c.
    - Then u_t = v1 everywhere and u = (g / c^2) (x^2 - 2 L x), twice the sag of the bar at rest.
      In flight, s = t - t1 - 2L/c, the mean of u is v1 s - g s^2/2 - 2 g L^2 / (3 c^2). The
      remainder oscillates freely: (g / 2c^2) (P(x - c s) + P(x + c s)), with P(x) = x^2 - 2 L x +
      2 L^2/3 continued with the period 2L. Its cosine series is sum 4 / lambda^2 cos(lambda x),
      lambda = n pi / L.
    - With g > 0 the flight lasts 2 v1 / g. If this is a multiple of 2L/c, the bar lands in the
      state in which it left, and the motion runs backwards to its start.

    Attributes:
        length: L [m].
        young: E [Pa]; the section is 1 m^2.
        density: rho [kg/m^3].
        height: h0 [m].
        gravity: g [m/s^2], zero or positive.
        speed: v, downward [m/s].

    Raises:
        ValueError: The flight is not a multiple of 2L/c, so the motion is not periodic.
    """

    length: float
    young: float
    density: float
    height: float
    gravity: float = 0.0
    speed: float = 0.0

    def __post_init__(self) -> None:
        """Check that the exact solution applies."""
        if self.gravity > 0.0:
            cycles = 2.0 * self.impact_speed / self.gravity / self.contact_duration
            if abs(cycles - round(cycles)) > 1e-9:
                raise ValueError(
                    f"A flight lasts {cycles:.6g} times the contact; it must be a whole number."
                )

    @property
    def wave_speed(self) -> float:
        """Wave speed c [m/s]."""
        return math.sqrt(self.young / self.density)

    @property
    def impact_speed(self) -> float:
        """Speed v1 at the first contact [m/s]."""
        return math.sqrt(self.speed**2 + 2.0 * self.gravity * self.height)

    @property
    def impact_time(self) -> float:
        """Start t1 of the first contact [s]."""
        return 2.0 * self.height / (self.speed + self.impact_speed)

    @property
    def contact_duration(self) -> float:
        """Duration of a contact, 2L/c [s]."""
        return 2.0 * self.length / self.wave_speed

    @property
    def release_time(self) -> float:
        """End of the first contact [s]."""
        return self.impact_time + self.contact_duration

    @property
    def period(self) -> float:
        """Period of the motion, infinite without gravity [s]."""
        if self.gravity == 0.0:
            return math.inf
        return 2.0 * (self.release_time + self.impact_speed / self.gravity)

    def displacement(self, time: ArrayLike, x: ArrayLike) -> Floats:
        """Return u at times (t,) [s] and places (n,) [m], shape (t, n), [m]."""
        return self._motion(time, x)[0]

    def velocity(self, time: ArrayLike, x: ArrayLike) -> Floats:
        """Return u_t at times (t,) [s] and places (n,) [m], shape (t, n), [m/s]."""
        return self._motion(time, x)[1]

    def force(self, time: ArrayLike) -> Floats:
        """Return the force of the wall at times (t,) [s], shape (t,), [N]."""
        t, _ = self._folded(time)
        tau = t - self.impact_time
        touching = (tau >= 0.0) & (tau <= self.contact_duration)
        impedance = self.density * self.wave_speed
        return np.where(touching, impedance * (self.impact_speed + self.gravity * tau), 0.0)

    def _folded(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Return equivalent times in the first half period, and the time direction, shape (t,)."""
        t = np.atleast_1d(np.asarray(time, dtype=np.float64))
        if self.gravity == 0.0:
            return t, np.ones_like(t)
        t = np.mod(t, self.period)
        late = t > 0.5 * self.period
        return np.where(late, self.period - t, t), np.where(late, -1.0, 1.0)

    def _motion(self, time: ArrayLike, x: ArrayLike) -> tuple[Floats, Floats]:
        t, sense = self._folded(time)
        place = np.atleast_1d(np.asarray(x, dtype=np.float64))[None, :]
        tau = (t - self.impact_time)[:, None]
        contact = self._contact(np.minimum(tau, self.contact_duration), place)
        flight = self._flight(np.maximum(tau - self.contact_duration, 0.0), place)
        u, v = (
            np.where(tau > self.contact_duration, after, before)
            for before, after in zip(contact, flight, strict=True)
        )
        return u, sense[:, None] * v

    def _contact(self, tau: Floats, x: Floats) -> tuple[Floats, Floats]:
        """Return u and u_t until the end of the contact; tau is negative in the fall."""
        c, g, v1 = self.wave_speed, self.gravity, self.impact_speed
        u, v = -(v1 + 0.5 * g * tau) * tau, -(v1 + g * tau)
        for distance in (x, 2.0 * self.length - x):
            y = np.maximum(tau - distance / c, 0.0)
            u, v = u + (v1 + 0.5 * g * y) * y, v + np.where(y > 0.0, v1 + g * y, 0.0)
        return u, v

    def _flight(self, s: Floats, x: Floats) -> tuple[Floats, Floats]:
        c, g, length = self.wave_speed, self.gravity, self.length
        mean = (self.impact_speed - 0.5 * g * s) * s - 2.0 * g * length**2 / (3.0 * c**2)
        u, v = mean + 0.0 * x, self.impact_speed - g * s + 0.0 * x
        for sense in (-1.0, 1.0):
            from_end = np.mod(x + sense * c * s, 2.0 * length) - length
            u = u + 0.5 * g / c**2 * (from_end**2 - length**2 / 3.0)
            v = v + sense * g / c * from_end
        return u, v


# Bar of Doyen, Ern and Piperno, and a fast steel bar.
BOUNCING = BouncingBar(length=10.0, young=900.0, density=1.0, height=5.0, gravity=10.0)
ON_WALL = BouncingBar(length=0.2, young=2e11, density=8000.0, height=2e-3, speed=100.0)


def bar_matrices(
    elements: int, *, length: float = 1.0, young: float = 1.0, density: float = 1.0
) -> tuple[Floats, Floats]:
    """Return consistent mass [kg] and stiffness [N/m] of equal linear elements, of unit section."""
    size = length / elements
    mass, stiffness = np.zeros((2, elements + 1, elements + 1))
    for e in range(elements):
        dofs = slice(e, e + 2)
        mass[dofs, dofs] += density * size / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        stiffness[dofs, dofs] += young / size * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return mass, stiffness


def bar(
    exact: BouncingBar,
    *,
    elements: int = 100,
    end: float,
    stiffness_ratio: float = 1e3,
    massless: bool = False,
) -> Problem:
    """Return a bar of linear elements above a wall.

    Args:
        exact: The bar.
        elements: Number of elements.
        end: Time of the last step [s].
        stiffness_ratio: k_n h / E of the contact, with the element size h.
        massless: Remove the mass of the striking node by redistribution.
    """
    mass, stiffness = bar_matrices(
        elements, length=exact.length, young=exact.young, density=exact.density
    )
    nodes = np.linspace(0.0, exact.length, elements + 1)
    rows = np.zeros((3, elements + 1))
    rows[0, 0] = 1.0
    size = exact.length / elements
    system = dj.MatrixSystem.from_arrays(
        mass=mass,
        stiffness=stiffness,
        gap=rows,
        law=dj.frictionless(normal_stiffness=stiffness_ratio * exact.young / size),
    )
    if massless:
        system = redistribute(system, nodes[:, None])
    # Apply gravity to the redistributed mass, so that the bar falls without strain.
    weight = system.mass.createVecRight()
    weight.setArray(-exact.gravity * lumped_mass(system))
    start = exact.displacement(0.0, np.zeros(elements + 1))[0]
    return Problem(
        system=replace(system, patterns=[(weight, lambda _: 1.0)]),
        period=size / exact.wave_speed,
        end=end,
        displacement=start,
        velocity=np.full(elements + 1, -exact.speed),
        motion=Motion(
            displacement=lambda time: exact.displacement(time, nodes),
            velocity=lambda time: exact.velocity(time, nodes),
            force=lambda time: -exact.force(time),
        ),
    )


# ---------------------------------------------------------------- friction


def dry_friction(exact: CoulombOscillator) -> Motion:
    """Return the motion of the Coulomb oscillator."""
    turns, last = exact.turning_points, len(exact.turning_points) - 1
    omega = math.sqrt(exact.stiffness / exact.mass)

    def half(time: ArrayLike) -> tuple[Floats, NDArray[np.int64], Floats]:
        """Return time in half cycles, number of the half cycle, and direction, 0 at rest."""
        t = np.asarray(time, dtype=np.float64) / exact.half_period
        number = np.clip(np.floor(t), 0, last).astype(np.int64)
        return t, number, np.where(number == last, 0.0, np.sign(turns[number]))

    def velocity(time: ArrayLike) -> Floats:
        t, number, sense = half(time)
        swing = np.abs(sense) * turns[number] - sense * exact.friction / exact.stiffness
        return -omega * swing * np.sin(math.pi * (t - number))

    def force(time: ArrayLike) -> Floats:
        """Return the force of the mass on the ground; at rest it is the spring force."""
        sense = half(time)[2]
        return np.where(sense == 0.0, -exact.stiffness * turns[-1], -sense * exact.friction)

    return one_dof(exact.displacement, velocity, force)


class Phase(NamedTuple):
    """Phase of sliding or sticking: x = origin + centre + cosine cos(W t) + sine sin(W t).

    t is the time since the start of the phase.

    Attributes:
        begin: Start of the phase [s].
        origin: Place where the mass sticks, 0 if it slides [m].
        centre: Centre of the oscillation, relative to the origin [m].
        cosine: Cosine amplitude [m].
        sine: Sine amplitude [m].
        frequency: Circular frequency W [rad/s].
        way: Direction of sliding, 1 or -1; 0 if it sticks.
        elastic_slip: Elastic slip e at the start [m].
    """

    begin: float
    origin: float
    centre: float
    cosine: float
    sine: float
    frequency: float
    way: float
    elastic_slip: float

    def at(self, time: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return x [m], x' [m/s] and e [m] at times (t,) [s]; attributes may be arrays (t,)."""
        angle = self.frequency * (np.asarray(time) - self.begin)
        moved = self.centre + self.cosine * np.cos(angle) + self.sine * np.sin(angle)
        rate = self.frequency * (self.sine * np.cos(angle) - self.cosine * np.sin(angle))
        e = self.elastic_slip + np.where(self.way == 0.0, moved, 0.0)
        return self.origin + moved, rate, e


@dataclass(frozen=True, kw_only=True)
class ElasticFriction:
    """Coulomb oscillator with one dof and elastic sticking of stiffness k_s.

    The friction force is k_s e with |e| <= r = F / k_s, and e = -r at the release from x0 > 0. If
    the mass slides in direction w, e = w r and m x'' + k x + w F = 0, until it turns. From the
    turning point x_t on it sticks: m y'' + (k + k_s) y + k x_t + w F = 0 with y = x - x_t and
    e = w r + y, until e = -w r. If e does not reach -w r, it oscillates there forever.

    Attributes:
        rigid: The Coulomb oscillator.
        shear_stiffness: k_s [N/m].
    """

    rigid: CoulombOscillator
    shear_stiffness: float

    @property
    def limit(self) -> float:
        """Largest elastic slip r [m]."""
        return self.rigid.friction / self.shear_stiffness

    @cached_property
    def phases(self) -> list[Phase]:
        """Alternating phases of sliding and sticking; the last phase does not end."""
        m, k, force, r = self.rigid.mass, self.rigid.stiffness, self.rigid.friction, self.limit
        both = k + self.shear_stiffness
        omega, fast = math.sqrt(k / m), math.sqrt(both / m)
        phases, begin, x, v, way = [], 0.0, self.rigid.start, 0.0, -1.0
        while True:
            centre = -way * force / k
            cosine, sine = x - centre, v / omega
            phases.append(Phase(begin, 0.0, centre, cosine, sine, omega, way, way * r))
            angle = math.atan2(abs(sine), way * cosine)
            begin += angle / omega
            x = centre + cosine * math.cos(angle) + sine * math.sin(angle)
            centre = -(k * x + way * force) / both
            phases.append(Phase(begin, x, centre, -centre, 0.0, fast, 0.0, way * r))
            reached = 1.0 + 2.0 * way * r / centre  # the cosine of the angle at which e = -w r
            if abs(reached) > 1.0:
                return phases
            angle = math.acos(reached)
            begin += angle / fast
            x, v = x + centre * (1.0 - reached), centre * fast * math.sin(angle)
            way = -way

    def at(self, time: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return x [m], x' [m/s] and e [m] at times (t,) [s]."""
        t, table = np.asarray(time, dtype=np.float64), np.array(self.phases)
        return Phase(*table[np.searchsorted(table[:, 0], t, side="right") - 1].T).at(t)

    def motion(self) -> Motion:
        """Return the reference motion."""
        return one_dof(
            lambda time: self.at(time)[0],
            lambda time: self.at(time)[1],
            lambda time: self.shear_stiffness * self.at(time)[2],
        )


def on_ground(
    *, stiffness: float, shear_stiffness: float, friction: float, push: Callable[[float], float]
) -> tuple[dj.MatrixSystem, float]:
    """Return 1 kg on a spring along x, pressed by 10 N on a joint, and the penetration [m].

    The dofs are x, the height, and y, in which nothing moves. The joint has equal stiffness in
    compression and shear, or is rigid.
    """
    angle = math.degrees(math.atan(friction / 10.0))
    rigid = math.isinf(shear_stiffness)
    law: Law = (
        RigidJoint(friction_angle_deg=angle)
        if rigid
        else dj.FrictionNoTension(
            normal_stiffness=shear_stiffness,
            shear_stiffness=shear_stiffness,
            friction_angle_deg=angle,
        )
    )
    system = dj.MatrixSystem.from_arrays(
        mass=np.eye(3),
        stiffness=np.diag([stiffness, 0.0, 0.0]),
        gap=[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        law=law,
        load=lambda time: [push(time), -10.0, 0.0],
    )
    return system, 0.0 if rigid else 10.0 / shear_stiffness


def coulomb(ratio: float) -> Problem:
    """Return a mass on a spring with dry friction, k_s / k = ``ratio`` (infinite: rigid).

    Friction is at its limit when the mass is released.
    """
    exact = CoulombOscillator(mass=1.0, stiffness=1e4, friction=1.0, start=0.85e-3)
    system, depth = on_ground(
        stiffness=exact.stiffness,
        shear_stiffness=ratio * exact.stiffness,
        friction=exact.friction,
        push=lambda _: 0.0,
    )
    joints: JointState | None = None
    motion = dry_friction(exact)
    if depth:
        motion = ElasticFriction(rigid=exact, shear_stiffness=ratio * exact.stiffness).motion()
        slip = -(1.0 - 1e-12) * exact.friction / (ratio * exact.stiffness)
        gap = np.array([[-depth, exact.start, 0.0]])
        joints = JointState(gap=gap, elastic_slip=np.array([[slip, 0.0]]))
    return Problem(
        system=system,
        period=2.0 * exact.half_period,
        end=2.25 * 2.0 * exact.half_period,
        displacement=np.array([exact.start, -depth, 0.0]),
        velocity=np.zeros(3),
        motion=motion,
        joints=joints,
        component=1,
        compared=slice(0, 1),
    )


def sliding(shear_stiffness: float = math.inf) -> Problem:
    """Return Newmark's block of 1 kg on a base with a pulse; k_s [N/m], rigid by default."""
    exact = SlidingBlock(pulse=4.0, yield_acceleration=2.0, duration=0.5)

    def push(time: float) -> float:
        remaining = exact.duration - time
        return exact.pulse * (0.5 if abs(remaining) < 1e-9 else float(remaining > 0.0))

    system, depth = on_ground(
        stiffness=0.0, shear_stiffness=shear_stiffness, friction=2.0, push=push
    )
    return Problem(
        system=system,
        period=1.0,
        end=1.5,
        displacement=np.array([0.0, -depth, 0.0]),
        velocity=np.zeros(3),
        motion=one_dof(
            exact.slip,
            exact.velocity,
            lambda time: np.where(np.asarray(time) < exact.stop_time, 2.0, 0.0),
        ),
        component=1,
        compared=slice(0, 1),
    )


# ---------------------------------------------------------------- solids


def with_fine_motion(problem: Problem, dt: float, sampling: float) -> Problem:
    """Return the problem with its energy-consistent run in steps of dt [s] as reference.

    Displacements and velocities are available only at the ends of these steps. Forces are
    interpolated between the middles of the steps.
    """
    run = march(problem, dj.EnergyConsistent(), dt)

    def at_ends(values: Floats, time: ArrayLike) -> Floats:
        wanted = np.asarray(time)
        rows = np.searchsorted(run.time, wanted - 1e-6 * sampling)
        if np.abs(run.time[rows] - wanted).max() > 1e-6 * sampling:
            raise ValueError("No step of the fine run ends at a requested time.")
        return values[rows]

    motion = Motion(
        displacement=partial(at_ends, run.displacement),
        velocity=partial(at_ends, run.velocity),
        force=lambda time: np.interp(time, run.time - 0.5 * run.dt, run.force),
    )
    return replace(problem, motion=motion, sampling=sampling)


def of_model(
    model: dj.Model,
    *,
    period: float,
    end: float,
    static: StaticState | None = None,
    upper: ArrayLike | None = None,
    motion: Acceleration | None = None,
    component: int = 0,
) -> Problem:
    """Return the problem of a model.

    Args:
        model: The model.
        period: See `Problem`.
        end: See `Problem`.
        static: Initial state; undeformed by default.
        upper: Initial velocity of the cell group ``upper``, shape (3,), [m/s]; zero by default.
        motion: Acceleration of the base [m/s^2].
        component: See `Problem`.
    """
    displacement, velocity = np.zeros((2, model.num_dofs))
    if static is not None:
        displacement = static.displacement.array.copy()
    if upper is not None:
        cells = model.jointed.cells("upper")
        nodes = np.unique([model.V.dofmap.cell_dofs(cell) for cell in cells])
        velocity.reshape(-1, 3)[nodes] = upper
    loads = [] if motion is None else [dj.BaseMotion(acceleration=motion)]
    return Problem(
        system=model.system(loads),
        period=period,
        end=end,
        displacement=displacement,
        velocity=velocity,
        joints=static.joints if static is not None else None,
        component=component,
    )


STIFF = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=20.0)


def blocks(*, end: float = 3e-3, law: CondensedLaw = STIFF, massless: bool = False) -> Problem:
    """Return a block of 1 m thrown obliquely on another one, 0.2 m/s down and 0.15 m/s along.

    The blocks have hexahedra of 0.5 m, 9 joint points and a gap of 0.1 mm. The upper block strikes,
    slides and rebounds within 3 ms. ``massless`` removes the mass of joint nodes.
    """
    model = dj.Model(
        mesh_of(two_blocks, size=0.5),
        material=dj.Elastic(young=30e9, poisson=0.2, density=2400.0),
        joints=dj.Joints(law, initial_gaps={"joint_1": 1e-4}),
        supports=[dj.Fixed(group="base")],
        damping=dj.stiffness_proportional(ratio=0.05, frequency=800.0),
        body=dj.Body(redistribute_mass=massless),
    )
    return of_model(model, period=1e-3, end=end, upper=(0.15, 0.05, -0.2))
