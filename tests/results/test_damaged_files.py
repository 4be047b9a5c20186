# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damaged and unfinished HDF5 files: one error message each, and no endless reading."""

import contextlib
import hashlib

import h5py
import numpy as np
import pytest

from dolfinx_joints import Results, ResultsError
from dolfinx_joints.common.errors import CheckpointError
from dolfinx_joints.common.hdf5 import DIGEST_BYTES
from dolfinx_joints.results.overview import describe
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.simulation.checkpoint_file import read_checkpoint, write_checkpoint


def results_file(path):
    with ResultsWriter(path, {"title": "wall"}) as writer:
        writer.static("mesh/nodes", np.zeros((2, 3)), "m", "nodes")
        writer.series("run", "u", (3,), "m", "displacement")
        writer.start()
        writer.append("run", 0.0, {"u": np.ones(3)})
        writer.finish("complete", {})
    return "static/mesh/nodes"


def checkpoint(path):
    write_checkpoint(path, {"memory": {"step": 3}, "state": {"u": np.ones(5)}})
    return "arrays/state/u"


@contextlib.contextmanager
def changing(path):
    """A file to be changed; one with a checksum has that of what it holds afterwards."""
    content = path.read_bytes()
    with_seal = content[-DIGEST_BYTES:] == hashlib.sha256(content[:-DIGEST_BYTES]).digest()
    if with_seal:
        path.write_bytes(content[:-DIGEST_BYTES])
    with h5py.File(path, "r+") as file:
        yield file
    if with_seal:
        sealed(path)


def sealed(path):
    """Give a changed file the checksum it would have if it had been written so."""
    content = path.read_bytes()
    path.write_bytes(content + hashlib.sha256(content).digest())


FILES = {
    "results": (results_file, Results, ResultsError),
    "checkpoint": (checkpoint, read_checkpoint, CheckpointError),
}


def layout(change):
    """A results file with a change of its layout."""

    def write(path):
        results_file(path)
        with h5py.File(path, "r+") as file:
            change(file)

    return write


def replaced(name, value):
    def change(file):
        del file[name]
        file[name] = value

    return layout(change)


def text(value):
    return np.frombuffer(value.encode(), dtype=np.uint8)


DAMAGED = {
    "metadata are no JSON": replaced("metadata", text("{")),
    "status is missing": replaced("status", np.zeros(0)),
    "a group is an array": replaced("streams", np.zeros(3)),
    "a stream without time": layout(lambda file: file.__delitem__("streams/run/time")),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_results_file_gets_one_message(damage, tmp_path):
    path = tmp_path / "given.h5"
    DAMAGED[damage](path)
    with pytest.raises(ResultsError, match=r"^[^\n]*given\.h5 is [^\n]*\.$"):
        describe(path)


def test_times_that_go_back_are_reported(tmp_path):
    path = tmp_path / "given.h5"
    results_file(path)
    with ResultsWriter.resume(path, {"run": 1}) as writer:
        for row in range(1, 4):
            writer.append("run", float(row), {"u": np.ones(3)})
    for wrong in (np.nan, 0.5):
        with h5py.File(path, "r+") as file:
            file["streams/run/time"][2] = wrong
        with (
            Results(path) as results,
            pytest.raises(ResultsError, match="the times of the stream 'run' do not increase"),
        ):
            results.time("run")


def left_open(path):
    """A results file as a killed run leaves it: HDF5 believes that it is being written."""
    with ResultsWriter(path, {"title": "wall"}) as writer:
        writer.static("mesh/nodes", np.zeros((2, 3)), "m", "nodes")
        writer.start()
        writer.to_disk()
        return path.read_bytes()


def test_a_damaged_file_of_a_killed_run_is_read_to_an_end(tmp_path):
    # HDF5 by itself would try 100 times, each after twice the time: longer than anybody waits.
    path = tmp_path / "given.h5"
    content = bytearray(left_open(path))
    path.write_bytes(content)
    with Results(path) as results:
        assert results.status == "running"
    content[content.index(b"OHDR", content.index(b"OHDR") + 1) + 8] ^= 1
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=r"given\.h5 (is damaged|cannot be read)"):
        describe(path)


@pytest.mark.parametrize("kind", ["results", "checkpoint"])
def test_texts_without_a_checksum_are_errors(kind, tmp_path):
    # HDF5 keeps texts of variable length in a heap, and reads one whose size is 0 for ever.
    write, read, error = FILES[kind]
    path = tmp_path / "given.h5"
    write(path)
    with changing(path) as file:
        file.attrs["format"] = file.attrs["format"].decode()
    with pytest.raises(error, match="the attribute 'format' is neither a text of fixed length"):
        read(path)


def test_hdf5_of_an_older_kind_is_an_error(tmp_path):
    # Its metadata have no checksums; one wrong byte can let HDF5 read for ever.
    path = tmp_path / "given.h5"
    with h5py.File(path, "w", libver="earliest") as file:
        file.attrs["format"] = np.bytes_("dolfinx_joints results")
    with pytest.raises(ResultsError, match="an HDF5 file of another program.*version 0"):
        Results(path)


def test_a_truncated_results_file_is_refused(tmp_path):
    whole, torn = tmp_path / "whole.h5", tmp_path / "torn.h5"
    with ResultsWriter(whole, {}) as writer:
        writer.series("run", "u", (1000,), "m", "displacement")
        writer.start()
        for step in range(20):
            writer.append("run", float(step), {"u": np.arange(1000.0)})
        writer.finish("complete", {})
    size = whole.stat().st_size
    for length in (10, 35, 36, size // 2, size - 1):
        torn.write_bytes(whole.read_bytes()[:length])
        with pytest.raises(ResultsError, match=f"is truncated: it has {length} "):
            Results(torn)


def test_a_truncated_copy_of_a_growing_file_is_refused(tmp_path):
    grows, torn = tmp_path / "grows.h5", tmp_path / "torn.h5"
    with ResultsWriter(grows, {}, flush_interval=0.0) as writer:
        writer.series("run", "u", (1000,), "m", "displacement")
        writer.start()
        for step in range(20):
            writer.append("run", float(step), {"u": np.arange(1000.0)})
            with Results(grows) as results:
                assert results.rows("run") == step + 1
        content = grows.read_bytes()
    assert content[11]  # marked as open
    end = int.from_bytes(content[28:36], "little")  # room that HDF5 has not used yet follows
    for length in (20, 200, 2000, end // 2, end - 1):
        torn.write_bytes(content[:length])
        with pytest.raises(ResultsError, match=f"is truncated: it has {length} "):
            Results(torn)
