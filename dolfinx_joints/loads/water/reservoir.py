# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Added mass of a reservoir by finite elements, for incompressible water by default.

The reservoir is the wet face extruded horizontally upstream, so its cross-section is constant. The
edges of the face form floor and banks. No separate mesh is needed; see `reservoir_slabs`.
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
from dolfinx_joints.loads.load import LoadedBody, Vector
from dolfinx_joints.loads.water.reservoir_slabs import half_of_inverse, resistance
from dolfinx_joints.loads.water.wet_face import (
    WetFace,
    check_reaches_level,
    check_upstream,
    wet_face,
)
from dolfinx_joints.mesh.cells import Floats, Ints

# Coupling, relative to the largest one, below which a dof is not loaded by the water.
NEGLIGIBLE_COUPLING = 1e-12

# Number of dense matrices of the water nodes during the doubling of slabs; bytes per entry of the
# added mass, for its copies with indices in M and in the factor of a step.
SLAB_MATRICES, MASS_BYTES = 8, 64


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirMass:
    """Added mass of water in a reservoir with the cross-section of the wet face.

    By default the water is incompressible. The pressure satisfies Laplace's equation with p = 0 at
    the level, dp/dn = -rho a_n on the face and dp/dn = 0 on floor and banks. The mass couples all
    nodes of the wet face, moves with the face and has no weight.

    Attributes:
        group: Name of the facet group, which must reach up to the level or higher.
        level: Height of the water level, a coordinate along z (y in 2-D) [m].
        length: Length of the reservoir up to a rigid wall at rest [m]; infinite by default.
        upstream: Horizontal vector along which the reservoir extends; by default the horizontal
            part of the mean normal of the wet face.
        density: Density of the water [kg/m^3].
        frequency: If positive, the water is compressible, in steady vibration at this frequency
            [Hz], which must be below the natural frequencies of the reservoir.
        sound_speed: Speed of sound of compressible water [m/s].
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
        """Return the added mass in the layout of the model's matrices [kg] (collective).

        Raises:
            ValueError: A region of the face does not reach the level, a part of the face does not
                face upstream, the frequency is too high, or the memory is too small.
            MeshError: The group does not exist, or some of its facets are inside the body.
        """
        comm = model.jointed.mesh.comm
        part = wet_face(model, self)
        free = available_bytes(comm)

        def solve() -> tuple[Ints, Floats]:
            count, (rows, dofs, values) = part.face.count, part.coupling
            all_dofs, columns = np.unique(dofs, return_inverse=True)
            self._check_size(count, len(all_dofs), free)
            check_reaches_level(self, part.face)
            coupling = np.zeros((count, len(all_dofs)))
            np.add.at(coupling, (rows, columns.ravel()), values)
            largest = np.abs(coupling).max(axis=0, initial=0.0)
            is_loaded = largest > NEGLIGIBLE_COUPLING * largest.max(initial=0.0)
            if not count:
                return all_dofs[is_loaded], coupling[:, is_loaded]
            return all_dofs[is_loaded], self._half(part, coupling[:, is_loaded])

        dofs, half = on_root(comm, solve)
        return _assemble(model, dofs, np.sqrt(self.density) * half)

    def _half(self, part: WetFace, coupling: Floats) -> Floats:
        """Return Y, where Y^T Y is the added mass divided by the density."""
        wavenumber = 2.0 * np.pi * self.frequency / self.sound_speed
        try:
            resistance_matrix = resistance(part.face, part.upstream, self.length, wavenumber)
            return half_of_inverse(resistance_matrix, coupling)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"{self}: frequency is {self.frequency:g} Hz; it must be below the lowest natural "
                f"frequency of the reservoir (c/4H, with c = {self.sound_speed:g} m/s, for a long "
                "reservoir of constant depth H)."
            ) from None

    def _check_size(self, nodes: int, dofs: int, free: float) -> None:
        needed = 8.0 * SLAB_MATRICES * nodes**2 + MASS_BYTES * dofs**2
        if needed > SHARE * free:
            raise ValueError(
                f"{self}: the dense matrix of {nodes} wet nodes needs {needed / 1e9:.2g} GB, "
                f"including the solver, which is more than half of the {free / 1e9:.2g} GB of free "
                "memory. Use larger cells on the face, or a WestergaardMass."
            )


def _assemble(model: LoadedBody, dofs: Ints, half: Floats) -> PETSc.Mat:
    """Return Y^T Y at the given dofs, in the layout of the model's matrices (collective)."""
    blocks = model.V.dofmap.index_map
    first, owned = (model.gdim * n for n in (blocks.local_range[0], blocks.size_local))
    owned_columns = np.flatnonzero((dofs >= first) & (dofs < first + owned))
    rows = half[:, owned_columns].T @ half
    starts = np.zeros(owned + 1, dtype=PETSc.IntType)
    starts[dofs[owned_columns] - first + 1] = len(dofs)
    csr = (
        np.cumsum(starts, dtype=PETSc.IntType),
        np.tile(dofs.astype(PETSc.IntType), len(owned_columns)),
        rows.ravel(),
    )
    sizes = ((owned, None), (owned, None))
    matrix = PETSc.Mat().createAIJ(
        sizes, bsize=model.gdim, csr=csr, comm=lasting(model.jointed.mesh.comm)
    )
    matrix.assemble()
    return matrix
