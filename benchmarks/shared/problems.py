# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small dynamic problems with known motions, and how to march them: shared by the benchmarks."""

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

# Schemes whose traction is the mean over a step, not that at its end.
MIDPOINT = ("ec", "ec_exact", "implicit")


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion to compare with: functions of times (t,) [s] for the n dofs that are compared.

    Attributes:
        displacement: Shape (t, n), [m].
        velocity: Shape (t, n), [m/s].
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
    """A system, how its motion starts, and what it should be.

    Attributes:
        system: What is marched.
        period: What time steps are given as fractions of [s].
        end: Time of the last step [s].
        displacement: At the start, shape (n,), [m].
        velocity: At the start, shape (n,), [m/s].
        motion: What the motion should be; None where nothing is compared.
        joints: Response of the joints at the start; at rest there unless given.
        component: Of the joint traction, whose force is compared: 0 normal, 1 or 2 shear.
        compared: Dofs that are compared.
        sampling: Compare displacements and velocities at its multiples only [s]; else at all steps.
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
    """A march: histories with one row per accepted step, and what it took.

    Attributes:
        time: Ends of the steps, shape (t,), [s].
        dt: Their lengths, shape (t,), [s].
        displacement: Of the dofs compared, shape (t, n), [m].
        velocity: Of the same, shape (t, n), [m/s].
        force: Joint force as the scheme has it in the step, shape (t,), [N].
        steps: Steps accepted.
        solves: Attempts.
        iterations: Newton iterations of the steps accepted.
        seconds: Processor time of the march, factorizations included [s].
        energy_error: The paper's energy error.
        ledger: Largest sum of all energy lines; None where the scheme loses energy of the body.
        growth: Largest stored energy over the energy at the start and the largest input.
        row: Energies at the end.
        chatter: Share of each joint that chatters, of joints that do.
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
    """The state that a problem starts from."""
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
    """March a problem to its end in steps of dt [s], cut where ``control`` says.

    Raises:
        JointsError: A step did not converge or lost energy, however often it was cut.
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
    """Relative errors of a run.

    ``displacement`` is the largest error (2-norm over the dofs) over the largest displacement;
    ``velocity`` and ``force`` are root mean squares in time, that of the velocity weighted with the
    mass, over those of the right motion. A force that is the mean over a step counts at its middle;
    it is compared with the larger of both, so that about 1 says it is not resolved at all.
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
    """Row sums of the mass matrix, shape (n,), [kg]."""
    ones, sums = system.mass.createVecRight(), system.mass.createVecLeft()
    ones.set(1.0)
    system.mass.mult(ones, sums)
    return sums.array.copy()


# ---------------------------------------------------------------- a mass on a spring and a stop


def oscillator(ratio: float, gap: float = 0.0) -> ImpactOscillator:
    """Return a mass on a spring before a stop ``ratio`` times as stiff."""
    return ImpactOscillator(
        mass=100.0, stiffness=1e4, stop_stiffness=1e4 * ratio, initial_velocity=1.0, gap=gap
    )


def impact(ratio: float, *, gap: float = 0.0, periods: float = 2.0) -> Problem:
    """The mass of `oscillator` over periods of the free mass."""
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
    r"""An elastic bar, unstrained, falls on a rigid wall and bounces (Doyen, Ern, Piperno 2011).

    With x in [0, L] from the end that strikes, u(x, t) its height above the undeformed bar that
    touches the wall, and c = sqrt(E / rho):

        u_tt = c^2 u_xx - g,   u_x(L) = 0,   u(0) >= 0,   u(x, 0) = h0,   u_t(x, 0) = -v

    - It touches at t1, when h0 = v t1 + g t1^2 / 2, with the speed v1 = v + g t1.
    - In contact, tau = t - t1, a wave runs up the bar and back: with f(y) = v1 y + g y^2/2 for
      y > 0, u = f(tau - x/c) + f(tau - (2L - x)/c) - f(tau) (d'Alembert, even at the free end).
      The wall pushes with E f'(tau) / c = rho c (v1 + g tau), until the wave is back at
      tau = 2L/c.
    - There u_t = v1 everywhere and u = (g / c^2) (x^2 - 2 L x), twice the sag of the bar at rest.
      In flight, s = t - t1 - 2L/c, the mean is v1 s - g s^2/2 - 2 g L^2 / (3 c^2), and the rest
      oscillates freely: (g / 2c^2) (P(x - c s) + P(x + c s)), P(x) = x^2 - 2 L x + 2 L^2/3
      continued with the period 2L; its cosine series is sum 4 / lambda^2 cos(lambda x),
      lambda = n pi / L.
    - With g > 0 the flight takes 2 v1 / g. If these are whole periods 2L/c, the bar touches just as
      it left, and all runs backwards to where it began.

    Attributes:
        length: L [m].
        young: E [Pa]; the section is 1 m^2.
        density: rho [kg/m^3].
        height: h0 [m].
        gravity: g [m/s^2], zero or positive.
        speed: v, downward [m/s].

    Raises:
        ValueError: The bar would not touch twice in the same way.
    """

    length: float
    young: float
    density: float
    height: float
    gravity: float = 0.0
    speed: float = 0.0

    def __post_init__(self) -> None:
        """Check that the motion is one of those solved."""
        if self.gravity > 0.0:
            cycles = 2.0 * self.impact_speed / self.gravity / self.contact_duration
            if abs(cycles - round(cycles)) > 1e-9:
                raise ValueError(
                    f"A flight lasts {cycles:.6g} times the contact; it must be a whole number."
                )

    @property
    def wave_speed(self) -> float:
        """The wave speed c [m/s]."""
        return math.sqrt(self.young / self.density)

    @property
    def impact_speed(self) -> float:
        """Speed v1 at the first contact [m/s]."""
        return math.sqrt(self.speed**2 + 2.0 * self.gravity * self.height)

    @property
    def impact_time(self) -> float:
        """Begin t1 of the first contact [s]."""
        return 2.0 * self.height / (self.speed + self.impact_speed)

    @property
    def contact_duration(self) -> float:
        """2L/c [s]."""
        return 2.0 * self.length / self.wave_speed

    @property
    def release_time(self) -> float:
        """End of the first contact [s]."""
        return self.impact_time + self.contact_duration

    @property
    def period(self) -> float:
        """After which all is as at the start; infinite without gravity [s]."""
        if self.gravity == 0.0:
            return math.inf
        return 2.0 * (self.release_time + self.impact_speed / self.gravity)

    def displacement(self, time: ArrayLike, x: ArrayLike) -> Floats:
        """U at times (t,) [s] and places (n,) [m], shape (t, n), [m]."""
        return self._motion(time, x)[0]

    def velocity(self, time: ArrayLike, x: ArrayLike) -> Floats:
        """U_t at times (t,) [s] and places (n,) [m], shape (t, n), [m/s]."""
        return self._motion(time, x)[1]

    def force(self, time: ArrayLike) -> Floats:
        """Push of the wall at times (t,) [s], shape (t,), [N]."""
        t, _ = self._folded(time)
        tau = t - self.impact_time
        touching = (tau >= 0.0) & (tau <= self.contact_duration)
        impedance = self.density * self.wave_speed
        return np.where(touching, impedance * (self.impact_speed + self.gravity * tau), 0.0)

    def _folded(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Times in the first half of the period, and the sense in which they run, shape (t,)."""
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
        """From the start to the end of the contact; tau is negative in the fall."""
        c, g, v1 = self.wave_speed, self.gravity, self.impact_speed
        u, v = -(v1 + 0.5 * g * tau) * tau, -(v1 + g * tau)
        for way in (x, 2.0 * self.length - x):
            y = np.maximum(tau - way / c, 0.0)
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


# The bar of Doyen, Ern and Piperno, and a fast steel bar.
BOUNCING = BouncingBar(length=10.0, young=900.0, density=1.0, height=5.0, gravity=10.0)
ON_WALL = BouncingBar(length=0.2, young=2e11, density=8000.0, height=2e-3, speed=100.0)


def bar_matrices(
    elements: int, *, length: float = 1.0, young: float = 1.0, density: float = 1.0
) -> tuple[Floats, Floats]:
    """Return consistent mass [kg] and stiffness [N/m] of equal linear elements, of unit section."""
    size = length / elements
    mass, stiffness = np.zeros((2, elements + 1, elements + 1))
    for e in range(elements):
        here = slice(e, e + 2)
        mass[here, here] += density * size / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        stiffness[here, here] += young / size * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return mass, stiffness


def bar(
    exact: BouncingBar,
    *,
    elements: int = 100,
    end: float,
    stiffness_ratio: float = 1e3,
    massless: bool = False,
) -> Problem:
    """A bar of linear elements over a wall.

    Args:
        exact: The bar.
        elements: Their number.
        end: Time of the last step [s].
        stiffness_ratio: k_n h / E of the contact, h being the element size.
        massless: Take the mass from the struck node.
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
    # Gravity acts where the mass is, so that the bar falls without strain.
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
        """Return times in half cycles, their number, and the sense of the motion, 0 at rest."""
        t = np.asarray(time, dtype=np.float64) / exact.half_period
        number = np.clip(np.floor(t), 0, last).astype(np.int64)
        return t, number, np.where(number == last, 0.0, np.sign(turns[number]))

    def velocity(time: ArrayLike) -> Floats:
        t, number, sense = half(time)
        swing = np.abs(sense) * turns[number] - sense * exact.friction / exact.stiffness
        return -omega * swing * np.sin(math.pi * (t - number))

    def force(time: ArrayLike) -> Floats:
        """Return the force of the mass on the ground: that of the spring where it rests."""
        sense = half(time)[2]
        return np.where(sense == 0.0, -exact.stiffness * turns[-1], -sense * exact.friction)

    return one_dof(exact.displacement, velocity, force)


class Phase(NamedTuple):
    """Sliding or sticking: x = origin + centre + cosine cos(W t) + sine sin(W t) from its begin.

    Attributes:
        begin: Time [s].
        origin: Place where it sticks, 0 where it slides [m].
        centre: Place about which it swings, from the origin [m].
        cosine: Of the swing [m].
        sine: Of the swing [m].
        frequency: W [rad/s].
        way: Direction of sliding, 1 or -1; 0 where it sticks.
        elastic_slip: e at the begin [m].
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
    """The Coulomb oscillator with elastic sticking of stiffness k_s, as one dof.

    Friction is k_s e, |e| <= r = F / k_s, and e = -r at the release from x0 > 0. Sliding in the
    direction w, e = w r and m x'' + k x + w F = 0, until it turns. From a turning point x_t on it
    sticks, m y'' + (k + k_s) y + k x_t + w F = 0 with y = x - x_t and e = w r + y, until e = -w r;
    if it never gets there it trembles for good.

    Attributes:
        rigid: The oscillator.
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
        """Sliding and sticking in turns; the last phase has no end."""
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
        """Return the motion to compare with."""
        return one_dof(
            lambda time: self.at(time)[0],
            lambda time: self.at(time)[1],
            lambda time: self.shear_stiffness * self.at(time)[2],
        )


def on_ground(
    *, stiffness: float, shear_stiffness: float, friction: float, push: Callable[[float], float]
) -> tuple[dj.MatrixSystem, float]:
    """1 kg on a spring along x, pressed by 10 N on a joint; and the penetration [m].

    The dofs are x, the height, and y, along which nothing happens; the joint is as stiff in
    compression as in shear, or rigid.
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
    """A mass on a spring with dry friction, k_s / k = ``ratio`` (infinite: rigid).

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
    """Newmark's block, 1 kg, on a base shaken by a pulse; rigid joint by default, k_s [N/m]."""
    exact = SlidingBlock(pulse=4.0, yield_acceleration=2.0, duration=0.5)

    def push(time: float) -> float:
        left = exact.duration - time
        return exact.pulse * (0.5 if abs(left) < 1e-9 else float(left > 0.0))

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
    """Return the problem to be compared with its own energy-consistent run in steps of dt [s].

    Displacements and velocities are known at the ends of these steps only; forces are interpolated
    between their middles.
    """
    run = march(problem, dj.EnergyConsistent(), dt)

    def at_ends(values: Floats, time: ArrayLike) -> Floats:
        wanted = np.asarray(time)
        rows = np.searchsorted(run.time, wanted - 1e-6 * sampling)
        if np.abs(run.time[rows] - wanted).max() > 1e-6 * sampling:
            raise ValueError("The fine run has no step that ends at a time asked for.")
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
        static: State to start from; undeformed unless given.
        upper: Velocity at the start of the cell group ``upper``, shape (3,), [m/s]; else at rest.
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
    """A block of 1 m thrown obliquely on another one, 0.2 m/s down and 0.15 m/s along.

    Hexahedra of half a metre, 9 joint points, a gap of 0.1 mm: the upper block strikes, slides
    and rebounds within 3 ms. The nodes of a joint may be without mass.
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
