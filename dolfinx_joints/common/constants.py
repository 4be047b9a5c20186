# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constants shared by several subpackages."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2] (3rd CGPM, 1901): the g in which records are given."""

# Largest errors without a warning. The energy error is relative to the largest energy; with joints
# the paper's is below 4 %. The error of a single step is relative to the largest displacement.
LARGE_ENERGY_ERROR = 0.05
LARGE_LOCAL_ERROR = 0.05

# Largest imbalance of the energy ledger, relative to the largest energy; far above rounding.
LARGE_IMBALANCE = 1e-6

LARGE_LOSS = 0.01
"""Largest fraction of a motion's squared acceleration that a long step may filter out: 10 % of the
amplitude."""

ACCELERATION_BAND = 25.0
"""Default cut-off frequency of reported accelerations [Hz]. It is above the governing modes of a
dam, and low enough that peaks near closing joints do not depend on the time step."""
