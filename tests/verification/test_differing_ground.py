# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports that move differently: a rod between two abutments, and a jointed wall.

The left end of a rod of length L moves by f(t), the right one by f(t - tau) as the wave arrives
there. Without damping and lateral contraction d'Alembert's waves, sent out by each end and
reflected by both, are the solution, a finite sum as f(t <= 0) = 0:

    u(x, t) = sum over k of  f(t - (x + 2 k L)/c) - f(t - (2 (k + 1) L - x)/c)
              + f(t - tau - (L - x + 2 k L)/c) - f(t - tau - ((2 k + 1) L + x)/c).

Its static part is the straight line between the ends.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from boxes import Rows, box, largest
from shaken_wall import DT, POINTS, STEPS, Killed, Killer, shaking, wall

import dolfinx_joints as dj
from dolfinx_joints.common.errors import PlausibilityWarning
from dolfinx_joints.motions.courses import displacement_of

LENGTH, SPEED, TAU = 100.0, 1000.0, 0.05  # m, m/s, s
ROCK = dj.Elastic(young=2.4e9, poisson=0.0, density=2400.0)
PULSE, SIZE, END = 0.1, 0.01, 0.3  # of f: s, m; of the run: s
CLOSED = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=30.0)


def moved(time):
    """f, a pulse sin^4 [m]."""
    return SIZE * np.sin(np.pi * np.clip(time, 0.0, PULSE) / PULSE) ** 4


def record(dt):
    """f as a motion along x, its acceleration sampled."""
    time = dt * np.arange(round(PULSE / dt) + 1)
    w = np.pi / PULSE
    s, c = np.sin(w * time), np.cos(w * time)
    a = np.zeros((len(time), 3))
    a[:, 0] = SIZE * w**2 * (12.0 * s**2 * c**2 - 4.0 * s**4)
    return dj.Motion(acceleration=a, dt=dt, name="pulse")


def exact(x, t):
    """Displacement of the rod [m]."""
    u = np.zeros(np.broadcast(x, t).shape)
    for k in range(int(END * SPEED / LENGTH) + 1):
        far = 2.0 * k * LENGTH
        u += moved(t - (x + far) / SPEED) - moved(t - (2.0 * LENGTH + far - x) / SPEED)
        u += moved(t - TAU - (LENGTH + far - x) / SPEED)
        u -= moved(t - TAU - (LENGTH + far + x) / SPEED)
    return u


def rod(comm, cells, joints=None, **options):
    """A rod between the groups left and right, with a joint in the middle if it has a law."""
    split = {"middle": (0, LENGTH / 2)} if joints else {}
    ends = {"left": (0, 0.0), "right": (0, LENGTH)}
    return dj.Model(
        box([LENGTH, 2.0], [cells, 1], joints=split, groups=ends, comm=comm),
        material=ROCK,
        joints=joints,
        **{"supports": [dj.Fixed(group="left"), dj.Fixed(group="right")], "body": dj.Body(degree=2)}
        | options,
    )


def march(model, motion, steps, end=END, **options):
    """Nodes, times, displacements along the rod at all steps, static parts, and the outcome."""

    def along(u):
        return u.array.reshape(-1, 2)[:, 0].copy()

    def row(record):
        static = record.static_part
        still = along(static(record.time)) if static is not None else ()
        return record.time, along(record.displacement), still

    seen = Rows(row)
    outcome = dj.Simulation(model, monitors=[seen]).dynamics(
        dt=end / steps, steps=steps, motion=motion, **options
    )
    times, total, static = (np.array(column) for column in zip(*seen.rows, strict=True))
    x = model.V.tabulate_dof_coordinates()[: total.shape[1], 0]
    return x, times, total, static, outcome


def passing(dt):
    return dj.DifferingMotion(
        motions=record(dt), passage=dj.Passage(speed=LENGTH / TAU, direction=(3.0, 0.0))
    )


def test_a_rod_between_abutments_that_a_wave_reaches_in_turn(comm):
    """Order 2 of mesh and step together (2.0 found), static part apart; the ledger closes."""
    errors = []
    for cells, steps in ((20, 120), (40, 240)):
        dt = END / steps
        x, t, total, static, outcome = march(rod(comm, cells), passing(dt / 4), steps)
        ground, late = moved(t)[:, None], moved(t - TAU)[:, None]
        errors.append(largest(total + ground - exact(x, t[:, None])) / SIZE)
        line = ground + (late - ground) * x / LENGTH
        # Of f the record knows the accelerations at every quarter of a step, linear in between.
        assert largest(static + ground - line) < 2e-4 * SIZE
        assert outcome.imbalance < 1e-11
        assert outcome.energy_error < 1e-11
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2
    assert errors[1] < 0.02


def test_a_long_dam_above_a_wave_that_passes(comm):
    """Against waves that go along with the ground: order 2 in time; the static part 3 in space."""
    long_dam = pytest.importorskip("validation.exact.long_dam")
    errors = []
    for cells, steps in ((3, 60), (6, 120)):
        found = long_dam.march(comm, cells, steps)
        alone = np.array([long_dam.away_from_ends(found.x, t) for t in found.times])
        exact = np.array([long_dam.whole(found.x, found.z, t) for t in found.times])
        crest = np.isclose(found.z, long_dam.HEIGHT)
        still = np.array([long_dam.static(found.x[crest], t) for t in found.times])
        apart = found.whole[alone] - exact[alone], found.static[:, crest] - still
        errors.append([largest(each) for each in apart])
    orders = np.log2(np.divide(*errors))
    assert 1.7 < orders[0] < 2.3
    assert orders[1] > 2.8
    np.testing.assert_array_less(errors[1], [0.03, 2e-5])


@pytest.mark.parametrize(
    "scheme", [dj.EnergyConsistent(), dj.Newmark(), dj.HilberHughesTaylor(alpha=0.1)]
)
def test_equal_motions_are_a_uniform_one(comm, scheme):
    """To rounding, and without any static part: groups, stations and a wave that meets all."""
    motion = record(END / 240)
    plain = march(rod(comm, 8, CLOSED), motion, 60, scheme=scheme)[2]
    places = {"one": (0.0, 0.0), "two": (LENGTH, 1.0)}
    for differing in (
        dj.DifferingMotion(motions={"left": motion, "right": motion}),
        dj.DifferingMotion(motions=dict.fromkeys(places, motion), positions=places),
        dj.DifferingMotion(motions=motion, passage=dj.Passage(speed=1e30, direction=(1.0, 0.0))),
    ):
        _, _, total, static, _ = march(rod(comm, 8, CLOSED), differing, 60, scheme=scheme)
        assert largest(total - plain) < 1e-12 * largest(plain)
        assert largest(static) < 1e-12 * SIZE


def absolute(motion):
    """Ground that moves everywhere alike, seen from ground that rests."""
    rest = dj.Motion(acceleration=np.zeros_like(motion.acceleration), dt=motion.dt, name="rest")
    places = {"rest": (-LENGTH, 0.0), "start": (0.0, 0.0), "end": (LENGTH, 0.0)}
    motions = {"rest": rest, "start": motion, "end": motion}
    return dj.DifferingMotion(motions=motions, positions=places)


def drag(u, v):
    """A damping form that resists translations as well [N s/m]."""
    return 2e4 * ufl.inner(u, v) * ufl.dx


# Every kind of damping that a model takes, some 5 to 15 % of the lowest modes.
DAMPINGS = {
    "none": {},
    "stiffness": {"damping": dj.stiffness_proportional(ratio=0.05, frequency=5.0)},
    "mass": {"damping": dj.mass_proportional(ratio=0.1, frequency=3.0)},
    "Rayleigh": {"damping": dj.rayleigh(ratio=0.05, frequencies=(2.0, 10.0))},
    "modes": {"damping": dj.ModalRatios(ratio=0.1, modes=3)},
    "modes and mass": {
        "damping": dj.ModalRatios(ratio=0.15, modes=2, beyond=dj.Rayleigh(mass_factor=0.3))
    },
    "form": {"body": dj.Body(degree=2, extra_damping=drag)},
}


LAWS = {
    "closed": CLOSED,
    "rigid": dj.RigidJoint(friction_angle_deg=30.0),
    "frictionless": dj.frictionless(normal_stiffness=1e10),
}


CASES = [(damping, "closed") for damping in DAMPINGS]
CASES += [("mass", "rigid"), ("mass", "frictionless")]


@pytest.mark.parametrize(("damping", "law"), CASES)
@pytest.mark.filterwarnings("ignore:The motions of rest, start, end")
def test_absolute_displacements_are_those_relative_to_the_ground_and_its_own(comm, damping, law):
    """Under a constant acceleration, which steps integrate exactly, to rounding.

    Under any other to the order of the steps, 2: loads take an acceleration at their ends.
    """
    constant = dj.Motion(acceleration=np.tile([2.0, 0.0, 0.0], (2, 1)), dt=END)
    model = rod(comm, 8, LAWS[law], **DAMPINGS[damping])
    _, t, relative, _, _ = march(model, constant, 60)
    total, static = march(model, absolute(constant), 60)[2:4]
    ground = t[:, None] ** 2  # 2 t^2 / 2
    assert largest(total - ground - relative) < 1e-12 * largest(ground)
    assert largest(static - ground) < 1e-9 * largest(ground)  # K of 1e10 N/m solved
    apart = []
    for steps in (60, 120):
        motion = record(END / steps)
        _, t, relative, _, _ = march(model, motion, steps)
        total = march(model, absolute(motion), steps)[2]
        apart.append(largest(total - moved(t)[:, None] - relative))
    assert 1.8 < np.log2(apart[0] / apart[1]) < 2.2


def leaning(comm, **options):
    """A plane wall, 60 m long and 40 m high, on a base."""
    jointed = box([60.0, 40.0], [6, 4], groups={"base": (1, 0.0)}, comm=comm)
    soft = dj.Elastic(young=5e8, poisson=0.2, density=2400.0)
    return dj.Model(jointed, material=soft, supports=[dj.Fixed(group="base")], **options)


def moved_ground(reference, dt, share):
    """A pulse of the left end of the base along x and z, and a share of it of the right end.

    Stations are both ends and a place far to the left that rests.
    """
    time = np.arange(round(0.6 / dt) + 1) * dt
    path = np.zeros((len(time), 3))
    path[:, 0] = 0.05 * np.sin(np.pi * time / 0.6) ** 4
    path[:, 2] = 0.5 * path[:, 0]
    return dj.DifferingMotion(
        motions={
            "rest": dj.motion_from_displacement(0.0 * path, dt=dt),
            "left": dj.motion_from_displacement(path, dt=dt),
            "right": dj.motion_from_displacement(share * path, dt=dt),
        },
        positions={"rest": (-500.0, 0.0), "left": (0.0, 0.0), "right": (60.0, 0.0)},
        reference=reference,
    )


def shaken_wall(model, motion, reference, steps, scheme=None):
    """Displacements of the wall's nodes with those of the reference, (steps + 1, nodes, 2)."""
    ground = displacement_of(reference)
    seen = Rows(
        lambda record: (
            record.displacement.array.reshape(-1, 2) + ground(np.array([record.time]))[0, [0, 2]]
        )
    )
    outcome = dj.Simulation(model, monitors=[seen]).dynamics(
        dt=1.2 / steps, steps=steps, motion=motion, scheme=scheme
    )
    if outcome.imbalance is not None:
        assert outcome.imbalance < 1e-11
        assert outcome.energy_error < 1e-11
    return np.array(seen.rows)


SCHEMES = [
    dj.EnergyConsistent(),
    dj.EnergyConsistent(exact_modes=4),
    dj.Newmark(),
    dj.HilberHughesTaylor(alpha=0.3),
    dj.GeneralizedAlpha(spectral_radius=0.5),
]
RUNS = [(d, SCHEMES[0]) for d in DAMPINGS] + [("modes and mass", s) for s in SCHEMES[1:]]


@pytest.mark.parametrize(("damping", "scheme"), RUNS)
def test_the_response_does_not_depend_on_the_reference(comm, damping, scheme):
    """Every damping, along and up: the absolute motion differs by the order of the scheme, 2.

    A uniform motion as one that differs, relative to a station that moves or one that rests,
    against the plain uniform one; and ground that differs, relative to each of three stations.
    """
    model = leaning(comm, **DAMPINGS[damping])
    for share in (1.0, 0.6):
        apart = []
        for steps in (60, 120):
            grounds = {
                name: moved_ground(name, 0.3 / steps, share) for name in ("left", "right", "rest")
            }
            own = {name: ground.named[name] for name, ground in grounds.items()}
            seen = {
                name: shaken_wall(model, ground, own[name], steps, scheme)
                for name, ground in grounds.items()
            }
            if share == 1.0:
                plain = shaken_wall(model, own["left"], own["left"], steps, scheme)
                scale = largest(plain)
                # Relative to a ground that moves alike nothing is left but rounding.
                assert largest(seen["left"] - plain) < 1e-11 * scale
                assert largest(seen["right"] - plain) < 1e-11 * scale
            pairs = [("left", "rest")] if share == 1.0 else [("left", "right"), ("left", "rest")]
            apart.append(
                [
                    [largest((seen[one] - seen[other])[:, :, axis]) for axis in range(2)]
                    for one, other in pairs
                ]
            )
        orders = np.log2(np.divide(*apart))
        assert (orders > 1.8).all(), orders
        assert (orders < 2.2).all(), orders
        assert np.max(apart[1]) < 0.01 * largest(seen["left"])


def apart(distance, dt, end):
    """Abutments of which the right one moves by a distance, smoothly over the time [m]."""
    share = np.linspace(0.0, 1.0, round(end / dt) + 1)
    path = np.zeros((len(share), 3))
    path[:, 0] = distance * (share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi))
    right = dj.motion_from_displacement(path, dt=dt)
    left = dj.Motion(acceleration=np.zeros((2, 3)), dt=dt)
    return dj.DifferingMotion(motions={"left": left, "right": right})


@pytest.mark.mpi
def test_abutments_open_a_joint_and_close_it(comm):
    """Apart by 1 cm slowly: the joint opens by that. Together: a bar and a joint in series."""
    damping = dj.stiffness_proportional(ratio=0.3, frequency=5.0)
    for distance in (0.01, -0.01):
        model = rod(comm, 8, CLOSED, damping=damping)
        # Not slower: K u of halves that move 1 cm is rounding, to be small beside their energy.
        outcome = dj.Simulation(model).dynamics(
            dt=0.02, steps=80, motion=apart(distance, 0.02, 1.6)
        )
        joints = outcome.state.joints
        opening = np.full(len(joints.state.gap), max(distance, 0.0))
        stiffness = 1.0 / (LENGTH / ROCK.young + 1.0 / CLOSED.normal_stiffness)
        traction = np.full(len(opening), stiffness * min(distance, 0.0))
        if distance < 0.0:
            opening += traction / CLOSED.normal_stiffness
        # The halves, with periods of 0.2 s, follow what takes 1.6 s but for some (0.2/1.6)^3.
        assert largest(joints.state.gap[:, 0] - opening) < 1e-3 * abs(distance)
        assert largest(joints.traction[:, 0] - traction) < 1e-3 * stiffness * abs(distance)
        assert outcome.imbalance < 1e-11


def stations():
    """Two stations below the ends of the wall, and a wave that passes it obliquely."""
    time = DT / 2 * np.arange(2 * STEPS + 1)
    sampled = np.array([shaking(t) for t in time])
    return dj.DifferingMotion(
        motions={
            "left": dj.Motion(acceleration=sampled, dt=DT / 2),
            "right": dj.Motion(acceleration=0.6 * sampled, dt=DT / 2),
        },
        positions={"left": (0.0, 0.0, 0.0), "right": (20.0, 0.0, 0.0)},
        passage=dj.Passage(speed=800.0, direction=(1.0, 0.5, 0.0)),
        reference="right",
    )


def shaken(jointed, path, *, kill=None, checkpoint=None):
    """A wall on a base that stations and a wave move, its joints opening and sliding."""
    monitors = [dj.ResultsMonitor(path, points=POINTS, every=3, static_part=True), Killer(kill)]
    beyond = dj.rayleigh(ratio=0.02, frequencies=(5.0, 40.0))
    model = wall(jointed, damping=dj.ModalRatios(ratio=0.05, modes=2, beyond=beyond))
    simulation = dj.Simulation(model, monitors=monitors)
    if checkpoint is None or not checkpoint.resume:
        simulation.statics()
    return simulation.dynamics(dt=DT, steps=STEPS, motion=stations(), checkpoint=checkpoint)


NAMES = ("displacement", "static_displacement", "acceleration", "joint_slip", "reaction/base")


def histories(path):
    with dj.Results(path) as results:
        return [results.series("histories", name) for name in NAMES]


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:The motions of left, right end")
def test_a_jointed_wall_on_any_number_of_ranks(comm, wall_file, read, new_path):
    """The same as on one rank, continued from a checkpoint as well; the ledger closes.

    On one rank the run goes on to the last bit. MUMPS on several sums in the order in which what
    ranks tell each other comes in.
    """
    path, file = new_path("differing"), wall_file()
    if comm.rank == 0:
        path.mkdir()
    comm.barrier()
    outcome = shaken(read(file), path / "whole.h5")
    assert outcome.imbalance < 1e-11
    assert outcome.energy_error < 1e-11
    assert outcome.energy.joint_friction.sum() > 0.0
    kept = dj.Checkpoints(path / "run.ckpt", every=4)
    with pytest.raises(Killed):
        shaken(read(file), path / "resumed.h5", kill=7, checkpoint=kept)
    shaken(read(file), path / "resumed.h5", checkpoint=replace(kept, resume=True))
    comm.barrier()
    if comm.rank == 0:
        shaken(read(file, MPI.COMM_SELF), path / "alone.h5")
        whole = histories(path / "whole.h5")
        for name, expected, again, alone in zip(
            NAMES, whole, histories(path / "resumed.h5"), histories(path / "alone.h5"), strict=True
        ):
            scale = np.abs(expected).max()
            assert scale > 0.0
            rounding = 0.0 if comm.size == 1 else 1e-12 * scale
            np.testing.assert_allclose(again, expected, rtol=0, atol=rounding, err_msg=name)
            np.testing.assert_allclose(alone, expected, rtol=0, atol=1e-9 * scale, err_msg=name)
    comm.barrier()


@pytest.mark.parametrize("rebounds", [True, False])
def test_a_rigid_joint_down_to_ground_that_differs(wall_file, read, rebounds):
    """Where the ground holds both faces, its rounding is no force: nothing can give way there."""
    law = dj.RigidJoint(friction_angle_deg=30.0, restitution=int(rebounds))
    damping = dj.rayleigh(ratio=0.02, frequencies=(5.0, 40.0))
    model = wall(read(wall_file(divisions=(4, 1, 2), joints=1)), law, damping=damping)
    record = dj.synthetic_motion(duration=2.0)
    ground = dj.DifferingMotion(
        motions={"left": record, "right": record.scaled(0.9)},
        positions={"left": (0.0, 0.0, 0.0), "right": (20.0, 0.0, 0.0)},
        reference="left",
    )
    simulation = dj.Simulation(model)
    simulation.statics()
    outcome = simulation.dynamics(dt=0.01, steps=40, motion=ground)
    assert outcome.counts.rejected == 0
    assert outcome.imbalance <= 1e-11


@pytest.mark.mpi
def test_what_cannot_move_is_an_error(comm):
    motion = record(0.01)
    for motions, message in (
        ({"left": motion, "rihgt": motion}, "rihgt"),
        ({"left": motion}, r"nodes with supports are in no group, such as the node at \(100, "),
    ):
        with pytest.raises(dj.MeshError, match=message):
            march(rod(comm, 4), dj.DifferingMotion(motions=motions), 1)
    stood = [dj.Fixed(group="left"), dj.Spring(group="right", normal_stiffness=1e9)]
    with pytest.raises(ValueError, match="also has ground springs or viscous boundaries"):
        march(rod(comm, 4, supports=stood), passing(0.01), 1)


def test_a_run_goes_on_where_its_ground_is(comm):
    """In two stages as in one; not on other ground, where the supports would jump."""
    dt, motion = END / 60, passing(END / 240)
    simulation = dj.Simulation(rod(comm, 8))
    whole = simulation.dynamics(dt=dt, steps=30, motion=motion).state.displacement
    half = simulation.dynamics(dt=dt, steps=10, motion=motion).state
    rest = simulation.dynamics(dt=dt, steps=20, motion=motion, start=half).state.displacement
    # The first velocities of supports are differences once more: 1e-4 found, of second order.
    assert largest(rest.array - whole.array) < 1e-3 * largest(whole.array)
    with pytest.raises(ValueError, match="displacements of the supports at t = 0.05 s differ"):
        simulation.dynamics(dt=dt, steps=1, start=half)


def test_prescribed_displacements_are_relative_to_their_ground(comm):
    """A rod pulled by its right end while the ground passes: the sum of both answers."""
    pulled = [
        dj.Fixed(group="left"),
        dj.Prescribed(group="right", component="x", value=moved),
        dj.Fixed(group="right", components="y"),
    ]
    model = rod(comm, 8, supports=pulled)
    alone = march(model, None, 60)[2]
    ground = march(rod(comm, 8), passing(END / 240), 60)[2]
    both = march(model, passing(END / 240), 60)[2]
    assert largest(both - alone - ground) < 1e-11 * SIZE


def test_ground_that_drifts_apart_is_warned_of():
    with pytest.warns(PlausibilityWarning, match=r"differ by up to 2 m/s, .* correct their base"):
        dj.DifferingMotion(
            motions={
                "left": dj.Motion(acceleration=np.zeros((2, 3)), dt=1.0),
                "right": dj.Motion(acceleration=np.tile([2.0, 0.0, 0.0], (2, 1)), dt=1.0),
            }
        )
