# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws: arrays in, arrays out.

From gap and state to traction, tangent and new state; a law knows no mesh, no time and no solver.
"""
