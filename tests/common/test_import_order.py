# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Order of imports where DOLFINx is the wheel from PyPI, which a module of its name stands for."""

import os
import subprocess
import sys

import pytest


@pytest.fixture
def python(tmp_path):
    """Runs code where ``dolfinx_solver`` is there and prints whether h5py was before it."""
    (tmp_path / "dolfinx_solver.py").write_text("import sys\nprint('h5py' in sys.modules)\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])

    def run(code: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
        )

    return run


def test_the_package_loads_h5py_before_dolfinx(python):
    done = python("import dolfinx_joints")
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_the_wrong_order_is_named(python):
    before = "import sys; sys.modules['dolfinx.fem.petsc'] = sys"
    done = python(f"{before}\nimport dolfinx_joints")
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: dolfinx.fem.petsc was imported before h5py")
    assert "put 'import dolfinx_joints' (or 'import h5py') above" in last
    assert python(f"{before}\nimport h5py, dolfinx_joints").stdout == "True\n"
