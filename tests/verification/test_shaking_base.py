# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A block on a base that is shaken harmonically: it sticks, sticks and slips, or always slips.

            ____________________
           |  block, mu g = f   |  -> s
           |____________________|
           |____________________|
           //////////////////////  <- ground, A sin(w t)

Rigid and with Coulomb friction, the slip obeys s'' = -A sin(w t) - f sign(s') while it slides, and
the block sticks where s' = 0 and A |sin| <= f. So it

- sticks for ever where A <= f;
- sticks and slips: a slide begins where A |sin| = f, or at once where the last one ends beyond;
- always slips, in the end, where A/f > sqrt(1 + pi^2/4) = 1.862. For in such a motion the slides
  last half a period each; that friction takes away what one of them gains, f pi/w = 2 (A/w)
  cos(p), gives their first phase, cos(p) = pi f / (2 A), and there must be no rest,
  A sin(p) >= f.

`BlockOnSprings` adds the elastic slip of the joint: that is what the finite elements with average
acceleration must tend to, with order 2 where the sticking is resolved. At a stiff joint they tend
to the rigid block. What is left then is the step in which a slide ends: friction reverses or falls
somewhere within it, which leaves the speed wrong by at most f dt. A sticking block keeps that as a
tremble, with which the next slide begins. Each of the two makes the slip wrong by up to f dt T/2.
"""

import math
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

pytest.importorskip("dolfinx")

from boxes import Rows

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.geometry.two_blocks import two_blocks

LENGTH, WIDTH, HEIGHT = 2.0, 1.0, 0.02  # of the block [m]; flat, so that it hardly rocks
# Without lateral contraction self weight leaves the joint without shear.
STONE = dj.Elastic(young=30e9, poisson=0.0, density=2400.0)
MASS = STONE.density * LENGTH * WIDTH * HEIGHT
K_N = 1e10  # Pa/m
STIFF, SOFT = 1e11, 4e6  # k_s [Pa/m]: sticking at 7000 and at 46 Hz
GRAVITY, FRICTION = 10.0, 2.0  # g and mu g [m/s^2]
PERIOD = 0.2  # s
CYCLES = 2


class Slide(NamedTuple):
    """From a time to a time [s], in the direction ``way`` (1 or -1), from a slip [m]."""

    begin: float
    end: float
    way: int
    origin: float


@dataclass(frozen=True)
class ShakenBlock:
    """The exact motion of the rigid block from rest.

    Attributes:
        ratio: A / f.
        friction: f = mu g [m/s^2].
        period: 2 pi / w [s].
        cycles: How many periods are followed.
    """

    ratio: float
    friction: float = FRICTION
    period: float = PERIOD
    cycles: int = CYCLES

    @property
    def amplitude(self):
        """A [m/s^2]."""
        return self.ratio * self.friction

    @property
    def frequency(self):
        """Of the ground, w [rad/s]."""
        return 2.0 * math.pi / self.period

    @cached_property
    def slides(self):
        """All slides that begin within the time followed."""
        slides, time, origin = [], self._yield_after(0.0), 0.0
        while time < self.cycles * self.period:
            way = -1 if math.sin(self.frequency * time) > 0.0 else 1
            begun = Slide(time, math.inf, way, origin)
            # The speed grows until A |sin| falls below f, and is used up before it is f again.
            calm = math.asin(1.0 / self.ratio) / self.frequency
            half = math.floor(2.0 * time / self.period)
            fastest = 0.5 * self.period * (half + 1) - calm
            slowest = 0.5 * self.period * (half + 2) + calm
            stop = brentq(
                lambda t, s=begun: self._motion(s, t)[1], fastest, slowest, xtol=1e-15, rtol=1e-15
            )
            slides.append(begun._replace(end=stop))
            origin = float(self._motion(begun, stop)[0])
            time = self._yield_after(stop)
        return slides

    def _yield_after(self, time):
        """When the block must slide, at or after a time."""
        if self.ratio <= 1.0:
            return math.inf
        phase = math.fmod(self.frequency * time, math.pi)
        begin = math.asin(1.0 / self.ratio)
        if begin <= phase <= math.pi - begin:
            return time
        return time + (begin - phase + (math.pi if phase > begin else 0.0)) / self.frequency

    def _motion(self, slide, time):
        """Slip and its rate."""
        w, since = self.frequency, time - slide.begin
        gain = self.amplitude / w
        cosine = math.cos(w * slide.begin)
        rate = gain * (np.cos(w * time) - cosine) - slide.way * self.friction * since
        swing = (np.sin(w * time) - math.sin(w * slide.begin)) / w - cosine * since
        return slide.origin + gain * swing - 0.5 * slide.way * self.friction * since**2, rate

    def slip(self, time):
        """S at times [s], [m]."""
        return self._at(time)[0]

    def rate(self, time):
        """S' at times [s], [m/s]."""
        return self._at(time)[1]

    def _at(self, time):
        time = np.asarray(time, dtype=float)
        values = np.zeros((2, *time.shape))
        for slide in self.slides:
            moved = np.array(self._motion(slide, np.minimum(time, slide.end)))
            moved[1] = np.where(time < slide.end, moved[1], 0.0)
            values = np.where(time >= slide.begin, moved, values)
        return values

    def path(self, time):
        """Way slid up to a time, both directions counted [m]."""
        return sum(
            abs(float(self._motion(s, min(time, s.end))[0]) - s.origin)
            for s in self.slides
            if s.begin < time
        )


class Phase(NamedTuple):
    """Sliding (``way`` 1 or -1) or sticking (0) from a time [s] on, and how it begins there."""

    begin: float
    way: int
    slip: float  # m
    rate: float  # m/s
    elastic_slip: float  # m


@dataclass(frozen=True)
class BlockOnSprings:
    """The exact motion of the rigid block on a joint with shear stiffness.

    Sticking, e = y with y'' + W^2 y = -A sin(w t), W^2 = k_s / (mass per area): a free oscillation
    and the forced one, -A sin(w t) / (W^2 - w^2). It ends where |y| = r = f / W^2. Sliding is that
    of `ShakenBlock`, from the rate at which sticking ended. As nothing damps the free oscillation,
    the block trembles where it sticks; each reversal of friction takes a time of the order of 1/W.

    Attributes:
        rigid: The problem.
        stiffness: W^2 [1/s^2].
    """

    rigid: ShakenBlock
    stiffness: float

    @property
    def r(self):
        """Largest elastic slip [m]."""
        return self.rigid.friction / self.stiffness

    @cached_property
    def phases(self):
        """All phases that begin within the time followed."""
        phases, end = [Phase(0.0, 0, 0.0, 0.0, 0.0)], self.rigid.cycles * self.rigid.period
        while True:
            last = phases[-1]
            time = self._end(last, end)
            if time is None:
                return phases
            slip, rate, e = (float(value) for value in self._motion(last, time))
            if last.way:
                phases.append(Phase(time, 0, slip, 0.0, last.way * self.r))
            else:
                way = 1 if e > 0.0 else -1
                phases.append(Phase(time, way, slip, rate, way * self.r))

    def _end(self, phase, latest):
        """When a phase ends: a search in hundredths of the trembling, then a root."""

        def left(time):
            _, rate, e = self._motion(phase, time)
            return phase.way * rate if phase.way else self.r - np.abs(e)

        step = 2.0 * math.pi / math.sqrt(self.stiffness) / 200.0
        times = phase.begin + step * np.arange(1, math.ceil((latest - phase.begin) / step) + 1)
        over = np.flatnonzero(left(times) < 0.0)
        if not len(over):
            return None
        after = times[over[0]]
        before = after - step if over[0] else phase.begin + 1e-6 * step
        return brentq(left, before, after, xtol=1e-15, rtol=1e-15)

    def _motion(self, phase, time):
        """Slip, its rate and the elastic slip."""
        rigid, since = self.rigid, time - phase.begin
        if phase.way:
            slide = Slide(phase.begin, math.inf, phase.way, phase.slip)
            slip, rate = rigid._motion(slide, time)
            e = np.full_like(slip, phase.elastic_slip)
            return slip + phase.rate * since, rate + phase.rate, e
        w, W = rigid.frequency, math.sqrt(self.stiffness)
        forced = -rigid.amplitude / (self.stiffness - w**2)
        cosine = phase.elastic_slip - forced * math.sin(w * phase.begin)
        sine = (phase.rate - forced * w * math.cos(w * phase.begin)) / W
        e = forced * np.sin(w * time) + cosine * np.cos(W * since) + sine * np.sin(W * since)
        rate = forced * w * np.cos(w * time)
        rate = rate + W * (sine * np.cos(W * since) - cosine * np.sin(W * since))
        return phase.slip + e - phase.elastic_slip, rate, e

    def _at(self, time):
        """Slip, its rate and the elastic slip at times, shape (3, n)."""
        time = np.asarray(time, dtype=float)
        number = np.searchsorted([p.begin for p in self.phases], time, side="right") - 1
        values = np.empty((3, *time.shape))
        for index, phase in enumerate(self.phases):
            values[:, number == index] = self._motion(phase, time[number == index])
        return values

    def slip(self, time):
        """S, elastic part included, at times [s], [m]."""
        return self._at(time)[0]

    def path(self, time):
        """Way slid up to a time, both directions counted [m]."""
        ends = [*(p.begin for p in self.phases[1:]), math.inf]
        return sum(
            abs(float(self._motion(p, min(time, end))[0]) - p.slip)
            for p, end in zip(self.phases, ends, strict=True)
            if p.way and p.begin < time
        )


@cache
def blocks(cell):
    """The mesh."""
    sizes = {"length": LENGTH, "width": WIDTH, "size": 0.5, "cell": cell}
    return mesh_of(two_blocks, lower_height=0.1, upper_height=HEIGHT, **sizes)


class History(NamedTuple):
    """At all steps: time [s], mean slips [m], friction work [J], numbers of points."""

    time: np.ndarray
    slip: np.ndarray
    across: np.ndarray
    friction: np.ndarray
    sliding: np.ndarray
    open: np.ndarray


@cache
def shake(ratio, *, steps=200, k_s=STIFF, cell="hex", direction_deg=0.0):
    """Self weight, then the ground shakes along a direction of the plane.

    Args:
        ratio: A / f.
        steps: Steps per period.
        k_s: Shear stiffness of the joint [Pa/m].
        cell: ``hex`` or ``tet``.
        direction_deg: Direction of the ground's motion from x.

    Returns:
        The history, slip along and across that direction, and the outcome.
    """
    exact = ShakenBlock(ratio)
    law = dj.FrictionNoTension(
        normal_stiffness=K_N,
        shear_stiffness=k_s,
        friction_angle_deg=math.degrees(math.atan(FRICTION / GRAVITY)),
    )
    model = dj.Model(
        blocks(cell),
        material=STONE,
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=(0.0, 0.0, -GRAVITY))],
    )
    c, s = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))

    def ground(time):
        a = exact.amplitude * math.sin(exact.frequency * time)
        return a * c, a * s, 0.0

    contact = model.contact
    area = contact.integral(np.ones(len(contact.operator.areas)))

    def row(record):
        x, y = (contact.integral(record.joints.state.gap[:, axis]) / area for axis in (1, 2))
        counts = contact.counts(record.joints.status)
        along, across = c * x + s * y, c * y - s * x
        return record.time, along, across, record.energy.friction, counts.slip, counts.open

    seen = Rows(row)
    simulation = dj.Simulation(model, monitors=[seen])
    simulation.statics()
    dt = PERIOD / steps
    outcome = simulation.dynamics(dt=dt, steps=CYCLES * steps, motion=ground)
    return History(*np.array(seen.rows).T), outcome


def exact_time(count=4001):
    """Times over the whole run [s]."""
    return np.linspace(0.0, CYCLES * PERIOD, count)


def no_event(times, events, margin):
    """The times that are away from all events."""
    return times[np.abs(times[:, None] - np.array(events)).min(axis=1) > margin]


@pytest.mark.parametrize("ratio", [1.05, 1.4, 1.8, 1.9, 3.0, 10.0])
def test_rigid_solution_solves_its_equation(ratio):
    """s'' = -A sin(w t) - f sign(s'), from differences; where it rests, A |sin| <= f.

    Tolerances: rounding of the slip over h^2, and w^2 h^2 / 6 of a rate of 0.6 m/s.
    """
    exact, h = ShakenBlock(ratio), 1e-5
    events = [time for slide in exact.slides for time in (slide.begin, slide.end)]
    t = no_event(exact_time(), [*events, 0.0, CYCLES * PERIOD], 2 * h)
    before, s, after = (exact.slip(t + shift * h) for shift in (-1, 0, 1))
    ground = exact.amplitude * np.sin(exact.frequency * t)
    slides = after != before
    pushed = -ground - exact.friction * np.sign(after - before)
    assert (after - 2.0 * s + before)[slides] / h**2 == pytest.approx(pushed[slides], abs=1e-5)
    assert np.abs(ground[~slides]).max(initial=0.0) <= exact.friction
    assert (after - before) / (2.0 * h) == pytest.approx(exact.rate(t), abs=2e-8)
    assert 0 < len(exact.slides) <= 2 * CYCLES


def test_regimes_of_the_rigid_block():
    """The limits 1 and sqrt(1 + pi^2/4) = 1.8621, and the steady phase cos(p) = pi f / (2 A)."""
    assert not ShakenBlock(0.999).slides
    assert not ShakenBlock(0.999).slip(exact_time()).any()
    limit = math.sqrt(1.0 + 0.25 * math.pi**2)
    assert limit == pytest.approx(1.8621, abs=1e-4)
    for ratio, rests in ((1.001, True), (limit - 1e-3, True), (limit + 1e-3, False), (3.0, False)):
        last = ShakenBlock(ratio, cycles=40).slides[-2:]
        assert (last[1].begin > last[0].end) == rests
        if not rests:
            phase = math.fmod(2.0 * math.pi * last[1].begin / PERIOD, math.pi)
            assert math.cos(phase) == pytest.approx(0.5 * math.pi / ratio, rel=1e-9)


@pytest.mark.parametrize("ratio", [0.9, 1.4, 3.0])
def test_elastic_solution_solves_its_equation(ratio):
    """s'' = -A sin(w t) - W^2 e, |e| <= r; continuous; and W^2 e s' is stored or lost."""
    exact, h = BlockOnSprings(ShakenBlock(ratio), 1e5), 2e-6
    begins = [phase.begin for phase in exact.phases]
    t = no_event(exact_time(), [*begins, CYCLES * PERIOD], 2 * h)
    before, s, after = (exact.slip(t + shift * h) for shift in (-1, 0, 1))
    _, rate, e = exact._at(t)
    ground = exact.rigid.amplitude * np.sin(exact.rigid.frequency * t)
    # Rounding of the slip over h^2 is some 1e-6.
    found = (after - 2.0 * s + before) / h**2
    assert found == pytest.approx(-ground - exact.stiffness * e, abs=1e-4)
    assert (after - before) / (2.0 * h) == pytest.approx(rate, abs=1e-8)
    assert np.abs(e).max() <= exact.r * (1.0 + 1e-12)
    for last, phase in zip(exact.phases[:-1], exact.phases[1:], strict=True):
        assert np.array(phase[2:]) == pytest.approx(
            np.array(exact._motion(last, phase.begin), dtype=float), rel=1e-9, abs=1e-14
        )


def on_springs(ratio, k_s):
    """The exact solution with the joint of the finite elements."""
    return BlockOnSprings(ShakenBlock(ratio), k_s / (STONE.density * HEIGHT))


@pytest.mark.parametrize(
    ("ratio", "cell", "direction"), [(1.4, "hex", 0.0), (1.8, "hex", 145.0), (3.0, "tet", 35.0)]
)
def test_slip_at_a_stiff_joint(ratio, cell, direction):
    """Of the rigid block, within 2 f dt T/2 for each slide so far; the friction work likewise.

    Before the first slide the points slide one after another, within 2 r.
    """
    steps, exact = 200, ShakenBlock(ratio)
    history, outcome = shake(ratio, steps=steps, cell=cell, direction_deg=direction)
    time, dt = history.time, PERIOD / steps
    each = 2.0 * FRICTION * dt * 0.5 * PERIOD
    begun = np.array([sum(s.begin < t for s in exact.slides) for t in time])
    error = np.abs(history.slip - exact.slip(time))
    assert (error <= begun * each + 2.0 * on_springs(ratio, STIFF).r).all()
    assert np.abs(history.across).max() < 1e-6 * np.abs(history.slip).max()
    slid = history.friction[-1] / (MASS * FRICTION)
    assert slid == pytest.approx(exact.path(time[-1]), abs=begun[-1] * each)
    assert outcome.energy_error < 2e-8
    assert not history.open.any()
    points = history.sliding.max()
    for slide in exact.slides:
        within = (time > slide.begin + 2.0 * dt) & (time < slide.end - 2.0 * dt)
        assert (history.sliding[within] == points).all()
    for last, after in pairwise(exact.slides):
        rest = (time > last.end + 2.0 * dt) & (time < after.begin - 2.0 * dt)
        tremble = history.slip[rest]
        assert len(tremble) == 0 or np.ptp(tremble) < 4.0 * FRICTION * dt**2


@pytest.mark.slow
def test_slip_at_a_stiff_joint_tends_to_the_rigid_one():
    """Order 2 (2.0 found), with scatter: it depends on where in a step a slide ends."""
    steps, exact = (100, 200, 400, 800), ShakenBlock(3.0)
    runs = [shake(3.0, steps=n)[0] for n in steps]
    errors = [np.abs(run.slip - exact.slip(run.time)).max() for run in runs]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 1.6 < order < 3.0
    assert errors[-1] < 5e-3 * np.abs(runs[-1].slip).max()


@pytest.mark.parametrize(
    ("ratio", "steps"),
    [
        (1.8, (100, 200, 400)),
        pytest.param(1.4, (200, 400, 800, 1600), marks=pytest.mark.slow),
        pytest.param(1.8, (200, 400, 800, 1600), marks=pytest.mark.slow),
        pytest.param(3.0, (200, 400, 800, 1600), marks=pytest.mark.slow),
    ],
)
def test_slip_at_a_soft_joint(ratio, steps):
    """Order 2 (1.6 to 2.5 found), with scatter, towards the solution with elastic slip.

    The friction work is mu N times the way slid of that solution.

    The trembling lasts 22 ms: 11 steps of T/100, 44 of T/400. The rigid solution is missed by far.
    """
    exact = on_springs(ratio, SOFT)
    runs = [shake(ratio, steps=n, k_s=SOFT)[0] for n in steps]
    errors = [np.abs(run.slip - exact.slip(run.time)).max() for run in runs]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    last = runs[-1]
    largest = np.abs(last.slip).max()
    work = FRICTION * MASS * exact.path(last.time[-1])
    assert 1.6 < order < 3.0
    assert errors[-1] < 2e-3 * largest
    rigid = np.abs(ShakenBlock(ratio).slip(last.time) - last.slip).max()
    assert rigid > 50.0 * errors[-1]
    assert last.friction[-1] == pytest.approx(work, rel=2e-3)
