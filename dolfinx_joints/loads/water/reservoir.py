# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Added mass of a reservoir by finite elements, of incompressible water by default.

The reservoir is the wet face moved horizontally upstream: its floor and banks are the traces of the
face's edges, so the valley has the same cross-section all along. It matches the face by
construction and needs no mesh of its own; see `slabs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.memory import SHARE, available_bytes
from dolfinx_joints.common.mpi import lasting, on_root
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.loads.load import Vector
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.loads.water.reservoir_slabs import half_of_inverse, resistance
from dolfinx_joints.loads.water.wet_face import (
    WetFace,
    check_reaches_level,
    check_upstream,
    wet_face,
)
from dolfinx_joints.mesh.cells import Floats, Ints

# Of the largest coupling, below which a direction of a node feels no pressure.
UNFELT = 1e-12

# Square matrices over the water's nodes while slabs are doubled; copies of the added mass with
# their indices, in M, in its copies and in the factor of a step.
SLAB_MATRICES, MASS_BYTES = 8, 64


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirMass:
    """Added mass of water in a reservoir with the cross-section of the wet face.

    The water is incompressible unless a frequency is given: Laplace's equation for the pressure,
    p = 0 at the level, dp/dn = -rho a_n on the face, zero on floor and banks. The mass couples all
    nodes of the wet face, moves with it and has no weight.

    Attributes:
        group: Name of the facet group, which reaches up to the level or higher.
        level: Height of the water, a coordinate along z (y in 2-D) [m].
        length: Of the reservoir, up to a rigid end at rest [m]; endless unless given.
        upstream: Horizontal vector along which it extends; the mean normal of the wet face, without
            its vertical part, unless given.
        density: Of the water [kg/m^3].
        frequency: Of the motion [Hz]: above zero the mass is that of compressible water in a
            steady vibration at this frequency, which must be below those of the reservoir itself.
        sound_speed: Of compressible water [m/s].
    """

    group: str
    level: Annotated[float, at.Unit("m")]
    length: Annotated[float, at.Gt(0), at.Unit("m")] | None = None
    upstream: Vector | None = None
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")] = 1000.0
    frequency: Annotated[float, at.Ge(0), at.Unit("Hz")] = 0.0
    sound_speed: Annotated[float, at.Gt(0), at.Unit("m/s")] = 1440.0

    def __post_init__(self) -> None:
        check_upstream(self)

    def __str__(self) -> str:
        return f"ReservoirMass on {shown(self.group)}"

    def matrix(self, model: LoadedBody) -> PETSc.Mat:
        """The added mass in the layout of the model's matrices [kg] (collective).

        Raises:
            ValueError: The face ends below the level, a region of it does not reach the level, a
                part of it does not look upstream, or the matrix does not fit into memory.
            MeshError: There is no such group, or some of its facets lie inside the body.
        """
        comm = model.jointed.mesh.comm
        wet = wet_face(model, self)
        free = available_bytes(comm)

        def solve() -> tuple[Ints, Floats]:
            count, (rows, dofs, values) = wet.face.count, wet.coupling
            used, columns = np.unique(dofs, return_inverse=True)
            self._check_size(count, len(used), free)
            check_reaches_level(self, wet.face)
            coupling = np.zeros((count, len(used)))
            np.add.at(coupling, (rows, columns.ravel()), values)
            largest = np.abs(coupling).max(axis=0, initial=0.0)
            felt = largest > UNFELT * largest.max(initial=0.0)
            if not count:
                return used[felt], coupling[:, felt]
            return used[felt], self._half(wet, coupling[:, felt])

        dofs, half = on_root(comm, solve)
        return _assembled(model, dofs, np.sqrt(self.density) * half)

    def _half(self, wet: WetFace, coupling: Floats) -> Floats:
        """Y, Y^T Y being the added mass per density."""
        wavenumber = 2.0 * np.pi * self.frequency / self.sound_speed
        try:
            resists = resistance(wet.face, wet.upstream, self.length, wavenumber)
            return half_of_inverse(resists, coupling)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"{self}: frequency is {self.frequency:g} Hz; it must be below the lowest one at "
                f"which the reservoir itself resonates (c/4H, with c = {self.sound_speed:g} m/s, "
                "in a long one with a level floor)."
            ) from None

    def _check_size(self, nodes: int, dofs: int, free: float) -> None:
        needed = 8.0 * SLAB_MATRICES * nodes**2 + MASS_BYTES * dofs**2
        if needed > SHARE * free:
            raise ValueError(
                f"{self}: its {nodes} wet nodes make a full matrix, which may take "
                f"{needed / 1e9:.2g} GB here and in the solver, more than the half of the "
                f"{free / 1e9:.2g} GB that are free; take larger cells on the face, or a "
                "WestergaardMass."
            )


def _assembled(model: LoadedBody, dofs: Ints, half: Floats) -> PETSc.Mat:
    """Y^T Y over given dofs in the layout of the model's matrices (collective)."""
    blocks = model.V.dofmap.index_map
    first, owned = (model.gdim * n for n in (blocks.local_range[0], blocks.size_local))
    mine = np.flatnonzero((dofs >= first) & (dofs < first + owned))
    rows = half[:, mine].T @ half
    starts = np.zeros(owned + 1, dtype=PETSc.IntType)
    starts[dofs[mine] - first + 1] = len(dofs)
    csr = (
        np.cumsum(starts, dtype=PETSc.IntType),
        np.tile(dofs.astype(PETSc.IntType), len(mine)),
        rows.ravel(),
    )
    sizes = ((owned, None), (owned, None))
    matrix = PETSc.Mat().createAIJ(
        sizes, bsize=model.gdim, csr=csr, comm=lasting(model.jointed.mesh.comm)
    )
    matrix.assemble()
    return matrix
