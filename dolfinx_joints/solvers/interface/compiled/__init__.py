# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The iteration on the joint forces as one compiled function, on one rank.

It does what `solvers.interface.solver` does in Python, which is the text to read first and what
several ranks and laws without compiled loops run.
"""
