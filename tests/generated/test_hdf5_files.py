# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files, mode files, checkpoints and study tables: changed bytes and changed contents.

Reading them ends, with what they hold or with one sentence. Changed bytes are those of whole files,
of files that a killed run has left open, and, where a checksum would find them, behind a checksum
that is right all the same.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from generated_input import answer, cheap
from hypothesis import given, note
from mutations import SEEDS, TOKENS, changed_bytes
from test_damaged_files import SECRET, changing, checkpoint, modes_file, sealed, table

from dolfinx_joints.simulation.checkpoint_file import read_checkpoint
from dolfinx_joints.common.errors import CheckpointError, ResultsError, StudyError
from dolfinx_joints.common.hdf5 import DIGEST_BYTES
from dolfinx_joints.results.reader import Results, describe
from dolfinx_joints.results.overview import overview
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.study_table import read_table
from dolfinx_joints.postprocessing.csv_tables import tables_of


def results(path: Path) -> None:
    """A run with a point and a joint."""
    law = {"kind": "FrictionNoTension", "friction_angle_deg": 30.0, "cohesion": 0.0}
    manifest = {"versions": {"numpy": "2"}, "joint_laws": {"joint_1": "one"}, "command": ["a"]}
    told = {"point_names": ["crest"], "laws": {"joint_1": law}, "steps": 3, "manifest": manifest}
    with ResultsWriter(path, told) as writer:
        writer.static("histories/points", np.ones((1, 3)), "m", "points")
        writer.static("joints/joint_1/points", np.zeros((2, 3)), "m", "points")
        writer.series("histories", "displacement", (1, 3), "m", "displacement")
        writer.series("states", "joints/joint_1/gap", (2, 3), "m", "gap")
        writer.start()
        for row in range(3):
            writer.append("histories", 0.1 * row, {"displacement": np.full((1, 3), row)})
            writer.append("states", 0.1 * row, {"joints/joint_1/gap": np.zeros((2, 3))})
        writer.finish("complete", {"seconds": {"steps": 1.5}, "iterations": 7})


def read_arrays(path: Path) -> None:
    """All that a results file can be asked for without knowing what run it is of."""
    with Results(path) as opened:
        for name in opened.statics:
            opened.static(name)
        for stream, names in opened.streams.items():
            rows = opened.rows(stream)
            assert len(opened.time(stream)) == rows
            for name in names:
                assert len(opened.series(stream, name)) == rows
        for joint in opened.joints:
            opened.law(joint)


def read_tables(path: Path) -> None:
    with Results(path) as opened:
        tables_of(opened)


def read_results(path: Path, seed: int) -> None:
    """One of what reads results files."""
    (describe, overview, read_arrays, read_tables)[seed // 8 % 4](path)


class Kind(NamedTuple):
    """A kind of file: what writes it, what reads it, and how that refuses it."""

    write: Callable[[Path], Any]
    read: Callable[[Path, int], Any]
    error: type[Exception]


KINDS = {
    "results file": Kind(results, read_results, ResultsError),
    "mode file": Kind(modes_file, read_results, ResultsError),
    "checkpoint": Kind(
        checkpoint, lambda path, _: read_checkpoint(path, ("memory",)), CheckpointError
    ),
    "study table": Kind(table, lambda path, _: read_table(path), StudyError),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hdf5")
    with h5py.File(made / SECRET, "w") as file:
        file["x"] = np.arange(4.0)
    return made


@pytest.fixture(scope="module")
def good(folder: Path) -> Callable[[str], bytes]:
    """What a good file of a kind holds."""
    contents = {}
    for kind, each in KINDS.items():
        each.write(folder / "good.h5")
        contents[kind] = (folder / "good.h5").read_bytes()
        (folder / "good.h5").unlink()
    return lambda kind: contents[kind]


def without_zeros(seed: int, content: bytes) -> bytes:
    """A file changed where it holds something: most of a results file is room for its summary."""
    blocks = [content[i : i + 64] for i in range(0, len(content), 64)]
    told = [i for i, block in enumerate(blocks) if any(block)]
    changed = changed_bytes(seed, b"".join(blocks[i] for i in told))
    for place, i in enumerate(told):
        blocks[i] = changed[64 * place : 64 * place + 64]
    blocks.append(changed[64 * len(told) :])
    return b"".join(blocks)


@pytest.mark.parametrize("kind", KINDS)
@cheap()
@given(seed=SEEDS)
def test_changed_bytes(folder: Path, good: Callable[[str], bytes], kind: str, seed: int) -> None:
    path, content = folder / "FILE.h5", good(kind)
    if KINDS[kind].error is ResultsError:
        path.write_bytes(without_zeros(seed, content))
    elif seed % 8 == 0:
        path.write_bytes(changed_bytes(seed, content))
    else:
        path.write_bytes(changed_bytes(seed, content[:-DIGEST_BYTES]))
        sealed(path)
    answer(f"{kind}, changed bytes", lambda: KINDS[kind].read(path, seed), KINDS[kind].error)


HOSTILE: tuple[Callable[[h5py.Group, str, Path], Any], ...] = (
    lambda group, name, folder: group.__setitem__(name, h5py.ExternalLink(folder / SECRET, "/x")),
    lambda group, name, folder: group.__setitem__(name, h5py.SoftLink(name)),
    lambda group, name, folder: group.__setitem__(name, h5py.SoftLink("/")),
    lambda group, name, folder: group.__setitem__(name, group.file["/"]),
    lambda group, name, folder: group.__setitem__(name, group),
    lambda group, name, folder: group.create_group(name),
    lambda group, name, folder: group.create_group(name + "/x/" * 20),
    lambda group, name, folder: group.__setitem__(name, np.dtype("f8")),
    lambda group, name, folder: group.create_dataset(name, shape=(10**13,), chunks=(9,)),
    lambda group, name, folder: group.create_dataset(name, shape=(2**40, 2**18, 3), dtype="u1"),
    lambda group, name, folder: group.create_dataset(
        name, shape=(4,), dtype=float, external=[(str(folder / SECRET), 0, 32)]
    ),
    lambda group, name, folder: group.create_dataset(name, data=np.zeros(99), compression="gzip"),
    lambda group, name, folder: group.create_dataset(name, shape=(2,), dtype=h5py.ref_dtype),
    lambda group, name, folder: group.create_dataset(name, shape=(2,), dtype=h5py.vlen_dtype(int)),
    lambda group, name, folder: group.create_dataset(name, shape=(2,), dtype=h5py.string_dtype()),
    lambda group, name, folder: group.create_dataset(name, data=h5py.Empty("f8")),
)
VALUES = (
    *(1.0, np.nan, True, b"text", np.bytes_(b"\xff" * 16), np.uint64(2**64 - 1), 1j, 10**12),
    *(
        np.zeros(0),
        np.zeros((0, 3)),
        np.zeros((2, 2)),
        np.full(3, np.nan),
        np.array([2.0, 1.0, 3.0]),
    ),
    *(np.zeros(3, "f4,i8"), np.array([b"running"]), np.array([b"\xff\xfe"]), np.zeros((1,) * 20)),
    *(np.full(4, 255, np.uint8), np.zeros((3, 1, 3), ">f4"), np.float16([1, 2, 3]), np.int8([1])),
)
JSON = (
    *('{"laws": 3}', '{"laws": {"joint_1": []}}', '{"point_names": 1}', '{"point_names": {}}'),
    *(
        '{"manifest": []}',
        '{"manifest": {"joint_laws": 1}}',
        '{"seconds": 1}',
        '{"iterations": {}}',
    ),
    *(
        '{"seconds": {"a": "b"}}',
        '{"a": NaN}',
        '{"a": 1e999}',
        "[" * 5000,
        "null",
        '"a"',
        "{",
        "{}",
    ),
    *('{"state": {"u": 1}}', '{"state": 1}', '{"memory": 1}', '["case"]', '["case", "x", "y"]'),
    *('{"laws": {"joint_1": {"kind": 1, "friction_angle_deg": "", "cohesion": 0}}}', "[1, [2]]"),
    *('["../case"]', '["/"]', '["."]', '[""]', '{"error": {"a": [1]}, "steps": null}', "\x00"),
)


def change(file: h5py.File, rng: random.Random, folder: Path) -> None:
    """Change one thing of an open file: a name, an attribute, a value, a text."""
    names: list[str] = ["/"]
    file.visit(names.append)
    name = rng.choice(names[1:])
    above, last = file[name].parent, name.rpartition("/")[2]
    match rng.randrange(7):
        case 0:
            del above[last]
        case 1 | 2:
            del above[last]
            rng.choice(HOSTILE)(above, last, folder)
        case 3:
            del above[last]
            above[last] = rng.choice(VALUES)
        case 4:
            texts = [one for one in ("metadata", "summary", "facts", "names") if one in file]
            key = rng.choice(texts or ["facts"])
            if texts:
                del file[key]
            file[key] = np.frombuffer(rng.choice((*JSON, *JSON, *TOKENS)).encode(), np.uint8)
        case 5:
            item = file[rng.choice(names)]
            key = rng.choice((*item.attrs, "format", "version", "unit", "created"))
            if key in item.attrs:
                del item.attrs[key]
            if rng.random() < 0.8:
                item.attrs[key] = rng.choice((*VALUES[:12], "text", h5py.Empty("f8"), file.ref))
        case _:
            rng.choice(HOSTILE)(above, f"new_{rng.randrange(10**9)}", folder)


@pytest.mark.parametrize("kind", KINDS)
@cheap()
@given(seed=SEEDS)
def test_changed_contents(folder: Path, good: Callable[[str], bytes], kind: str, seed: int) -> None:
    path, rng = folder / "FILE.h5", random.Random(seed)
    path.write_bytes(good(kind))
    with changing(path) as file:
        for _ in range(rng.choice((1, 1, 2))):
            change(file, rng, folder)
        note(repr(list(file)))
    answer(f"{kind}, changed contents", lambda: KINDS[kind].read(path, seed), KINDS[kind].error)
