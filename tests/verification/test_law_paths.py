# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The friction law followed along slip paths that have exact solutions; arrays only, no mesh.

    s2 ^   circle of radius R          s2 ^    e, |e| = r
       |    , - ~ - ,---> slip            |   /
       |  '     R     ' ~> e              |  / angle a    straight slip turns e
       | ,      +------,                  | /__________>  into its own direction
       '----------------> s1              '----------------> s1

All is governed by one length, r = mu p / k_s, the elastic slip at which a point slides. With the
elastic slip e, sliding under constant pressure is e' = s' - (s'.e) e / r^2 on the circle |e| = r,
and the traction is k_s e. The exact solutions below are derived from this; nothing in them is taken
from the return mapping. Many points with their own pressures and paths are followed at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.law import Floats, JointState, Status

EXACT = 1e-10  # relative; what rounding makes of some hundred steps is nearer to 1e-13
K_N, K_S = 1e11, 4e10  # Pa/m
LAW = FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0)


class History(NamedTuple):
    """Answers along a path: shapes (steps, n, 3), (steps, n, 2), (steps, n) and (steps, n)."""

    traction: Floats
    elastic_slip: Floats
    dissipation: Floats
    status: Floats


def follow(law, gaps, elastic_slip=None):
    """Start at rest, or with an elastic slip (n, 2), at the first gap and go through the others.

    Args:
        law: The law.
        gaps: Gaps (n, s1, s2), shape (1 + steps, n, 3), [m].
        elastic_slip: Elastic slip at the first gap, shape (n, 2), [m].
    """
    state = JointState.at_rest(gaps[0])
    if elastic_slip is not None:
        state = JointState(gap=gaps[0].copy(), elastic_slip=np.array(elastic_slip))
    answers = []
    for gap in gaps[1:]:
        answers.append(law.backward_euler(gap, state))
        state = answers[-1].state
    return History(
        traction=np.array([a.traction for a in answers]),
        elastic_slip=np.array([a.state.elastic_slip for a in answers]),
        dissipation=np.array([a.dissipation for a in answers]),
        status=np.array([a.status for a in answers]),
    )


def sliding_length(law, pressure):
    """R = mu p / k_s [m]."""
    return law.friction_coefficient * pressure / law.shear_stiffness


def in_plane(law, slip, pressure, direction_deg=0.0):
    """Gaps for slips (steps, n) along a direction under pressures (n,) or (steps, n)."""
    angle = np.radians(direction_deg)
    normal = np.broadcast_to(-np.asarray(pressure) / law.normal_stiffness, slip.shape)
    return np.stack([normal, slip * np.cos(angle), slip * np.sin(angle)], axis=-1)


def observed_order(sizes, errors):
    """Slope of the errors over the step sizes."""
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


# ---------------------------------------------------------------- load, unload, reverse


@dataclass(frozen=True)
class Cycle:
    """Slip 0 -> a -> -a -> a -> ... under constant pressure.

    From a turning point, where e is -+r (or what it reached), e follows the slip until it arrives
    at the opposite limit. Where a <= r nothing slides, e = s. The loop of the traction over the
    slip is a parallelogram of height 2 mu p and base 2 (a - r): its area is the friction work.

    Attributes:
        r: Sliding length of each point, shape (n,), [m].
        amplitude: a of each point, shape (n,), [m].
    """

    r: Floats
    amplitude: Floats

    def elastic_slip(self, branch, slip):
        """E [m] on branch 0 (first loading), 1 (down), 2 (up), ... at slips (steps, n)."""
        reached = np.minimum(self.r, self.amplitude)
        if branch == 0:
            return np.minimum(slip, self.r)
        if branch % 2:
            return np.maximum(reached - (self.amplitude - slip), -self.r)
        return np.minimum(-reached + (self.amplitude + slip), self.r)

    def nodes(self, branch, count):
        """Slips that end a branch, with the point at which it begins to slide among them."""
        reached = np.minimum(self.r, self.amplitude)
        if branch == 0:
            return np.sort(np.vstack([np.linspace(0, self.amplitude, count + 1)[1:], reached]), 0)
        up = np.linspace(-self.amplitude, self.amplitude, count + 1)[1:]
        up = np.sort(np.vstack([up, 2.0 * reached - self.amplitude]), axis=0)
        return -up if branch % 2 else up

    def work(self, limit):
        """Friction work of a cycle per area [J/m^2] for a shear strength mu p (n,) [Pa]."""
        return 4.0 * limit * np.maximum(self.amplitude - self.r, 0.0)


PRESSURES = np.array([1e4, 3e5, 1e6, 2e6, 5e6])  # Pa
AMPLITUDES = np.array([0.4, 0.999, 1.001, 3.0, 250.0])  # times r: elastic, nearly so, sliding
LAWS = [(1e11, 4e10, 30.0)] + [(10.0**n, 0.4 * 10.0**n, 30.0) for n in (5, 7, 9, 13, 16)]
LAWS += [(1e11, 4e10, 89.999), (1e11, 1e5, 30.0), (1e5, 1e16, 1e-3)]


@pytest.mark.parametrize("direction", [0.0, 17.0, 90.0, 231.0])
@pytest.mark.parametrize(("k_n", "k_s", "angle"), LAWS)
def test_load_unload_reverse(k_n, k_s, angle, direction):
    """The stiffnesses from 1e5 to 1e16 Pa/m, and a friction angle at which next to all sticks."""
    law = FrictionNoTension(normal_stiffness=k_n, shear_stiffness=k_s, friction_angle_deg=angle)
    pressure, share = (m.ravel() for m in np.meshgrid(PRESSURES, AMPLITUDES))
    r = sliding_length(law, pressure)
    exact = Cycle(r, share * r)
    slips = [np.zeros((1, len(r))), *(exact.nodes(branch, 7) for branch in range(5))]
    expected = np.vstack([exact.elastic_slip(b, s) for b, s in enumerate(slips[1:])])
    history = follow(law, in_plane(law, np.vstack(slips), pressure, direction))
    along = np.array([math.cos(math.radians(direction)), math.sin(math.radians(direction))])
    assert np.abs((history.elastic_slip @ along - expected) / r).max() < EXACT
    across = history.elastic_slip @ [-along[1], along[0]]
    assert np.abs(across / r).max() < EXACT
    shear = history.traction[..., 1:] - law.shear_stiffness * expected[..., None] * along
    assert np.abs(shear / (law.friction_coefficient * pressure)[:, None]).max() < EXACT
    np.testing.assert_allclose(-history.traction[..., 0], np.tile(pressure, (len(expected), 1)))


@pytest.mark.parametrize("count", [1, 2, 9])
def test_friction_work_of_a_cycle(count):
    """4 mu p (a - mu p / k_s), exact in any number of steps that end where sliding sets in."""
    pressure, share = (m.ravel() for m in np.meshgrid(PRESSURES, AMPLITUDES))
    r, limit = sliding_length(LAW, pressure), LAW.friction_coefficient * pressure
    exact = Cycle(r, share * r)
    slips = [exact.nodes(branch, count) for branch in range(5)]
    history = follow(LAW, in_plane(LAW, np.vstack([np.zeros((1, len(r))), *slips]), pressure))
    lengths = np.cumsum([len(s) for s in slips])
    for first in (0, 2):
        done = history.dissipation[lengths[first] : lengths[first + 2]].sum(axis=0)
        error = np.abs(done - exact.work(limit)) / (limit * share * r)
        assert error.max() < EXACT


def test_work_of_a_cycle_by_hand():
    """K_s 2e12, mu 0.5, 1 MPa, +-1 um: r = 0.25 um, 4 x 0.5 MPa x 0.75 um = 1.5 J/m^2."""
    cycle = Cycle(np.array([0.5e6 / 2e12]), np.array([1e-6]))
    assert cycle.work(0.5e6)[0] == pytest.approx(1.5, rel=1e-14)


# ---------------------------------------------------------------- pressure that varies


@dataclass(frozen=True)
class BreathingPressure:
    """Steady slip s = c r0 t under a pressure that swings, so that r(t) = r0 (1 + a sin t).

    Sliding, e = r(t), lasts as long as the limit rises slower than the slip, r' <= c r0. It ends at
    2 pi n - acos(c/a); from there e follows the slip, until r comes down to it again.

    Attributes:
        r0: Mean sliding length [m].
        swing: a, below 1.
        speed: c, below a.
    """

    r0: float
    swing: float
    speed: float

    @property
    def start(self):
        """A time at which the joint slides, e = r."""
        return math.acos(self.speed / self.swing)

    @property
    def catch(self):
        """Time at which sticking begins."""
        return 2.0 * math.pi - self.start

    @property
    def release(self):
        """Time at which it slides again."""
        begin, end = 2.0 * math.pi + self.start, self.catch + 2.0 * math.pi
        return brentq(lambda t: self.r(t) - self._stuck(t), begin, end, xtol=1e-15, rtol=1e-15)

    def r(self, time):
        """Sliding length [m]."""
        return self.r0 * (1.0 + self.swing * np.sin(time))

    def slip(self, time):
        """S [m]."""
        return self.speed * self.r0 * time

    def _stuck(self, time):
        return self.r(self.catch) + self.slip(time - self.catch)

    def elastic_slip(self, time):
        """E from `start` to the end of the second sliding, [m]."""
        sticks = (time > self.catch) & (time < self.release)
        return np.where(sticks, self._stuck(time), self.r(time))

    def plastic_work(self, end):
        """Integral of e over the plastic slip from `start` to a time before `catch`, [m^2].

        That is of r (s' - r'); times k_s it is the friction work per area.
        """
        begin, r0 = self.start, self.r0
        swung = self.swing * (math.cos(end) - math.cos(begin))
        area = self.speed * r0**2 * (end - begin - swung)
        return area - 0.5 * (self.r(end) ** 2 - self.r(begin) ** 2)


BREATHING = [BreathingPressure(1e-6 * k, a, c) for k, a, c in [(1, 0.9, 0.1), (3, 0.5, 0.4)]]
BREATHING += [BreathingPressure(2e-7, 0.7, 0.35), BreathingPressure(1e-4, 0.99, 0.01)]


def breathing_times(exact, count):
    """From the first sliding through sticking to the end of the second, events included."""
    events = (exact.start, exact.catch, exact.release, exact.catch + 2.0 * math.pi)
    pieces = [np.linspace(a, b, count + 1)[1:] for a, b in pairwise(events)]
    return np.concatenate([[exact.start], *pieces])


def breathe(law, times):
    """Follow all the programmes at once, times of shape (1 + steps, n)."""
    programmes = list(zip(BREATHING, times.T, strict=True))
    slip = np.column_stack([exact.slip(t) for exact, t in programmes])
    r = np.column_stack([exact.r(t) for exact, t in programmes])
    pressure = law.shear_stiffness * r / law.friction_coefficient
    start = np.column_stack([r[0], np.zeros(len(BREATHING))])
    return follow(law, in_plane(law, slip, pressure), start)


@pytest.mark.parametrize("count", [1, 5, 40])
def test_varying_pressure(count):
    """Exact at every step, however long: along one direction sticking and sliding are linear."""
    times = np.column_stack([breathing_times(exact, count) for exact in BREATHING])
    history = breathe(LAW, times)
    for point, exact in enumerate(BREATHING):
        expected = exact.elastic_slip(times[1:, point])
        error = np.abs(history.elastic_slip[:, point, 0] - expected)
        assert error.max() < EXACT * exact.r0
        status = history.status[:, point].reshape(3, count)
        # The last step of sticking ends on the limit, where rounding decides.
        assert (status[1, :-1] == Status.STICK).all()
    assert np.abs(history.elastic_slip[..., 1]).max() == 0.0


def test_friction_work_under_varying_pressure():
    """Mean traction times plastic slip is a trapezoidal sum: order 2 in the step."""
    counts, errors = (20, 40, 80, 160), []
    for count in counts:
        times = np.column_stack([np.linspace(e.start, math.pi, count + 1) for e in BREATHING])
        done = breathe(LAW, times).dissipation.sum(axis=0)
        expected = [LAW.shear_stiffness * exact.plastic_work(math.pi) for exact in BREATHING]
        errors.append(np.abs(done / expected - 1.0))
    for point in range(len(BREATHING)):
        order = -observed_order(counts, np.array(errors)[:, point])
        assert order == pytest.approx(2.0, abs=0.02)


# ---------------------------------------------------------------- slip on a circle


@dataclass(frozen=True)
class CircularSlip:
    """Steady sliding around a circle of radius R, smoothly or along chords of angle D.

    Smoothly: e turns at the rate of the slip. Its rate r w is all the slip rate across e, R w
    sin(lag), so sin(lag) = r/R, and the work of a turn is mu p 2 pi R cos(lag).

    Along chords, of length c = 2 R sin(D/2): backward Euler turns e by D a step, onto e0 + c.
    Across the new e, the old one contributes -r sin(D) and the chord c sin(lag), lag now counted
    from the chord: sin(lag) = (r/R) cos(D/2). Along it they are r cos(D) + c cos(lag); r of this
    is elastic, the rest plastic.

    Attributes:
        r: Sliding length [m].
        radius: R above r [m].
        chord_angle: D [rad].
    """

    r: Floats
    radius: Floats
    chord_angle: float

    @property
    def smooth_lag(self):
        """Of e behind the tangent, for infinitely short chords [rad]."""
        return np.arcsin(self.r / self.radius)

    @property
    def lag(self):
        """Of e behind the chord [rad]."""
        return np.arcsin(self.r / self.radius * math.cos(0.5 * self.chord_angle))

    @property
    def plastic_slip(self):
        """Of one chord [m]."""
        chord = 2.0 * self.radius * math.sin(0.5 * self.chord_angle)
        return self.r * (math.cos(self.chord_angle) - 1.0) + chord * np.cos(self.lag)

    def work(self, limit):
        """Of one chord with the mean traction of its ends, per area [J/m^2]."""
        return 0.5 * limit * (1.0 + math.cos(self.chord_angle)) * self.plastic_slip

    def smooth_work(self, limit):
        """Of one turn, per area [J/m^2]."""
        return 2.0 * math.pi * limit * self.radius * np.cos(self.smooth_lag)

    def slip(self, steps):
        """Slip at the ends of the chords, shape (1 + steps, n, 2), [m]."""
        angle = (self.chord_angle * np.arange(steps + 1))[:, None]
        return np.stack([self.radius * np.cos(angle), self.radius * np.sin(angle)], axis=-1)

    def elastic_slip(self, steps):
        """E at the ends of the chords in the steady state, shape (1 + steps, n, 2), [m]."""
        angle = self.chord_angle * (np.arange(steps + 1)[:, None] - 0.5) + 0.5 * math.pi - self.lag
        return np.stack([self.r * np.cos(angle), self.r * np.sin(angle)], axis=-1)


RATIOS = np.array([1.001, 1.1, 1.5, 3.0, 40.0])  # R over r


def circle(chord_angle):
    """Points under 1 MPa on circles of their own."""
    r = np.full(len(RATIOS), sliding_length(LAW, 1e6))
    return CircularSlip(r, RATIOS * r, chord_angle)


def around(exact, steps, elastic_slip=None):
    """Follow the chords."""
    slip = exact.slip(steps)
    normal = np.full((*slip.shape[:2], 1), -1e6 / LAW.normal_stiffness)
    return follow(LAW, np.concatenate([normal, slip], axis=-1), elastic_slip)


@pytest.mark.parametrize("per_turn", [3, 4, 6, 7.3, 24, 360])
def test_circular_slip_along_chords(per_turn):
    """The steady state, once in it; down to triangles."""
    exact, steps = circle(2.0 * math.pi / per_turn), 24
    steady = exact.elastic_slip(steps)
    history = around(exact, steps, steady[0])
    assert np.abs(history.elastic_slip - steady[1:]).max() < EXACT * exact.r[0]
    assert (history.status == Status.SLIP).all()
    limit = LAW.friction_coefficient * 1e6
    error = np.abs(history.dissipation - exact.work(limit))
    assert error.max() < EXACT * limit * exact.r[0]


def test_circular_slip_arrives_at_the_steady_state():
    """From rest. The nearer R is to r the slower: exp(-sqrt(R^2/r^2 - 1) angle), 1e-5 in a turn."""
    exact, steps = circle(math.pi / 18.0), 36 * 4
    history = around(exact, steps)
    slow, fast = RATIOS < 1.05, RATIOS > 1.05
    error = np.abs(history.elastic_slip - exact.elastic_slip(steps)[1:]).max(axis=-1) / exact.r
    assert (error[-1, fast] < 1e-4).all()
    assert (error[-1, slow] < error[36, slow]).all()


def test_circular_slip_tends_to_the_smooth_one():
    """Lag behind the tangent at the end of the step: order 1, it is D/2 + O(D^2) too large.

    Behind the chord, that is behind the tangent in the middle of the step, it is of order 2. The
    work of a turn is less by tan(lag) D/2 of it (from `CircularSlip.work`), of order 1.
    """
    chords, ends, middles, works = 2.0 * math.pi / np.array([480, 960, 1920]), [], [], []
    limit = LAW.friction_coefficient * 1e6
    for chord_angle in chords:
        exact = circle(chord_angle)
        steps = round(2.0 * math.pi / chord_angle)
        history = around(exact, steps, exact.elastic_slip(0)[0])
        last = history.elastic_slip[-1]
        behind = 0.5 * math.pi - np.arctan2(last[:, 1], last[:, 0])  # the tangent at 2 pi
        ends.append(behind - exact.smooth_lag)
        middles.append(exact.smooth_lag - (behind - 0.5 * chord_angle))
        turn = history.dissipation.sum(axis=0)
        works.append(1.0 - turn / exact.smooth_work(limit))
    smooth = circle(1.0).smooth_lag
    # At R near r the lag is 90 degrees, and at R far above r the first term of the work is nought.
    for point in np.flatnonzero((RATIOS > 1.05) & (RATIOS < 10.0)):
        for errors, order in ((ends, 1.0), (middles, 2.0), (works, 1.0)):
            found = observed_order(chords, np.array(errors)[:, point])
            assert found == pytest.approx(order, abs=0.02)
        assert ends[-1][point] == pytest.approx(0.5 * chords[-1], rel=0.01)
        lost = 0.5 * math.tan(smooth[point]) * chords[-1]
        assert works[-1][point] == pytest.approx(lost, rel=0.05)


def test_circle_within_the_elastic_range():
    """A circle that passes through the origin of e with 2 R < r: e is the slip, nothing slides."""
    r = sliding_length(LAW, 1e6)
    exact = CircularSlip(np.array([r]), np.array([0.499 * r]), math.pi / 10.0)
    history = around(exact, 40)
    slip = exact.slip(40)
    assert np.abs(history.elastic_slip - (slip[1:] - slip[0])).max() < EXACT * r
    assert (history.status == Status.STICK).all()
    assert np.abs(history.dissipation).max() < EXACT * LAW.friction_coefficient * 1e6 * r


# ---------------------------------------------------------------- straight slip turns e


@dataclass(frozen=True)
class StraightSlip:
    """Straight slip s of a point whose elastic slip makes the angle a0 with it, |e| = r at first.

    Sliding turns e towards the slip, a' = -sin(a) s'/r: tan(a/2) = tan(a0/2) exp(-s/r), a
    tractrix. Beyond 90 degrees the slip first makes e shorter: it crosses the circle |e| = r along
    a chord of length -2 r cos(a0), sticking, and slides on from the angle pi - a0.

    Attributes:
        r: Sliding length [m].
        angle: a0 of each point, shape (n,), [rad].
    """

    r: float
    angle: Floats

    @property
    def stuck(self):
        """Slip without sliding [m]."""
        return np.maximum(-2.0 * self.r * np.cos(self.angle), 0.0)

    @property
    def _entry(self):
        return np.minimum(self.angle, math.pi - self.angle)

    def elastic_slip(self, slip):
        """E along and across the slip, shape (n, 2), [m]."""
        turned = np.exp(-np.maximum(slip - self.stuck, 0.0) / self.r) * np.tan(0.5 * self._entry)
        a = 2.0 * np.arctan(turned)
        sliding = self.r * np.column_stack([np.cos(a), np.sin(a)])
        start = self.r * np.column_stack([np.cos(self.angle), np.sin(self.angle)])
        sticking = start + np.column_stack([slip, np.zeros_like(slip)])
        return np.where((slip > self.stuck)[:, None], sliding, sticking)

    def plastic_slip(self, slip):
        """Its length: the integral of cos(a), with cos(a) = tanh(s/r + u0), [m]."""
        u0 = -np.log(np.tan(0.5 * self._entry))
        u1 = u0 + np.maximum(slip - self.stuck, 0.0) / self.r
        return self.r * (np.log(np.cosh(u1)) - np.log(np.cosh(u0)))


OBLIQUE = np.radians([1.0, 30.0, 60.0, 89.0, 100.0, 135.0, 150.0])


def slide_straight(exact, ends, steps, direction=0.4):
    """Follow slips 0 ... ends (n,) in equal steps; e at the end, along and across, and the work."""
    axes = np.array([[math.cos(direction), math.sin(direction)]])
    axes = np.vstack([axes, [[-axes[0, 1], axes[0, 0]]]])
    slip = np.linspace(0.0, ends, steps + 1)
    gaps = in_plane(LAW, slip, np.full(slip.shape, 1e6), math.degrees(direction))
    history = follow(LAW, gaps, exact.elastic_slip(np.zeros(len(ends))) @ axes)
    return history.elastic_slip[-1] @ axes.T, history.dissipation.sum(axis=0)


def test_straight_slip_turns_the_elastic_slip():
    """Backward Euler: order 1 in the step, of the direction and of the work."""
    exact = StraightSlip(sliding_length(LAW, 1e6), OBLIQUE)
    ends = exact.stuck + 1.5 * exact.r
    expected, limit = exact.elastic_slip(ends), LAW.friction_coefficient * 1e6
    counts, errors, works = (400, 800, 1600), [], []
    for count in counts:
        found, work = slide_straight(exact, ends, count)
        errors.append(np.linalg.norm(found - expected, axis=1) / exact.r)
        works.append(np.abs(work - limit * exact.plastic_slip(ends)) / (limit * exact.r))
    for series in (errors, works):
        orders = [-observed_order(counts, point) for point in np.transpose(series)]
        assert orders == pytest.approx(np.ones(len(OBLIQUE)), abs=0.02)


def test_crossing_the_elastic_range_is_exact():
    """Up to the far end of the chord nothing slides, in any number of steps."""
    exact = StraightSlip(sliding_length(LAW, 1e6), OBLIQUE[4:])
    for share in (0.3, 0.999):
        found, work = slide_straight(exact, share * exact.stuck, 7)
        assert np.abs(found - exact.elastic_slip(share * exact.stuck)).max() < EXACT * exact.r
        assert np.abs(work).max() < EXACT * LAW.friction_coefficient * 1e6 * exact.r


@pytest.mark.parametrize("steps", [1, 10])
def test_slip_along_the_elastic_slip_is_exact(steps):
    """Angle 0: e stays where it is. Angle 180: it goes through zero to the opposite limit."""
    r, limit = sliding_length(LAW, 1e6), LAW.friction_coefficient * 1e6
    exact = StraightSlip(r, np.array([0.0, math.pi]))
    ends = np.array([5.0 * r, 7.0 * r])
    found, work = slide_straight(exact, ends, steps)
    assert np.abs(found - [[r, 0.0], [r, 0.0]]).max() < EXACT * r
    assert work[0] == pytest.approx(5.0 * limit * r, rel=EXACT)


# ---------------------------------------------------------------- opening and closing again


@dataclass(frozen=True)
class Landing:
    """A straight path from an open gap g0 to a closed one g1, with the slip D on the way.

    It touches at the fraction g0 / (g0 - g1) of the path; the slip before that meets no pressure.
    From there slip and pressure grow in proportion, so that the point either sticks or slides all
    the way, and e is the slip since touching, or as much of it as the last pressure holds.

    Attributes:
        opened: g0 of each point, positive, shape (n,), [m].
        closed: g1 of each point, negative, shape (n,), [m].
        slip: D, shape (n, 2), [m].
    """

    opened: Floats
    closed: Floats
    slip: Floats

    @property
    def touching(self):
        """Fraction of the path at which the gap is zero."""
        return self.opened / (self.opened - self.closed)

    @property
    def loading_slip(self):
        """Slip after touching, shape (n, 2), [m]."""
        return (1.0 - self.touching)[:, None] * self.slip

    def elastic_slip(self, law):
        """At the end, shape (n, 2), [m]."""
        r = -sliding_length(law, self.closed * law.normal_stiffness)
        size = np.linalg.norm(self.loading_slip, axis=1)
        return np.minimum(1.0, r / size)[:, None] * self.loading_slip

    def work(self, law):
        """Friction work per area: half the last traction on what slid after touching [J/m^2]."""
        e = self.elastic_slip(law)
        return 0.5 * law.shear_stiffness * np.sum(e * (self.loading_slip - e), axis=1)

    def path(self, shares):
        """Gaps at shares (steps, n) of the way, shape (steps, n, 3), [m]."""
        normal = self.opened + shares * (self.closed - self.opened)
        return np.concatenate([normal[..., None], shares[..., None] * self.slip], axis=-1)


def landings(law, count=200):
    """Points that touch early and late, and stick or slide, at random."""
    rng = np.random.default_rng(3)
    pressure = 10.0 ** rng.uniform(4, 7, count)
    closed = -pressure / law.normal_stiffness
    opened = -closed * 10.0 ** rng.uniform(-2, 2, count)
    r = sliding_length(law, pressure)
    loading = (r * 10.0 ** rng.uniform(-2, 2, count))[:, None]
    angle = rng.uniform(0.0, 2.0 * math.pi, count)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    return Landing(opened, closed, loading * (1.0 - opened / closed)[:, None] * direction)


def test_closing_by_hand():
    """K_n 1e12, k_s 2e12, mu 0.5: from 0.5 to -1 um with 0.3 um of slip, 2/3 of it counts.

    0.2 um and 1 MPa: 0.4 MPa, below 0.5. With 0.6 um, 0.4 um counts: 0.5 MPa, e = 0.25 um.
    """
    law = FrictionNoTension(
        normal_stiffness=1e12, shear_stiffness=2e12, friction_angle_deg=math.degrees(math.atan(0.5))
    )
    gaps = 1e-6 * np.array([[[0.5, 0, 0], [0.5, 0, 0]], [[-1, 0.3, 0], [-1, 0, 0.6]]])
    traction = follow(law, gaps).traction[0]
    assert traction[0] == pytest.approx([-1e6, 0.4e6, 0.0], rel=1e-12)
    assert traction[1] == pytest.approx([-1e6, 0.0, 0.5e6], rel=1e-12)


@pytest.mark.parametrize("k_n", [1e5, 1e11, 1e16])
def test_closing_within_a_step(k_n):
    law = FrictionNoTension(
        normal_stiffness=k_n, shear_stiffness=0.4 * k_n, friction_angle_deg=30.0
    )
    exact = landings(law)
    history = follow(law, exact.path(np.array([[0.0], [1.0]]) * np.ones(200)))
    expected = exact.elastic_slip(law)
    size = np.linalg.norm(expected, axis=1)
    error = np.linalg.norm(history.elastic_slip[-1] - expected, axis=1)
    assert (error / size).max() < EXACT
    slides = np.linalg.norm(exact.loading_slip, axis=1) > 1.001 * size
    assert 50 < slides.sum() < 150
    np.testing.assert_array_equal(history.status[-1] == Status.SLIP, slides)


@pytest.mark.parametrize("count", [1, 2, 3, 10])
def test_closing_does_not_depend_on_the_steps(count):
    """Also where flight and contact are cut into equal steps: most close within one."""
    exact = landings(LAW)
    shares = np.linspace(0.0, 1.0, count + 1)[:, None] * np.ones(200)
    expected = exact.elastic_slip(LAW)
    error = np.linalg.norm(follow(LAW, exact.path(shares)).elastic_slip[-1] - expected, axis=1)
    assert (error / np.linalg.norm(expected, axis=1)).max() < EXACT


def test_friction_work_of_closing():
    """Exact from touching on, if a step ends there."""
    exact = landings(LAW)
    shares = np.array([np.zeros(200), exact.touching, np.ones(200)])
    path = exact.path(shares)
    path[1, :, 0] = 0.0
    history = follow(LAW, path)
    assert np.abs(history.dissipation[0]).max() == 0.0
    scale = LAW.shear_stiffness * np.sum(exact.elastic_slip(LAW) * exact.loading_slip, axis=1)
    assert np.abs((history.dissipation[1] - exact.work(LAW)) / scale).max() < EXACT


def test_slip_in_flight_leaves_no_trace():
    """Sheared, opened, moved about, closed at another place without slip: no shear is left.

    Then it is sheared afresh from there, as `Cycle` says. What the shear had stored is lost on
    opening: the friction work of that step is k_s e^2 / 2, its slip being none.
    """
    rng = np.random.default_rng(5)
    n, pressure = 50, 1e6
    r = sliding_length(LAW, pressure)
    stuck = 0.8 * r * rng.uniform(-1.0, 1.0, (n, 2)) / math.sqrt(2.0)
    places = [np.zeros((n, 2)), stuck, stuck, *(r * rng.normal(size=(3, n, 2)) * 100.0)]
    places += [places[-1], places[-1] + [3.0 * r, 0.0], places[-1] + [1.5 * r, 0.0]]
    closed, opened = -pressure / K_N, 2e-5
    normals = [closed, closed, *[opened] * 4, closed, closed, closed]
    gaps = np.array(
        [np.column_stack([np.full(n, g), p]) for g, p in zip(normals, places, strict=True)]
    )
    history = follow(LAW, gaps)
    stored = 0.5 * K_S * np.sum(stuck**2, axis=1)
    np.testing.assert_allclose(history.dissipation[1], stored, rtol=EXACT)
    np.testing.assert_array_equal(history.traction[1:5], 0.0)
    np.testing.assert_array_equal(history.dissipation[2:6], 0.0)
    np.testing.assert_array_equal(history.traction[5, :, 1:], 0.0)
    fresh = np.tile([[[r, 0.0]], [[-0.5 * r, 0.0]]], (1, n, 1))
    assert np.abs(history.elastic_slip[6:] - fresh).max() < EXACT * r


# ---------------------------------------------------------------- limits of the parameters


def wander(n=40, steps=30, seed=11):
    """Gaps that open, close and slip at random, of the order of 10 um."""
    rng = np.random.default_rng(seed)
    gaps = 1e-5 * rng.normal(size=(steps, n, 3))
    gaps[0] = [1e-5, 0.0, 0.0]
    return gaps


@pytest.mark.parametrize(("k_s", "angle"), [(K_S, 0.0), (0.0, 30.0), (0.0, 0.0)])
def test_without_friction_or_shear_stiffness(k_s, angle):
    """No shear traction, ever, and no work; the normal one is k_n <-g>."""
    law = FrictionNoTension(normal_stiffness=K_N, shear_stiffness=k_s, friction_angle_deg=angle)
    gaps = wander()
    history = follow(law, gaps)
    np.testing.assert_array_equal(history.traction[..., 1:], 0.0)
    np.testing.assert_array_equal(history.elastic_slip, 0.0)
    np.testing.assert_array_equal(history.dissipation, 0.0)
    np.testing.assert_array_equal(history.traction[..., 0], K_N * np.minimum(gaps[1:, :, 0], 0.0))


def test_initial_gap_takes_the_first_approach():
    """The law sees the gap with the initial one in it: nothing until g0 is used up, then k_n.

    Slip on the way, 100 r, does not count.
    """
    g0, pressure = np.array([1e-6, 1e-4, 1e-2]), 1e6
    r = sliding_length(LAW, pressure)
    approach = np.array([[0.0], [0.5], [1.0]]) * g0
    normal = np.vstack([g0 - approach, np.tile(-pressure / K_N, (2, 3))])
    slip = r * np.array([0.0, 50.0, 100.0, 100.0, 100.7])[:, None] * np.ones(3)
    history = follow(LAW, np.stack([normal, slip, np.zeros_like(slip)], axis=-1))
    np.testing.assert_array_equal(history.traction[:2], 0.0)
    np.testing.assert_array_equal(history.status[0], Status.OPEN)
    np.testing.assert_array_equal(history.status[1], Status.STICK)
    assert history.traction[2:, :, 0] == pytest.approx(np.full((2, 3), -pressure), rel=EXACT)
    np.testing.assert_array_equal(history.traction[2, :, 1:], 0.0)
    assert history.elastic_slip[3, :, 0] == pytest.approx(0.7 * r, rel=EXACT)


def test_points_do_not_know_of_each_other():
    """All at once, in another order, and one by one: the same bits."""
    gaps = wander()
    together = follow(LAW, gaps)
    assert all((together.status == status).any() for status in (0, 1, 2))
    order = np.random.default_rng(1).permutation(gaps.shape[1])
    for whole, mixed in zip(together, follow(LAW, gaps[:, order]), strict=True):
        np.testing.assert_array_equal(whole[:, order], mixed)
    for point in range(gaps.shape[1]):
        alone = follow(LAW, gaps[:, point : point + 1])
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[:, point : point + 1], part)
