# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""HDF5 files of others: nothing outside them is read, nothing larger than them is made room for."""

from __future__ import annotations

import contextlib
import hashlib
import pickle

import h5py
import numpy as np
import pytest

from dolfinx_joints import Results, ResultsError
from dolfinx_joints.cli import main
from dolfinx_joints.common.errors import CheckpointError
from dolfinx_joints.common.hdf5 import DIGEST_BYTES
from dolfinx_joints.results.overview import describe
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.simulation.checkpoint_file import read_checkpoint, write_checkpoint

SECRET = "secret.h5"


def results_file(path):
    with ResultsWriter(path, {"title": "wall"}) as writer:
        writer.static("mesh/nodes", np.zeros((2, 3)), "m", "nodes")
        writer.series("run", "u", (3,), "m", "displacement")
        writer.start()
        writer.append("run", 0.0, {"u": np.ones(3)})
        writer.finish("complete", {})
    return "static/mesh/nodes"


def modes_file(path):
    with ResultsWriter(path, {"stage": "modes", "modes": 2}) as writer:
        writer.static("mesh/nodes", np.zeros((4, 3)), "m", "nodes")
        writer.static("modes/frequency", np.array([1.0, 2.0]), "Hz", "frequencies")
        writer.static("modes/shape", np.ones((2, 4, 3)), "kg^-1/2", "shapes")
        writer.static("modes/participation", np.ones((2, 3)), "kg^1/2", "factors")
        writer.start()
        writer.finish("complete", {})
    return "static/modes/shape"


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


DOORS = {
    "results": (results_file, Results, ResultsError),
    "checkpoint": (checkpoint, read_checkpoint, CheckpointError),
}


def external_link(file, name, folder):
    file[name] = h5py.ExternalLink(str(folder / SECRET), "/x")


def soft_link(file, name, folder):
    file[name] = h5py.SoftLink("/elsewhere")


def virtual(file, name, folder):
    layout = h5py.VirtualLayout(shape=(4,), dtype=float)
    layout[:] = h5py.VirtualSource(folder / SECRET, "x", shape=(4,))
    file.create_virtual_dataset(name, layout)


def raw_data_elsewhere(file, name, folder):
    file.create_dataset(name, shape=(4,), dtype=float, external=[(str(folder / SECRET), 0, 32)])


def terabytes(file, name, folder):
    file.create_dataset(name, shape=(10**12,), dtype=float, chunks=(1024,))


def a_huge_chunk(file, name, folder):
    file.create_dataset(name, shape=(1,), maxshape=(None,), dtype="u1", chunks=(2**31,))


def packed(file, name, folder):
    file.create_dataset(name, data=np.zeros(10**6), compression="gzip")


def pickled(file, name, folder):
    kind = h5py.vlen_dtype(np.uint8)
    file.create_dataset(name, shape=(1,), dtype=kind)[0] = np.frombuffer(
        pickle.dumps(["never loaded"]), dtype=np.uint8
    )


def references(file, name, folder):
    file.create_dataset(name, shape=(1,), dtype=h5py.ref_dtype)


def records(file, name, folder):
    file[name] = np.zeros(3, dtype=[("a", float), ("b", int)])


def empty(file, name, folder):
    file[name] = h5py.Empty("f8")


def nested(file, name, folder):
    file[name + "/x" * 50] = 1.0


def a_ring_of_groups(file, name, folder):
    file[name] = file["/"]


SENTENCES = {
    external_link: "is a link that could lead elsewhere",
    soft_link: "is a link that could lead elsewhere",
    virtual: "takes its values from other files",
    raw_data_elsewhere: "takes its values from other files",
    terabytes: r"claims 8e\+12 bytes, more than the file can hold",
    a_huge_chunk: r"claims 2\.15e\+09 bytes, more than the file can hold",
    packed: "is packed by a filter",
    pickled: "holds object, not plain numbers",
    references: "holds object, not plain numbers",
    records: "holds .*, not plain numbers",
    empty: "is empty",
    nested: "groups are nested more than 8 deep",
    a_ring_of_groups: "groups are nested more than 8 deep",
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("change", SENTENCES, ids=lambda change: change.__name__)
def test_what_leads_out_of_a_file_is_refused(door, change, tmp_path):
    write, read, error = DOORS[door]
    with h5py.File(tmp_path / SECRET, "w") as file:
        file["x"] = np.arange(4.0)
    path = tmp_path / "given.h5"
    name = write(path)
    with changing(path) as file:
        del file[name]
        change(file, name, tmp_path)
    with pytest.raises(error, match=rf"given\.h5 is refused: .*{SENTENCES[change]}.*\.$"):
        read(path)


@pytest.mark.parametrize("door", DOORS)
def test_more_names_than_any_file_has_are_refused(door, tmp_path, monkeypatch):
    write, read, error = DOORS[door]
    write(tmp_path / "given.h5")
    read(tmp_path / "given.h5")
    monkeypatch.setattr("dolfinx_joints.common.hdf5._NAMES", 0)
    with pytest.raises(error, match=r"given\.h5 is refused: it has more than 0 names\.$"):
        read(tmp_path / "given.h5")


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


def attribute(name, key, value):
    return layout(lambda file: file[name].attrs.__setitem__(key, value))


def text(value):
    return np.frombuffer(value.encode(), dtype=np.uint8)


DAMAGED = {
    "metadata are no JSON": replaced("metadata", text("{")),
    "status is missing": replaced("status", np.zeros(0)),
    "version is a text": attribute("/", "version", "one"),
    "unit is a number": attribute("static/mesh/nodes", "unit", 1.0),
    "a group is an array": replaced("streams", np.zeros(3)),
    "a stream without time": layout(lambda file: file.__delitem__("streams/run/time")),
    "time is a table": replaced("streams/run/time", np.zeros((2, 2))),
    "a series is a number": replaced("streams/run/u", 1.0),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_results_file_gets_one_sentence(damage, tmp_path):
    path = tmp_path / "given.h5"
    DAMAGED[damage](path)
    with pytest.raises(ResultsError, match=r"^[^\n]*given\.h5 is [^\n]*\.$"):
        describe(path)


def test_times_that_go_back_are_told(tmp_path):
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


@pytest.mark.parametrize("seed", range(40))
def test_random_bytes_in_a_checkpoint_do_no_harm(seed, tmp_path):
    # The checksum is right each time, so that HDF5 itself is asked.
    random = np.random.default_rng(seed)
    path = tmp_path / "run.ckpt"
    checkpoint(path)
    content = bytearray(path.read_bytes()[:-32])
    for place in random.integers(0, len(content), 3):
        content[place] = random.integers(0, 256)
    path.write_bytes(content)
    sealed(path)
    with contextlib.suppress(CheckpointError):
        read_checkpoint(path, ("memory",))


def test_a_report_on_a_file_of_other_shapes_is_one_sentence(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("plotly")
    path = tmp_path / "given.h5"
    with ResultsWriter(path, {"point_names": ["a"]}) as writer:
        writer.static("histories/points", np.zeros((1, 3)), "m", "points")
        # Displacements of points have a row for each point.
        writer.series("histories", "displacement", (), "m", "displacement")
        writer.start()
        for row in range(3):
            writer.append("histories", float(row), {"displacement": 0.0})
        writer.finish("complete", {})
    assert main(["report", str(path), "--out", str(tmp_path / "r.html"), "--no-3d"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("dolfinx-joints: ")
    assert "r.html cannot be made of what the files hold: " in told
    assert told.count("\n") == 1
    assert not (tmp_path / "r.html").exists()


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
        Results(path)


@pytest.mark.parametrize("door", ["results", "checkpoint"])
def test_texts_without_a_checksum_are_refused(door, tmp_path):
    # HDF5 keeps texts of variable length in a heap, and reads one whose size is 0 for ever.
    write, read, error = DOORS[door]
    path = tmp_path / "given.h5"
    write(path)
    with changing(path) as file:
        file.attrs["format"] = file.attrs["format"].decode()
    with pytest.raises(error, match="the attribute 'format' is no text of fixed length and no"):
        read(path)


def test_hdf5_of_an_older_kind_is_refused(tmp_path):
    # Its metadata have no checksums; one wrong byte can let HDF5 read for ever.
    path = tmp_path / "given.h5"
    with h5py.File(path, "w", libver="earliest") as file:
        file.attrs["format"] = np.bytes_("dolfinx_joints results")
    with pytest.raises(ResultsError, match="HDF5 but not a file of this program.*version 0"):
        Results(path)
