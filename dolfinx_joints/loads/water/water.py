# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of compressible water for the coupling with a body, for any kind of reservoir.

The unknown is y = phi / c [m], the velocity potential divided by the speed of sound. The pressure
is p = -rho c dy/dt. Like a displacement, y has mass, stiffness and dashpots, (12t) to (12w).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from scipy.sparse import csr_array

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.loads.load import LoadedBody
from dolfinx_joints.mesh.cells import Floats, Ints

if TYPE_CHECKING:
    from dolfinx_joints.loads.water.far_field import Section


@dataclass(frozen=True, kw_only=True)
class WaterRows:
    """Some rows of the water matrices; the columns are all unknowns of the water.

    Attributes:
        mass: Matrix of the compression energy, and of the energy of a surface with waves [kg].
        stiffness: Matrix of the kinetic energy [N/m].
        losses: Dashpots of the bottom, of the far end and of the absorbing part before it [N s/m].
    """

    mass: csr_array
    stiffness: csr_array
    losses: csr_array


@dataclass(frozen=True, kw_only=True)
class WaterCells:
    """Cells of the water, for result files.

    Attributes:
        surface: Points without pressure, numbered after the unknowns, shape (n, gdim), [m].
        nodes: Unknowns and surface points of each cell in VTK's order, shape (cells, nodes).
        kind: VTK cell type.
    """

    surface: Floats
    nodes: Ints
    kind: int


@dataclass(frozen=True, kw_only=True)
class Water:
    """Compressible water in front of a body.

    Attributes:
        size: Number of unknowns.
        impedance: rho c [Pa s/m].
        rows: Function that returns the rows from one unknown up to another.
        coupling: Integral of the shape functions of water and body times the normal of the body,
            shape (size, dofs), [m^2].
        driven: Integral of the shape functions times the outward normal of the water over all
            boundaries that move with the ground, shape (size, gdim), [m^2].
        places: Coordinates of the unknowns, shape (size, gdim), [m].
        face: Unknowns on the face of the body, shape (n,).
        cells: Function that returns the cells.
        section: Cross-section at an absorbing far end; None if the wave needs no correction there.
    """

    size: int
    impedance: float
    rows: Callable[[int, int], WaterRows]
    coupling: csr_array
    driven: Floats
    places: Floats
    face: Ints
    cells: Callable[[], WaterCells]
    section: Section | None = None


class Reservoir(Protocol):
    """Compressible water with waves, `ReservoirWaves` or `MeshedReservoir`."""

    def water(self, model: LoadedBody) -> Water:
        """Return the matrices, ordered independently of the number of ranks (collective)."""


def reflected(alpha: float) -> float:
    """Return the dashpot of a boundary with reflection coefficient alpha, per rho c, (12s)."""
    return (1.0 - alpha) / (1.0 + alpha)


def surface_inertia(density: float, sound_speed: float) -> float:
    """Return the mass per area of a surface with gravity waves, rho c^2 / g, (12af)."""
    return density * sound_speed**2 / STANDARD_GRAVITY
