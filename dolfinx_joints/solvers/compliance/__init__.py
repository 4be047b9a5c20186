# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance of the structure at the joints: computed, stored dense or in blocks of low rank."""
