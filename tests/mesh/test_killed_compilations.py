# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""C files of forms whose compilation was killed are removed, those at work are not."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("dolfinx")

from dolfinx import jit

from dolfinx_joints.mesh.distribution import killed_compilations

pytestmark = pytest.mark.mpi


def test_only_killed_compilations_are_removed(comm, new_path, monkeypatch):
    folder = new_path("fenics")
    monkeypatch.setitem(jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (folder, ""))
    if comm.rank == 0:
        folder.mkdir()
        for name in ("libffcx_killed.c", "libffcx_whole.c", "libffcx_whole.c.cached"):
            (folder / name).touch()
            os.utime(
                folder / name,
                times=(0, time.time() - 2.0 * killed_compilations._LONGEST_GENERATION),
            )
    killed_compilations.remove_killed_compilations(comm)
    assert sorted(path.name for path in folder.iterdir()) == [
        "libffcx_whole.c",
        "libffcx_whole.c.cached",
    ]


def test_files_that_are_compiled_are_waited_for():
    compiler = [sys.executable, "-c", "import time; time.sleep(60)", "libffcx_abc.c"]
    with subprocess.Popen(compiler) as process:
        try:
            named = Path(f"/proc/{process.pid}/cmdline")
            while b"libffcx_abc" not in named.read_bytes():  # empty for a moment after exec
                time.sleep(0.01)
            assert killed_compilations._age_limit("libffcx_abc", 5.0) == float("inf")
            assert (
                killed_compilations._age_limit("libffcx_def", 5.0)
                <= killed_compilations._LONGEST_GENERATION
            )
        finally:
            process.kill()
