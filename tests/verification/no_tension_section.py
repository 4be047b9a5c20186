# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The section without tension: exact solution, and the model solved on a mesh of it.

Used by its test and by ``benchmarks/quadrature_rules.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.two_blocks import two_blocks


@dataclass(frozen=True, kw_only=True)
class SectionState:
    """State of a section.

    Attributes:
        contact_length: From the pressed edge to where the gap opens, at most h [m].
        edge_stress: Pressure at the pressed edge [Pa].
        rotation: Slope of the gap along the section.
        bent: Largest deviation of the gap from a plane, of its largest value.
        num_points: Number of joint points.
        num_facets: Number of facets of the joint.
    """

    contact_length: float
    edge_stress: float
    rotation: float
    bent: float = 0.0
    num_points: int = 0
    num_facets: int = 0


@dataclass(frozen=True, kw_only=True)
class NoTensionSection:
    """A force N at an eccentricity e on a section of height h and unit width, planes staying plane.

    Within the core, e <= h/6, the whole section is in contact and the edge stress is
    (1 + 6 e/h) N/h. Beyond it the pressure is a triangle whose centre lies under the force: the
    contact length is 3 (h/2 - e) and the edge stress twice the mean, 2 N / (3 (h/2 - e)); at
    e = h/4 that is 0.75 h and 2.66667 N/h.

    Attributes:
        height: h, along x [m].
        force: N for a unit width [N/m].
        stiffness: k_n of the joint [Pa/m].
        rigidity: E of the blocks over k_n h, so large that they stay plane.
    """

    height: float = 2.0
    force: float = 1e3
    stiffness: float = 1.5e9
    rigidity: float = 1e5

    def exact(self, eccentricity: float) -> SectionState:
        """State under the force at an eccentricity [m]."""
        h, e, mean = self.height, eccentricity, self.force / self.height
        if e <= h / 6:
            edge, other = mean * (1.0 + 6.0 * e / h), mean * (1.0 - 6.0 * e / h)
            return SectionState(
                contact_length=h, edge_stress=edge, rotation=(edge - other) / h / self.stiffness
            )
        length = 3.0 * (h / 2 - e)
        edge = 2.0 * self.force / length
        return SectionState(
            contact_length=length, edge_stress=edge, rotation=edge / length / self.stiffness
        )


def move_force(
    section: NoTensionSection,
    eccentricities: Sequence[float],
    *,
    cells: int = 16,
    cell: str = "hex",
    order: int = 1,
    quadrature: str | int = "auto",
) -> Iterator[SectionState]:
    """Move the force through ascending eccentricities on one mesh, state by state (collective).

    The gap is fitted by a plane (on tetrahedra the section tilts a little across its width, as
    the rule is not symmetric there): where it vanishes at mid-width the contact ends.

    Args:
        section: The problem.
        eccentricities: e [m].
        cells: Number of cells along the section; there is one across its width.
        cell: "hex" or "tet".
        order: Order of the elements.
        quadrature: Rule on the joint.
    """
    h, size = section.height, section.height / cells
    sizes = {"length": h, "width": size, "size": size, "cell": cell, "order": order}
    jointed = mesh_of(two_blocks, lower_height=h / 4, upper_height=h / 4, **sizes)
    x = ufl.SpatialCoordinate(jointed.mesh)[0] - h / 2
    mean = section.force / h
    ds = jointed.ds("top")
    k_n = section.stiffness
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=section.rigidity * k_n * h, poisson=0.0, density=0.0),
        joints=dj.Joints(
            dj.FrictionNoTension(normal_stiffness=k_n, shear_stiffness=k_n, friction_angle_deg=30),
            quadrature=quadrature,
        ),
        supports=[dj.Fixed(group="base")],
        loads=[
            dj.FormLoad(form=lambda v: -mean * v[2] * ds),
            # moment N e; the time stands for the eccentricity
            dj.FormLoad(form=lambda v: -12.0 * mean / h**2 * x * v[2] * ds, factor=lambda e: e),
        ],
    )
    simulation, operator = dj.Simulation(model), model.contact.operator
    facets = jointed.pairs.count
    points = operator.gather(operator.points[:, :2] - [h / 2, size / 2])

    def fit(gap: Any) -> SectionState:
        columns = np.column_stack([points, np.ones(len(points))])
        plane = np.linalg.lstsq(columns, gap, rcond=None)[0]
        slope, _, middle = (float(c) for c in plane)
        return SectionState(
            contact_length=min(h, h / 2 + middle / slope),
            edge_stress=-k_n * (middle + slope * h / 2),
            rotation=-slope,
            bent=float(np.abs(gap - columns @ plane).max() / np.abs(gap).max()),
            num_points=len(points),
            num_facets=facets,
        )

    for eccentricity in eccentricities:
        state = simulation.quasi_statics([eccentricity]).joints.state
        gap = operator.gather(state.gap[:, 0])
        yield on_root(MPI.COMM_WORLD, lambda gap=gap: fit(gap))
