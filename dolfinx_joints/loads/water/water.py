# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water with a potential, as matrices: what a body is coupled with, whatever they are made of.

The unknown is y = phi / c, the velocity potential over the speed of sound [m], with the pressure
p = -rho c dy/dt: like a displacement it has a mass, a stiffness and dashpots, (12t) to (12w).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from scipy.sparse import csr_array

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.cells import Floats, Ints

if TYPE_CHECKING:
    from dolfinx_joints.loads.water.far_field import Section


@dataclass(frozen=True, kw_only=True)
class WaterRows:
    """Some rows of the water's matrices; columns are those of all its unknowns.

    Attributes:
        mass: Of the energy of the pressure and of a surface that moves [kg].
        stiffness: Of the energy of motion [N/m].
        losses: Dashpots of the bottom, of the far end and before it [N s/m].
    """

    mass: csr_array
    stiffness: csr_array
    losses: csr_array


@dataclass(frozen=True, kw_only=True)
class WaterCells:
    """The water as cells, for files.

    Attributes:
        surface: Points with no pressure, numbered after the unknowns, shape (n, gdim), [m].
        nodes: Unknowns and these points in each cell, in VTK's order, shape (cells, nodes).
        kind: VTK's number of the cells' shape.
    """

    surface: Floats
    nodes: Ints
    kind: int


@dataclass(frozen=True, kw_only=True)
class Water:
    """Water with a potential, before a body.

    Attributes:
        size: Number of its unknowns.
        impedance: rho c [Pa s/m].
        rows: Makes the rows from one unknown up to another.
        coupling: Unknowns times dofs of the body, the integral of shape functions times the
            outward normal of the body, shape (size, dofs), [m^2].
        driven: That of shape functions times the outward normal of the water over all that moves
            with the ground, shape (size, gdim), [m^2].
        places: Coordinates of the unknowns, shape (size, gdim), [m].
        face: Those on the face of the body, shape (n,).
        cells: Makes its cells.
        section: Its cross-section where the far end takes waves, None where that is not known.
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
        """Its matrices, in the same order on any number of ranks (collective)."""


def reflected(alpha: float) -> float:
    """Dashpot over rho c of a bound that reflects the share alpha of a wave's pressure, (12s)."""
    return (1.0 - alpha) / (1.0 + alpha)


def surface_inertia(density: float, sound_speed: float) -> float:
    """Mass per area of a surface whose height makes the pressure on it, rho c^2 / g, (12af)."""
    return density * sound_speed**2 / STANDARD_GRAVITY
