# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks that own nothing: meshes with fewer cells than ranks, joints that most ranks do not see.

Every number is compared with that of the same model on one rank. Expected differences are those of
rounding, in sums over other parts; the bound is 1e-10 of the largest entry.

    pair   two cells with a joint between them, so that of four ranks two have no cell
    strip  twelve cells in a row with a joint behind the first one, shared by two ranks at most
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from mpi4py import MPI

from shaken_wall import Killed, Killer, shaking

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.mesh.dolfinx_versions import geometry_nodes
from dolfinx_joints.mesh.node_numbering import NodeNumbering

COMM = MPI.COMM_WORLD
pytestmark = [
    pytest.mark.mpi,
    pytest.mark.slow,
    pytest.mark.skipif(COMM.size < 3, reason="on one and two ranks each has a cell"),
]

TOLERANCE = 1e-10
CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
STIFF = {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 30.0}
LAW = dj.FrictionNoTension(**STIFF)
POINTS = {"crest": (0.0, 4.0, 20.0), "end": (20.0, 0.0, 20.0)}
STEPS, DT = 12, 4e-3
NEWTON = dj.SolverOptions(relative_tolerance=1e-13)
# Of the wall on its base, to judge what is zero but for rounding by.
PRESSURE = 20.0 * CONCRETE.density * STANDARD_GRAVITY
WEIGHT = 20.0 * 4.0 * PRESSURE
# Divisions and number of joints of a wall of 20 m x 4 m x 20 m; the first joint alone is split.
MESHES = {"pair": ((2, 1, 1), 1), "strip": ((12, 1, 1), 11)}


@pytest.fixture(params=MESHES)
def jointed(request, wall_file, read):
    """``jointed(comm)``: the mesh on all ranks or on one."""
    divisions, joints = MESHES[request.param]
    path = wall_file(divisions=divisions, joints=joints)
    return lambda comm: read(path, comm, ["joint_1"])


def winter(jointed):
    """A body that is colder at its back than at its front."""
    given = dj.steady_temperature(jointed, {"y_min": 4.0, "y_max": 12.0})
    return dj.Temperature(value=given, reference=10.0, expansion=1e-5)


WATER = {"level": 16.0}
FLOWING = dj.DruckerPrager(
    elastic=CONCRETE, cohesion=2e5, friction_angle_deg=30.0, dilatancy_angle_deg=5.0
)
GROUND = {
    "supports": lambda: [
        *(dj.ViscousBoundary(group=g) for g in ("base", "x_min", "x_max")),
        dj.Spring(group="base", normal_stiffness=1e9, tangential_stiffness=1e9),
    ]
}
# What is added to the plain model: options of the model, which may ask for the mesh.
MODELS = {
    "plain": {},
    "water": {
        "loads": lambda jointed: [
            dj.HydrostaticPressure(group="y_min", **WATER),
            dj.SiltPressure(group="y_min", level=5.0, density=900.0, coefficient=0.5),
            dj.JointWater(joint="joint_1", reached_from="y_min", **WATER),
        ],
        "water": lambda jointed: dj.WestergaardMass(group="y_min", **WATER),
    },
    "uplift": {"loads": lambda jointed: [dj.Uplift(joint="joint_1", pressure=5e4)]},
    "reservoir": {
        "water": lambda jointed: dj.ReservoirMass(group="y_min", **WATER),
    },
    "temperature": {"loads": lambda jointed: [winter(jointed)]},
    "rigid": {"joints": lambda jointed: dj.RigidJoint(friction_angle_deg=30.0)},
    "stops": {"joints": lambda jointed: dj.RigidJoint(friction_angle_deg=30.0, restitution=0)},
    "bonded": {
        "joints": lambda jointed: dj.MohrCoulombJoint(
            **STIFF, cohesion=1e5, tensile_strength=5e4, dilatancy_angle_deg=5.0
        ),
    },
    "plastic": {"material": lambda jointed: FLOWING},
    "quadratic": {
        "body": lambda jointed: dj.Body(degree=2),
        "joints": lambda jointed: dj.Joints(LAW, quadrature=4),
    },
    "dashpots": {"supports": lambda jointed: GROUND["supports"]()},
}


def model_of(jointed, kind="plain"):
    options = {name: make(jointed) for name, make in MODELS[kind].items()}
    given = {
        "material": CONCRETE,
        "joints": LAW,
        "supports": [dj.Fixed(group="base")],
        "damping": dj.stiffness_proportional(ratio=0.02, frequency=5.0),
        **options,
        "loads": [dj.Gravity(), *options.get("loads", [])],
    }
    return dj.Model(jointed, **given)


def agree(found, expected, name="", scale=0.0):
    """Fail unless arrays are equal but for rounding, seen from their largest entry or a scale."""
    scale = np.nanmax(np.abs(expected), initial=scale)  # directions that a node lacks are NaN
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * scale, err_msg=name)


def of_all(model, state):
    """Nodal displacements, gaps, tractions and states of a body, whole on each rank."""
    comm, operator = model.jointed.mesh.comm, model.operator
    joints = state.joints
    whole = {
        "displacement": NodeNumbering(model.V).gather(state.displacement),
        "gap": operator.gather(joints.state.gap[:, :3]),
        "traction": operator.gather(joints.traction),
        "status": operator.gather(joints.status.astype(float)),
    }
    return comm.bcast(whole, root=0)


def same_states(found, expected):
    scales = {"gap": np.abs(expected["displacement"]).max(), "traction": PRESSURE}
    for name, value in expected.items():
        agree(found[name], value, name, scales.get(name, 0.0))


def same_files(path, alone):
    """Compare results files, each rank that of its own run on one rank."""
    with dj.Results(path) as results, dj.Results(alone) as other:
        assert results.complete
        assert results.statics == other.statics
        for name in other.statics:
            agree(results.static(name), other.static(name), name)
        assert results.streams == other.streams
        scales = {
            "m": np.abs(other.series("states", "displacement")).max(),
            "J": np.abs(other.series("energy", "input")).max(),
            "Pa": PRESSURE,
            "N": WEIGHT,
            "N m": 20.0 * WEIGHT,
        }
        for stream, names in other.streams.items():
            np.testing.assert_array_equal(results.time(stream), other.time(stream))
            for name in names:
                if name == "iterations":  # a point that slides is on the cone but for the last bit
                    continue
                found, expected = (r.series(stream, name) for r in (results, other))
                scale = scales.get(other.unit(stream, name), 0.0)
                agree(found, expected, f"{stream}/{name}", scale)


def run(jointed, comm, path, *, kind="plain", envelopes=True, more=(), **options):
    """Self weight and a few steps, with everything that a results file can hold."""
    model = model_of(jointed(comm), kind)
    results = dj.ResultsMonitor(path, points=POINTS, every=3, envelopes=envelopes, resultants=True)
    simulation = dj.Simulation(model, monitors=[results, *more], options=NEWTON)
    if "checkpoint" not in options or not options["checkpoint"].resume:
        simulation.statics(steps=2)
    return simulation.dynamics(dt=DT, steps=STEPS, motion=shaking, **options)


def alone(new_path):
    """A path for each rank's own run."""
    return new_path("alone").with_suffix(f".{COMM.rank}.h5")


def test_some_ranks_have_nothing_of_a_joint(jointed):
    """What the meshes are for, so that they do not lose it."""
    here = jointed(COMM)
    cells = here.mesh.topology.index_map(3)
    x = here.mesh.geometry.x[geometry_nodes(here.mesh)[: cells.size_local], 0]
    joint = 20.0 / (2 if cells.size_global == 2 else 12)
    sees = COMM.allgather(bool(np.isclose(x, joint).any()))
    assert any(sees)
    assert not all(sees)
    if cells.size_global == 2:
        assert 0 in COMM.allgather(cells.size_local)


@pytest.mark.parametrize("solver", ["condensed", "monolithic", "forms"])
@pytest.mark.parametrize("kind", MODELS)
def test_statics(jointed, kind, solver):
    if kind in ("bonded", "plastic") and solver == "condensed":
        pytest.skip("these laws have the monolithic solver alone")
    if kind in ("rigid", "stops") and solver != "condensed":
        pytest.skip("rigid joints have the condensed solver alone")

    def found(comm):
        simulation = dj.Simulation(model_of(jointed(comm), kind), solver=solver, options=NEWTON)
        return of_all(simulation.model, simulation.statics(steps=2))

    same_states(found(COMM), found(MPI.COMM_SELF))


@pytest.mark.parametrize("linear", ["direct", "mumps", "iterative"])
def test_linear_solvers(jointed, linear):
    def found(comm):
        newton = replace(NEWTON, linear=linear)
        simulation = dj.Simulation(model_of(jointed(comm)), options=newton)
        simulation.statics()
        end = simulation.dynamics(dt=DT, steps=3, motion=shaking)
        return of_all(simulation.model, end.state)

    same_states(found(COMM), found(MPI.COMM_SELF))


@pytest.mark.parametrize("kind", MODELS)
def test_results(jointed, kind, new_path):
    """Histories, energies, states, envelopes, resultants."""
    path, own = new_path("together.h5"), alone(new_path)
    for comm, file in ((COMM, path), (MPI.COMM_SELF, own)):
        run(jointed, comm, file, kind=kind, envelopes=kind != "plastic")
    COMM.barrier()
    same_files(path, own)


@pytest.mark.parametrize(
    "options",
    [
        {"scheme": dj.Newmark()},
        {"scheme": dj.ImplicitContact()},
        {"control": dj.StepControl(max_halvings=3, tolerance=2e-4)},
    ],
    ids=["Newmark", "implicit contact", "steps cut"],
)
def test_schemes(jointed, options, new_path):
    path, own = new_path("together.h5"), alone(new_path)
    outcomes = [run(jointed, *where, **options) for where in ((COMM, path), (MPI.COMM_SELF, own))]
    COMM.barrier()
    same_files(path, own)
    assert outcomes[0].counts == outcomes[1].counts
    assert ("control" in options) == (outcomes[0].counts.accepted > STEPS)


@pytest.mark.parametrize("kind", ["plain", "water", "rigid", "stops", "bonded"])
@pytest.mark.parametrize("first", ["all", "one"])
def test_checkpoints(jointed, kind, first, new_path):
    """Begun by all ranks or by one, gone on with by all."""
    path, kept, own = new_path("run.h5"), new_path("run.ckpt"), alone(new_path)
    run(jointed, MPI.COMM_SELF, own, kind=kind, more=[Killer(None)])
    begun = COMM if first == "all" else MPI.COMM_SELF
    checkpoint = dj.Checkpoints(kept, every=4)
    if first == "all" or COMM.rank == 0:
        with pytest.raises(Killed):
            run(jointed, begun, path, kind=kind, more=[Killer(7)], checkpoint=checkpoint)
    COMM.barrier()
    checkpoint = replace(checkpoint, resume=True)
    run(jointed, COMM, path, kind=kind, more=[Killer(None)], checkpoint=checkpoint)
    COMM.barrier()
    same_files(path, own)


def test_construction_and_saved_states(jointed, new_path):
    """Blocks that stand alone, grouted, saved by all ranks and taken up by each one."""
    weight = dj.Gravity()

    def simulation(comm):
        cold = winter(jointed(comm))
        model = dj.Model(
            jointed(comm),
            material=CONCRETE,
            joints=LAW,
            supports=[dj.Fixed(group="base")],
            loads=[weight, cold],
        )
        return dj.Simulation(model, options=NEWTON)

    together, mine = simulation(COMM), simulation(MPI.COMM_SELF)
    for each in (together, mine):
        each.statics(joints="inactive", loads=[weight])
        each.grout()
    path = new_path("grouted.static")
    together.save_static(path)
    COMM.barrier()
    again = simulation(MPI.COMM_SELF)
    again.load_static(path)
    ends = [of_all(each.model, each.statics(steps=2)) for each in (together, mine, again)]
    same_states(ends[0], ends[1])
    same_states(ends[2], ends[1])


def test_modes(jointed, new_path):
    """Frequencies, effective masses, damping ratios; the file is written."""
    path = new_path("modes.h5")

    def found(comm):
        model = model_of(jointed(comm), "water")
        modes = dj.modes(model.system(), 4)
        damped = dj.modal_damping(model.system(), modes)
        if comm.size > 1:
            dj.write_modes(modes, model, path)
        return modes.frequencies, modes.effective_mass, damped.ratios

    together, own = found(COMM), found(MPI.COMM_SELF)
    for name, one, other in zip(("f", "masses", "ratios"), together, own, strict=True):
        agree(np.array(one), np.array(other), name)
    COMM.barrier()
    with dj.Results(path) as results:
        assert results.complete


def test_waves_from_below(jointed, new_path):
    """Weight on supports, their forces kept, then dashpots and a rising wave."""

    def incident(time):
        return 0.2 * np.sin(2 * np.pi * np.array([5.0, 4.0, 3.0]) * time)

    def found(comm):
        free = dj.Model(
            jointed(comm),
            material=CONCRETE,
            joints=LAW,
            supports=[dj.ViscousBoundary(group="base")],
            loads=[dj.Gravity()],
        )
        simulation = dj.Simulation(free, options=NEWTON)
        simulation.statics()
        waves = dj.FreeField(groups=["base"], incident=incident, surface=20.0)
        end = simulation.dynamics(dt=DT, steps=STEPS, loads=[waves])
        assert end.imbalance < 1e-9
        return of_all(free, end.state)

    same_states(found(COMM), found(MPI.COMM_SELF))


def test_fields_progress_and_resultants(jointed, new_path):
    """What else watches a run; forces on joints and blocks are the same on all ranks."""
    path = new_path("fields.vtkhdf")

    def found(comm, monitors):
        simulation = dj.Simulation(model_of(jointed(comm)), monitors=monitors, options=NEWTON)
        state = simulation.statics()
        simulation.dynamics(dt=DT, steps=3, motion=shaking)
        force = dj.JointForces(simulation.model)(state.joints)["joint_1"]
        return np.array([force.normal_force, force.shear_force])

    together = found(COMM, [dj.FieldMonitor(path, every=1), dj.ProgressMonitor()])
    agree(together, found(MPI.COMM_SELF, []))
    assert path.is_file()
