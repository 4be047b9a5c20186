# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declared parameters, errors, MPI, memory and files; nothing about mechanics."""
