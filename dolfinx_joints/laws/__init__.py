# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws: arrays in, arrays out.

From gap and state to traction, tangent and new state, or in condensed form. A law knows no mesh and
no time; one that depends on rates is given the length of the step, ``for_step(dt)``.
"""
