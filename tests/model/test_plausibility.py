# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values that no dam has are warned of, once each; others are not."""

import subprocess
import sys
import warnings
from contextlib import nullcontext

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints.model.plausibility import warn_of_grout

pytestmark = pytest.mark.mpi

CONCRETE = {"young": 25e9, "poisson": 0.2, "density": 2400.0}
COULOMB = {"friction_coefficient": 35.0}
POINTS = {"top": (0.0, 0.0, 20.0)}
JOINT = {"normal_stiffness": 1e11, "shear_stiffness": 4e10}


def told(comm, **options):
    """The lines on a wall with these options, from rank 0."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dj.Model(supports=[dj.Fixed(group="base")], **options)
    texts = [str(w.message) for w in caught if w.category is dj.PlausibilityWarning]
    assert comm.rank == 0 or not texts
    return comm.bcast(texts, root=0)


@pytest.fixture
def wall(wall_file, read):
    return read(wall_file())


def test_other_units_are_told_of(comm, wall):
    law = dj.FrictionNoTension(**{**JOINT, "normal_stiffness": 100.0}, friction_angle_deg=0.6)
    water = dj.HydrostaticPressure(group="y_min", level=18.0, density=1.0)
    found = told(
        comm,
        jointed=wall,
        material=dj.Elastic(young=25.0, poisson=0.2, density=2.4),
        joints={
            "joint_1": law,
            "joint_2": law,
            "joint_3": dj.FrictionNoTension(**JOINT, **COULOMB),
        },
        loads=[dj.Gravity(), water, dj.Temperature(value=5.0, reference=10.0, expansion=10.0)],
    )
    assert found == [
        "Elastic: young is 25 Pa; usual: 1e+06 to 1e+17 Pa; is it in GPa?",
        "Elastic: density is 2.4 kg/m^3; usual: 100 to 12000 kg/m^3; is it in t/m^3?",
        "FrictionNoTension of joint_1 and 1 more: normal_stiffness is 100 Pa/m; usual: 1e+06 to "
        "1e+20 Pa/m; is it in GPa/m?",
        "FrictionNoTension of joint_1 and 1 more: friction_angle_deg is 0.6 degrees; usual: 2 "
        "to 90 degrees; is it in radians?",
        "FrictionNoTension of joint_3: friction_coefficient is 35; usual: 0 to 10; is it in "
        "degrees?",
        "HydrostaticPressure: density is 1 kg/m^3; usual: 100 to 12000 kg/m^3; is it in t/m^3?",
        "Temperature: expansion is 10 1/K; usual: 1e-07 to 0.0001 1/K; is it in 1e-6/K?",
    ]


@pytest.mark.parametrize(
    ("material", "texts"),
    [
        (dj.Elastic(**CONCRETE | {"young": 25e3}), ["Elastic: young is 25000 Pa", "MPa?"]),
        (dj.Elastic(**CONCRETE | {"density": 24.0}), ["density is 24 kg/m^3", "in kN/m^3?"]),
        (dj.Elastic(**CONCRETE | {"density": 24e3}), ["density is 24000 kg/m^3", "in N/m^3?"]),
        (
            dj.DruckerPrager(
                elastic=dj.Elastic(**CONCRETE | {"young": 25.0}),
                cohesion=1e6,
                friction_angle_deg=45.0,
            ),
            ["DruckerPrager: young is 25 Pa"],
        ),
        (
            dj.Orthotropic(
                young=(25.0, 22.0, 20.0), poisson=(0.2,) * 3, shear=(1e10,) * 3, density=2400.0
            ),
            ["Orthotropic: young is 25 Pa"],
        ),
    ],
)
def test_parts_of_materials_are_looked_at(comm, wall, material, texts):
    law = dj.FrictionNoTension(**JOINT, friction_angle_deg=40.0)
    found = told(comm, jointed=wall, material=material, joints=law)
    assert len(found) == 1
    assert all(text in found[0] for text in texts)


def test_what_dams_have_is_not(comm, wall):
    # Also no friction, no mass, dashpots in joints.
    bare = dj.FrictionNoTension(**{**JOINT, "shear_stiffness": 0.0}, friction_angle_deg=0.0)
    dashpot = dj.ViscousJoint(
        law=dj.FrictionNoTension(**JOINT, friction_angle_deg=80.0), normal_viscosity=1.0
    )
    assert not told(
        comm,
        jointed=wall,
        material=dj.Elastic(**CONCRETE | {"density": 0.0}),
        joints={"joint_1": bare, "joint_2": dashpot, "joint_3": bare},
        loads=[dj.Gravity()],
        damping=dj.Rayleigh(),
    )


@pytest.mark.parametrize(
    ("level", "strange"), [(-2.0, True), (18.0, False), (26.5, False), (26.8, True)]
)
def test_water_that_misses_the_body(comm, wall, level, strange):
    water = dj.HydrostaticPressure(group="y_min", level=level)
    found = told(
        comm,
        jointed=wall,
        material=dj.Elastic(**CONCRETE),
        joints=dj.FrictionNoTension(**JOINT, friction_angle_deg=30.0),
        loads=[water],
    )
    text = f"HydrostaticPressure: level is {level:g} m; the body extends from 0 to 20 m."
    assert found == ([text] if strange else [])


@pytest.mark.parametrize(
    ("gap", "texts"),
    [
        (1e-3, []),
        (lambda x: 1e-3 - 1e-4 * x[:, 2], ["Joint 'joint_2': the initial gap is -0.001 m;"]),
    ],
)
def test_gaps_that_overlap(comm, wall, gap, texts):
    """At the top, 20 m up, the gap is 1 mm - 2 mm."""
    law = dj.FrictionNoTension(**JOINT, friction_angle_deg=30.0)
    joints = dj.Joints(law, initial_gaps={"joint_2": gap})
    given = {"material": dj.Elastic(**CONCRETE), "joints": joints}
    found = told(comm, jointed=wall, **given)
    assert [text[: text.index(";") + 1] for text in found] == texts


@pytest.mark.parametrize(("level", "strange"), [(76.0, True), (176.0, False)])
def test_water_that_misses_its_face(comm, level, strange):
    # A dam of 80 m on rock of 60 m, its foot at 100 m: 76 m is the depth of a level of 176 m. On
    # several ranks the face is on one of them.
    heights = np.repeat([40.0, 100.0, 180.0], 2)
    body = dj.mesh_from_arrays(
        comm,
        cell="quadrilateral",
        x=np.column_stack([np.tile([0.0, 60.0], 3), heights]),
        cells=np.array([[0, 1, 2, 3], [2, 3, 4, 5]]),
        facet_groups={"base": np.array([[0, 1]]), "upstream": np.array([[2, 4]])},
    )
    water = dj.HydrostaticPressure(group="upstream", level=level)
    found = told(comm, jointed=body, material=dj.Elastic(**CONCRETE), loads=[water])
    text = "HydrostaticPressure: level is 76 m; the lowest point of group 'upstream' is at 100 m."
    assert found == ([text] if strange else [])


@pytest.mark.parametrize(("value", "strange"), [(283.0, True), (-263.0, True), (40.0, False)])
def test_kelvin_beside_celsius(comm, wall, value, strange):
    space = fem.functionspace(wall.mesh, ("Lagrange", 1))
    field = fem.Function(space)
    field.x.array[:] = value
    joints = dj.FrictionNoTension(**JOINT, friction_angle_deg=30.0)
    loads = [
        dj.Temperature(value=field, reference={"concrete": 10.0}, expansion=1e-5),
        dj.Temperature(value=value, reference=10.0, expansion=1e-5),
    ]
    given = {"material": dj.Elastic(**CONCRETE), "joints": joints, "loads": loads}
    text = f"Temperature: value is {value:.4g} to {value:.4g} with a reference of 10; is one of"
    assert [line[: len(text)] for line in told(comm, jointed=wall, **given)] == [text] * 2 * strange


def test_loads_on_nothing(comm, wall):
    law = dj.FrictionNoTension(**JOINT, friction_angle_deg=30.0)
    given = {"jointed": wall, "material": dj.Elastic(**CONCRETE), "joints": law}
    water = dj.JointWater(joint="joint_1", level=-2.0)
    deep = dj.SeepageLine(start=(0, 0, 0), end=(1, 0, 0), upstream=-1.0, downstream=-2.0)
    low = told(comm, **given, loads=[water])
    assert low == ["JointWater: level is -2 m; the body extends from 0 to 20 m."]
    supports = [dj.Fixed(group="base")]
    for load, name in (
        (dj.Uplift(joint="joint_1", pressure=deep), "Uplift_joint_1"),
        (
            dj.FormLoad(form=lambda v: fem.Constant(wall.mesh, 0.0) * v[2] * wall.dx("concrete")),
            "FormLoad",
        ),
    ):
        text = f"{name} exerts no force: its value is zero, or no part of the mesh"
        with pytest.warns(dj.PlausibilityWarning, match=text) if comm.rank == 0 else nullcontext():
            dj.Simulation(dj.Model(**given, supports=supports, loads=[load])).statics()
    for measure, part in ((ufl.ds(5), 5), (ufl.dx(7), 7)):
        load = dj.FormLoad(form=lambda v, measure=measure: v[2] * measure)
        with pytest.raises(
            ValueError, match=f"integrates over the part {part} of a measure without"
        ):
            dj.Simulation(dj.Model(**given, supports=supports, loads=[load])).statics()


def test_strengths(comm, wall):
    """Strengths in other units, interchanged or of an unknown group, before any stage."""
    model = dj.Model(
        wall,
        material=dj.Elastic(**CONCRETE),
        joints=dj.FrictionNoTension(**JOINT, friction_angle_deg=35.0),
        supports=[dj.Fixed(group="base")],
    )

    def texts(strength):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            monitor = dj.ResultsMonitor("s.h5", points=POINTS, envelopes=True, strength=strength)
            dj.Simulation(model, monitors=[monitor])
        return comm.bcast([str(w.message) for w in caught])

    assert texts(dj.Strength(tensile=2e6, compressive=25e6)) == []
    assert texts({"concrete": dj.Strength(tensile=3.0, compressive=30.0)}) == [
        "Strength of concrete: tensile is 3 Pa; usual: 10000 to 3e+07 Pa; is it in MPa?",
        "Strength of concrete: compressive is 30 Pa; usual: 100000 to 3e+08 Pa; is it in MPa?",
    ]
    assert texts(dj.Strength(tensile=25e6, compressive=2e6)) == [
        "Strength: compressive is 2e+06 Pa, less than tensile 2.5e+07 Pa; are they interchanged?"
    ]
    with pytest.raises(dj.MeshError, match="damm.*concrete"):
        texts({"damm": dj.Strength(tensile=2e6, compressive=25e6)})


def test_a_mesh_in_millimetres_and_the_switch(comm):
    # A body of 80 m by 40 m in mm.
    x = 1e3 * np.array([[0.0, 0.0], [80.0, 0.0], [0.0, 40.0], [80.0, 40.0]])
    body = dj.mesh_from_arrays(
        comm,
        cell="quadrilateral",
        x=x,
        cells=np.array([[0, 1, 2, 3]]),
        facet_groups={"base": np.array([[0, 1]])},
    )
    options = {"jointed": body, "material": dj.Elastic(**CONCRETE)}
    assert told(comm, **options) == [
        "The mesh: extent is 80000 m; usual: 0.01 to 20000 m; is it in mm?"
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", dj.PlausibilityWarning)
        dj.Model(supports=[dj.Fixed(group="base")], **options)


def test_warnings_are_seen_in_a_script(comm):
    # DOLFINx 0.9 imports an FFCx that hands them to a logger without handlers.
    if comm.size > 1:
        return
    script = "import warnings, mpi4py.MPI, dolfinx, dolfinx_joints as dj"
    script += "; dj.Model; warnings.warn('seen')"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert "UserWarning: seen" in done.stderr


def test_grout_pressures_in_other_units(comm):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_grout(comm, 0.0)
        warn_of_grout(comm, 5e5)
        assert caught == []
        warn_of_grout(comm, 0.5)
    expected = "grout: pressure is 0.5 Pa; usual: 1000 to 3e+07 Pa; is it in MPa?"
    assert [str(each.message) for each in caught] == [expected] * (comm.rank == 0)
