# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

from .objects import to_pandas as to_pandas
from .objects import to_pyvista as to_pyvista
from .objects import to_xarray as to_xarray
from .paraview import write_vtk as write_vtk
from .tables import write_csv as write_csv
