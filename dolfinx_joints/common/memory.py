# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Memory of the machine: what a factor needs, what is free, and what this process has had."""

from __future__ import annotations

import os
import resource
from pathlib import Path
from typing import Any

import numpy as np

# Part of the free memory that one factor may take: matrices, results and a second one need some.
SHARE = 0.5


def factor_fits(comm: Any, dofs: int, components: int) -> bool:
    """Whether a Cholesky factor of so many rows fits into the memory that is free (collective)."""
    return factor_bytes(dofs, components) <= SHARE * available_bytes(comm)


def factor_bytes(dofs: int, components: int) -> float:
    """Memory that a Cholesky factor and its making may take, [bytes].

    Nested dissection leaves of the order of n^(4/3) entries in space and n log n in a plane. The
    numbers are measured: on cubes and squares, whose factors are the largest for their dofs.
    """
    size = max(dofs, 2)
    entries = 20.0 * size ** (4 / 3) if components == 3 else 5.0 * size * np.log2(size)
    return float(1.5 * 8.0 * entries)


def available_bytes(comm: Any) -> float:
    """Free memory of all the machines that the ranks run on (collective), [bytes]."""
    from mpi4py import MPI

    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    ranks = machine.size
    machine.Free()
    return float(comm.allreduce(min([_free_on_machine(), *_free_in_groups()]) / ranks))


def peak_mb() -> float:
    """Largest resident size of this process so far [MiB]."""
    # The system call below also counts the program that this one replaced.
    for line in Path("/proc/self/status").read_text("ascii", "replace").splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _free_on_machine() -> float:
    """Memory that can be had without swapping, else all that there is, [bytes]."""
    for line in Path("/proc/meminfo").read_text("ascii").splitlines():
        name, value = line.split(":")
        if name == "MemAvailable":
            return 1024.0 * float(value.split()[0])
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _free_in_groups(
    process: Path = Path("/proc/self/cgroup"), mounted: Path = Path("/sys/fs/cgroup")
) -> list[float]:
    """Memory that each control group (version 2) leaves of its limit, [bytes]; caches are free."""
    found = []
    for line in process.read_text().splitlines() if process.exists() else []:
        folder = mounted / line.split(":", 2)[2].strip("/")
        for group in (folder, *folder.parents):
            limit = group / "memory.max"
            if group.is_relative_to(mounted) and limit.exists() and limit.read_text() != "max\n":
                statistics = (group / "memory.stat").read_text().splitlines()
                cached = dict(line.split()[:2] for line in statistics)["inactive_file"]
                used = (group / "memory.current").read_text()
                found.append(max(float(limit.read_text()) - float(used) + float(cached), 0.0))
    return found
