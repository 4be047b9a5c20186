# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A folder in which no input may leave anything, short meshes, and results to ask for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from runs import write_run

# Fewer than a mesh may have, as each is to take a moment only.
MAX_CELLS = 2000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The working folder, empty before and after."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The results of a small run."""
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    from dolfinx_joints.results.reader import Results

    with Results(write_run(tmp_path_factory.mktemp("run"), MPI.COMM_SELF)) as opened:
        yield opened


@pytest.fixture
def small_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse meshes that would take long."""
    _checks = pytest.importorskip("geometry._checks")
    monkeypatch.setattr(_checks, "MAX_CELLS", MAX_CELLS)
