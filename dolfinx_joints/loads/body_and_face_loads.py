# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on the body and on its faces: gravity, traction, pressure, a UFL form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import check_vector, shown
from dolfinx_joints.loads.load import LoadedBody, TimeFactor, Vector, always


@dataclass(frozen=True, kw_only=True)
@checked
class Gravity:
    """Self weight, rho g per volume; ``redistribute_mass`` does not change it.

    Attributes:
        acceleration: g as a vector [m/s^2]; standard gravity along -z (-y in 2-D) by default.
        cells: Name of the loaded cell group; the whole body by default.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> state = dj.Simulation(model).statics()
        >>> round(model.resultant(state.reaction, "base")[2])  # 2 m^3 * 2400 * 9.80665 [N]
        47072
    """

    acceleration: Vector | None = None
    cells: str | None = None

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return M g with the mass of the body or of the cell group, without redistributed mass."""
        gdim = model.gdim
        vector = np.zeros(gdim)
        if self.acceleration is None:
            vector[-1] = -STANDARD_GRAVITY
        else:
            vector[:] = check_vector("Gravity: acceleration", self.acceleration, (gdim,))
        if self.cells is None:
            return [(model.inertia_pattern(vector, body_only=True), always)]
        g = fem.Constant(model.jointed.mesh, vector)
        weight = model.body.density * ufl.inner(g, ufl.TestFunction(model.V))
        return [(model.assemble(weight * model.jointed.dx(self.cells)), always)]


@dataclass(frozen=True, kw_only=True)
@checked
class Traction:
    """Surface traction on a facet group.

    Attributes:
        group: Name of the facet group.
        value: Traction vector [Pa].
        factor: Function of time [s] that multiplies the load; 1 by default.
    """

    group: str
    value: Vector
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the consistent nodal forces."""
        name = f"Traction on {shown(self.group)}: value"
        vector = check_vector(name, self.value, (model.gdim,))
        v = ufl.TestFunction(model.V)
        constant = fem.Constant(model.jointed.mesh, vector)
        return [
            (model.assemble(ufl.inner(constant, v) * model.jointed.ds(self.group)), self.factor)
        ]


@dataclass(frozen=True, kw_only=True)
@checked
class Pressure:
    """Pressure on a facet group, positive towards the body.

    Attributes:
        group: Name of the facet group.
        value: Pressure [Pa].
        factor: Function of time [s] that multiplies the load; 1 by default.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=20e9, poisson=0.0, density=2400.0)
        >>> law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11)
        >>> base = [dj.Fixed(group="base")]
        >>> loads = [dj.Pressure(group="top", value=1e6)]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=loads)
        >>> state = dj.Simulation(model).statics()
        >>> round(state.displacement.min()[1], 9)  # of the top, -p (2 / E + 1 / k_n) [m]
        -0.00011
    """

    group: str
    value: Annotated[float, at.Unit("Pa")]
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the consistent nodal forces."""
        v = ufl.TestFunction(model.V)
        n = ufl.FacetNormal(model.jointed.mesh)
        constant = fem.Constant(model.jointed.mesh, float(-self.value))
        form = constant * ufl.inner(n, v) * model.jointed.ds(self.group)
        return [(model.assemble(form), self.factor)]


@dataclass(frozen=True, kw_only=True)
@checked
class FormLoad:
    """Load given by a user-defined linear form.

    Attributes:
        form: Function of the test function that returns the UFL form of the load [N].
        factor: Function of time [s] that multiplies the load; 1 by default.
    """

    form: Callable[[Any], Any]
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the nodal forces."""
        return [(model.assemble(self.form(ufl.TestFunction(model.V))), self.factor)]
