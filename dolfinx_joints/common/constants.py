# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constants that several wings share."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2] (3rd CGPM, 1901): the g in which records are given."""

# Beyond these a run is doubtful: the energy error as a share of the largest energy (the paper's
# stayed below 4 % with joints), and the error estimated for a single step as one of the largest
# displacement.
LARGE_ENERGY_ERROR = 0.05
LARGE_LOCAL_ERROR = 0.05

# Part of the largest energy that no line of the ledger may leave unexplained: far above rounding.
LARGE_IMBALANCE = 1e-6

LARGE_LOSS = 0.01
"""Part of a motion's squared acceleration that long steps may remove: a tenth of its amplitude."""

ACCELERATION_BAND = 25.0
"""Up to this frequency accelerations are reported unless told otherwise [Hz]: above the modes that
move a dam, and low enough that peaks beside striking joints do not hang on the time step."""
