# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints whose points touch and lift every few steps."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from whole_vectors import as_read

from dolfinx_joints.joints.chatter import Chatter


def seen(pressed, chatter=None, rubbed=1.0):
    """Two joints of two points of 1 m^2; the second is pressed all along."""
    operator = SimpleNamespace(
        joint=np.array([0, 0, 1, 1]),
        areas=np.ones(4),
        names=("a", "b"),
        comm=MPI.COMM_SELF,
        gather=np.copy,
    )
    chatter = chatter or Chatter(SimpleNamespace(operator=operator))
    for on in pressed:
        traction = -np.array([on, on, 1.0, 1.0])[:, None] * [1.0, 0.0, 0.0]
        chatter.record(SimpleNamespace(traction=traction, dissipation=np.full(4, rubbed)), 0.1, 0.1)
    return chatter


def test_contacts_of_two_steps():
    """All impulse of the first joint, but for its first and last contact, comes in two steps."""
    assert seen([1, 1, 0] * 40 + [1]).joints() == pytest.approx({"a": 78 / 81})


@pytest.mark.parametrize(
    "pressed",
    [[1, 1, 0] * 15, ([1] * 12 + [0]) * 40, ([1] + [0] * 12) * 40],
    ids=["few", "lasting", "bouncing"],
)
def test_impacts_and_lasting_contacts_are_no_chatter(pressed):
    assert seen(pressed).joints() == {}


def test_nothing_that_sticks_chatters():
    assert seen([1, 1, 0] * 40, rubbed=0.0).joints() == {}


@pytest.mark.parametrize("first", [15, 16, 17])
def test_continued(first):
    """Within a contact or a flight, to the same share."""
    steps = [1, 1, 0] * 40
    whole, begun, second = seen(steps), seen(steps[:first]), seen([])
    second.load_state_dict(as_read(begun.state_dict()))
    assert seen(steps[first:], second).joints() == pytest.approx(whole.joints())
    assert Chatter(None).joints() == {}
    assert Chatter(None).state_dict() == {}
