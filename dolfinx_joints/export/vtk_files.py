# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView: an unstructured grid whose values change in time (VTKHDF 2.2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Dealt, blocks_in
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.grids import Array, Grid
from dolfinx_joints.export.whole_files import begun, changed, finished, forgotten
from dolfinx_joints.results.reader import listing
from dolfinx_joints.results.stream import add_rows, write_whole

SUFFIX = ".vtkhdf"
_VERSION = (2, 2)
_CHUNK = 1 << 16  # numbers of a chunk of values
_MORE_BYTES = 1 << 16  # of HDF5 for a file with its grid
# Where the part of each time begins; the grid, written once, is that of every time.
_FIXED_OFFSETS = ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets")

Values = Mapping[str, ArrayLike | Dealt]


class VtkFile:
    """A file that grows by one time after the other and is whole between them.

    A kill loses no more than the time that is being written. Only if it comes while the last few
    kilobytes are written, less than a millisecond, the file may be unreadable until it is
    continued, which repairs it from ``NAME.vtkhdf.redo`` beside it. Against a loss of power there
    is no guarantee.

    Args:
        path: The file, usually ``NAME.vtkhdf``; replaced if it is there.
        grid: The grid; its ``cell_data`` are stored once, with the first time.

    Raises:
        ResultsError: The file cannot be written.
    """

    def __init__(self, path: Path, grid: Grid) -> None:
        self.path, self._fixed = path, dict(grid.cell_data)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            forgotten(path)
            arrays = grid.points, grid.connectivity, grid.offsets, grid.kinds
            size = sum(int(np.prod(each.shape)) * each.dtype.itemsize for each in arrays)
            with begun(path, size + _MORE_BYTES) as file:
                _write_grid(file, grid)
        except OSError as error:
            raise ResultsError(f"{path} cannot be written: {error}.") from None

    @classmethod
    def resume(cls, path: Path, grid: Grid, last: float) -> VtkFile:
        """Go on with a file after the time ``last`` [s]; what was later is cut off.

        Raises:
            DamagedFileError: The file cannot be read.
            ResultsError: It is of another grid.
        """
        file = cls.__new__(cls)
        file.path, file._fixed = path, dict(grid.cell_data)
        try:
            finished(path)
            with changed(path) as opened:
                same = _is_of(opened["VTKHDF"], grid)
                if same:
                    _cut(opened["VTKHDF"], last)
        except (OSError, KeyError, RuntimeError) as error:
            raise DamagedFileError(f"{path} cannot be continued: {error}.") from None
        if not same:
            raise ResultsError(f"{path} cannot be continued: it is of another mesh.")
        return file

    def append(self, time: float, point_data: Values, cell_data: Values) -> None:
        """Add a time [s] with values by name, shape (points or cells, ...).

        Every time has the same names.

        Raises:
            ResultsError: The file cannot be written, or has no room to grow.
        """
        try:
            with changed(self.path) as file:
                root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
                for kind, data in (("PointData", point_data), ("CellData", cell_data)):
                    group, offsets = root[kind], steps[f"{kind}Offsets"]
                    for name, fixed in (self._fixed if kind == "CellData" else {}).items():
                        _append_values(group, offsets, name, fixed, once=True)
                    for name, values in data.items():
                        _append_values(group, offsets, name, values)
                file.flush()
                _append_time(steps, time)
        except (OSError, KeyError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ResultsError(f"{self.path} cannot grow: {reason}.") from None


class DamagedFileError(ResultsError):
    """A file that cannot be read any more, such as after a loss of power."""


def vtk_path(path: str | PathLike[str]) -> Path:
    """``NAME.vtkhdf`` of that or of ``NAME``, which may hold dots.

    Raises:
        ResultsError: It is a folder.
    """
    given = Path(path)
    if given.is_dir():
        raise ResultsError(f"{path} is a folder; give the name of a file, such as run{SUFFIX}.")
    return given if given.suffix == SUFFIX else given.with_name(given.name + SUFFIX)


def check_free(paths: Iterable[Path], *, overwrite: bool) -> None:
    """Check that no file would be lost.

    Raises:
        ResultsError: There is one.
    """
    there = [str(path) for path in paths if path.exists()]
    if there and not overwrite:
        raise ResultsError(f"{listing(there)}: there already; --force replaces (overwrite=True).")


def _is_of(root: h5py.Group, grid: Grid) -> bool:
    size = max(np.abs(each).max(initial=0.0) for each in blocks_in(grid.points))
    wanted = {"Points": grid.points, "Connectivity": grid.connectivity, "Offsets": grid.offsets}
    return all(_alike(root[name], each, 1e-9 * size) for name, each in wanted.items())


def _alike(dataset: h5py.Dataset, wanted: Array, tolerance: float) -> bool:
    if dataset.shape != wanted.shape:
        return False
    first, same = 0, True
    for block in blocks_in(wanted):
        here = dataset[first : first + len(block)]
        same &= bool(np.allclose(here, block, rtol=0.0, atol=tolerance))
        first += len(block)
    return same


def _write_grid(file: h5py.File, grid: Grid) -> None:
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array(_VERSION, dtype=np.int64)
    kind = b"UnstructuredGrid"
    root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
    root["NumberOfPoints"] = np.array([len(grid.points)], dtype=np.int64)
    root["NumberOfCells"] = np.array([len(grid.kinds)], dtype=np.int64)
    root["NumberOfConnectivityIds"] = np.array([len(grid.connectivity)], dtype=np.int64)
    whole: tuple[tuple[str, Array, Any], ...] = (
        ("Points", grid.points, np.float64),
        ("Connectivity", grid.connectivity, np.int64),
        ("Offsets", grid.offsets, np.int64),
        ("Types", grid.kinds, np.uint8),
    )
    for name, values, dtype in whole:
        write_whole(root.create_dataset(name, values.shape, dtype), values)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    _growing(steps, "Values", (), np.float64)
    _growing(steps, "NumberOfParts", (), np.int64)
    for name in _FIXED_OFFSETS:
        _growing(steps, name, () if name == "PartOffsets" else (1,), np.int64)
    for name in ("PointData", "CellData"):
        root.create_group(name)
        steps.create_group(f"{name}Offsets")


def _append_values(
    data: h5py.Group,
    offsets: h5py.Group,
    name: str,
    given: ArrayLike | Dealt,
    *,
    once: bool = False,
) -> None:
    """Append values of all points or cells, and where they begin; ``once`` for all times."""
    values = given if isinstance(given, Dealt) else np.asarray(given)
    key = name.replace("/", " per ")  # HDF5 takes it for a group
    if (known := data.get(key)) is None:
        rows = min(len(values), _CHUNK // max(1, int(np.prod(values.shape[1:]))))
        known = _growing(data, key, values.shape[1:], values.dtype, max(1, rows))
        _growing(offsets, key, (), np.int64)
    begin = len(known)
    if not (once and begin):
        _extend(known, values)
    _extend(offsets[key], [0 if once else begin])


def _append_time(steps: h5py.Group, time: float) -> None:
    """Count one more time; readers see it last of all."""
    for name in _FIXED_OFFSETS:
        _extend(steps[name], [0] if name == "PartOffsets" else [[0]])
    _extend(steps["NumberOfParts"], [1])
    times = steps["Values"]
    _extend(times, [time])
    steps.attrs["NSteps"] = len(times)


def _growing(
    group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any, rows: int = 64
) -> h5py.Dataset:
    """An empty dataset that grows by its first axis, in chunks of so many rows."""
    shapes = {"maxshape": (None, *shape), "chunks": (rows, *shape)}
    return group.create_dataset(name, (0, *shape), dtype, **shapes)


def _extend(dataset: h5py.Dataset, rows: Any) -> None:
    for block in blocks_in(rows if isinstance(rows, Dealt) else np.asarray(rows)):
        add_rows(dataset, block)


def _cut(root: h5py.Group, last: float) -> None:
    """Keep the times up to one."""
    steps = root["Steps"]
    kept = int(np.searchsorted(steps["Values"][:], last, side="right"))
    for kind in ("PointData", "CellData"):
        for name, offsets in steps[f"{kind}Offsets"].items():
            once = len(offsets) > 1 and offsets[1] == 0  # stored for all times
            if kept < len(offsets) and not once:
                root[kind][name].resize(int(offsets[kept]), axis=0)
            offsets.resize(kept, axis=0)
    for name in ("Values", "NumberOfParts", *_FIXED_OFFSETS):
        steps[name].resize(kept, axis=0)
    steps.attrs["NSteps"] = kept
