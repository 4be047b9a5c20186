# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView: an unstructured grid whose values change in time (VTKHDF 2.2)."""

from __future__ import annotations

import io
import warnings
from collections.abc import Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.grids import Grid
from dolfinx_joints.export.whole_files import changed, finished, forgotten, write_new

SUFFIX = ".vtkhdf"
_VERSION = (2, 2)
_ROUNDING = 1e-9  # of the size of a grid
# Where the part of each time begins; the grid, written once, is that of every time.
_FIXED_OFFSETS = ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets")

Values = Mapping[str, ArrayLike]


def vtk_path(path: str | PathLike[str], ending: str = "") -> Path:
    """``NAME.vtkhdf`` from itself or from ``NAME``, dots and all, with ``ending`` after NAME.

    Raises:
        ResultsError: The path is a folder.
    """
    if Path(path).is_dir():
        raise ResultsError(
            f"{path} is a folder; give the name of a file, such as {Path(path, 'run')}."
        )
    name = Path(path).name.removesuffix(SUFFIX)
    return Path(path).with_name(f"{name}{ending}{SUFFIX}")


class VtkFile:
    """A file that grows by one time after the other and is whole between them.

    A kill loses no more than the time that is being written. Only if it comes while the last few
    kilobytes are written, less than a millisecond, the file may be unreadable until it is
    continued, which repairs it from ``NAME.vtkhdf.redo`` beside it. Against a loss of power there
    is no guarantee.

    Args:
        path: The file, usually ``NAME.vtkhdf``; replaced if it is there.
        grid: The grid; its ``cell_data`` are written once.

    Raises:
        ResultsError: The file cannot be written.
    """

    def __init__(self, path: Path, grid: Grid) -> None:
        """Write the grid."""
        self.path, self._fixed = path, tuple(map(_key, grid.cell_data))
        content = io.BytesIO()
        with h5py.File(content, "w") as file:
            _write_grid(file, grid)
        try:
            forgotten(path)
            write_new(path, content.getvalue())
        except OSError as error:
            raise ResultsError(f"{path} cannot be written: {error.strerror or error}.") from None

    @classmethod
    def resume(cls, path: Path, grid: Grid, last: float) -> VtkFile:
        """Go on with a file after the time ``last`` [s]; what was later is cut off.

        A file that cannot be read becomes ``NAME.damaged.vtkhdf``, with a warning, and another one
        begins.

        Raises:
            ResultsError: The file holds another grid, or it cannot be written.
        """
        file = cls.__new__(cls)
        file.path, file._fixed = path, tuple(map(_key, grid.cell_data))
        try:
            finished(path)
            with changed(path) as opened:
                root = opened["VTKHDF"]
                same = _holds(root, grid)
                if same:
                    _cut(root, last, file._fixed)
        except PermissionError as error:
            raise ResultsError(f"{path} cannot be written: {error.strerror or error}.") from None
        except (OSError, KeyError, ValueError, RuntimeError) as error:
            return cls._anew(path, grid, str(error))
        if not same:
            raise ResultsError(
                f"{path} cannot be continued: its grid is not that of this model; take another "
                "path, or remove the file."
            )
        return file

    @classmethod
    def _anew(cls, path: Path, grid: Grid, reason: str) -> VtkFile:
        """Another file in the place of a damaged one."""
        aside = path.with_name(f"{path.stem}.damaged{path.suffix}")
        try:
            path.replace(aside)
        except OSError as error:
            raise ResultsError(f"{path} cannot be written: {error.strerror or error}.") from None
        warnings.warn(
            f"{path} cannot be read ({reason}): it is {aside.name} now, and a new file begins.",
            stacklevel=2,
        )
        return cls(path, grid)

    def append(self, time: float, point_data: Values, cell_data: Values) -> None:
        """Add a time [s] with values by name, shape (points or cells, ...).

        Every time has the same names.

        Raises:
            ResultsError: The disk is full; the file is as it was.
        """
        try:
            with changed(self.path) as file:
                root = file["VTKHDF"]
                steps = root["Steps"]
                for kind, data in (("PointData", point_data), ("CellData", cell_data)):
                    for name, values in data.items():
                        _append_values(root, kind, _key(name), np.asarray(values))
                for key in self._fixed:
                    _extend(steps["CellDataOffsets"], key, [0])
                for name in _FIXED_OFFSETS:
                    _extend(steps, name, [0] if name == "PartOffsets" else [[0]])
                _extend(steps, "NumberOfParts", [1])
                file.flush()  # values before what counts them
                _extend(steps, "Values", [time])
                steps.attrs["NSteps"] = len(steps["Values"])
        except OSError as error:
            reason = error.strerror or error
            raise ResultsError(
                f"{self.path} cannot grow: {reason}; what it holds so far is whole."
            ) from None


def _key(name: str) -> str:
    """Name of values in the file; HDF5 takes a slash for a group."""
    return name.replace("/", " per ")


def _write_grid(file: h5py.File, grid: Grid) -> None:
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array(_VERSION, dtype=np.int64)
    kind = b"UnstructuredGrid"
    root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
    root["NumberOfPoints"] = np.array([len(grid.points)], dtype=np.int64)
    root["NumberOfCells"] = np.array([len(grid.kinds)], dtype=np.int64)
    root["NumberOfConnectivityIds"] = np.array([len(grid.connectivity)], dtype=np.int64)
    root["Points"] = np.asarray(grid.points, dtype=np.float64)
    root["Connectivity"] = np.asarray(grid.connectivity, dtype=np.int64)
    root["Offsets"] = np.asarray(grid.offsets, dtype=np.int64)
    root["Types"] = np.asarray(grid.kinds, dtype=np.uint8)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    _growing(steps, "Values", (), np.float64)
    _growing(steps, "NumberOfParts", (), np.int64)
    for name in _FIXED_OFFSETS:
        _growing(steps, name, () if name == "PartOffsets" else (1,), np.int64)
    for name in ("PointData", "CellData"):
        root.create_group(name)
        steps.create_group(f"{name}Offsets")
    for name, values in grid.cell_data.items():  # of every time, as all begin at 0
        root["CellData"][_key(name)] = np.asarray(values)
        _growing(steps["CellDataOffsets"], _key(name), (), np.int64)


def _append_values(root: h5py.Group, kind: str, key: str, values: NDArray[Any]) -> None:
    """Append values of all points or cells, a chunk of their own, and where they begin."""
    data, offsets = root[kind], root[f"Steps/{kind}Offsets"]
    if key not in data:
        _growing(data, key, values.shape[1:], values.dtype, max(1, len(values)))
        _growing(offsets, key, (), np.int64)
    begin = len(data[key])
    _extend(data, key, values)
    _extend(offsets, key, [begin])


def _growing(
    group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any, rows: int = 64
) -> None:
    """An empty dataset that grows by its first axis, in chunks of so many rows."""
    group.create_dataset(name, (0, *shape), dtype, maxshape=(None, *shape), chunks=(rows, *shape))


def _extend(group: h5py.Group, name: str, rows: Any) -> None:
    dataset, rows = group[name], np.asarray(rows)
    dataset.resize(len(dataset) + len(rows), axis=0)
    if len(rows):
        dataset[-len(rows) :] = rows


def _holds(root: h5py.Group, grid: Grid) -> bool:
    """Whether a file has this grid, its points but for rounding."""
    given: Values = {
        "Offsets": grid.offsets,
        "Connectivity": grid.connectivity,
        "Types": grid.kinds,
    }
    if not all(np.array_equal(root[name][:], values) for name, values in given.items()):
        return False
    points, size = root["Points"][:], np.ptp(grid.points, axis=0).max()
    return bool(np.allclose(points, grid.points, rtol=0.0, atol=_ROUNDING * size))


def _cut(root: h5py.Group, last: float, fixed: Collection[str]) -> None:
    """Keep the times up to one."""
    steps = root["Steps"]
    kept = int(np.searchsorted(steps["Values"][:], last, side="right"))
    for kind in ("PointData", "CellData"):
        for name, offsets in steps[f"{kind}Offsets"].items():
            if kept < len(offsets) and not (kind == "CellData" and name in fixed):
                root[kind][name].resize(int(offsets[kept]), axis=0)
            offsets.resize(kept, axis=0)
    for name in ("Values", "NumberOfParts", *_FIXED_OFFSETS):
        steps[name].resize(kept, axis=0)
    steps.attrs["NSteps"] = kept
