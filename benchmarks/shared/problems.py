# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small dynamic problems with known motions, and how to march them: shared by the benchmarks."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.exact import CoulombOscillator, ImpactOscillator, SlidingBlock
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.laws.law import CondensedLaw, JointState, Law, Response
from dolfinx_joints.laws.rigid import RigidJoint
from dolfinx_joints.model.mass_redistribution import redistribute
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger, EnergyRow
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import Stepper

Floats = NDArray[np.float64]

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


class Motion(Protocol):
    """What a motion should be; ``n`` dofs are compared."""

    def displacement(self, time: ArrayLike) -> Floats:
        """At times (t,) [s], shape (t, n), [m]."""

    def velocity(self, time: ArrayLike) -> Floats:
        """At times (t,) [s], shape (t, n), [m/s]."""

    def force(self, time: ArrayLike) -> Floats:
        """Joint force at times (t,) [s], shape (t,), [N]."""


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
    operator = problem.system.contact.operator
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
            force = float(operator.areas @ state.joints.traction[:, problem.component])
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


@dataclass(frozen=True)
class _Impact:
    """Motion of the impact oscillator as one dof."""

    exact: ImpactOscillator

    def displacement(self, time: ArrayLike) -> Floats:
        return self.exact.displacement(time)[:, None]

    def velocity(self, time: ArrayLike) -> Floats:
        return self.exact.velocity(time)[:, None]

    def force(self, time: ArrayLike) -> Floats:
        return -self.exact.force(time)


def impact(ratio: float, *, gap: float = 0.0, periods: float = 2.0) -> Problem:
    """A mass on a spring against a stop ``ratio`` times as stiff, over periods of the free mass."""
    exact = ImpactOscillator(
        mass=100.0, stiffness=1e4, stop_stiffness=1e4 * ratio, initial_velocity=1.0, gap=gap
    )
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
        motion=_Impact(exact),
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


@dataclass(frozen=True, kw_only=True)
class _Bar:
    """Motion of the nodes of a bar."""

    exact: BouncingBar
    nodes: Floats

    def displacement(self, time: ArrayLike) -> Floats:
        return self.exact.displacement(time, self.nodes)

    def velocity(self, time: ArrayLike) -> Floats:
        return self.exact.velocity(time, self.nodes)

    def force(self, time: ArrayLike) -> Floats:
        return -self.exact.force(time)


def bar_matrices(exact: BouncingBar, elements: int) -> tuple[Floats, Floats]:
    """Consistent mass [kg] and stiffness [N/m] of equal linear elements."""
    size = exact.length / elements
    mass, stiffness = (np.zeros((elements + 1, elements + 1)) for _ in range(2))
    for e in range(elements):
        here = np.ix_((e, e + 1), (e, e + 1))
        mass[here] += exact.density * size / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        stiffness[here] += exact.young / size * np.array([[1.0, -1.0], [-1.0, 1.0]])
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
    mass, stiffness = bar_matrices(exact, elements)
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
        motion=_Bar(exact=exact, nodes=nodes),
    )


# ---------------------------------------------------------------- friction


@dataclass(frozen=True)
class _DryFriction:
    """Motion of the Coulomb oscillator as one dof."""

    exact: CoulombOscillator

    @cached_property
    def _omega(self) -> float:
        return math.sqrt(self.exact.stiffness / self.exact.mass)

    def _half(self, time: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Sense of the half cycles, their swings [m] and angles; swing zero at rest."""
        turns, last = self.exact.turning_points, len(self.exact.turning_points) - 1
        t = np.asarray(time, dtype=np.float64) / self.exact.half_period
        half = np.clip(np.floor(t), 0, last).astype(np.int64)
        sense = np.where(half == last, 0.0, np.sign(turns[half]))
        swing = turns[half] - sense * self.exact.friction / self.exact.stiffness
        return sense, np.where(half == last, 0.0, swing), math.pi * (t - half)

    def displacement(self, time: ArrayLike) -> Floats:
        return self.exact.displacement(time)[:, None]

    def velocity(self, time: ArrayLike) -> Floats:
        _, swing, angle = self._half(time)
        return (-self._omega * swing * np.sin(angle))[:, None]

    def force(self, time: ArrayLike) -> Floats:
        """Of the mass on the ground: against its motion, and that of the spring at rest."""
        sense, _, _ = self._half(time)
        held = -self.exact.stiffness * self.exact.turning_points[-1]
        return np.where(sense == 0.0, held, -sense * self.exact.friction)


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

    @cached_property
    def _phases(self) -> Floats:
        """Rows (begin, origin, centre, cosine, sine, frequency, w or 0, e at the begin).

        x = origin + centre + cosine cos(frequency s) + sine sin(frequency s), s after the begin.
        """
        m, k, limit = self.rigid.mass, self.rigid.stiffness, self.rigid.friction
        omega, r = math.sqrt(k / m), limit / self.shear_stiffness
        both = k + self.shear_stiffness
        fast = math.sqrt(both / m)
        rows, begin, x, v, way = [], 0.0, self.rigid.start, 0.0, -1.0
        while True:
            centre = -way * limit / k
            cosine, sine = x - centre, v / omega
            rows.append((begin, 0.0, centre, cosine, sine, omega, way, way * r))
            angle = math.atan2(abs(sine), way * cosine)
            begin += angle / omega
            x = centre + cosine * math.cos(angle) + sine * math.sin(angle)
            centre = -(k * x + way * limit) / both
            rows.append((begin, x, centre, -centre, 0.0, fast, 0.0, way * r))
            reached = 1.0 + 2.0 * way * r / centre  # the cosine of the angle at which e = -w r
            if abs(reached) > 1.0:
                return np.array(rows)
            angle = math.acos(reached)
            begin += angle / fast
            x, v = x + centre * (1.0 - reached), centre * fast * math.sin(angle)
            way = -way

    def _at(self, time: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """X, x' and e at times (t,)."""
        t = np.asarray(time, dtype=np.float64)
        row = np.searchsorted(self._phases[:, 0], t, side="right") - 1
        begin, origin, centre, cosine, sine, frequency, way, slip = self._phases[row].T
        angle = frequency * (t - begin)
        moved = centre + cosine * np.cos(angle) + sine * np.sin(angle)
        rate = frequency * (sine * np.cos(angle) - cosine * np.sin(angle))
        return origin + moved, rate, slip + np.where(way == 0.0, moved, 0.0)

    def displacement(self, time: ArrayLike) -> Floats:
        """See `Motion`."""
        return self._at(time)[0][:, None]

    def velocity(self, time: ArrayLike) -> Floats:
        """See `Motion`."""
        return self._at(time)[1][:, None]

    def force(self, time: ArrayLike) -> Floats:
        """See `Motion`."""
        return self.shear_stiffness * self._at(time)[2]


@dataclass(frozen=True)
class _Slide:
    """Motion of Newmark's block relative to its base, as one dof."""

    exact: SlidingBlock
    friction: float

    def displacement(self, time: ArrayLike) -> Floats:
        return self.exact.slip(time)[:, None]

    def velocity(self, time: ArrayLike) -> Floats:
        return self.exact.velocity(time)[:, None]

    def force(self, time: ArrayLike) -> Floats:
        t = np.asarray(time)
        return np.where(t < self.exact.stop_time, self.friction, 0.0)


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
    motion: Motion = _DryFriction(exact)
    if depth:
        motion = ElasticFriction(rigid=exact, shear_stiffness=ratio * exact.stiffness)
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
        motion=_Slide(exact, 2.0),
        component=1,
        compared=slice(0, 1),
    )


# ---------------------------------------------------------------- solids


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """The motion that a fine run gave."""

    run: Run
    sampling: float

    def _rows(self, time: ArrayLike) -> NDArray[np.int64]:
        wanted = np.asarray(time)
        rows = np.searchsorted(self.run.time, wanted - 1e-6 * self.sampling)
        if np.abs(self.run.time[rows] - wanted).max() > 1e-6 * self.sampling:
            raise ValueError("The fine run has no step that ends at a time asked for.")
        return rows

    def displacement(self, time: ArrayLike) -> Floats:
        """See `Motion`; at ends of its steps only."""
        return self.run.displacement[self._rows(time)]

    def velocity(self, time: ArrayLike) -> Floats:
        """See `Motion`; at ends of its steps only."""
        return self.run.velocity[self._rows(time)]

    def force(self, time: ArrayLike) -> Floats:
        """See `Motion`; between the middles of its steps along straight lines."""
        return np.interp(time, self.run.time - 0.5 * self.run.dt, self.run.force)


def with_fine_motion(problem: Problem, dt: float, sampling: float) -> Problem:
    """The problem to be compared with its own energy-consistent run in steps of dt [s]."""
    run = march(problem, dj.EnergyConsistent(), dt)
    return replace(problem, motion=Sampled(run=run, sampling=sampling), sampling=sampling)


def _mesh(write: Callable[[Path], object]) -> dj.JointedMesh:
    comm = MPI.COMM_WORLD
    with TemporaryDirectory() as folder:
        path = Path(comm.bcast(folder)) / "mesh.msh"
        on_root(comm, lambda: write(path))
        return dj.read_msh(path, comm)


STIFF = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=20.0)


def blocks(*, end: float = 3e-3, law: CondensedLaw = STIFF, massless: bool = False) -> Problem:
    """A block of 1 m thrown obliquely on another one, 0.2 m/s down and 0.15 m/s along.

    Hexahedra of half a metre, 9 joint points, a gap of 0.1 mm: the upper block strikes, slides
    and rebounds within 3 ms. The nodes of a joint may be without mass.
    """
    jointed = _mesh(lambda path: two_blocks(path, size=0.5))
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=30e9, poisson=0.2, density=2400.0),
        joints=dj.Joints(law, initial_gaps={"joint_1": 1e-4}),
        supports=[dj.Fixed(group="base")],
        damping=dj.stiffness_proportional(ratio=0.05, frequency=800.0),
        body=dj.Body(redistribute_mass=massless),
    )
    velocity = np.zeros(model.num_dofs)
    upper = np.unique([model.V.dofmap.cell_dofs(c) for c in jointed.cells("upper")])
    velocity.reshape(-1, 3)[upper] = (0.15, 0.05, -0.2)
    return Problem(
        system=model.system(),
        period=1e-3,
        end=end,
        displacement=np.zeros(model.num_dofs),
        velocity=velocity,
    )


def wall(
    acceleration: Callable[[float], Floats],
    *,
    end: float,
    divisions: tuple[int, int, int] = (8, 2, 8),
) -> Problem:
    """A free-standing wall in four blocks, after self weight, on a shaken base."""
    jointed = _mesh(lambda path: jointed_wall(path, divisions=divisions))
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        joints=dj.FrictionNoTension(
            normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0
        ),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
    )
    static = dj.Simulation(model).statics()
    return Problem(
        system=model.system([dj.BaseMotion(acceleration=acceleration)]),
        period=0.005,
        end=end,
        displacement=static.displacement.array.copy(),
        velocity=np.zeros(model.num_dofs),
        joints=static.joints,
    )
