# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a folder written for ParaView holds, read by the C interface of the library that wrote it.

DOLFINx brings ADIOS2's library, not its Python module.
"""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

_READ, _AT_ONCE = 2, 5  # adios2_mode_read, adios2_mode_sync
_OF_STEP = 2  # adios2_step_mode_read
_DONE, _END = 0, 2  # adios2_step_status_ok, adios2_step_status_end_of_stream


class _Variable(ctypes.Structure):
    """adios2_varinfo, up to the number of blocks."""

    _fields_ = (
        ("dims", ctypes.c_int),
        ("shape", ctypes.c_void_p),
        ("is_value", ctypes.c_int),
        ("reversed", ctypes.c_int),
        ("blocks", ctypes.c_size_t),
    )


class VtxStep(NamedTuple):
    """A time [s], and nodes and values with a block for each rank, shape (nodes, 3)."""

    time: float
    nodes: list[np.ndarray]
    values: list[np.ndarray]


def read_vtx(path: Path, name: str) -> list[VtxStep]:
    """All times of a folder, with the values of a function of a name."""
    c, status = _library(), ctypes.c_int()
    adios = _pointer(c.adios2_init_serial)()
    io = _pointer(c.adios2_declare_io)(adios, b"read")
    engine = _pointer(c.adios2_open)(io, str(path).encode(), _READ)
    assert engine.value, f"{path} cannot be read"
    steps: list[VtxStep] = []
    nodes: list[np.ndarray] = []
    while True:
        c.adios2_begin_step(engine, _OF_STEP, ctypes.c_float(-1.0), ctypes.byref(status))
        if status.value == _END:
            break
        assert status.value == _DONE
        time = ctypes.c_double()
        variable = _pointer(c.adios2_inquire_variable)(io, b"step")
        assert c.adios2_get(engine, variable, ctypes.byref(time), _AT_ONCE) == 0
        nodes = _blocks(c, io, engine, "geometry") or nodes  # may be written once
        steps.append(VtxStep(time.value, nodes, _blocks(c, io, engine, name)))
        c.adios2_end_step(engine)
    c.adios2_close(engine)
    c.adios2_finalize(adios)
    return steps


def _library() -> ctypes.CDLL:
    """The C interface beside the library that DOLFINx has loaded."""
    maps = Path("/proc/self/maps").read_text()
    core = re.search(r"/\S*/libadios2\S*_core\.so", maps) or re.search(
        r"/\S*/libadios2\S*\.so", maps
    )
    found = sorted(Path(core[0]).parent.glob("libadios2*_c.so*")) if core else []
    if not found:
        pytest.skip("ADIOS2 has no C interface here")
    return ctypes.CDLL(str(found[0]))


def _pointer(function: Any) -> Any:
    function.restype = ctypes.c_void_p
    return lambda *arguments: ctypes.c_void_p(function(*arguments))


def _blocks(c: ctypes.CDLL, io: Any, engine: Any, name: str) -> list[np.ndarray]:
    """Values of a variable at this step, a block for each rank; none where it is not there."""
    variable = _pointer(c.adios2_inquire_variable)(io, name.encode())
    if not variable.value:
        return []
    step, kind, length = ctypes.c_size_t(), ctypes.create_string_buffer(32), ctypes.c_size_t()
    c.adios2_current_step(ctypes.byref(step), engine)
    c.adios2_variable_type_string(kind, ctypes.byref(length), variable)
    info = _pointer(c.adios2_inquire_blockinfo)(engine, variable, step)
    count = ctypes.cast(info, ctypes.POINTER(_Variable)).contents.blocks
    c.adios2_free_blockinfo(info)
    found = []
    for block in range(count):
        c.adios2_set_block_selection(variable, ctypes.c_size_t(block))
        shape = (ctypes.c_size_t * 2)()
        assert c.adios2_variable_count(shape, variable) == 0
        values = np.full(tuple(shape), np.nan, dtype=kind.value.decode())
        at = values.ctypes.data_as(ctypes.c_void_p)
        assert c.adios2_get(engine, variable, at, _AT_ONCE) == 0
        found.append(values)
    return found
