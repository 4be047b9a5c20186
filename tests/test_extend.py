# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Listings of the guide's page on extensions: a law, a load, an output quantity, a mesh reader."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("h5py")

from mpi4py import MPI

import ufl

import dolfinx_joints as dj

PROJECT = Path(__file__).resolve().parents[1]
PAGE = PROJECT / "docs" / "guide" / "extend.md"
STIFFNESS = 1e10  # normal stiffness of the joint [Pa/m]
# Two squares of 1 m, one on the other; the nodes of each cell run around it.
MESH = """\
node 0 0
node 1 0
node 0 1
node 1 1
node 0 2
node 1 2
quad 0 1 3 2
quad 2 3 5 4
base 0 1
joint 2 3
top 4 5
"""


def listings() -> list[str]:
    """Return the Python listings of the page in their order."""
    return re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), flags=re.M | re.S)


def run_listings() -> ModuleType:
    """Run the listings, except for the row of the table, and return the module they define."""
    module = ModuleType("extend_page")
    module.__dict__.update(np=np, ufl=ufl, MPI=MPI, dj=dj, comm=MPI.COMM_WORLD)
    sys.modules[module.__name__] = module  # dataclasses look their module up
    for listing in listings():
        if not listing.startswith("Q("):
            exec(listing, module.__dict__)
    return module


@pytest.fixture(scope="module")
def page():
    yield run_listings()
    del sys.modules["extend_page"]


@pytest.fixture
def jointed(page, tmp_path):
    path = tmp_path / "two_squares.txt"
    path.write_text(MESH)
    return page.read_lines(path, MPI.COMM_WORLD)


def model_of(jointed, loads, law):
    return dj.Model(
        jointed,
        material=dj.Elastic(young=30e9, poisson=0.0, density=2400.0),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=loads,
    )


def test_the_reader_finds_groups_and_joint(jointed):
    assert jointed.joint_names == ("joint",)
    assert sorted(jointed.facet_groups) == ["base", "top"]
    assert jointed.mesh.topology.index_map(2).size_global == 2


@pytest.mark.parametrize("force", [-3e6, 3e6])
def test_law_and_load(page, jointed, force):
    """Compare traction and gap of the joint with a spring, in pressure and in tension."""
    law = page.Bonded(normal_stiffness=STIFFNESS, shear_stiffness=0.4 * STIFFNESS)
    model = model_of(jointed, [page.SpreadForce(group="top", force=(0.0, force))], law)
    simulation = dj.Simulation(model)
    state = simulation.statics()
    np.testing.assert_allclose(state.joints.traction[:, 0], force, rtol=1e-9)
    np.testing.assert_allclose(state.joints.state.gap[:, 0], force / STIFFNESS, rtol=1e-9)
    assert list(state.energy.input_by_load) == ["SpreadForce_top"]
    outcome = simulation.dynamics(dt=1e-3, steps=3)  # at rest: the static state lasts
    np.testing.assert_allclose(outcome.state.joints.traction[:, 0], force, rtol=1e-6)
    assert outcome.laws_without_losses == ("Bonded",)


def test_every_group_of_a_load_is_checked(page, jointed):
    law = page.Bonded(normal_stiffness=STIFFNESS, shear_stiffness=0.4 * STIFFNESS)
    with pytest.raises(dj.JointsError, match="crest"):
        model_of(jointed, [page.SpreadForce(group="crest", force=(0.0, 1.0))], law)


def test_a_new_row_is_in_files_and_tables(tmp_path):
    """Put the row into the table, in a separate process, and read its values back."""
    (tmp_path / "two_squares.txt").write_text(MESH)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(PROJECT), *sys.path])}
    subprocess.run(
        [sys.executable, __file__], cwd=tmp_path, env=environment, check=True, timeout=300
    )


def with_row(row: str) -> None:
    """Load the table of quantities with one more row of the stream ``joints``."""
    name = "dolfinx_joints.results.quantities"
    spec = importlib.util.find_spec(name)
    source = Path(spec.origin).read_text("utf-8")
    begin = '    "joints": (\n'
    assert source.count(begin) == 1
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    exec(
        compile(source.replace(begin, f"{begin}        {row.strip()},\n"), spec.origin, "exec"),
        module.__dict__,
    )


def run_with_row() -> None:
    """Shear the upper square, and compare the new quantity with the integral of the shear."""
    (row,) = (listing for listing in listings() if listing.startswith("Q("))
    with_row(row)
    page = run_listings()
    law = page.Bonded(normal_stiffness=STIFFNESS, shear_stiffness=0.4 * STIFFNESS)
    loads = [page.SpreadForce(group="top", force=(2e6, -3e6))]
    model = model_of(page.read_lines("two_squares.txt", MPI.COMM_WORLD), loads, law)
    monitor = dj.ResultsMonitor("run.h5", points={"top": (1.0, 2.0)})
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=1e-3, steps=3)
    with dj.Results("run.h5") as results:
        mean = results.series("joints", "joint/mean_shear")
        np.testing.assert_allclose(mean, 2e6, rtol=1e-6)
        np.testing.assert_allclose(mean, results.series("joints", "joint/shear_sum"), rtol=1e-12)
        assert results.unit("joints", "joint/mean_shear") == "Pa"
        dj.write_csv(results, "tables")
        assert "mean_shear_max" in dj.measures.joint_measures(results)["joint"]
    assert "mean shear" in "".join(path.read_text() for path in Path("tables").glob("*.csv"))


if __name__ == "__main__":
    run_with_row()
