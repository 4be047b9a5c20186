# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Removed names and arguments raise one sentence that names the way on."""

import inspect

import pytest

import dolfinx_joints
from dolfinx_joints.common.errors import REMOVED_ARGUMENTS, REMOVED_NAMES


@pytest.mark.parametrize("name", REMOVED_NAMES)
def test_a_removed_name(name):
    with pytest.raises(AttributeError, match=rf"^{name} was removed; .*\.$"):
        getattr(dolfinx_joints, name)
    assert name not in dir(dolfinx_joints)


@pytest.mark.parametrize(
    ("of", "name"), [(of, name) for of, removed in REMOVED_ARGUMENTS.items() for name in removed]
)
def test_a_removed_argument(of, name):
    pytest.importorskip("dolfinx")
    from dolfinx_joints import EnergyConsistent, Model, Simulation

    call = {"EnergyConsistent": EnergyConsistent, "Model": Model, "dynamics": Simulation.dynamics}
    with pytest.raises(TypeError, match=rf"^{name} was removed; .*\.$"):
        call[of](**{name: 0.8})
    assert name not in inspect.signature(call[of]).parameters


def test_other_arguments_are_as_before():
    pytest.importorskip("dolfinx")
    from dolfinx_joints import EnergyConsistent

    assert EnergyConsistent(exact_modes=3) == EnergyConsistent(exact_modes=3)
    assert EnergyConsistent(exact_modes=3).exact_modes == 3
    with pytest.raises(TypeError, match="unexpected keyword argument 'radius'"):
        EnergyConsistent(radius=0.8)
    with pytest.raises(ValueError, match="exact_modes is -1"):
        EnergyConsistent(exact_modes=-1)
