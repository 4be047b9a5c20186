# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints whose points touch and lift every few steps."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from dolfinx_joints.joints.chatter import Chatter


def seen(pressed, chatter=None):
    """Two joints of two points of 1 m^2; the second is pressed all along."""
    operator = SimpleNamespace(
        joint=np.array([0, 0, 1, 1]), areas=np.ones(4), names=("a", "b"), comm=MPI.COMM_SELF
    )
    chatter = chatter or Chatter(SimpleNamespace(operator=operator))
    for on in pressed:
        traction = -np.array([on, on, 1.0, 1.0])[:, None] * [1.0, 0.0, 0.0]
        chatter.see(SimpleNamespace(traction=traction), 0.1)
    return chatter


def test_contacts_of_two_steps():
    """All impulse of the first joint, but for its last contact, comes in contacts of two steps."""
    assert seen([1, 1, 0] * 40 + [1]).joints() == pytest.approx({"a": 80 / 81})


def test_impacts_and_lasting_contacts_are_no_chatter():
    assert seen([1, 1, 0] * 15).joints() == {}
    assert seen(([1] * 12 + [0]) * 40).joints() == {}


def test_continued():
    first = seen([1, 0] * 15)
    second = seen([])
    second.load_state_dict(first.state_dict())
    assert seen([1, 0] * 15, second).joints() == pytest.approx({"a": 1.0})
    assert Chatter(None).joints() == {}
    assert Chatter(None).state_dict() == {}
