# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies of jointed dams: the case of the 1992 paper, its figures, and its open questions."""
