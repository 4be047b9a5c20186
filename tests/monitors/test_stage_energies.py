# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies and jumps of static stages in file, tables and report against the ledger of the run."""

import csv
import re

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("plotly")
from dolfinx.mesh import CellType, create_rectangle, locate_entities, locate_entities_boundary
from reading_back import Tables
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints import measures, report
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.results.overview import overview

pytestmark = pytest.mark.mpi

TERMS = ("strain", "supports", "plastic", "water_released", "error", "scale")
JOINT_TERMS = ("elastic", "friction", "numerical", "bonds", "released")
DENSITY, ANGLE = 2400.0, 30.0

# The wedge: length of the joint and stiffness of the spring under it.
LEAN, PUSH, STIFFNESS, WEDGE_ANGLE = np.radians(10.0), 1e-3, 1e7, np.radians(35.0)
LIMIT = STIFFNESS * PUSH * np.tan(WEDGE_ANGLE - LEAN) / np.cos(LEAN)
OPENS_AT = PUSH / np.tan(LEAN)
SPRING = LIMIT / (3.0 * OPENS_AT)


def rectangle(comm, height, cells, joint=None, groups=()):
    """The rectangle [0, 2] x [0, height] in parts, with groups of boundary facets by name."""
    mesh = create_rectangle(comm, [(0.0, 0.0), (2.0, height)], cells, CellType.quadrilateral)
    mesh.topology.create_connectivity(1, 2)
    joints = {} if joint is None else {joint[0]: locate_entities(mesh, 1, joint[1])}
    return mesh, joints, {n: locate_entities_boundary(mesh, 1, where) for n, where in groups}


def at(axis, value, after=0.0):
    """Whether points are on a line, and not left of a place."""
    return lambda x: np.isclose(x[axis], value) & (x[0] > after - 1e-9)


def pushed_block(comm):
    """A block on a level joint, pushed by 0.9 of what friction takes: some points slide."""
    groups = [("base", at(1, 0.0)), ("top", at(1, 2.0))]
    mesh, joints, groups = rectangle(comm, 2.0, (6, 4), ("joint_level", at(1, 1.0)), groups)
    push = 0.9 * np.tan(np.radians(ANGLE)) * DENSITY * STANDARD_GRAVITY
    law = dj.FrictionNoTension(
        normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=ANGLE
    )
    return dj.Model(
        dj.split_mesh(mesh, joints=joints, groups=groups),
        material=dj.Elastic(young=25e9, poisson=0.2, density=DENSITY),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), dj.Traction(group="top", value=(float(push), 0.0))],
        body=dj.Body(plane="strain"),
    )


def wedge(comm):
    """Half of a wedge in a slot that is wider below, held by friction; a load pulls it down.

     ______ ______
    |wall /       :  rollers on the axis of symmetry
    |____/________:
           spring
    """
    groups = [("wall", at(0, 0.0)), ("axis", at(0, 2.0))]
    groups += [("foot", at(1, 0.0, after=1.0)), ("head", at(1, 1.0, after=1.0))]
    mesh, joints, groups = rectangle(comm, 1.0, (4, 2), ("joint_wall", at(0, 1.0)), groups)
    x = mesh.geometry.x
    x[:, 0] -= np.tan(LEAN) * (1.0 - x[:, 1]) * np.minimum(x[:, 0], 2.0 - x[:, 0])
    spring = float(SPRING / (1.0 + np.tan(LEAN)))
    law = dj.FrictionNoTension(
        normal_stiffness=STIFFNESS, shear_stiffness=STIFFNESS, friction_angle_deg=35.0
    )
    return dj.Model(
        dj.split_mesh(mesh, joints=joints, groups=groups),
        material=dj.Elastic(young=1e10, poisson=0.0, density=0.0),
        joints=law,
        supports=[
            dj.Prescribed(group="wall", component="x", value=lambda t: PUSH),
            dj.Fixed(group="wall", components="y"),
            dj.Fixed(group="axis", components="x"),
            dj.Spring(group="foot", normal_stiffness=spring, tangential_stiffness=spring),
        ],
        loads=[dj.Traction(group="head", value=(0.0, float(-LIMIT)), factor=lambda t: t)],
        body=dj.Body(plane="strain"),
    )


def check_file(path, joints, states):
    """Every number of the stream is that of the state; return the energies as they are read."""
    with dj.Results(path) as results:
        names = results.streams["statics"]
        for i, (name, state) in enumerate(states.items()):
            energy = state.energy
            known = {f"energy/{term}": getattr(energy, term) for term in TERMS}
            for term in JOINT_TERMS:
                values = zip(joints, getattr(energy, f"joint_{term}"), strict=True)
                known |= {f"energy/joints/{joint}/{term}": value for joint, value in values}
            known |= {f"energy/loads/{load}": work for load, work in energy.input_by_load.items()}
            known["jump_energy"] = sum(jump.energy for jump in state.jumps)
            for series, value in known.items():
                assert results.series("statics", series, i) == value
                assert results.unit("statics", series) == "J"
                assert results.description("statics", series)
            assert results.series("statics", "jumps", i) == len(state.jumps)
            others = {n for n in names if n.startswith("energy/")} - known.keys()
            assert [results.series("statics", n, i) for n in others] == [0.0] * len(others)
            # Loads that never acted are there, too.
            assert {"energy/loads/grout", "energy/loads/construction"} <= set(names)
            assert results.stage_names[i] == name
        stages = measures.static_stages(results)
    assert len(stages) == len(states)
    for stage, state in zip(stages, states.values(), strict=True):
        found, energy = stage.energy, state.energy
        assert [getattr(found, term) for term in TERMS] == [getattr(energy, t) for t in TERMS]
        for load, work in found.loads.items():
            assert work == energy.input_by_load.get(load, 0.0)
        for i, joint in enumerate(joints):
            known = {term: float(getattr(energy, f"joint_{term}")[i]) for term in JOINT_TERMS}
            assert found.joints[joint] == known
        assert found.relative_error == energy.relative_error
        # The sum of what is stored and lost is the input.
        lost = found.plastic
        lost += sum(j[t] for j in found.joints.values() for t in ("friction", "numerical", "bonds"))
        stored = found.strain + sum(j["elastic"] for j in found.joints.values())
        given = sum(found.loads.values()) + found.supports
        assert abs(stored + lost - given) <= 1e-9 * found.scale
    return stages


def check_tables(path, folder, stages):
    """Check that every cell is that of the stage, in joules; of files with one joint or none."""
    with dj.Results(path) as results:
        dj.write_csv(results, folder)
    words = {"supports": "work of supports", "strain": "strain energy", "plastic": "plastic work"}
    words |= {"water_released": "energy released with water", "error": "error of the energies"}
    words |= {"scale": "largest energy", "jump_energy": "energy released by jumps"}
    rows = list(csv.DictReader((folder / "stages.csv").open(encoding="utf-8")))
    assert [row["stage"] for row in rows] == [stage.name for stage in stages]
    for row, stage in zip(rows, stages, strict=True):
        for name, text in words.items():
            assert float(row[f"{text} [J]"]) == getattr(stage.energy, name)
        for load, work in stage.energy.loads.items():
            assert float(row[f"work of {load} [J]"]) == work
        assert int(row["jumps [-]"]) == stage.energy.jump_count == len(stage.jumps)
    if not stages[0].joints:
        return
    rows = list(csv.DictReader((folder / "stage_joints.csv").open(encoding="utf-8")))
    for row, stage in zip(rows, stages, strict=True):
        found = {term: float(row[f"{term} [J]"]) for term in JOINT_TERMS}
        assert (row["stage"], found) == (stage.name, stage.energy.joints[row["joint"]])


def shown_energies(path, out, stages, columns):
    """Columns of the report's table without those of zeros, cells in SI; return the page."""
    html = report.write([path], out, with_3d=False).read_text(encoding="utf-8")
    (table,) = Tables(html).having("balance error").tables
    heads = [re.sub(r" \[.*", "", head) for head in table[0][1:]]
    assert heads == [*columns, "balance error / largest energy"]
    for stage in stages:
        energy, joints = stage.energy, stage.energy.joints.values()
        known = {f"work of {load}": work for load, work in energy.loads.items()}
        known |= {"work of supports": energy.supports, "strain energy": energy.strain}
        for word, term in (("joints, elastic", "elastic"), ("broken bonds", "bonds")):
            known[word] = sum(joint[term] for joint in joints)
        for term in ("friction", "numerical", "released"):
            known[term] = sum(joint[term] for joint in joints)
        for column in columns:
            found = Tables(html).having("balance error").value(stage.name, f"{column} [")
            # Four digits; what is below rounding is a zero.
            assert found == pytest.approx(known[column], rel=6e-4, abs=1e-12 * energy.scale)
        found = Tables(html).having("balance error").value(stage.name, "balance error")
        assert found == pytest.approx(energy.relative_error, rel=6e-4)
    return html


def test_friction_and_two_loads(comm, new_path):
    """Weight, then a push under which points slide, and the same stages in a dynamic file."""
    path, model = new_path("pushed.h5"), pushed_block(comm)
    monitor = dj.ResultsMonitor(path, points={"top": (2.0, 2.0)})
    simulation = dj.Simulation(model, monitors=[monitor])
    weight = simulation.statics(loads=model.loads[:1], name="weight")
    states = {"weight": weight, "push": simulation.statics(steps=4, name="push")}
    energy = states["push"].energy
    assert energy.joint_friction[0] > 1e-3 * energy.scale
    assert energy.joint_released[0] == 0.0

    def look():
        stages = check_file(path, ["joint_level"], states)
        check_tables(path, path.with_suffix(".tables"), stages)
        columns = ["work of Gravity", "work of Traction_top", "strain energy", "joints, elastic"]
        columns += ["friction", "numerical"]
        html = shown_energies(path, path.with_suffix(".html"), stages, columns)
        assert "jumps in the static stage" not in html
        assert re.search(r"static energy energies balance to \S+ of the largest, no jumps", text())

    def text():
        return " ".join(overview(path).split())

    on_root(comm, look)
    simulation.dynamics(dt=1e-3, steps=1)
    on_root(comm, lambda: check_file(path, ["joint_level"], states))


def test_a_jump(comm, new_path):
    """A rigid wedge slides out of its slot and falls onto a spring.

    By the formulas of a rigid wedge: it sticks until friction bears LIMIT, with the slip y_s =
    PUSH tan(phi - lean). From there the force of the joint falls linearly to zero, where the joint
    opens. The energy released is the work of the limit load up to where the spring bears it, less
    the work of the joint and of the spring on that way.
    """
    path, model = new_path("wedge.h5"), wedge(comm)
    monitor = dj.ResultsMonitor(path, points={"foot": (2.0, 0.0)})
    simulation = dj.Simulation(model, monitors=[monitor])
    push = simulation.quasi_statics([0.0], name="push")
    pulled = simulation.quasi_statics([0.5, 1.5, 2.0], name="pull", allow_jumps=True)
    (jump,) = pulled.jumps
    stiffness = STIFFNESS / np.cos(LEAN)  # of the joint that sticks
    start, end = (0.5 + factor for factor in (jump.start, jump.end))
    bears = LIMIT * (1.0 + SPRING / stiffness)
    assert (jump.step, jump.time, jump.joints) == (2, 1.5, ("joint_wall",))
    assert start * LIMIT < bears < end * LIMIT
    slides = PUSH * np.tan(WEDGE_ANGLE - LEAN)
    rests = bears / SPRING
    spring, joint = 0.5 * SPRING * (rests**2 - slides**2), 0.5 * LIMIT * (OPENS_AT - slides)
    # Blocks are 1000 times stiffer than the joint.
    assert jump.energy == pytest.approx(bears * (rests - slides) - spring - joint, rel=1e-2)
    grouted = simulation.grout(name="grout")  # nothing moves, nothing jumps
    assert grouted.energy is pulled.energy
    assert grouted.jumps == []
    half, whole, last = (record.state for record in simulation.stages[1:4])
    assert [len(state.jumps) for state in (half, whole, last)] == [0, 1, 0]
    states = {"push": push, "pull, t = 0.5 s": half, "pull, t = 1.5 s": whole}
    states |= {"pull, t = 2 s": last, "grout": grouted}
    words = f"{jump.energy:.4g} J released in joint_wall between the load factors "
    words += f"{jump.start:.4g} and {jump.end:.4g} of step 2 at t = 1.5 s"
    assert words in " ".join(str(pulled).split())

    def look():
        stages = check_file(path, ["joint_wall"], states)
        assert [stage.jumps for stage in stages] == [(), (), (words,), (), ()]
        check_tables(path, path.with_suffix(".tables"), stages)
        columns = ["work of Traction_head", "work of supports", "strain energy", "joints, elastic"]
        columns += ["friction", "numerical", "released"]
        html = shown_energies(path, path.with_suffix(".html"), stages, columns)
        stage = "&#x27;pull, t = 1.5 s&#x27;"
        sentence = f": the structure jumps in the static stage {stage}: {words}."
        # Among the warnings at the top, and below the table.
        assert (html.count(f"{sentence}</li>"), html.count(f"{sentence}</p>")) == (1, 1)
        shown = " ".join(overview(path).split())
        assert f"1 jump in 'pull, t = 1.5 s' ({jump.energy:.4g} J)" in shown
        assert f"jump: {words}" in shown

    on_root(comm, look)


def test_a_body_without_joints(comm, new_path):
    """A column of height H and width B under its weight g, without lateral strain.

    Linear elements of height h are exact at their nodes, so the energy is that of the exact
    solution, g^2 B H^3 / (6 E), less that of what they leave out, g^2 B H h^2 / (24 E).
    """
    height, width, size, young = 2.0, 2.0, 0.5, 25e9
    groups = [("base", at(1, 0.0)), ("top", at(1, height))]
    mesh, _, groups = rectangle(comm, height, (4, 4), None, groups)
    model = dj.Model(
        dj.split_mesh(mesh, groups=groups),
        material=dj.Elastic(young=young, poisson=0.0, density=DENSITY),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        body=dj.Body(plane="strain"),
    )
    path = new_path("column.h5")
    simulation = dj.Simulation(model, monitors=[dj.ResultsMonitor(path, points={"top": (1, 2)})])
    states = {"weight": simulation.statics(name="weight")}
    gamma = DENSITY * STANDARD_GRAVITY
    exact = gamma**2 * width * (height**3 / 6.0 - height * size**2 / 24.0) / young

    def look():
        stages = check_file(path, [], states)
        assert stages[0].energy.strain == pytest.approx(exact, rel=1e-9)
        assert stages[0].energy.loads["Gravity"] == pytest.approx(exact, rel=1e-9)
        check_tables(path, path.with_suffix(".tables"), stages)
        shown_energies(
            path, path.with_suffix(".html"), stages, ["work of Gravity", "strain energy"]
        )

    on_root(comm, look)
