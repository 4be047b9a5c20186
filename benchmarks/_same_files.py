# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files and checkpoints of two runs compared: all that must be the same."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints import Results
from dolfinx_joints.simulation.checkpoint_file import read_checkpoint


class DamagedError(Exception):
    """A file is not what another run wrote."""


def content(path: Path) -> dict[str, Any]:
    """All that a results file holds but times of day, seconds and the command line."""
    with Results(path) as results:
        found: dict[str, Any] = {name: results.static(name) for name in results.statics}
        found |= records(results)
        summary = {k: v for k, v in results.summary.items() if k not in ("seconds", "peak_mb")}
        metadata = results.metadata
        metadata["manifest"].pop("command")  # names another folder
        told = {"status": results.status, "summary": summary, "metadata": metadata}
        return found | dict(_leaves(told, ""))


def records(results: Results) -> dict[str, Any]:
    """The records of a results file by stream and name."""
    found = {}
    for stream, names in results.streams.items():
        times = results.time(stream)
        found[f"{stream}/time"] = times
        for name in names:
            found[f"{stream}/{name}"] = results.series(stream, name, slice(len(times)))
    return found


def checkpoint(path: Path) -> dict[str, Any]:
    """All that a checkpoint holds, by name."""
    return dict(_leaves(read_checkpoint(path), ""))


def _leaves(tree: Mapping[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{name}/")
        else:
            numbers = isinstance(value, list) and all(isinstance(one, float) for one in value)
            yield above + name, np.array(value) if numbers else value


def scales(whole: Mapping[str, Any]) -> dict[str, float]:
    """Largest entry of each array and number of a finished run, to judge rounding by.

    Energies are differences of large parts and share theirs, as forces that rounding leaves do;
    what a summary tells are shares, as residuals are.
    """
    found: Counter[str] = Counter()
    for name, value in whole.items():
        if _is_real(value):
            size = float(np.nanmax(np.abs(value), initial=0.0))
            found[_kind(name)] = max(found[_kind(name)], size)
    return {
        name: max(found[_kind(name)], 1.0 if _is_share(name) else 0.0)
        for name, value in whole.items()
        if _is_real(value)
    }


def difference(
    found: Mapping[str, Any], expected: Mapping[str, Any], scale: Mapping[str, float]
) -> float:
    """Largest of all arrays and numbers relative to their `scales`; 0 if all bits are the same.

    Raises:
        DamagedError: Names, shapes, whole numbers or texts are not the same.
    """
    if found.keys() != expected.keys():
        raise DamagedError(f"other names: {sorted(found.keys() ^ expected.keys())}")
    largest = 0.0
    for name, value in expected.items():
        if not _is_real(value):
            if not np.array_equal(found[name], value):
                raise DamagedError(f"{name}: {found[name]!s:.200} instead of {value!s:.200}")
            continue
        if np.shape(found[name]) != np.shape(value):
            raise DamagedError(f"{name}: shape {np.shape(found[name])}, not {np.shape(value)}")
        if not np.array_equal(found[name], value, equal_nan=True):
            off = float(np.max(np.abs(np.subtract(found[name], value))))
            off = off / scale[name] if scale[name] > 0.0 else np.inf
            largest = max(largest, np.inf if np.isnan(off) else off)
    return largest


def _is_real(value: Any) -> bool:
    return isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")


def _is_share(name: str) -> bool:
    return name.startswith("summary/") or name.endswith("/residual")


def _kind(name: str) -> str:
    """Names whose values share a scale."""
    if "energy/" in name and not name.endswith("time"):
        return "energy"
    return name.replace("state/remainder", "state/elastic_force")
