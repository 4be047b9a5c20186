# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One malformed HDF5 file of each kind for each reader of such files; see ``bad_files``."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from bad_files import JUNK, Bad, Door
from test_damaged_files import changing, checkpoint, modes_file, results_file, table

from dolfinx_joints.simulation.checkpoint_file import read_checkpoint
from dolfinx_joints.common.errors import CheckpointError, ResultsError, StudyError
from dolfinx_joints.results.reader import describe
from dolfinx_joints.study_table import read_table

HDF5_KINDS = (
    "empty",
    "binary junk",
    "torn",
    "changed bit",
    "another program's HDF5",
    "other version",
    "missing dataset",
    "wrong shape",
    "wrong type",
    "not a number",
    "no JSON",
    "external link",
    "raw data elsewhere",
    "packed",
    "huge",
    "text without a checksum",
)

Change = Callable[[h5py.File], Any]


def removed(name: str) -> Change:
    return lambda file: file.__delitem__(name)


def replaced(name: str, **options: Any) -> Change:
    """An array in the place of another."""

    def change(file: h5py.File) -> None:
        del file[name]
        file.create_dataset(name, **options)

    return change


def text(name: str, content: str) -> Change:
    """Another text in the place of one."""
    return replaced(name, data=np.frombuffer(content.encode(), dtype=np.uint8))


def a_time_that_is_none(file: h5py.File) -> None:
    for name in ("time", "u"):
        file["streams/run"][name].resize(2, axis=0)
    file["streams/run/time"][:] = [np.nan, 1.0]


def linked(name: str) -> Change:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = h5py.ExternalLink("secret.h5", "/x")

    return change


def attribute(key: str, value: Any) -> Change:
    return lambda file: file.attrs.__setitem__(key, value)


class _Maker:
    """What a good file becomes by a change."""

    def __init__(self, write: Callable[[Path], Any], folder: Path) -> None:
        self._good, self._changed = folder / "good.h5", folder / "changed.h5"
        self._good.unlink(missing_ok=True)
        write(self._good)
        self.good = self._good.read_bytes()

    def __call__(self, what: str, change: Change) -> Bad:
        shutil.copyfile(self._good, self._changed)
        with changing(self._changed) as file:
            change(file)
        return Bad(what, self._changed.read_bytes())

    def foreign(self) -> Bad:
        with h5py.File(self._changed, "w") as file:
            file["x"] = 1.0
        return Bad("written by h5py alone", self._changed.read_bytes())

    def with_other_bit(self) -> Bad:
        content = bytearray(self.good)
        content[self.good.index(b"OHDR") + 8] ^= 1
        return Bad("one bit of a header", bytes(content))


def common(maker: _Maker, name: str) -> dict[str, Bad | str]:
    """Kinds that are the same for all files; ``name`` is that of one of its arrays."""
    external = [("secret.bin", 0, 32)]
    return {
        "empty": Bad("no bytes", b""),
        "binary junk": Bad("junk that begins as HDF5 does", JUNK),
        "torn": Bad("its first half", maker.good[: len(maker.good) // 2]),
        "changed bit": maker.with_other_bit(),
        "another program's HDF5": maker.foreign(),
        "other version": maker("version 99", attribute("version", 99)),
        "wrong type": maker(
            f"references in `{name}`", replaced(name, shape=(2,), dtype=h5py.ref_dtype)
        ),
        "external link": maker(f"`{name}` is in another file", linked(name)),
        "raw data elsewhere": maker(
            f"numbers of `{name}` in another file",
            replaced(name, shape=(4,), dtype=float, external=external),
        ),
        "packed": maker(
            f"`{name}` is compressed", replaced(name, data=np.zeros(9), compression="gzip")
        ),
        "huge": maker(
            f"8 TB in `{name}`", replaced(name, shape=(10**12,), dtype=float, chunks=(99,))
        ),
        "text without a checksum": maker(
            "an attribute of variable length", attribute("format", "a text")
        ),
    }


def hdf5_doors() -> Iterator[Door]:
    """Results files, mode files, checkpoints and study tables."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        door = partial(Door, suffix=".h5", kinds=HDF5_KINDS)
        maker = _Maker(results_file, place)
        yield door(
            title="results files",
            error=ResultsError,
            read=describe,
            good=maker.good,
            bad={
                **common(maker, "static/mesh/nodes"),
                "missing dataset": maker("without `status`", removed("status")),
                "wrong shape": maker(
                    "times as a table", replaced("streams/run/time", data=np.zeros((2, 2)))
                ),
                "not a number": maker("the first of two times is NaN", a_time_that_is_none),
                "no JSON": maker("metadata that end too early", text("metadata", "{")),
            },
        )
        maker = _Maker(modes_file, place)
        yield door(
            title="mode files",
            error=ResultsError,
            read=describe,
            good=maker.good,
            bad={
                **common(maker, "static/modes/shape"),
                "missing dataset": maker("without `metadata`", removed("metadata")),
                "wrong shape": maker(
                    "two of `status`", replaced("status", data=np.array([b"a", b"b"]))
                ),
                "not a number": "numbers of modes are taken as their run wrote them",
                "no JSON": maker("metadata that are a list", text("metadata", "[1]")),
            },
        )
        maker = _Maker(checkpoint, place)
        yield door(
            title="checkpoints",
            error=CheckpointError,
            read=lambda path: read_checkpoint(path, ("memory", "state")),
            good=maker.good,
            bad={
                **common(maker, "arrays/state/u"),
                "missing dataset": maker("without `facts`", removed("facts")),
                "wrong shape": "shapes are compared with the model when a run goes on",
                "not a number": "numbers of states are taken as their run wrote them",
                "no JSON": maker("facts that end too early", text("facts", "{")),
            },
        )
        maker = _Maker(table, place)
        bad = common(maker, "columns/x")
        yield door(
            title="study tables",
            error=StudyError,
            read=read_table,
            good=maker.good,
            bad={
                **bad,
                "other version": "a table has no version; a study gathers it anew at each run",
                "missing dataset": maker("without a column that it names", removed("columns/x")),
                "wrong shape": maker(
                    "columns of two lengths", replaced("columns/x", data=np.zeros(3))
                ),
                "not a number": "NaN is what a failed case has",
                "no JSON": maker("names that end too early", text("names", "[")),
            },
        )
