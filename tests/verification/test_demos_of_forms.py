# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Demos 05 and 06, joints by interior-facet integrals: what they print, and other numbers of ranks.

Their own verification runs as well. Forms and B are the same sums, so that displacements differ by
what Newton's method leaves, below 1e-10 of them.
"""

from __future__ import annotations

import contextlib
import io
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")
pytest.importorskip("pyvista")

from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from studies import ambiesta

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
DEMOS = Path(__file__).resolve().parents[2] / "demos"
STEPS = 20
TOLERANCE = 1e-10
NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?"


@pytest.fixture
def printed(new_path, monkeypatch):
    """``printed(demo, *arguments)``: what it prints, run in a folder of its own (collective)."""

    def of(demo, *arguments):
        folder = new_path(demo)
        on_root(COMM, folder.mkdir)
        monkeypatch.chdir(folder)
        with contextlib.redirect_stdout(io.StringIO()) as text:
            names = runpy.run_path(str(DEMOS / demo))
            if arguments:
                names["main"](arguments)
        return COMM.bcast(text.getvalue())

    return of


def numbers(text, line):
    """Numbers in the lines that a pattern finds, after it."""
    found = re.findall(rf"^{line}(.*)$", text, re.M)
    assert found, line
    return [float(number) for rest in found for number in re.findall(NUMBER, rest)]


def test_a_law_in_ufl(printed):
    """The bond by forms and by B; UFL's own measure finds nothing between the faces."""
    text = printed("05_joint_law_in_ufl.py")
    assert numbers(text, "displacements by forms and by B differ by ")[0] < TOLERANCE
    by_operator, by_forms = (numbers(text, f".*by {name}.*: ")[0] for name in ("B", "JointedMesh"))
    assert by_forms == pytest.approx(by_operator, rel=1e-12)
    if COMM.size == 1:  # on several ranks DOLFINx refuses ufl.dS
        assert abs(numbers(text, ".*by UFL's dS.*: ")[0]) < 1e-12 * abs(by_operator)
    assert 0.0 < numbers(text, "past the strength of 0.5 MPa: ")[0] < 100.0


def test_the_dam_by_forms(printed, new_path):
    """Three solvers, the law at the points, the paper's energy errors; one rank and several."""
    text = printed("06_dam_by_forms.py", "--steps", str(STEPS))
    for solver in ("monolithic", "condensed"):
        assert numbers(text, rf"{solver} .* off by ")[0] < TOLERANCE
    assert numbers(text, ".*ratio of sliding ones off tan 30° by ")[0] < 1e-12
    linear, joints = numbers(text, r"  energy error / largest energy \[%\]: ")[::2]
    assert linear < 2.0
    assert joints < 4.0
    moved = numbers(text, "largest displacement of a node: ")[0]
    with dj.Results("output/06_dam_by_forms/forms/joints.h5") as here, alone(new_path) as single:
        assert here.rows("states") == 1 + STEPS // ambiesta.STATE_INTERVAL
        tractions = [f"joints/{joint}/traction" for joint in here.joints]
        for names in (["displacement"], tractions):
            found, expected = (
                np.concatenate([file.series("states", name) for name in names], axis=1)
                for file in (here, single)
            )
            assert np.abs(found - expected).max() <= TOLERANCE * np.abs(expected).max()
        u = single.series("states", "displacement")
    assert moved == pytest.approx(1e3 * np.linalg.norm(u, axis=2).max(), rel=TOLERANCE)


def alone(new_path):
    """Results of the same run of each rank for itself."""
    case = ambiesta.Case(size=8.0, order=1, steps=STEPS, scheme="newmark")
    mesh = ambiesta.make_mesh(case, new_path("mesh"))
    own = new_path(f"alone_{COMM.rank}")
    own.mkdir()
    model = ambiesta.build(case, "joints", mesh, MPI.COMM_SELF)
    return dj.Results(ambiesta.simulate(case, "joints", model, own, solver="forms").results)
