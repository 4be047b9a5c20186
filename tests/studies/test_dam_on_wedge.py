# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Study of an arch dam on a wedge: joints of the mesh, and order of the factors of safety."""

from mpi4py import MPI

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import dolfinx_joints as dj
from studies import dam_on_wedge


def test_left_block_stands_on_the_wedge_alone(tmp_path):
    names = dj.read_msh(dam_on_wedge.make_mesh(tmp_path), MPI.COMM_SELF).joint_names
    assert {"joint_fault", "joint_foliation", "joint_dam_4_wedge", "joint_rock_dam_1"} < set(names)
    assert "joint_rock_dam_4" not in names


@pytest.mark.slow
def test_command(tmp_path, capsys):
    """Check the order of the factors of safety: shaking and uplift lower them."""
    dam_on_wedge.main(["--quick", "--out", str(tmp_path)])
    lines = [line.rsplit(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    values = {name.strip(): float(v) for name, v in lines[-10:-1]}
    assert 1.0 < values["safety_min"] < values["safety_static"] < values["F by reduced strength"]
    assert values["F after, full uplift"] < values["F by reduced strength"]
    assert (tmp_path / "dam_on_wedge.png").stat().st_size > 10_000
