# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages in results files and for ParaView: a column with a level joint at half its height.

Without lateral strain (Poisson's ratio 0, sides held) each quantity has a closed form, to which
linear elements are exact at their nodes.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from shaken_wall import Killed, Killer
from vtk_files import on_root, read_vtk
from whole_vectors import all_of

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.joint_rows import JointRows

pytestmark = pytest.mark.mpi

E, RHO, HEIGHT, SIZE, AREA = 20e9, 2400.0, 2.0, 0.5, 1.0
STIFFNESS, EXPANSION, COLD, PORE, PRESS = 1e11, 1e-5, -10.0, 1e4, 3e4
CONCRETE = dj.Elastic(young=E, poisson=0.0, density=RHO)
LAW = dj.FrictionNoTension(
    normal_stiffness=STIFFNESS, shear_stiffness=STIFFNESS, friction_angle_deg=45.0
)
GAMMA = RHO * STANDARD_GRAVITY
ABOVE = GAMMA * AREA * HEIGHT / 2  # weight above the joint
SETTLEMENT = GAMMA * HEIGHT**2 / (2 * E) + ABOVE / AREA / STIFFNESS
POINTS = {"top": (0.5, 0.5, 2.0), "base": (0.5, 0.5, 0.0)}
WEIGHT = dj.Gravity()
PORES = dj.Uplift(joint="joint_1", pressure=PORE)
WINTER = dj.Temperature(value=COLD, reference=0.0, expansion=EXPANSION)
ROOF = dj.Pressure(group="top", value=PRESS, factor=lambda t: t)


@pytest.fixture
def column(blocks_file, read):
    """The column; another on each call, on the same mesh."""
    path = blocks_file(angle=0.0, size=SIZE)

    def make():
        held = [dj.Fixed(group="base"), dj.Fixed(group="sides", components="xy")]
        loads = [WEIGHT, PORES, WINTER, ROOF]
        return dj.Model(read(path), material=CONCRETE, joints=LAW, supports=held, loads=loads)

    return make


def history(simulation):
    """Weight, water in the joint, grout, winter, and a load on top that comes in time; states."""
    return [
        simulation.statics(loads=[WEIGHT], name="weight"),
        simulation.statics(loads=[WEIGHT, PORES]),
        simulation.grout(name="grout"),
        simulation.statics(name="winter"),
        simulation.quasi_statics([0.5, 1.0], name="roof"),
        simulation.quasi_statics([0.0]),
    ]


NAMES = ["weight", "statics 1", "grout", "winter"]
NAMES += ["roof, t = 0.5 s", "roof, t = 1 s", "quasi-statics 1"]
# Loads by the names of the energies.
WITH_WATER = "Gravity, Uplift_joint_1"
ACTING = ["Gravity", WITH_WATER, WITH_WATER]
ACTING += 4 * [f"{WITH_WATER}, Temperature, Pressure_top"]


def test_stages_of_a_column(comm, column, new_path):
    """By hand, and against the states returned, in files with dynamics and without."""
    path, model = new_path("column.h5"), column()
    monitor = dj.ResultsMonitor(path, points=POINTS, envelopes=["sides"], resultants=True)
    simulation = dj.Simulation(model, monitors=[monitor])
    states = history(simulation)
    comm.barrier()
    with dj.Results(path) as results:
        assert (results.status, results.metadata["stage"]) == ("complete", "static")
        alone = check(comm, model, results, states)
    wet = simulation.stages[1]
    forces = dj.JointForces(model)(wet.state.joints, wet.pressure)["joint_1"]
    np.testing.assert_allclose(forces.water_force, (0.0, 0.0, PORE * AREA), atol=1e-9 * PORE)
    simulation.dynamics(dt=1e-3, steps=2)
    with dj.Results(path) as results:
        assert results.rows("histories") == 3
        both = check(comm, model, results, states)
        # Dynamics start where the stages ended.
        np.testing.assert_array_equal(
            results.series("states", "displacement", 0),
            results.series("statics", "displacement")[-1],
        )
    assert str(alone) == str(both)


def check(comm, model, results, states):
    """Compare the stages of a file; return them."""
    assert results.stage_names == NAMES
    assert results.metadata["manifest"]["static_stages"] == dict(zip(NAMES, ACTING, strict=True))
    stages = dj.measures.static_stages(results)
    weight, wet, grout, winter, half, full, last = stages
    for stage, pores, cold, roof in (
        (weight, 0.0, 0.0, 0.0),
        (wet, PORE, 0.0, 0.0),
        (grout, PORE, 0.0, 0.0),
        (winter, PORE, COLD, 0.0),
        (half, PORE, COLD, 0.5 * PRESS),
        (full, PORE, COLD, PRESS),
        (last, PORE, COLD, 0.0),
    ):
        joint = stage.joints["joint_1"]
        # The joint bears all that is above it, the water's part with the rest.
        assert joint.normal_force == pytest.approx(ABOVE + (roof - pores) * AREA)
        assert joint.water_force == pytest.approx(pores * AREA)
        assert joint.pressure_max == pytest.approx(ABOVE / AREA + roof - pores)
        assert joint.contact == pytest.approx(1.0)
        down = SETTLEMENT + roof * HEIGHT / E + (roof - pores) / STIFFNESS
        down -= EXPANSION * cold * HEIGHT
        np.testing.assert_allclose(stage.displacement["top"], [0.0, 0.0, -down], atol=1e-9 * down)
        np.testing.assert_array_equal(stage.displacement["base"], 0.0)
        lift = stage.reaction["base"][2]
        assert lift == pytest.approx(GAMMA * AREA * HEIGHT + roof * AREA)
        # Sides that cannot shrink are stretched; the lowest cell bears the mean weight on it.
        clamped = -E * EXPANSION * cold
        assert stage.stresses["principal_max"] == pytest.approx(clamped, abs=1e-6 * GAMMA)
        pressed = -GAMMA * (HEIGHT - SIZE / 2) - roof
        assert stage.stresses["principal_min"] == pytest.approx(pressed)
        assert stage.stresses["cantilever_min"] == pytest.approx(pressed)
    assert [s.load_time for s in stages] == [0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0]
    nodes = NodeNumbering(model.V)
    rows = JointRows(model.operator)
    for name, state in zip([*NAMES[:4], *NAMES[5:]], states, strict=True):
        number = results.stage_index(name)
        u = comm.bcast(nodes.gather(state.displacement))
        np.testing.assert_array_equal(results.series("statics", "displacement", number), u)
        response = state.joints
        arrays = {"gap": response.state.gap, "traction": response.traction}
        for what, local in (arrays | {"status": response.status}).items():
            found = results.series("statics", f"joints/joint_1/{what}", number)
            np.testing.assert_array_equal(found, all_of(comm, rows(local)))
    return stages


def test_a_block_that_is_not_there_has_no_temperature(comm, column, new_path):
    """The cold stretches the lower block between its sides, and the upper one once it is cast."""
    path, fields = new_path("cast.h5"), new_path("cast.vtkhdf")
    monitors = [
        dj.ResultsMonitor(path, points=POINTS, envelopes=["sides"]),
        dj.FieldMonitor(fields),
    ]
    simulation = dj.Simulation(column(), monitors=monitors)
    simulation.statics(loads=[WEIGHT, WINTER], absent=["upper"])
    simulation.statics(loads=[WEIGHT, WINTER])

    def look():
        with dj.Results(path) as results:
            nodes = results.static("mesh/nodes")[results.static("envelopes/nodes")]
            stresses = results.series("statics", "stress/principal_max")
        grids = [grid for _, grid in read_vtk(fields.with_name(f"{fields.stem}_stages.vtkhdf"))]
        for stress, grid, built in zip(stresses, grids, (HEIGHT / 2, HEIGHT), strict=True):
            sure = ~np.isclose(nodes[:, 2], HEIGHT / 2)  # where nodes of both blocks are
            there = nodes[sure, 2] < built + SIZE / 2
            clamped = -E * EXPANSION * COLD
            np.testing.assert_allclose(stress[sure], clamped * there, atol=1e-6 * clamped)
            there = grid.cell_centers().points[:, 2] < built
            found = grid.cell_data["largest principal stress [Pa]"]
            np.testing.assert_allclose(found, clamped * there, atol=1e-6 * clamped)
            change = grid.cell_data["temperature change [K]"]
            np.testing.assert_allclose(change, COLD * there)

    on_root(comm, look)


def test_stages_saved_travel(comm, column, new_path):
    """A run of another day begins with the stages of the first, and with monitors of its own."""
    first = dj.Simulation(column())
    first.statics(loads=[WEIGHT, PORES], name="weight")
    path, kept = new_path("next.h5"), new_path("kept.static")
    first.save_static(kept)
    second = dj.Simulation(column(), monitors=[dj.ResultsMonitor(path, points=POINTS)])
    second.load_static(kept)
    with pytest.raises(dj.JointsError, match="'weight' is in use; choose a name other than weight"):
        second.statics(name="weight")
    second.statics(name="winter")
    for _ in range(2):
        comm.barrier()
        with dj.Results(path) as results:
            weight, winter = dj.measures.static_stages(results)
        assert (weight.name, winter.name) == ("weight", "winter")
        assert weight.joints["joint_1"].water_force == pytest.approx(PORE * AREA)
        drop = winter.displacement["top"] - weight.displacement["top"]
        assert drop[2] == pytest.approx(EXPANSION * COLD * HEIGHT)
        second.dynamics(dt=1e-3, steps=1)
        second.monitors.clear()


def test_a_continued_run_keeps_its_stages(comm, column, new_path):
    """Statics that are run again before a run is continued cost no record of it."""
    path, kept = new_path("long.h5"), new_path("long.ckpt")

    def run(last, **how):
        writing = dj.ResultsMonitor(path, points=POINTS, overwrite=True)
        simulation = dj.Simulation(column(), monitors=[writing, Killer(last)])
        simulation.statics(name="all")
        simulation.dynamics(dt=1e-3, steps=4, checkpoint=dj.Checkpoints(kept, every=2, **how))

    with pytest.raises(Killed):
        run(3)
    comm.barrier()
    run(None, resume=True)
    with dj.Results(path) as results:
        assert results.status == "complete"
        assert results.stage_names == ["all"]
        np.testing.assert_allclose(results.time("histories"), 1e-3 * np.arange(5))
        top = dj.measures.static_stages(results)[0].displacement["top"]
        np.testing.assert_allclose(results.series("histories", "displacement", 0)[0], top)
    assert not path.with_name(f"{path.name}.before").exists()


def test_files_of_others_are_kept(comm, column, new_path):
    """A static stage replaces no file unasked, and puts aside what it was told to replace."""
    path, text = new_path("mine.h5"), "something else"
    if comm.rank == 0:
        path.write_text(text)
    comm.barrier()
    simulation = dj.Simulation(column(), monitors=[dj.ResultsMonitor(path, points=POINTS)])
    with pytest.raises(dj.ResultsError, match="exists; pass overwrite=True"):
        simulation.statics()
    writing = dj.ResultsMonitor(path, points=POINTS, overwrite=True)
    dj.Simulation(column(), monitors=[writing]).statics()
    assert path.with_name(f"{path.name}.before").read_text() == text
    with dj.Results(path) as results:
        assert results.stage_names == ["statics 1"]
    beside = new_path("own.h5.before")
    if comm.rank == 0:
        beside.write_text(text)
    comm.barrier()
    path = beside.with_name("own.h5")
    run = dj.Simulation(column(), monitors=[dj.ResultsMonitor(path, points=POINTS)])
    run.statics()
    run.dynamics(dt=1e-3, steps=2)
    assert beside.read_text() == text
    with pytest.raises(dj.ResultsError, match="exists; pass overwrite=True"):
        run.dynamics(dt=1e-3, steps=1)
    with dj.Results(path) as results:
        assert results.rows("histories") == 3
