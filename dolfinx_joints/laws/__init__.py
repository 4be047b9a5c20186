# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws: arrays in, arrays out.

A law maps gap and state to traction, tangent and new state, also in condensed form, without mesh
and time. A rate-dependent law receives the step length by ``for_step(dt)``.
"""
