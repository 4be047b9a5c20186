# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

from .csv_files import write_csv as write_csv
from .datasets import to_xarray as to_xarray
from .frames import to_pandas as to_pandas
from .meshes import to_pyvista as to_pyvista
from .paraview import write_vtk as write_vtk
