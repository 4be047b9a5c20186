# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options with which a mesh file is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from generated_input import answer, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, passed_on
from sentences import one_sentence

pytest.importorskip("dolfinx")

from dolfinx_joints import read_msh

groups = st.sampled_from(("joint_1", "base", "top", "sides", "joint_9", "joint_1+", ""))


@pytest.mark.mpi
@costly()
@given(joints=st.lists(groups, max_size=3) | JUNK)
def test_joints_of_a_mesh_file(blocks_file: Callable[..., Path], comm: Any, joints: Any) -> None:
    path = blocks_file(size=1.0)
    call = one_sentence(passed_on(lambda: read_msh(path, comm, joints=joints)))
    answer("read_msh, joints", call, comm=comm)


@pytest.mark.mpi
@costly()
@given(path=JUNK | st.sampled_from(("no.msh", "/", "/proc", "/dev/null", "/proc/self/mem")))
def test_paths_of_mesh_files(comm: Any, path: Any) -> None:
    call = one_sentence(passed_on(lambda: read_msh(path, comm)))
    assert answer("read_msh, path", call, comm=comm) is None
