# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws do at one point, compiled: return mapping, discrete gradient, compliance."""
