# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Faults of the machine: one sentence each, what was written stays whole, no rank waits."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from dolfinx_joints import Results, ResultsError
from dolfinx_joints.errors import CheckpointError
from dolfinx_joints.file_lock import FileLock
from dolfinx_joints.results_writer import ResultsWriter

WRITER = """
import sys, time
from dolfinx_joints.results_writer import ResultsWriter
writer = ResultsWriter(sys.argv[1], {})
writer.series("run", "u", (), "m", "displacement")
writer.start()
writer.append("run", 0.0, {"u": 1.0})
writer.flush()
print("written", flush=True)
time.sleep(100)
"""


def environment():
    """The variables of this process but those by which MPI knows it."""
    return {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PRTE_"))}


@pytest.fixture
def other_run(tmp_path):
    """A process that writes run.h5, and the file."""
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment()) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"written\n"
        yield process, path
        process.kill()


def test_a_results_file_has_one_writer(other_run):
    process, path = other_run
    sentence = rf"run\.h5 is being written by process {process.pid} on \S+; wait for it, end it"
    with pytest.raises(ResultsError, match=sentence):
        ResultsWriter(path, {}, overwrite=True)
    with pytest.raises(ResultsError, match=sentence):
        ResultsWriter.resume(path, {"run": 1})
    with Results(path) as results:  # readers are welcome, and nothing was harmed
        assert results.series("run", "u").tolist() == [1.0]
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert path.with_name("run.h5.lock").exists()  # the dead one's
    with ResultsWriter.resume(path, {"run": 1}) as writer:
        writer.append("run", 1.0, {"u": 2.0})
    with Results(path) as results:
        assert results.series("run", "u").tolist() == [1.0, 2.0]
    assert sorted(p.name for p in path.parent.iterdir()) == ["run.h5"]


def test_a_lock_is_free_after_its_release(tmp_path):
    path = tmp_path / "run.ckpt"
    first = FileLock(path, CheckpointError)
    with pytest.raises(CheckpointError, match=f"written by process {os.getpid()} on"):
        FileLock(path, CheckpointError)
    first.release()
    with FileLock(path, CheckpointError):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_file_system_without_locks_is_told(tmp_path, monkeypatch):
    def none(file, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.warns(UserWarning, match=r"run\.h5 is on a file system without locks \(No locks"):
        FileLock(tmp_path / "run.h5", ResultsError).release()

    def broken(file, how):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(fcntl, "flock", broken)
    with pytest.raises(ResultsError, match=r"run\.h5 cannot be locked: .*Input/output error"):
        FileLock(tmp_path / "run.h5", ResultsError)


# The kernel refuses files in /proc to everybody, root included.
@pytest.mark.parametrize("name", ["run.h5", "run.ckpt"])
def test_a_folder_that_cannot_be_written_is_named(name):
    with pytest.raises(ResultsError, match=rf"^/proc/{name} cannot be created: .*\.$"):
        ResultsWriter(f"/proc/{name}", {})


FULL = """
import resource, sys
import numpy as np
from dolfinx_joints import ResultsError
from dolfinx_joints.results_writer import ResultsWriter
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    with ResultsWriter(sys.argv[1], {}, flush_interval=0.0) as writer:
        writer.series("run", "u", (1000,), "m", "displacement")
        writer.start()
        for row in range(10_000):
            writer.append("run", float(row), {"u": np.full(1000, float(row))})
except ResultsError as error:
    print(error)
"""


@pytest.mark.parametrize("limit", [2_000_000, 2_100_007, 3_000_001])
def test_what_was_written_before_the_disk_was_full_is_read(tmp_path, limit):
    # A limit of file sizes fails as a full disk does, by an error of the system's write.
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", FULL, str(path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    assert (done.returncode, done.stderr) == (0, "")  # HDF5 has nothing to say when it closes
    assert "run.h5 cannot grow by" in done.stdout
    assert "File too large; what it holds so far is whole." in done.stdout
    with Results(path) as results:
        rows = results.rows("run")
        assert results.status == "failed"
        assert "cannot grow" in results.summary["error"]
        assert results.series("run", "u")[:, 0].tolist() == list(range(rows))
        # 8 kB a row, less the 1 MiB that is kept for HDF5 itself and a chunk of 64 KiB.
        assert rows >= (limit - 2**20) / 8000 - 40
    assert path.stat().st_size <= limit
    with ResultsWriter.resume(path, {"run": rows}) as writer:
        writer.append("run", 1e9, {"u": np.zeros(1000)})


def test_no_room_for_a_new_file_leaves_none(tmp_path):
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", FULL, str(path), "100000"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "run.h5 cannot grow by" in done.stdout
    assert list(tmp_path.iterdir()) == []
