# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Removal of unfinished files of killed form compilations from FFCx's cache."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from dolfinx.jit import get_options

# Time [s] that FFCx waits for the compilation by another process before it fails; upper bound of
# the time [s] to generate the code of a form of this package.
_FFCX_WAIT, _LONGEST_GENERATION = 10.0, 30.0


def remove_killed_compilations(comm: Any) -> None:
    """Remove C files of forms whose compilation was killed (collective).

    FFCx creates the C file first and ``.c.cached`` last. If only the C file exists, FFCx assumes
    that another process is compiling this file, waits for `_FFCX_WAIT` and fails in each later run.
    """
    if comm.rank == 0:
        names = {file.name for file in Path(get_options()["cache_dir"]).glob("libffcx_*")}
        for name in names:
            if not name.endswith(".c") or f"{name}.cached" in names:
                continue
            source = Path(get_options()["cache_dir"], name)
            with suppress(OSError):  # removed by another process, or owned by another user
                while not source.with_suffix(".c.cached").exists():
                    age = time.time() - source.stat().st_mtime
                    if age > _age_limit(source.stem, age):
                        source.unlink()
                    time.sleep(0.1)
    comm.barrier()


def _age_limit(name: str, age: float) -> float:
    """Return the age [s] above which an unfinished C file is certainly abandoned.

    A running compiler has the file name in its arguments. Before the compiler starts, any busy
    DOLFINx process that is older than the file may be generating the code.
    """
    limit = _FFCX_WAIT
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if name.encode() in (process / "cmdline").read_bytes():
                return float("inf")
            fields = (process / "stat").read_text().rpartition(")")[2].split()
            begun = int(fields[19]) / os.sysconf("SC_CLK_TCK")
            older = time.clock_gettime(time.CLOCK_BOOTTIME) - begun > age
            busy = fields[0] in "RD" and process.name != str(os.getpid())
            if older and busy and b"dolfinx" in (process / "maps").read_bytes():
                limit = _LONGEST_GENERATION
    return limit
