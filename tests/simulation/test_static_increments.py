# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages that arrive: solvers that take over, increments that are cut, what a failure says.

 ________________
|       |       |
|_______|_______|   5 m    four blocks that meet at a cross
|       |       |
|_______|_______|   5 m
  5 m      5 m
"""

import re

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from dolfinx.mesh import CellType, create_rectangle, locate_entities, locate_entities_boundary
from petsc4py import PETSc

import dolfinx_joints as dj
from dolfinx_joints import report
from dolfinx_joints.common.mpi import lasting, on_root
from dolfinx_joints.geometry.section_table import SectionTable
from dolfinx_joints.geometry.sections_dam import sections_dam
from dolfinx_joints.results.overview import overview
from dolfinx_joints.simulation.statics.load_increments import LoadIncrements

G = 9.80665  # [m/s^2]
DENSITY = 2400.0  # [kg/m^3]
CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=DENSITY)


def law(normal, shear, angle):
    return dj.FrictionNoTension(
        normal_stiffness=normal, shear_stiffness=shear * normal, friction_angle_deg=angle
    )


def square(comm, joint_law, *, cut, cells, shape, loads=(), corners=(10.0, 10.0)):
    """A rectangle in plane strain on a fixed base, cut at x = 5 m ("x") and y = 5 m ("y")."""
    mesh = create_rectangle(comm, [(0.0, 0.0), corners], cells, shape)
    mesh.topology.create_connectivity(1, 2)
    planes = {"x": lambda x: np.isclose(x[0], 5.0), "y": lambda x: np.isclose(x[1], 5.0)}
    joints = {f"joint_{axis}": locate_entities(mesh, 1, planes[axis]) for axis in cut}
    ends = {"base": (1, 0.0), "top": (1, corners[1])}
    groups = {
        name: locate_entities_boundary(mesh, 1, lambda x, a=axis, v=at: np.isclose(x[a], v))
        for name, (axis, at) in ends.items()
    }
    return dj.Model(
        dj.split_mesh(mesh, joints=joints, groups=groups),
        material=CONCRETE,
        joints=joint_law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), *loads],
        body=dj.Body(plane="strain"),
    )


def check(model, static, weight, friction):
    """The supports carry the weight [N]; joints push, within the Coulomb cone."""
    total = sum(model.resultant(static.reaction, support.group) for support in model.supports)
    assert total[-1] == pytest.approx(weight, rel=1e-9)
    normal, shear = static.joints.traction[:, 0], static.joints.traction[:, 1:]
    every = model.operator.comm.allgather(float(np.abs(normal).max(initial=0.0)))
    assert normal.max(initial=0.0) <= 0.0
    excess = np.linalg.norm(shear, axis=1) + friction * normal
    assert excess.max(initial=0.0) <= 1e-9 * max(every)


@pytest.mark.mpi
@pytest.mark.parametrize("stiffness", [1e11, 1e13])
@pytest.mark.parametrize("solver", ["auto", "condensed", "monolithic"])
def test_four_blocks_that_meet_at_a_cross(comm, stiffness, solver):
    """Corrections halved until the residual falls crept towards a kink, in both solvers."""
    friction = law(stiffness, 1.0, 89.0)
    model = square(comm, friction, cut="xy", cells=(4, 4), shape=CellType.triangle)
    static = dj.Simulation(model, solver=solver).statics()
    check(model, static, DENSITY * G * 100.0, np.tan(np.radians(89.0)))
    # The vertical joint opens in its upper half, as the blocks grow wide at their feet.
    counts = model.contact.counts(static.joints.status)
    assert (counts.open, counts.stick, counts.total) == (4, 8, 12)


@pytest.fixture(scope="module")
def dam_file(comm, tmp_path_factory):
    """A dam with vertical joints and one under it; nothing else holds its blocks."""
    table = SectionTable(
        {
            "elevation": np.array([320.0, 345.0, 370.0]),
            "extrados_radius": np.array([45.0, 62.0, 80.0]),
            "crown_thickness": np.array([9.0, 6.5, 3.5]),
            "left_thickness": np.array([11.0, 8.0, 4.0]),
            "right_thickness": np.array([11.5, 8.2, 4.0]),
            "left_angle": np.array([20.0, 34.0, 46.0]),
            "right_angle": np.array([24.0, 38.0, 50.0]),
            "centre_x": np.array([45.0, 50.0, 60.0]),
        }
    )
    path = comm.bcast(tmp_path_factory.mktemp("dam") / "dam.msh" if comm.rank == 0 else None)
    options = {"size": 10.0, "order": 1, "joints": 5, "foundation": 40.0, "spread": 20.0}
    on_root(comm, lambda: sections_dam(path, table, perimetral=True, **options))
    return path


@pytest.mark.mpi
@pytest.mark.parametrize("steps", [1, 4])
def test_a_dam_on_a_perimetral_joint_arrives(comm, read, dam_file, steps):
    """Where the monolithic solver does not at 1e12 Pa/m, in steps however short."""
    rock = dj.Elastic(young=20e9, poisson=0.25, density=2600.0)
    model = dj.Model(
        read(dam_file),
        material={"concrete": CONCRETE, "foundation": rock},
        joints=law(1e12, 0.4, 45.0),
        supports=[dj.Fixed(group="foundation_outer")],
        loads=[dj.Gravity(), dj.HydrostaticPressure(group="upstream", level=365.0)],
    )
    static = dj.Simulation(model).statics(steps=steps)
    assert (static.cuts, len(static.reports)) == (0, steps)
    assert {report.solver for report in static.reports} == {"condensed"}
    system = model.system()
    load = system.load(0.0, system.stiffness.createVecRight()).getArray()
    check(model, static, -comm.allreduce(load[2::3].sum()), 1.0)


def pushed(comm, ratio):
    """A block on a level joint, pushed by a ratio of what friction takes."""
    friction = np.tan(np.radians(30.0))
    push = dj.Traction(group="top", value=(ratio * friction * DENSITY * G * 5.0, 0.0))
    shape = CellType.quadrilateral
    return square(comm, law(1e11, 0.4, 30.0), cut="y", cells=(4, 4), shape=shape, loads=[push])


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["auto", "condensed"])
def test_a_push_beyond_the_friction_stops_at_the_load_factor(comm, solver):
    """A block of weight W takes mu W; pushed by mu W / 0.6 it slides at a load factor of 0.6."""
    model = pushed(comm, 1.0 / 0.6)
    simulation = dj.Simulation(model, solver=solver)
    simulation.statics(loads=[model.loads[0]])
    with pytest.raises(dj.ConvergenceError) as failure:
        simulation.statics(name="push")
    # In increments of 1/64, 38 of which are in equilibrium.
    reached, text = failure.value.reached, str(failure.value)
    assert reached == 38 / 64
    where = (
        f"The static stage 'push', step 1, did not converge beyond the load factor {reached:.4g}"
    )
    assert text.startswith(f"{where} in ")
    assert "worst joint 'joint_y'" in text
    assert "limit load may be reached" in text
    assert ('solver="auto"' in text) == (solver != "auto")


@pytest.mark.mpi
def test_a_failed_stage_is_seen_in_info_and_report(comm, new_path):
    """A block pushed by twice what friction takes, at first and after a stage that held it.

    The file had the stage of another run, of which nothing is left.
    """
    pytest.importorskip("plotly")
    path, model = new_path("pushed.h5"), pushed(comm, 2.0)

    def run():
        monitor = dj.ResultsMonitor(path, points={"top": (0.0, 10.0)}, overwrite=True)
        return dj.Simulation(model, monitors=[monitor])

    run().statics(loads=[model.loads[0]], name="yesterday")
    comm.barrier()
    simulation = run()
    for done, after in (([], "in the first static stage"), (["weight"], "after the static stage")):
        with pytest.raises(dj.ConvergenceError) as failure:
            simulation.statics()
        comm.barrier()
        with dj.Results(path) as results:
            assert (results.status, results.stage_names) == ("failed", done)
            assert results.summary["error"] == f"ConvergenceError: {failure.value}"
        if comm.rank == 0:
            told = " ".join(overview(path).split())
            assert "pushed.h5: failed, created" in told
            assert "error ConvergenceError: The static stage" in told
            page = report.write([path], path.with_suffix(".html"), with_3d=False).read_text()
            warning = page[page.index("Warnings") :]
            assert f"failed {' '.join([after, *done])} (ConvergenceError: The static" in warning
            assert f"beyond the load factor {failure.value.reached:.4g}" in warning
            assert "None." not in warning[:2000]
        comm.barrier()
        # A stage that ends mends it.
        simulation.statics(loads=[model.loads[0]], name="weight again" if done else "weight")
        comm.barrier()
        with dj.Results(path) as results:
            assert (results.status, results.stage_names[: len(done)]) == ("complete", done)


@pytest.mark.mpi
@pytest.mark.parametrize("share", [0.5, 1.00001, 1.1])
def test_a_block_on_a_rigid_joint_slides_from_mu_times_its_weight(comm, share):
    """In pseudo-time as well, where next to no inertia holds it in the end."""
    friction = np.tan(np.radians(30.0))
    push = dj.Traction(group="top", value=(share * friction * DENSITY * G * 5.0, 0.0))
    rigid = dj.RigidJoint(friction_angle_deg=30.0)
    shape = CellType.quadrilateral
    model = square(comm, rigid, cut="y", cells=(4, 4), shape=shape, loads=[push])
    simulation = dj.Simulation(model)
    simulation.statics(loads=[model.loads[0]])
    if share < 1.0:
        check(model, simulation.statics(), DENSITY * G * 100.0, friction)
    else:
        with pytest.raises(dj.ConvergenceError, match="worst joint 'joint_y'"):
            simulation.statics()


def test_increments_are_halved_and_grow_again():
    """A ramp of two steps, then one in time, whose shares count from its own start."""
    increments, ends = LoadIncrements([(None, 0.5), (None, 1.0), (2.0, 1.0)]), []
    spoilt = {0, 1, 4}  # attempts that fail
    for attempt, increment in enumerate(increments):
        if attempt in spoilt:
            increments.cut()
            continue
        ends.append((increment.time, increment.share, increment.whole))
    # Cut to a quarter of the first step: 1/8; as 1/4 is half a step, halves fit from there on.
    assert ends[:2] == [(None, 0.125, False), (None, 0.25, False)]
    assert [end for end in ends if end[2]] == [
        (None, 0.5, True),
        (None, 1.0, True),
        (2.0, 1.0, True),
    ]
    assert increments.cuts == 3


@pytest.mark.mpi
def test_what_petsc_keeps_of_load_steps_does_not_grow(comm, capfd):
    # On several ranks PETSc keeps all that Python drops, until it is told to let go.
    kept = []

    class Counting(dj.Monitor):
        def static_stage(self, model, stages):
            PETSc.garbage_view(lasting(comm))
            shown = comm.bcast(capfd.readouterr().out)
            kept.append(sum(int(n) for n in re.findall(r"Total entries: (\d+)", shown)))

    shape = CellType.quadrilateral
    model = square(comm, law(1e10, 0.4, 45.0), cut="y", cells=[4, 4], shape=shape)
    dj.Simulation(model, monitors=[Counting()]).quasi_statics([1.0, 2.0, 3.0, 4.0])
    assert len(kept) == 4
    assert kept[-1] <= kept[0]
