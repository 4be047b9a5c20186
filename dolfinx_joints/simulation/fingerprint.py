# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facts that tell one run from another: model, loads, motion, scheme and step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.supports import Prescribed, place_of
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.common.parameters import number_at
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.loads.load import FollowsJoints
from dolfinx_joints.loads.water.joint_water import label
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.inventory import HASH, Inventory, hashed

Floats = NDArray[np.float64]

# Sums over other numbers of ranks differ by rounding.
SAME = 1e-9

# Sums that stand for a vector, or for a function of time: shorter ones are compared one by one.
PARTS = 1021


def fingerprint(
    model: Model,
    system: MatrixSystem,
    nodes: NodeNumbering,
    settings: Mapping[str, Any],
    motion: Callable[[float], Any] | None,
    times: Floats,
) -> tuple[dict[str, Any], list[str]]:
    """Facts of a run by name, and what it has that cannot be compared (collective).

    They are the same on any number of ranks; those of rank 0 count. Matrices are known by their
    products with a field that weighs each node differently, functions of time by their values at
    all times and by what they hold.

    Args:
        model: The model.
        system: Its system in this run.
        nodes: Numbers the nodes.
        settings: Further facts, nodal vectors among them.
        motion: Ground acceleration [m/s^2] at a time [s], or None.
        times: Those of the steps [s]; of a static state only the one.
    """
    sums = _NodalSums(system, nodes, model)
    held = Inventory()
    vectors = {name: value for name, value in settings.items() if isinstance(value, PETSc.Vec)}
    damping: dict[str, Any] = {"Rayleigh damping": system.rayleigh}
    if system.damped_modes is not None:
        damping["damping ratios"] = system.damped_modes.asked
    for name, value in {**settings, **damping}.items():
        if name not in vectors:
            held.add(name, value)
    comm, points = model.jointed.mesh.comm, nodes.positions
    facts: dict[str, Any] = {**held.facts}
    facts["node coordinates"] = _of_ranks(comm, _numbers(nodes.first, points), points.ravel())
    facts |= {name: sums(vector.getArray(readonly=True)) for name, vector in vectors.items()}
    matrices = {"mass": system.mass, "stiffness": system.stiffness, "dashpots": system.dashpots}
    for name, matrix in matrices.items():
        facts[f"{name} matrix"] = sums.of_matrix(matrix)
    fixed = np.zeros(len(sums.weights))
    fixed[system.constrained] = 1.0
    facts["supports"] = sums(fixed)
    if system.values is not None:
        weights = sums.weights[system.constrained]
        moved = np.array([system.prescribed(float(t)) @ weights for t in times])
        every = summed(comm, moved)
        facts["motion of the supports"] = _over_time(every)
    functions: dict[str, Any] = {}
    if motion is not None:
        axes = np.array([motion(float(t)) for t in times]).T
        facts["ground motion"] = np.array([_over_time(axis) for axis in axes])
        functions["ground motion"] = motion
    named = [
        (f"load {name}", *p) for name, p in zip(system.load_names, system.patterns, strict=True)
    ]
    # Time by time: the components of a motion come from one call.
    factors = np.array([[number_at(n, f, float(t)) for n, _, f in named] for t in times])
    for i, (load, vector, factor) in enumerate(named):
        name = _unused(load, facts)
        facts[name] = sums(vector.getArray(readonly=True))
        facts[f"{name}, factor"] = _over_time(factors[:, i])
        functions[f"{name}, factor"] = factor
    if system.water is not None:
        facts |= system.water.facts(times)
        facts |= _of_points(model.operator, system.water.at_points())
        following = [load for load in system.in_joints if isinstance(load, FollowsJoints)]
        functions |= {f"load {label(load)}, factor": load for load in following}
    for support in model.supports:
        if isinstance(support, Prescribed):
            functions[f"displacement {support.component} of {place_of(support)}"] = support.value
    if system.contact is not None:
        facts |= _of_joints(system.contact, held)
    if len(times) > 1:
        for name, function in functions.items():
            held.add(f"{name}, its function", function)
    return {**facts, **held.facts}, held.unknown


def _of_joints(contact: Contact, held: Inventory) -> dict[str, Any]:
    """Facts of the joint points; what the laws hold is added (collective)."""
    operator = contact.operator
    held.add("joints", ", ".join(operator.names))
    for name, law in contact.laws.items():
        held.add(f"law of {name}", law)
    # A law may hold arrays of its rank's points, of which rank 0 knows its own alone.
    of_rank = sorted(fact for fact in held.facts.items() if fact[0].startswith("law of "))
    of_ranks = operator.comm.allgather(hashed(of_rank))
    if len(set(of_ranks)) > 1:
        held.facts["laws as each rank holds them"] = hashed(of_ranks)
    facts: dict[str, Any] = {
        "joint points": operator.areas,
        "joints of the points": operator.joint,
    }
    return _of_points(operator, {**facts, "initial gaps": contact.initial_gap})


def _of_points(operator: GapOperator | None, values: Mapping[str, Floats]) -> dict[str, Floats]:
    """Sums that stand for values of the local joint points, (n, ...), by name (collective)."""
    assert operator is not None
    first = operator.matrix.getOwnershipRange()[0] // 3
    return {
        name: _of_ranks(operator.comm, _numbers(first, each), each.ravel())
        for name, each in values.items()
    }


def _numbers(first: int, rows: NDArray[Any]) -> NDArray[np.int64]:
    """Number of each entry of rows of all ranks, those of this rank beginning at the ``first``."""
    width = int(np.prod(rows.shape[1:]))
    return np.arange(first * width, (first + len(rows)) * width)


def _of_ranks(comm: Any, numbers: NDArray[np.int64], values: Floats) -> Floats:
    """Sums over numbered values of all ranks (collective)."""
    return summed(comm, _sums(numbers, values))


def first_difference(saved: Mapping[str, Any], here: Mapping[str, Any]) -> str | None:
    """A clause that names the first fact in which two runs differ, None where they are alike."""
    for name in (*here, *saved):
        one, other = saved.get(name), here.get(name)
        if one is None or other is None:
            return f"{name}: only {'this run' if one is None else 'the checkpoint'} has it"
        if isinstance(other, str) or isinstance(one, str):
            if one != other:
                hashed = any(str(each).startswith(HASH) for each in (one, other))
                text = f"{one} in the checkpoint, {other} here"
                return f"{name}: {'not the same' if hashed else text}"
        elif not _alike(np.asarray(one), np.asarray(other)):
            return f"{name}: the numbers are not the same"
    return None


def _alike(one: Floats, other: Floats) -> bool:
    """Whether numbers are the same but for rounding, of a table row by row."""
    if one.shape != other.shape:
        return False
    scale = np.abs(one).max(axis=-1, keepdims=True, initial=0.0)
    return bool(np.all(np.abs(one - other) <= SAME * scale))


def _unused(name: str, facts: Mapping[str, Any]) -> str:
    """A name, numbered where it is taken."""
    numbered = (name if i == 1 else f"{name} ({i})" for i in count(1))
    return next(each for each in numbered if each not in facts)


def _over_time(values: Floats) -> Floats:
    """Sums that stand for the values at all times."""
    return _sums(np.arange(len(values)), values)


def _sums(numbers: NDArray[np.int64], values: Floats) -> Floats:
    """Sums over groups of numbered values, each with a weight of its own between 0.5 and 2.5."""
    weights = 1.5 + np.sin(numbers.astype(np.float64))
    sums = np.bincount(numbers % PARTS, weights * values, minlength=PARTS)
    return np.asarray(sums, dtype=np.float64)


class _NodalSums:
    """Sums that stand for nodal vectors, the same on any number of ranks."""

    def __init__(self, system: MatrixSystem, nodes: NodeNumbering, model: Model) -> None:
        """Number the dofs by their node's place in the input, those of the water after them."""
        self._comm, self._field = model.jointed.mesh.comm, system.stiffness.createVecRight()
        owned = nodes.number[: model.V.dofmap.index_map.size_local]
        self._dofs = (model.gdim * owned[:, None] + np.arange(model.gdim)).ravel()
        if system.coupled is not None:
            self._dofs = np.append(self._dofs, model.num_dofs + system.coupled.numbers)
        self.weights = 1.5 + np.sin(self._dofs.astype(np.float64))
        self._field.setArray(self.weights)

    def __call__(self, values: Floats) -> Floats:
        """Sums of a value per owned dof (collective)."""
        return _of_ranks(self._comm, self._dofs, values)

    def of_matrix(self, matrix: PETSc.Mat | None) -> Floats:
        """Those of a matrix times the weights, none for no matrix (collective)."""
        if matrix is None:
            return np.zeros(0)
        product = self._field.duplicate()
        matrix.mult(self._field, product)
        return self(product.getArray(readonly=True))
