# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of results with respect to joint parameters, by a reverse sweep over recorded steps."""
