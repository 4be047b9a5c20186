# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The iteration on the joint forces of a time step as one compiled function.

It does what `solvers.interface.solver` does in Python, which is the text to read first and what
statics, laws without compiled loops and steps that this does not solve run.
"""
