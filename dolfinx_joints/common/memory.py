# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Memory that a matrix factor needs, free memory, and the peak memory of this process."""

from __future__ import annotations

import os
import resource
from pathlib import Path
from typing import Any

import numpy as np

# Fraction of the free memory for one factor; the rest is for matrices, results, a second factor.
SHARE = 0.5


def factor_fits(comm: Any, dofs: int, components: int) -> bool:
    """Return True if a Cholesky factor of ``dofs`` rows fits in the free memory (collective)."""
    return factor_bytes(dofs, components) <= SHARE * available_bytes(comm)


def factor_bytes(dofs: int, components: int) -> float:
    """Return the largest memory for computing and storing a Cholesky factor, [bytes].

    With nested dissection, the factor has of the order of n^(4/3) entries in 3-D and n log n in
    2-D. The coefficients are measured on cubes and squares, which have the largest factors.
    """
    size = max(dofs, 2)
    entries = 20.0 * size ** (4 / 3) if components == 3 else 5.0 * size * np.log2(size)
    return float(1.5 * 8.0 * entries)


def available_bytes(comm: Any) -> float:
    """Return the free memory of all machines that the ranks run on, [bytes] (collective)."""
    from mpi4py import MPI

    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    ranks = machine.size
    machine.Free()
    return float(comm.allreduce(min([_free_on_machine(), *_free_in_groups()]) / ranks))


def peak_mb() -> float:
    """Return the largest resident size of this process so far [MiB]."""
    # getrusage below also counts the program that exec replaced by this one; prefer VmHWM.
    for line in Path("/proc/self/status").read_text("ascii", "replace").splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _free_on_machine() -> float:
    """Return the memory available without swapping, or else the total memory, [bytes]."""
    for line in Path("/proc/meminfo").read_text("ascii").splitlines():
        name, value = line.split(":")
        if name == "MemAvailable":
            return 1024.0 * float(value.split()[0])
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _free_in_groups(
    process: Path = Path("/proc/self/cgroup"), mounted: Path = Path("/sys/fs/cgroup")
) -> list[float]:
    """Return the memory left below each cgroup limit (version 2), caches included, [bytes]."""
    free = []
    for line in process.read_text().splitlines() if process.exists() else []:
        folder = mounted / line.split(":", 2)[2].strip("/")
        for group in (folder, *folder.parents):
            limit = group / "memory.max"
            if group.is_relative_to(mounted) and limit.exists() and limit.read_text() != "max\n":
                statistics = (group / "memory.stat").read_text().splitlines()
                cached = dict(line.split()[:2] for line in statistics)["inactive_file"]
                used = (group / "memory.current").read_text()
                free.append(max(float(limit.read_text()) - float(used) + float(cached), 0.0))
    return free
