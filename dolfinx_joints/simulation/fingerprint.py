# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facts that tell one run from another: model, loads, motion, scheme and step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.parameters import number_at
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem

Floats = NDArray[np.float64]

# Sums over other numbers of ranks differ by rounding.
SAME = 1e-9


def fingerprint(
    model: Model,
    system: MatrixSystem,
    nodes: NodeNumbering,
    settings: Mapping[str, Any],
    motion: Callable[[float], Any] | None,
    times: Floats,
) -> dict[str, Any]:
    """Facts of a run by name, the same on any number of ranks (collective).

    Matrices and loads are known by their products with a field that weighs each node differently.

    Args:
        model: The model.
        system: Its system in this run.
        nodes: Numbers the nodes.
        settings: Further facts, compared as text.
        motion: Ground acceleration [m/s^2] at a time [s], or None.
        times: Times at which functions of time are compared [s].
    """
    weights = _weights(system, nodes, model.gdim)
    facts: dict[str, Any] = {name: _as_text(value) for name, value in settings.items()}
    facts["node coordinates"] = nodes.positions
    matrices = {"mass": system.mass, "stiffness": system.stiffness, "dashpots": system.dashpots}
    for name, matrix in matrices.items():
        facts[f"{name} matrix"] = _energy(matrix, weights)
    facts["Rayleigh damping"] = _as_text(system.rayleigh)
    fixed = np.zeros(weights.getLocalSize())
    fixed[system.constrained] = 1.0
    facts["supports"] = _sum(model, fixed * weights.getArray(readonly=True))
    facts["motion of the supports"] = np.array(
        [
            _sum(model, system.prescribed(float(t)) @ weights.getArray()[system.constrained])
            for t in times
            if system.values is not None
        ]
    )
    if motion is not None:
        facts["ground motion"] = np.array([np.asarray(motion(float(t)))[:3] for t in times])
    for i, (vector, factor) in enumerate(system.patterns):
        name = f"load {system.load_names[i]}"
        values = np.array([number_at(name, factor, float(t)) for t in times])
        both = np.array([float(vector.dot(weights)), float(vector.norm())])
        facts[name] = np.concatenate([facts.get(name, np.zeros(0)), np.outer(both, values).ravel()])
    if system.water is not None:
        facts |= system.water.facts(times)
    if system.contact is not None:
        contact = system.contact
        facts["joints"] = ", ".join(contact.operator.names)
        facts["laws of the joints"] = "; ".join(_as_text(law) for law in contact.laws.values())
        gap = np.linalg.norm(contact.initial_gap, axis=1)
        facts["joint points"] = contact.integrals(np.ones(len(gap)))
        facts["initial gaps"] = contact.integrals(gap)
    return facts


def first_difference(saved: Mapping[str, Any], here: Mapping[str, Any]) -> str | None:
    """A clause that names the first fact in which two runs differ, None where they are alike."""
    for name in (*here, *saved):
        one, other = saved.get(name), here.get(name)
        if one is None or other is None:
            return f"{name}: only {'this run' if one is None else 'the checkpoint'} has it"
        if isinstance(other, str) or isinstance(one, str):
            if one != other:
                return f"{name}: {one} in the checkpoint, {other} here"
        elif not _alike(np.asarray(one), np.asarray(other)):
            return f"{name}: the numbers are not the same"
    return None


def _alike(one: Floats, other: Floats) -> bool:
    if one.shape != other.shape:
        return False
    scale = float(np.abs(one).max(initial=0.0))
    return bool(np.allclose(one, other, rtol=SAME, atol=SAME * scale))


def _as_text(value: Any) -> str:
    """A value as text, without the address that Python shows of plain objects."""
    text = repr(value)
    return text if " at 0x" not in text else type(value).__qualname__


def _weights(system: MatrixSystem, nodes: NodeNumbering, components: int) -> PETSc.Vec:
    """A number between 0.5 and 2.5 for each dof, by its node's place in the input."""
    weights = system.stiffness.createVecRight()
    owned = nodes.number[: weights.getLocalSize() // components]
    dofs = components * owned[:, None] + np.arange(components)
    weights.setArray(1.5 + np.sin(dofs.ravel().astype(np.float64)))
    return weights


def _energy(matrix: PETSc.Mat | None, weights: PETSc.Vec) -> float:
    if matrix is None:
        return 0.0
    product = weights.duplicate()
    matrix.mult(weights, product)
    return float(product.dot(weights))


def _sum(model: Model, values: Any) -> float:
    return float(model.jointed.mesh.comm.allreduce(float(np.sum(values))))
