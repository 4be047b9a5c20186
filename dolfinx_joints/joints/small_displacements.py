# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Check of the assumption of small displacements: slip and opening are small against the elements.

Joint points keep their initial partner points and axes (paper eq. 1). This assumption is wrong if
slip or opening reaches the size of an element.
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

# Fraction of the element size.
LARGEST_JUMP = 0.1


class SmallDisplacements:
    """Record of the largest jump / element size of each joint; warns once per joint.

    Args:
        contact: The joints, or None. Joints given by a matrix have no element sizes; ignored.
    """

    def __init__(self, contact: Contact | None) -> None:
        sizes = None if contact is None else contact.operator.sizes
        self._contact, self._sizes = contact, sizes
        count = 0 if contact is None else len(contact.operator.names)
        self._largest: Floats = np.zeros(count)
        self._warned = np.zeros(count, dtype=bool)

    def record(self, gap: Floats) -> None:
        """Record the gaps of the local points including the initial gap, shape (n, 3), [m]."""
        if self._contact is None or self._sizes is None:
            return
        contact = self._contact
        _record(gap, contact.initial_gap, self._sizes, contact.operator.joint, self._largest)

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return the recorded data for a restart (collective)."""
        if self._contact is None:
            return {}
        largest = np.max(self._contact.operator.comm.allgather(self._largest), axis=0)
        return {"largest": largest, "warned": self._warned}

    def begin(self) -> None:
        """Reset, so that the results of the next stage contain the warnings again."""
        self._largest[:], self._warned[:] = 0.0, False

    def load_state_dict(self, state_dict: Mapping[str, NDArray[Any]]) -> None:
        """Restore the data of ``state_dict``."""
        if state_dict:
            self._largest[:], self._warned[:] = state_dict["largest"], state_dict["warned"]

    def warn(self, when: str) -> list[str]:
        """Warn of joints that newly exceed the limit; return the messages on rank 0 (collective).

        Args:
            when: Text with the time for the message, such as ``by t = 2 s``.
        """
        messages: list[str] = []
        if self._contact is None or self._sizes is None:
            return messages
        operator = self._contact.operator
        largest = np.max(operator.comm.allgather(self._largest), axis=0)
        for i in np.flatnonzero((largest > LARGEST_JUMP) & ~self._warned):
            self._warned[i] = True
            if operator.comm.rank == 0:
                messages.append(
                    f"Joint {operator.names[i]!r}: slip or opening reached "
                    f"{100 * largest[i]:.3g} % of the element size {when}. Joint points keep "
                    "their initial partners and axes: displacements must be small, here at most "
                    f"{100 * LARGEST_JUMP:g} %."
                )
                warn(messages[-1])
        return messages


@njit(cache=True)
def _record(
    gap: Floats, initial: Floats, sizes: Floats, joint: NDArray[Any], largest: Floats
) -> None:
    """Update the largest relative jump of each joint."""
    for i in range(len(gap)):
        a, b, c = gap[i, 0] - initial[i, 0], gap[i, 1] - initial[i, 1], gap[i, 2] - initial[i, 2]
        jump = np.sqrt(a * a + b * b + c * c) / sizes[i]
        largest[joint[i]] = max(largest[joint[i]], jump)
