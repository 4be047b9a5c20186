# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView (VTKHDF 2.2): grids with values that change in time, and their export."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Dealt, Floats, blocks_in
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.hdf5 import new_file
from dolfinx_joints.export.grids import Array, Grid, body_grid, joined, joint_grid, joint_values
from dolfinx_joints.export.whole_files import ChangingFile, discard_redo, repair
from dolfinx_joints.results.arguments import StageStates
from dolfinx_joints.results.reader import Results, listing
from dolfinx_joints.results.stream import add_rows, write_whole

SUFFIX = ".vtkhdf"
_VERSION = (2, 2)
_CHUNK = 1 << 16  # numbers in a chunk of values
_MORE_BYTES = 1 << 16  # HDF5's own data in a file with a grid
# Offsets that are zero at every time, because the grid is written once.
_FIXED_OFFSETS = ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets")

Values = Mapping[str, ArrayLike | Dealt]


class VtkFile:
    """VTKHDF file to which times are appended, readable before and after each append.

    If the process is killed, at most the time being written is lost. An append ends by overwriting
    a few kilobytes, in less than a millisecond. A kill in this time can make the file unreadable;
    `resume` then repairs the file by ``NAME.vtkhdf.redo``. A power failure may damage the file.

    Args:
        path: The file, usually ``NAME.vtkhdf``; an existing file is replaced.
        grid: The grid. Its ``cell_data`` are stored once, at the first time.

    Raises:
        ResultsError: The file cannot be written.
    """

    def __init__(self, path: Path, grid: Grid) -> None:
        self.path, self._fixed, self._file = path, dict(grid.cell_data), ChangingFile(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            discard_redo(path)
            arrays = grid.points, grid.connectivity, grid.offsets, grid.kinds
            size = sum(int(np.prod(array.shape)) * array.dtype.itemsize for array in arrays)
            with replacing(path) as part, new_file(part, size + _MORE_BYTES) as file:
                _write_grid(file, grid)
        except OSError as error:
            raise ResultsError(f"{path} cannot be written: {error}.") from None

    @classmethod
    def resume(cls, path: Path, grid: Grid, last: float) -> VtkFile:
        """Continue a file after the time ``last`` [s]; later times are removed.

        Raises:
            DamagedFileError: The file cannot be read.
            ResultsError: The file has a different grid.
        """
        file = cls.__new__(cls)
        file.path, file._fixed, file._file = path, dict(grid.cell_data), ChangingFile(path)
        try:
            repair(path)
            with file._file.changes() as opened:
                same_grid = _has_grid(opened["VTKHDF"], grid)
                if same_grid:
                    _truncate(opened["VTKHDF"], last)
        except (OSError, KeyError, RuntimeError) as error:
            raise DamagedFileError(f"{path} cannot be continued: {error}.") from None
        if not same_grid:
            raise ResultsError(f"{path} cannot be continued: its mesh differs from this model's.")
        return file

    def append(self, times: Floats, point_data: Values, cell_data: Values) -> None:
        """Append times [s] with values by name, shape (times x points or cells, ...).

        The values of the times follow each other. All times must have the same names.

        Raises:
            ResultsError: The file cannot be written, or the disk is full.
        """
        try:
            with self._file.changes() as file:
                all_data = {"PointData": point_data, "CellData": {**self._fixed, **cell_data}}
                for kind, data in all_data.items():
                    for name, values in data.items():
                        self._append_values(file, kind, name, values, len(times))
                file.flush()
                self._append_times(file, times)
        except (OSError, KeyError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ResultsError(f"{self.path} cannot grow: {reason}.") from None

    def close(self) -> None:
        """Close the file until the next append."""
        self._file.close()

    def _append_values(
        self, file: h5py.File, kind: str, name: str, data_values: ArrayLike | Dealt, count: int
    ) -> None:
        """Append the values of ``count`` times and their offsets; store fixed values only once."""
        values = data_values if isinstance(data_values, Dealt) else np.asarray(data_values)
        key = name.replace("/", " per ")  # a slash would create a group in HDF5
        places = f"VTKHDF/{kind}/{key}", f"VTKHDF/Steps/{kind}Offsets/{key}"
        fixed = kind == "CellData" and name in self._fixed
        length = len(values) if fixed else len(values) // count
        if self._file.dataset(places[0]) is None:
            rows = min(length, _CHUNK // max(1, int(np.prod(values.shape[1:]))))
            _new_growing(file, places[0], values.shape[1:], values.dtype, max(1, rows))
            _new_growing(file, places[1], (), np.int64)
        dataset, offsets = map(self._file.dataset, places)
        begin = dataset.id.shape[0]
        if not (fixed and begin):
            _extend(dataset, values)
        if fixed:
            _extend_by_zeros(offsets, count)
        else:
            _extend(offsets, begin + length * np.arange(count))

    def _append_times(self, file: h5py.File, times: Floats) -> None:
        """Append times; increase the number of steps last, so that readers see complete data."""
        for name in _FIXED_OFFSETS:
            _extend_by_zeros(self._file.dataset(f"VTKHDF/Steps/{name}"), len(times))
        _extend(self._file.dataset("VTKHDF/Steps/NumberOfParts"), np.ones(len(times)))
        values = self._file.dataset("VTKHDF/Steps/Values")
        _extend(values, times)
        file["VTKHDF/Steps"].attrs["NSteps"] = values.id.shape[0]


class DamagedFileError(ResultsError):
    """A file that cannot be read, for example after a power failure."""


def vtk_path(path: str | PathLike[str]) -> Path:
    """Return ``NAME.vtkhdf`` for the path ``NAME.vtkhdf`` or ``NAME``, which may contain dots.

    Raises:
        ResultsError: The path is a folder.
    """
    full_path = Path(path)
    if full_path.is_dir():
        raise ResultsError(f"{path} is a folder; give the name of a file, such as run{SUFFIX}.")
    return full_path if full_path.suffix == SUFFIX else full_path.with_name(full_path.name + SUFFIX)


def check_free(paths: Iterable[Path], *, overwrite: bool) -> None:
    """Check that no existing file would be replaced, unless ``overwrite`` is set.

    Raises:
        ResultsError: A file exists.
    """
    files = [str(path) for path in paths if path.exists()]
    if files and not overwrite:
        raise ResultsError(f"{listing(files)}: file exists; --force (overwrite=True) replaces it.")


def _has_grid(root: h5py.Group, grid: Grid) -> bool:
    size = max(np.abs(block).max(initial=0.0) for block in blocks_in(grid.points))
    arrays = {"Points": grid.points, "Connectivity": grid.connectivity, "Offsets": grid.offsets}
    return all(_equal_to(root[name], array, 1e-9 * size) for name, array in arrays.items())


def _equal_to(dataset: h5py.Dataset, expected: Array, tolerance: float) -> bool:
    if dataset.shape != expected.shape:
        return False
    first, all_equal = 0, True
    for block in blocks_in(expected):
        stored = dataset[first : first + len(block)]
        all_equal &= bool(np.allclose(stored, block, rtol=0.0, atol=tolerance))
        first += len(block)
    return all_equal


def _write_grid(file: h5py.File, grid: Grid) -> None:
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array(_VERSION, dtype=np.int64)
    kind = b"UnstructuredGrid"
    root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
    root["NumberOfPoints"] = np.array([len(grid.points)], dtype=np.int64)
    root["NumberOfCells"] = np.array([len(grid.kinds)], dtype=np.int64)
    root["NumberOfConnectivityIds"] = np.array([len(grid.connectivity)], dtype=np.int64)
    datasets: tuple[tuple[str, Array, Any], ...] = (
        ("Points", grid.points, np.float64),
        ("Connectivity", grid.connectivity, np.int64),
        ("Offsets", grid.offsets, np.int64),
        ("Types", grid.kinds, np.uint8),
    )
    for name, values, dtype in datasets:
        write_whole(root.create_dataset(name, values.shape, dtype), values)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    _new_growing(steps, "Values", (), np.float64)
    _new_growing(steps, "NumberOfParts", (), np.int64)
    for name in _FIXED_OFFSETS:
        _new_growing(steps, name, () if name == "PartOffsets" else (1,), np.int64)
    for name in ("PointData", "CellData"):
        root.create_group(name)
        steps.create_group(f"{name}Offsets")


def _new_growing(
    group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any, rows: int = 64
) -> h5py.Dataset:
    """Create an empty dataset whose first axis can grow, with ``rows`` rows per chunk."""
    shapes = {"maxshape": (None, *shape), "chunks": (rows, *shape)}
    return group.create_dataset(name, (0, *shape), dtype, **shapes)


def _extend_by_zeros(dataset: h5py.Dataset, count: int) -> None:
    """Append rows that are not written, because zero is the fill value."""
    first, *others = dataset.id.shape
    dataset.id.set_extent((first + count, *others))


def _extend(dataset: h5py.Dataset, rows: Any) -> None:
    for block in blocks_in(rows if isinstance(rows, Dealt) else np.asarray(rows)):
        add_rows(dataset, block)


def _truncate(root: h5py.Group, last: float) -> None:
    """Remove the times after ``last`` [s]."""
    steps = root["Steps"]
    time_count = int(np.searchsorted(steps["Values"][:], last, side="right"))
    for kind in ("PointData", "CellData"):
        for name, offsets in steps[f"{kind}Offsets"].items():
            once = len(offsets) > 1 and offsets[1] == 0  # stored for all times
            if time_count < len(offsets) and not once:
                root[kind][name].resize(int(offsets[time_count]), axis=0)
            offsets.resize(time_count, axis=0)
    for name in ("Values", "NumberOfParts", *_FIXED_OFFSETS):
        steps[name].resize(time_count, axis=0)
    steps.attrs["NSteps"] = time_count


_BLOCK_BYTES = 1 << 22  # displacements of the states that are in memory together


@checked
def write_vtk(
    results: Results, path: str | PathLike[str], *, overwrite: bool = False
) -> list[Path]:
    """Write the recorded states of a results file for ParaView, PyVista and VTK.

    ``NAME.vtkhdf`` contains the body in cells of the degree of the displacement. Its data are
    ``displacement [m]`` from the unloaded body, and ``in GROUP [-]``, 1 in the cells of a group.

    ``NAME_joints.vtkhdf`` contains the joints, one polygon per joint point. Its data are
    ``displacement [m]`` (mean of both faces), ``gap [m]`` and ``traction [Pa]`` in local axes
    (n, s1, s2), ``opening [m]``, ``tangential gap [m]``, ``mean pressure [Pa]`` of each joint,
    ``tied [-]``, ``status [-]`` (0 open, 1 sticking, 2 sliding, 3 closed without friction, 4 tied)
    and all other recorded quantities. Static stages are in ``NAME_stages.vtkhdf`` and
    ``NAME_stages_joints.vtkhdf``, with the number of the stage as time.

    Args:
        results: The run.
        path: ``NAME.vtkhdf``, or ``NAME``.
        overwrite: True to replace existing files.

    Returns:
        Paths of the files.

    Raises:
        ResultsError: The file has neither states nor stages, or no cells, or an output file exists.
    """
    sources = {
        first.with_name(f"{first.stem}{ending}{first.suffix}"): part
        for first in [vtk_path(path)]
        for ending, part in (("", results), ("_stages", StageStates(results)))
        if part.streams.get("states") and part.rows("states")
    }
    if not sources:
        raise ResultsError(f"{results.path} has neither states nor static stages to export.")
    count = 2 if results.joints else 1
    paths = [place for first in sources for place in (first, joints_path(first))[:count]]
    check_free(paths, overwrite=overwrite)
    for first, part in sources.items():
        _write(part, first)
    return paths


def _write(results: Results, path: Path) -> None:
    names, times, grid = results.joints, results.time("states"), body_grid(results)
    body = VtkFile(path, grid)
    if names:
        surfaces = joined({name: joint_grid(results, name) for name in names})
        joints = VtkFile(joints_path(path), surfaces)
    count = max(1, _BLOCK_BYTES // grid.points.nbytes)
    for first in range(0, len(times), count):
        block = slice(first, first + count)
        moved = results.series("states", "displacement", block)
        body.append(times[block], {"displacement [m]": np.concatenate(moved)}, {})
        if names:
            values = values_of(results, names, block, surfaces)
            of_joints = np.concatenate([surfaces.motion @ nodes for nodes in moved])
            joints.append(
                times[block],
                {"displacement [m]": of_joints},
                {name: np.concatenate(states) for name, states in values.items()},
            )


def joints_path(path: Path) -> Path:
    """Return the path of the file of the joints, given the path of the file of the body."""
    return path.with_name(f"{path.stem}_joints{path.suffix}")


def values_of(results: Results, joints: Sequence[str], block: slice, grid: Grid) -> dict[str, Any]:
    """Return the values of records at the points of all given joints, by name with unit.

    The shape is (records, points, ...). Quantities that a joint does not have are NaN.
    """
    starts = tuple(f"joints/{joint}/" for joint in joints)
    names = [name for name in results.streams["states"] if name.startswith(starts)]
    records = {name: results.series("states", name, block) for name in names}
    values = {}
    for quantity in dict.fromkeys(name.split("/", 2)[2] for name in names):
        parts = []
        for start in starts:
            missing = np.full(records[f"{start}gap"].shape[:2], np.nan)
            parts.append(records.get(start + quantity, missing))
        values[quantity] = np.concatenate(parts, axis=1)
    return joint_values(values, grid.cell_data, len(joints))
