# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads: nodal force patterns times functions of time.

A load reads the model through the protocol `LoadedBody` and never imports `Model`. Patterns are
fixed, except those of water pressures that follow the joint openings (`load.FollowsJoints`).
"""
