# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensitivities with closed forms: a weight on a joint; the map of a joint read back."""

import csv
import io
import re

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import COMM, box
from matplotlib.collections import EllipseCollection
from recorded_blocks import CONCRETE, LAW, blocks, recorded

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY

pytestmark = pytest.mark.mpi
WEIGHTLESS = {"poisson": 0.0, "density": 2400.0}
GAP = 2e-5


def statics(model, tape):
    dj.Simulation(model, monitors=[tape]).statics()


def parametric():
    """Return two blocks whose upper one weighs rho g on a joint with the stiffness k_n."""

    def build(values):
        law = dj.FrictionNoTension(
            normal_stiffness=values["k_n"], shear_stiffness=3e9, friction_coefficient=0.5
        )
        material = dj.Elastic(young=24e9, poisson=0.0, density=values["rho"])
        force = dj.Pressure(group="right", value=values["push"])
        return blocks(law, material=material, loads=[dj.Gravity(), force])

    stiffness = dj.Parameter(value=5e9, deviation=1e9, unit="Pa/m")
    density = dj.Parameter(value=2400.0, deviation=50.0, unit="kg/m^3")
    push = dj.Parameter(value=0.0, deviation=1.0, unit="Pa")
    return dj.ParametricModel(build, {"k_n": stiffness, "rho": density, "push": push})


def rows_of(sensitivity):
    return {(row["parameter"], row["joint"]): row for row in sensitivity.table}


def test_weight_on_a_joint():
    """Compare with the gap g0 - W / (k_n A): 1 % of k_n, weight or density is 1 % of W / (k_n A).

    The initial gap of zero has no per cent.
    """
    made = parametric()
    tape = recorded(statics, made.model(), body=True)
    gradient = dj.gradient_of(tape, dj.Quantity.at_end("middle", 0), made)
    sensitivity = dj.sensitivity(gradient, unit="m")
    change = 0.01 * 2400.0 * STANDARD_GRAVITY * 1.0 / 5e9
    rows = rows_of(sensitivity)
    expected = {
        ("normal_stiffness", "j"): change,
        ("k_n", ""): change,
        ("Gravity", ""): -change,
        ("rho", ""): -change,
    }
    for key, value in expected.items():
        assert rows[key]["per_cent"] == pytest.approx(value, rel=1e-6)
    assert rows["normal_stiffness", "j"]["value"] == 5e9
    assert rows["normal_stiffness", "j"]["unit"] == rows["k_n", ""]["unit"] == "Pa/m"
    assert rows["friction_coefficient", "j"]["unit"] == ""
    for key in (("initial_gap", "j"), ("push", "")):
        assert rows[key]["value"] == 0.0
        assert rows[key]["per_cent"] is None
    assert rows["initial_gap", "j"]["derivative"] == gradient.by_joint["initial_gap"]["j"]
    assert rows["push", ""]["derivative"] == gradient.by_parameter["push"]
    changes = [row["per_cent"] for row in sensitivity.table]
    sizes = [abs(change) for change in changes if change is not None]
    assert sizes == sorted(sizes, reverse=True)
    assert changes[len(sizes) :] == [None, None]
    text = str(sensitivity)
    assert re.search(r"normal_stiffness j +\+4\.707e-08 m per 1 % of 5e\+09 Pa/m", text)
    assert re.search(r"initial_gap j +is zero and has no per cent; the derivative is", text)
    written = io.StringIO()
    csv.DictWriter(written, sensitivity.table[0]).writerows(sensitivity.table)
    assert len(written.getvalue().splitlines()) == len(sensitivity.table)


def test_initial_gaps():
    """Push a block over an open joint: the displacement of its top contains the gap, 1 to 1."""
    soft = dj.Spring(group="top", normal_stiffness=1.0)  # carries the block until the joint closes
    mesh = box(
        (2.0, 2.0), (2, 4), joints={"j": (1, 1.0)}, groups={"base": (1, 0.0), "top": (1, 2.0)}
    )
    model = dj.Model(
        mesh,
        material=dj.Elastic(young=24e9, **WEIGHTLESS),
        joints=dj.Joints(LAW, initial_gaps={"j": GAP}),
        supports=[dj.Fixed(group="base"), soft],
        loads=[dj.Gravity()],
    )
    tape = recorded(statics, model)
    gradient = dj.gradient_of(tape, dj.Quantity.at_end("top", 1))
    row = rows_of(dj.sensitivity(gradient))["initial_gap", "j"]
    assert row["value"] == pytest.approx(GAP)
    assert row["per_cent"] == pytest.approx(-0.01 * GAP, rel=1e-6)


def test_map():
    """Colours under uniform pressure are equal; their integral is the row of the table."""
    size = (2.0, 1.0, 2.0)
    mesh = box(size, (2, 2, 4), joints={"j": (2, 1.0)}, groups={"base": (2, 0.0)})
    model = dj.Model(
        mesh,
        material=dj.Elastic(young=24e9, **WEIGHTLESS),
        joints=LAW,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    tape = dj.Tape(gaps={"gap": "j"})
    statics(model, tape)
    sensitivity = dj.sensitivity(dj.gradient_of(tape, dj.Quantity.at_end("gap", 0)), unit="m")
    figure = sensitivity.map("normal_stiffness")
    areas = model.operator.gather(model.operator.areas)
    assert (figure is None) == (COMM.rank != 0)
    if figure is None:
        return
    panel, bar = figure.axes
    (discs,) = (c for c in panel.collections if isinstance(c, EllipseCollection))
    assert panel.get_title() == "j"
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("s1 [m]", "s2 [m]")
    assert bar.get_ylabel() == "[m/m\N{SUPERSCRIPT TWO}]"
    assert figure.get_suptitle() == "change per 1 % of normal_stiffness and per area"
    offsets = np.array(discs.get_offsets())
    assert len(offsets) == len(areas) == 9
    assert np.ptp(offsets, axis=0) == pytest.approx([2.0, 1.0])
    values = np.array(discs.get_array())
    assert values == pytest.approx(values.mean(), rel=1e-6)
    row = rows_of(sensitivity)["normal_stiffness", "j"]
    assert areas @ values == pytest.approx(row["per_cent"], rel=1e-9)
    low, high = discs.get_clim()
    assert -low == high == pytest.approx(abs(values).max())


def test_wrong_arguments():
    tape = recorded(statics, blocks(dj.frictionless(normal_stiffness=5e9), material=CONCRETE))
    gradient = dj.gradient_of(tape, dj.Quantity.at_end("middle", 0))
    sensitivity = dj.sensitivity(gradient)
    assert "shear_stiffness" not in str(sensitivity)
    for name in ("friction_coefficient", "initial_gap", "Gravity", 3, None):
        with pytest.raises(ValueError, match="is not a joint parameter with a value other than"):
            sensitivity.map(name)
    with pytest.raises(ValueError, match="gradient is .* it must be a Gradient"):
        dj.sensitivity(tape)
    with pytest.raises(ValueError, match="unit is 3"):
        dj.sensitivity(gradient, unit=3)
