# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""HDF5 files of others: what may be in them, checked before any of it is read.

HDF5 can point out of a file (external links, virtual datasets, raw data elsewhere), ask for plugins
to unpack data, and declare arrays of any size in a few bytes. None of that is written here, so none
of it is followed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py

from dolfinx_joints.errors import JointsError

# What reading a damaged or foreign file was seen to raise.
DAMAGE = (
    OSError,
    RuntimeError,
    LookupError,
    TypeError,
    AttributeError,
    ValueError,
    OverflowError,
    MemoryError,
    RecursionError,
)

_DEPTH = 8
_NAMES = 100_000
# Room for rows that a killed run had declared and not yet written.
_SLACK = 1 << 26


class DamageTold:
    """A block in which what reading a damaged file raises becomes one sentence.

    Args:
        path: The file.
        error: What to raise instead.
        verdict: What to say of the file, after its name.
    """

    def __init__(self, path: Path, error: type[Exception], verdict: str = "is damaged") -> None:
        """Nothing is read yet."""
        self._path, self._error, self._verdict = path, error, verdict

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        raised: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Raise the sentence."""
        if isinstance(raised, DAMAGE) and not isinstance(raised, JointsError):
            told = " ".join(str(raised).split()) or type(raised).__name__
            raise self._error(f"{self._path} {self._verdict}: {told[:300]}.") from raised


def check_contents(
    file: h5py.File, path: Path, error: type[Exception], *, texts: bool = False
) -> None:
    """Refuse what points elsewhere, is no plain array, or is larger than the file can hold.

    Args:
        file: The open file.
        path: Its name, for messages and its size.
        error: What to raise.
        texts: Whether arrays of texts are let through.

    Raises:
        Exception: ``error``.
    """
    limit = 2 * path.stat().st_size + _SLACK
    for count, (name, item) in enumerate(_items(file, "", 0, path, error)):
        if count > _NAMES:
            raise error(f"{path} is refused: it has more than {_NAMES} names.")
        if isinstance(item, h5py.Dataset):
            wrong = _fault(item, limit, texts=texts)
            if wrong:
                raise error(f"{path} is refused: {name!r} {wrong}.")


def _items(
    group: h5py.Group, above: str, depth: int, path: Path, error: type[Exception]
) -> Iterator[tuple[str, Any]]:
    """All that is in a group, by full name; links are looked at before they are opened."""
    if depth > _DEPTH:
        raise error(f"{path} is refused: groups are nested more than {_DEPTH} deep at {above!r}.")
    for key in group:
        name = f"{above}{key}"
        link = group.get(key, getlink=True)
        if not isinstance(link, h5py.HardLink):
            raise error(f"{path} is refused: {name!r} is a link that could lead elsewhere.")
        item = group[key]
        yield name, item
        if isinstance(item, h5py.Group):
            yield from _items(item, f"{name}/", depth + 1, path, error)


def _fault(dataset: h5py.Dataset, limit: int, *, texts: bool) -> str | None:
    """What is wrong with an array, in words that follow its name."""
    creation = dataset.id.get_create_plist()
    if dataset.is_virtual or creation.get_external_count():
        return "takes its values from other files"
    if creation.get_nfilters():
        return "is packed by a filter"
    text = texts and h5py.check_string_dtype(dataset.dtype) is not None
    if dataset.dtype.kind not in "biufS" and not text:
        return f"holds {dataset.dtype}, not plain numbers"
    if dataset.shape is None:
        return "is empty"
    size = dataset.dtype.itemsize
    for length in dataset.shape:
        size *= int(length)
    chunk = dataset.dtype.itemsize
    for length in dataset.chunks or ():
        chunk *= int(length)
    if max(size, chunk) > limit:
        return f"claims {max(size, chunk):.3g} bytes, more than the file can hold"
    return None
