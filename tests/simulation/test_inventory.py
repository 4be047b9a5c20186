# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What values hold reads alike when a script is started again, and otherwise once it changed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import ShearKeyJoint
from dolfinx_joints.laws.law import JointState
from dolfinx_joints.simulation.inventory import Inventory

# A user's module in which {} stands for one number.
SCRIPT = """
import functools, json, sys
from dataclasses import dataclass
import numba, numpy as np
from dolfinx_joints import FrictionNoTension, Motion, ViscousJoint
from dolfinx_joints.simulation.inventory import Inventory

one, kinds = {0}, {{"stick", "slip", "open"}}
table = np.linspace(0.0, {1}, 7)

@numba.njit
def compiled(x):
    return x + {2}

def inner(t):
    return one * t if "slip" in {{"slip", "stick"}} else compiled(t)

@functools.lru_cache
def factor(t, scale={3}):
    return scale * inner(t) + np.interp(t, table, table)

class Base:
    share = {4}
    def __call__(self, t):
        return sum(v for v in [self.share, {5}])

class Slotted(Base):
    __slots__ = ("k",)
    def __init__(self):
        self.k = {6}

@dataclass(frozen=True)
class Nested:
    parts: dict
    @property
    def value(self):
        return {7}

soft = FrictionNoTension(normal_stiffness=1e9 + {8}, shear_stiffness=1e9, friction_angle_deg=30)
record = Motion(acceleration=np.outer(np.arange(3.0) + {9}, [1, 1, 1]), dt=0.1)
values = [
    functools.partial(factor, scale=2.0), Slotted(), Nested({{"a": [soft, kinds], 2: record}}),
    ViscousJoint(law=soft, normal_viscosity=1.0 + {10}, shear_viscosity=1.0), record.__call__,
    list(range(1000)) + [{11}],
]
held = Inventory()
held.add("x", values)
assert not held.unknown, held.unknown
if __name__ == "__main__":
    print(json.dumps(held.facts))
"""
COUNT = 12


def script(changed=None):
    """The script with one of its numbers changed."""
    return SCRIPT.format(*(2.0 if i == changed else 1.0 for i in range(COUNT)))


def facts(changed=None):
    """What the script finds in this process."""
    module = ModuleType("script")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "script", module)
        exec(compile(script(changed), "script.py", "exec"), vars(module))
    return module.held.facts


def test_the_same_in_another_process(tmp_path):
    """Addresses and the order of sets say nothing, which that process has otherwise."""
    path = tmp_path / "script.py"
    path.write_text(script())
    here = os.environ.get("PYTHONHASHSEED", "random")
    given = {**os.environ, "PYTHONHASHSEED": "1" if here != "1" else "2"}
    run = [sys.executable, str(path)]
    found = subprocess.run(run, env=given, capture_output=True, text=True, check=True)
    assert json.loads(found.stdout) == facts()


@pytest.mark.parametrize("changed", range(COUNT))
def test_each_number_is_seen(changed):
    assert facts(changed) != facts()


def test_what_a_law_has_worked_out_is_no_fact():
    law = ShearKeyJoint(
        normal_stiffness=1e10,
        shear_stiffness=4e9,
        friction_angle_deg=30.0,
        depth=0.2,
        flank_angle_deg=45.0,
        spacing=1.0,
        tooth_cohesion=1e6,
    )

    def facts():
        inventory = Inventory()
        inventory.add("law", law)
        assert not inventory.unknown
        return inventory.facts

    before, gap = facts(), np.zeros((1, 3))
    state = replace(JointState.at_rest(gap), internal=law.initial_variables(gap))
    law.backward_euler(gap, state)
    assert facts() == before
