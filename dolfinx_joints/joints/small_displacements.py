# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A watch on what the joints assume: slip and opening small against the elements.

A joint point keeps its partner and its axes for ever (paper eq. 1), which a slip or an opening of
the size of an element makes wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import warn
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import Floats

# Of the element size.
LARGEST_JUMP = 0.1


class SmallDisplacements:
    """Keeps the largest jump of each joint relative to the element size, and warns once of it.

    Args:
        contact: The joints; those without element sizes (plain matrices) are not watched.
    """

    def __init__(self, contact: Contact | None) -> None:
        sizes = None if contact is None else contact.operator.sizes
        self._contact, self._sizes = contact, sizes
        count = 0 if contact is None else len(contact.operator.names)
        self._largest: Floats = np.zeros(count)
        self._warned = np.zeros(count, dtype=bool)

    def see(self, gap: Floats) -> None:
        """Take note of the gaps of the local points, initial gap included, shape (n, 3), [m]."""
        if self._contact is None or self._sizes is None:
            return
        contact = self._contact
        _see(gap, contact.initial_gap, self._sizes, contact.operator.joint, self._largest)

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """What has been seen and said so far (collective)."""
        if self._contact is None:
            return {}
        largest = np.max(self._contact.operator.comm.allgather(self._largest), axis=0)
        return {"largest": largest, "warned": self._warned}

    def begin(self) -> None:
        """Begin anew: the next stage has results of its own to say it in."""
        self._largest[:], self._warned[:] = 0.0, False

    def load_state_dict(self, state_dict: Mapping[str, NDArray[Any]]) -> None:
        """Take up what another's ``state_dict`` gave."""
        if state_dict:
            self._largest[:], self._warned[:] = state_dict["largest"], state_dict["warned"]

    def warn(self, when: str) -> list[str]:
        """Warn of the joints that went too far since the last call; what rank 0 said (collective).

        Args:
            when: When they did, such as ``by t = 2 s``.
        """
        said: list[str] = []
        if self._contact is None or self._sizes is None:
            return said
        operator = self._contact.operator
        largest = np.max(operator.comm.allgather(self._largest), axis=0)
        for i in np.flatnonzero((largest > LARGEST_JUMP) & ~self._warned):
            self._warned[i] = True
            if operator.comm.rank == 0:
                said.append(
                    f"Joint {operator.names[i]!r}: slip or opening reached "
                    f"{100 * largest[i]:.3g} % of the element size {when}. Points keep their "
                    f"partners and axes: beyond {100 * LARGEST_JUMP:g} % displacements are no "
                    "longer small."
                )
                warn(said[-1])
        return said


@njit(cache=True)
def _see(gap: Floats, initial: Floats, sizes: Floats, joint: NDArray[Any], largest: Floats) -> None:
    """Raise the largest jump of each joint to those of its points."""
    for i in range(len(gap)):
        a, b, c = gap[i, 0] - initial[i, 0], gap[i, 1] - initial[i, 1], gap[i, 2] - initial[i, 2]
        jump = np.sqrt(a * a + b * b + c * c) / sizes[i]
        largest[joint[i]] = max(largest[joint[i]], jump)
