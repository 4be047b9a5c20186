# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Demos 05, 06 and 09, joints in forms and solvers of DOLFINx: what they print.

Their own verification runs as well. Forms and B are the same sums, so that displacements differ by
what Newton's method leaves, below 1e-10 of them.
"""

from __future__ import annotations

import contextlib
import io
import re
import runpy
from pathlib import Path

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")
pytest.importorskip("pyvista")

from mpi4py import MPI

from dolfinx_joints.common.mpi import on_root

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
DEMOS = Path(__file__).resolve().parents[2] / "demos"
TOLERANCE = 1e-10
NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?"


@pytest.fixture
def printed(new_path, monkeypatch):
    """``printed(demo)``: what it prints, run in a folder of its own (collective)."""

    def of(demo):
        folder = new_path(demo)
        on_root(COMM, folder.mkdir)
        monkeypatch.chdir(folder)
        with contextlib.redirect_stdout(io.StringIO()) as text:
            runpy.run_path(str(DEMOS / demo))
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


@pytest.mark.skipif(COMM.size > 1, reason="written for one rank")
def test_how_it_works(printed):
    """The formulation written out gives the displacements of the package."""
    text = printed("06_how_it_works.py")
    assert numbers(text, ".*of demo and package differ by ")[0] < 1e-8
    assert Path("how_it_works.png").exists()


def test_own_newton(printed):
    """Any number of ranks finds what one rank printed, and the joint carries the load.

    Differences from the linear solution are those of one rank, to the four digits printed.
    """
    text = printed("09_own_newton.py")
    force, apart = (numbers(text, ".*joint force ")[k::2] for k in (0, 1))
    assert force == pytest.approx([1e2, 1e3, 1e4], rel=1e-9)
    assert apart == pytest.approx([9.156e-4, 9.240e-3, 1.868e-1], rel=1e-3)
