# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The facts of a run are equal when its script starts again, and differ once anything changed."""

import inspect
import json
import os
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import shaken_wall
import ufl
from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.simulation.fingerprint import Parameters, fingerprint, first_difference

# A user's module in which {} stands for one number.
SCRIPT = """
import functools, json, sys
from dataclasses import dataclass
import numba, numpy as np
from dolfinx_joints import FrictionNoTension, Motion, ViscousJoint
from dolfinx_joints.simulation.fingerprint import Parameters

one, kinds = {0}, {{"stick", "slip", "open"}}
table = np.linspace(0.0, {1}, 7)

@numba.njit
def compiled(x):
    return x + {2}

def inner(t):
    return one * t if "slip" in {{"slip", "stick"}} else compiled(t)

@functools.lru_cache
def factor(t, scale={3}):
    return scale * inner(t) + np.interp(t, table, table)

class Base:
    share = {4}
    def __call__(self, t):
        return sum(v for v in [self.share, {5}])

class Slotted(Base):
    __slots__ = ("k",)
    def __init__(self):
        self.k = {6}

@dataclass(frozen=True)
class Nested:
    parts: dict
    @property
    def value(self):
        return {7}

soft = FrictionNoTension(normal_stiffness=1e9 + {8}, shear_stiffness=1e9, friction_angle_deg=30)
record = Motion(acceleration=np.outer(np.arange(3.0) + {9}, [1, 1, 1]), dt=0.1)
values = [
    functools.partial(factor, scale=2.0), Slotted(), Nested({{"a": [soft, kinds], 2: record}}),
    ViscousJoint(law=soft, normal_viscosity=1.0 + {10}, shear_viscosity=1.0), record.__call__,
    list(range(1000)) + [{11}],
]
held = Parameters()
held.add("x", values)
assert not held.unknown, held.unknown
if __name__ == "__main__":
    print(json.dumps(held.facts))
"""
COUNT = 12


def script(changed=None):
    """The script with one of its numbers changed."""
    return SCRIPT.format(*(2.0 if i == changed else 1.0 for i in range(COUNT)))


def facts(changed=None):
    """Return the facts that the script computes in this process."""
    module = ModuleType("script")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "script", module)
        exec(compile(script(changed), "script.py", "exec"), vars(module))
    return module.held.facts


def test_the_same_in_another_process(tmp_path):
    """Addresses and the order of sets say nothing, which that process has otherwise."""
    path = tmp_path / "script.py"
    path.write_text(script())
    here = os.environ.get("PYTHONHASHSEED", "random")
    given = {**os.environ, "PYTHONHASHSEED": "1" if here != "1" else "2"}
    run = [sys.executable, str(path)]
    found = subprocess.run(run, env=given, capture_output=True, text=True, check=True)
    assert json.loads(found.stdout) == facts()


@pytest.mark.parametrize("changed", range(COUNT))
def test_each_number_is_seen(changed):
    assert facts(changed) != facts()


PUBLIC = {name: getattr(dj, name) for name in dir(dj) if not name.startswith("_")}
DECLARED = [
    (kind, each.name)
    for kind in PUBLIC.values()
    if is_dataclass(kind) and not issubclass(kind, Exception | dj.JointedMesh)
    for each in fields(kind)
    if each.init
]


@pytest.mark.parametrize(
    ("kind", "name"), DECLARED, ids=[f"{kind.__name__}.{name}" for kind, name in DECLARED]
)
def test_each_declared_parameter_counts(kind, name):
    def facts(**changed):
        value, found = object.__new__(kind), Parameters()
        for each in fields(kind):
            object.__setattr__(value, each.name, changed.get(each.name, 1.0))
        found.add("it", value)
        assert not found.unknown
        return found.facts

    assert first_difference(facts(), facts()) is None
    changed = f"it.{name}: 1.0 in the checkpoint, 2.0 in this run"
    assert first_difference(facts(), facts(**{name: 2.0})) == changed


def facts_of(jointed, *, times=(0.0, 0.1), **changed):
    """Facts of a run of a wall (collective)."""
    model = shaken_wall.wall(jointed, **changed)
    nodes = NodeNumbering(model.V)
    found, unknown = fingerprint(model, model.system(), nodes, {}, (), np.array(times))
    assert not unknown
    return found


def gaps(change):
    return dj.Joints(shaken_wall.LAW, initial_gaps={"joint_1": change})


BODIES = {
    "degree": 2,
    "plane": "stress",
    "extra_stiffness": lambda u, v: 1e9 * ufl.inner(u, v) * ufl.dx,
    "extra_mass": lambda u, v: 10.0 * ufl.inner(u, v) * ufl.dx,
    "extra_damping": lambda u, v: 1e3 * ufl.inner(u, v) * ufl.dx,
    "symmetric": False,
    "redistribute_mass": True,
}

# A value of each argument of a model, which differs from that of the wall.
CHANGED = {
    "material": replace(shaken_wall.CONCRETE, young=23e9),
    "joints": replace(shaken_wall.LAW, shear_stiffness=2e11),
    "joints.initial_gaps": gaps(lambda x: 1e-4 * x[:, 2]),
    "joints.quadrature": dj.Joints(shaken_wall.LAW, quadrature="gauss"),
    "supports": [dj.Fixed(group="base", components="xz")],
    "loads": [dj.Gravity(acceleration=(0.0, 0.0, -9.0))],
    "damping": dj.stiffness_proportional(ratio=0.03, frequency=5.0),
    "water": [dj.WestergaardMass(group="y_min", level=15.0)],
    "water.level": dj.ReservoirWaves(group="y_min", level=18.0, length=30.0),
    **{f"body.{name}": dj.Body(**{name: value}) for name, value in BODIES.items()},
}


def test_every_argument_of_a_model_is_changed():
    names = {name.partition(".")[0] for name in CHANGED}
    assert names == inspect.signature(dj.Model).parameters.keys() - {"jointed"}
    for kind in (dj.Joints, dj.Body):
        declared = {f"{kind.__name__.lower()}.{each.name}" for each in fields(kind)}
        assert declared - {"joints.laws"} <= CHANGED.keys()


@pytest.mark.parametrize("name", CHANGED)
def test_each_argument_of_a_model_counts(name, wall_file, read):
    jointed, argument = read(wall_file()), name.partition(".")[0]
    found = first_difference(facts_of(jointed), facts_of(jointed, **{argument: CHANGED[name]}))
    paths = {"joints": "law of joint_1.", "loads": "load Gravity.acceleration", "water": "water"}
    assert found.startswith(paths.get(name, argument if argument == "water" else name))


def test_the_energy_of_a_law_in_ufl_counts(wall_file, read):
    def facts(k):
        stiffness = {"normal_stiffness": 1e11, "shear_stiffness": 1e11}
        law = dj.PotentialJoint(lambda g: k * (g[0] ** 2 + g[1] ** 2 + g[2] ** 2), **stiffness)
        return facts_of(read(wall_file()), joints=law)

    assert first_difference(facts(0.5e11), facts(0.5e11)) is None
    assert first_difference(facts(0.5e11), facts(0.6e11)).startswith("law of joint_1.energy.k: 5")


def test_equal_models_have_equal_facts(wall_file, read):
    """Joints that share one law, and joints with equal laws, have equal facts."""
    names = read(wall_file()).joint_names
    apart = {name: replace(shaken_wall.LAW) for name in names}
    assert first_difference(facts_of(read(wall_file())), facts_of(read(wall_file()))) is None
    other = facts_of(read(wall_file()), joints=apart)
    assert first_difference(facts_of(read(wall_file())), other) is None


def test_another_mesh_is_another_run(wall_file, read):
    finer = facts_of(read(wall_file(divisions=(4, 1, 4))))
    found = first_difference(facts_of(read(wall_file())), finer)
    assert found == "node coordinates: the numbers differ"


OUTSIDE = {
    "initial gaps of the joint points": {"joints": gaps(lambda x: outside() + 0 * x[:, 0])},
    "functions of time": {
        "loads": [
            dj.HydrostaticPressure(group="y_min", level=5.0, factor=lambda t: 1.0 + t * outside())
        ]
    },
    "pattern 1 of the loads": {
        "loads": [dj.FormLoad(form=lambda v: outside() * v[0] * ufl.dx, factor=lambda t: t)]
    },
    "mass matrix": {"body": dj.Body(extra_mass=lambda u, v: outside() * ufl.inner(u, v) * ufl.dx)},
}


def outside():
    """A number that a run cannot find in its functions, as one in a file."""
    return float(os.environ["OUTSIDE"])


@pytest.mark.parametrize("name", OUTSIDE)
def test_values_from_outside_count(name, wall_file, read, monkeypatch):
    def facts(value):
        monkeypatch.setenv("OUTSIDE", value)
        return facts_of(read(wall_file()), **OUTSIDE[name])

    assert first_difference(facts("1e-3"), facts("1e-3")) is None
    assert first_difference(facts("1e-3"), facts("2e-3")) == f"{name}: the numbers differ"


@pytest.mark.parametrize("name", ["loads", "body"])
def test_fields_of_dolfinx_count_by_what_is_assembled_from_them(name, wall_file, read):
    jointed = read(wall_file())
    field = fem.Function(fem.functionspace(jointed.mesh, ("DG", 0)))

    def facts(value):
        field.x.array[:] = value
        load = dj.FormLoad(form=lambda v: field * v[0] * ufl.dx, factor=lambda t: t)
        body = dj.Body(extra_stiffness=lambda u, v: field * ufl.inner(u, v) * ufl.dx)
        return facts_of(jointed, **{name: {"loads": [load], "body": body}[name]})

    matrix = {"loads": "pattern 1 of the loads", "body": "stiffness matrix"}[name]
    assert first_difference(facts(1e6), facts(1e6)) is None
    found = first_difference(facts(1e6), facts(2e6))
    assert found == f"{matrix}: the numbers differ"


def test_a_static_state_depends_on_loads_at_its_time_alone(wall_file, read):
    def facts(times, factor):
        water = dj.JointWater(joint="joint_1", level=15.0, closed=1e4, factor=factor)
        top = dj.Traction(group="y_min", value=(0.0, 1e5, 0.0), factor=factor)
        load = {"JointWater": water, "Traction": top}
        return {
            kind: facts_of(read(wall_file()), loads=[each], times=times)
            for kind, each in load.items()
        }

    static, dynamic = (0.0,), (0.0, 0.1)
    one, later, first = (lambda t: 1.0 + t), (lambda t: 1.0 + 2.0 * t), (lambda t: 2.0 + t)
    for kind, facts_at_zero in facts(static, one).items():
        assert first_difference(facts_at_zero, facts(static, later)[kind]) is None
        assert "at the start" in first_difference(facts_at_zero, facts(static, first)[kind])
        found = first_difference(facts(dynamic, one)[kind], facts(dynamic, later)[kind])
        assert found.endswith(".factor: different")


class PlainLaw:
    """A law of the user, neither a dataclass nor with a text of its own."""

    def __init__(self, of_points):
        self.of_points = of_points

    def backward_euler(self, gap, state):
        return shaken_wall.LAW.backward_euler(gap, state)

    def stored_energy(self, state):
        return np.zeros(len(state.gap))

    def closed_stiffness(self):
        return 1e11, 1e11


@pytest.mark.mpi
def test_arrays_of_a_law_are_compared_on_every_rank(comm, wall_file, read):
    """Each rank holds an array of its points; one number of the last rank is another."""
    last = comm.rank == comm.size - 1
    one, same, other = (
        facts_of(read(wall_file()), joints=PlainLaw(np.array([comm.rank, value if last else 0.0])))
        for value in (1.0, 1.0, 2.0)
    )
    assert first_difference(one, same) is None
    found = first_difference(one, other)
    assert found == (
        "law of joint_1.of_points: different" if last else "laws as each rank holds them: different"
    )


@pytest.mark.mpi
@pytest.mark.parametrize("waves", [True, False])
def test_the_same_on_one_rank_and_on_all(comm, waves, wall_file, read):
    def found(jointed):
        heights = np.linspace(0.0, 20.0, 5)
        water = {"group": "y_min", "level": 18.0}
        swayed = dj.Prescribed(group="base", component="x", value=lambda x, t: 1e-3 * t * x[:, 0])
        model = dj.Model(
            jointed,
            material=shaken_wall.CONCRETE,
            joints=dj.Joints(
                PlainLaw(np.arange(3.0)),
                initial_gaps={"joint_2": lambda x: 1e-4 * np.interp(x[:, 2], heights, heights)},
            ),
            supports=[dj.Fixed(group="base", components="yz"), swayed],
            loads=[
                dj.Gravity(),
                dj.HydrostaticPressure(**water),
                dj.FormLoad(form=lambda v: 1e4 * v[1] * jointed.ds("y_max"), factor=np.sin),
                dj.JointWater(joint="joint_1", level=15.0, closed=lambda x: 1e3 * (20.0 - x[:, 2])),
                dj.Temperature(value=lambda x: x[2], reference=4.0, expansion=1e-5),
            ],
            damping=shaken_wall.DAMPING,
            water=dj.ReservoirWaves(**water, length=30.0) if waves else None,
            body=dj.Body(redistribute_mass=True),
        )
        given = dj.simulation.first_state.nodal_vector(model, "velocity", lambda x: 0.0 * x)
        settings = {"initial velocity": given, "time step": 0.1}
        system = model.system(waves=0.1 if waves else None)
        nodes, times = NodeNumbering(model.V), np.linspace(0.0, 1.0, 5)
        return fingerprint(model, system, nodes, settings, [], times)

    facts, unknown = found(read(wall_file()))
    assert not unknown
    alone, _ = found(read(wall_file(), MPI.COMM_SELF))
    if comm.rank == 0:
        assert first_difference(alone, facts) is None
