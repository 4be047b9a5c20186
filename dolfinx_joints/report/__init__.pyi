# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

from .page import Section as Section
from .runs import Addition as Addition
from .runs import Run as Run
from .writing import picture_folder as picture_folder
from .writing import write as write
