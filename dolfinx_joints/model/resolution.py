# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Highest frequencies of elastic waves that the mesh and the joints of a model resolve."""

from __future__ import annotations

import math
from typing import Any

import basix
import numpy as np

from dolfinx_joints.materials.bulk_law import Material, elastic_part
from dolfinx_joints.materials.orthotropic import Orthotropic
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.mesh.dolfinx_versions import geometry_nodes
from dolfinx_joints.model.model import Model
from dolfinx_joints.results.resolved import Resolved

NODES_PER_WAVELENGTH = 10.0


def resolution(model: Model) -> Resolved:
    """Return the highest frequencies that mesh and joints resolve at any time step (collective)."""
    topology = model.jointed.mesh.topology
    cells = topology.index_map(topology.dim)
    waves = np.zeros((cells.size_local + cells.num_ghosts, 3))
    for group, material in model.body.materials.items():
        waves[model.jointed.cells(group) if group else slice(None)] = _waves(material)
    return Resolved(mesh=of_mesh(model, waves[:, 0]), joints=of_joints(model, waves[:, 1:]))


def of_mesh(model: Model, speed: Floats) -> float:
    """Return min c_s p / (10 h) of all cells, ten nodes per shear wave [Hz] (collective).

    p is the displacement's degree, h a cell's longest edge, c_s the ``speed`` of the slowest shear
    wave in each local cell [m/s]. Kuhlemeyer and Lysmer (1973) require eight to ten nodes; a
    wave is then 1.6 % too fast with linear elements.
    """
    mesh, shape = model.jointed.mesh, model.jointed.shape
    nodes, longest = geometry_nodes(mesh), np.zeros(len(speed))
    for a, b in basix.topology(shape.type)[1]:
        along = mesh.geometry.x[nodes[:, b]] - mesh.geometry.x[nodes[:, a]]
        longest = np.maximum(longest, np.linalg.norm(along, axis=1))
    degree = model.V.ufl_element().degree
    least = (speed * degree / (NODES_PER_WAVELENGTH * longest)).min(initial=math.inf)
    return min(mesh.comm.allgather(float(least)))


def of_joints(model: Model, impedance: Floats) -> float:
    """Return the lowest frequency [Hz] at which a closed joint transmits half of a wave's energy.

    (Collective.) Compared with a bonded joint, a spring k between bodies of impedances Z = rho c
    transmits the fraction 1 / (1 + (omega / (k (1/Z- + 1/Z+)))^2) (Schoenberg 1980). It is one half
    at f = k (1/Z- + 1/Z+) / (2 pi), or k / (pi Z) between equal bodies. k is k_n for pressure waves
    and k_s for shear waves, unless k_s is zero. Z is the largest impedance at the joint.
    ``impedance`` has rho c_p and rho c_s of each local cell, shape (n, 2), [kg/(m^2 s)].
    """
    if model.contact is None:
        return math.inf
    topology, names = model.jointed.mesh.topology, list(model.contact.laws)
    cells = topology.connectivity(topology.dim - 1, topology.dim)
    largest = np.zeros((len(names), 2, 2))
    for i, name in enumerate(names):
        for side, sign in enumerate("-+"):
            behind = cells.array[cells.offsets[model.jointed.facets(name + sign)]]
            largest[i, side] = impedance[behind].max(axis=0, initial=0.0)
    largest = np.max(model.jointed.mesh.comm.allgather(largest), axis=0)
    stiffness = np.array([law.closed_stiffness() for law in model.contact.laws.values()])
    with np.errstate(divide="ignore"):
        frequency = stiffness * (1.0 / largest).sum(axis=1) / (2.0 * np.pi)
    return float(frequency[stiffness > 0.0].min(initial=math.inf))


def _waves(material: Material) -> tuple[float, float, float]:
    """Return the least c_s [m/s], and rho c_p and rho c_s of the fastest waves [kg/(m^2 s)]."""
    elastic: Any = elastic_part(material)
    shear = elastic.shear if isinstance(elastic, Orthotropic) else (elastic.shear_modulus,)
    pressure = elastic.stiffness_matrix().diagonal()[:3].max()
    density = elastic.density
    slowest = math.sqrt(min(shear) / density) if density else math.inf
    return slowest, math.sqrt(density * pressure), math.sqrt(density * max(shear))
