# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a file for ParaView holds, read by VTK, as ParaView does."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest


def read_vtk(path: Path) -> list[tuple[float, Any]]:
    """Times [s] and the grid of each, as PyVista wraps it."""
    pyvista = pytest.importorskip("pyvista")
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(Pipeline.TIME_STEPS())
    if times is None:  # VTK's way to say that there is one time only
        reader.Update()
        with h5py.File(path) as file:
            times = tuple(file["VTKHDF/Steps/Values"][:])
    assert reader.GetNumberOfSteps() == len(times)
    found = []
    for time in times:
        reader.UpdateTimeStep(time)
        found.append((time, pyvista.wrap(reader.GetOutput()).copy()))
    return found


def on_root(comm: Any, look: Callable[[], None]) -> None:
    """Look at files on rank 0; every rank fails alike."""
    failure = None
    if comm.rank == 0:
        try:
            look()
        except Exception as error:
            failure = f"{type(error).__name__}: {error}"
    failure = comm.bcast(failure)
    assert failure is None, failure
