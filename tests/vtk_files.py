# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Content of a file for ParaView, read by VTK, as in ParaView."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest


def read_vtk(path: Path) -> list[tuple[float, Any]]:
    """Return the times [s] and the grid at each time, as an object of PyVista."""
    pyvista = pytest.importorskip("pyvista")
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(Pipeline.TIME_STEPS())
    if times is None:  # None for a file with a single time
        reader.Update()
        with h5py.File(path) as file:
            times = tuple(file["VTKHDF/Steps/Values"][:])
    assert reader.GetNumberOfSteps() == len(times)
    grids = []
    for time in times:
        reader.UpdateTimeStep(time)
        grids.append((time, pyvista.wrap(reader.GetOutput()).copy()))
    return grids


def on_root(comm: Any, look: Callable[[], None]) -> None:
    """Check files on rank 0; if the check fails, every rank fails with the same message."""
    failure = None
    if comm.rank == 0:
        try:
            look()
        except Exception as error:
            failure = f"{type(error).__name__}: {error}"
    failure = comm.bcast(failure)
    assert failure is None, failure
