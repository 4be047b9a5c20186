# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""``python -m dolfinx_joints``: the command ``dolfinx-joints``."""

import sys

from dolfinx_joints.cli import main

sys.exit(main())
