# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names of a first script have an example in their docstring, which ``make doctest`` runs."""

import doctest
import inspect
import sys

import pytest
from doctest_folders import ExampleFinder

import dolfinx_joints as dj

NAMES = (
    "read_msh mesh_from_arrays split_mesh Elastic FrictionNoTension frictionless MohrCoulombJoint "
    "RigidJoint ViscousJoint KeyedJoint propose_stiffness stiffness_proportional rayleigh Fixed "
    "Prescribed Spring Gravity Pressure HydrostaticPressure Uplift Body Joints Model modes "
    "Simulation EnergyConsistent Newmark StepControl Motion synthetic_motion read_record Probe "
    "ResultsMonitor FieldMonitor JointForces Checkpoints Results measures.joint_measures write_csv"
)


@pytest.mark.parametrize("name", NAMES.split())
def test_name_has_a_complete_example(name):
    public = dj
    for part in name.split("."):
        public = getattr(public, part)
    text = inspect.getdoc(public)
    _, _, section = text.partition("\n\nExample:\n")
    lines = section.splitlines()
    assert 3 <= len(lines) <= 14
    assert all(line.startswith("    ") for line in lines), "the example ends the docstring"
    examples = doctest.DocTestParser().get_examples(section)
    assert "import dolfinx_joints as dj\n" in [example.source for example in examples]
    assert name.split(".")[-1] in "".join(example.source for example in examples)
    assert examples[-1].want, "the example shows a result"


def test_examples_are_found_by_make_doctest():
    public = [getattr(dj, name) for name in NAMES.split() if "." not in name]
    modules = {owner.__module__ for owner in public}
    tests = [test for name in modules for test in ExampleFinder().find(sys.modules[name])]
    names = {test.name for test in tests if test.examples}
    assert {f"{owner.__module__}.{owner.__name__}" for owner in public} <= names
