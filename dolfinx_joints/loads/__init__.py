# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Patterns in space times functions of time.

A load states what it reads of a model and never imports one. Patterns are fixed, but water in
joints may follow them (`load.FollowsJoints`).
"""
