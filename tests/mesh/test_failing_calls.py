# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes made inside calls that fail, in a process of its own: without a fix it crashes."""

import subprocess
import sys

import pytest

pytest.importorskip("dolfinx")


IN_A_CALL = """
from mpi4py import MPI
import dolfinx_joints as dj

X = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]

def mesh():
    return dj.mesh_from_arrays(MPI.COMM_SELF, cell="quadrilateral", x=X, cells=[[0, 1, 2, 3]])

for _ in range(2):
    try:
        dj.Model(mesh(), wrong=1)
    except TypeError as error:
        print(error)
print(len(mesh().mesh.geometry.x), "nodes")
"""


def test_a_mesh_made_inside_a_call_that_fails():
    """The message of the failure is shown, and the next mesh can be made."""
    command = [sys.executable, "-c", IN_A_CALL]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    first, second, last = done.stdout.splitlines()
    assert first == second
    assert "unexpected keyword argument 'wrong'" in first
    assert last == "4 nodes"
