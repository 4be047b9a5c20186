# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

from .accuracy import Accuracy as Accuracy
from .fragility_curves import Fragility as Fragility
from .fragility_curves import fragility as fragility
from .motion_suite import MotionSuite as MotionSuite
from .runner import Study as Study
from .runner import Tally as Tally
from .table import Table as Table
from .table import read_table as read_table
from .table import write_csv as write_csv
