# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A jointed elastic body, ready when constructed: matrices, joints with laws, supports, loads."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.body.elasticity import ElasticBody
from dolfinx_joints.body.matrices import blocked, without_ghosts, without_zeros
from dolfinx_joints.body.supports import Constraints, Spring, Support
from dolfinx_joints.body.viscous_boundary import ViscousBoundary, absorbing_groups
from dolfinx_joints.common.mpi import lasting
from dolfinx_joints.common.parameters import check_kind_of, check_vector
from dolfinx_joints.joints.contact import Contact, InitialGap
from dolfinx_joints.joints.operator import JointOperator
from dolfinx_joints.laws.law import Law
from dolfinx_joints.loads.load import AddedMass, Load
from dolfinx_joints.loads.temperature.thermal_strain import Temperature, check_temperatures
from dolfinx_joints.materials.bulk_law import Material, is_plastic
from dolfinx_joints.mesh.jointed_mesh import JointedMesh
from dolfinx_joints.model.arguments import (
    check_added,
    check_form,
    check_joints,
    check_loads,
    check_nodal,
    check_options,
)
from dolfinx_joints.model.mass_redistribution import RINGS, Redistribution, redistributed_mass
from dolfinx_joints.model.system import MatrixSystem

if TYPE_CHECKING:
    from dolfinx_joints.body.plastic_cells import PlasticBulk

BilinearForm = Callable[[Any, Any], Any]


class Model:
    """M a + C v + K u + B^T w t(B u) = F on a mesh split at its joints.

    Args:
        jointed: The mesh; without joints the body is monolithic and no joint code runs.
        material: One material, or one per named cell group: `Elastic`, `Orthotropic`, or plastic
            such as `DruckerPrager`.
        joints: One law for all joints, or one per joint name; not needed without joints.
        supports: Fixed and prescribed components, springs, viscous boundaries.
        loads: Loads that act in every stage (self weight, tractions, ...).
        damping: Rayleigh damping, its stiffness part of the bulk alone; none unless given.
        initial_gaps: Initial normal gap of named joints, a number or a function of the points [m].
        degree: Degree of the displacement, that of the mesh unless given.
        quadrature: Rule on the joints: ``auto``, ``nodal``, ``gauss``, or the degree that a Gauss
            rule is exact for.
        plane: ``strain`` or ``stress`` in 2-D.
        extra_stiffness: Bilinear form (u, v) added to K.
        extra_mass: Bilinear form (u, v) added to M.
        extra_damping: Bilinear form (u, v) added to C.
        added_mass: Masses that move with a face, `WestergaardMass` or `ReservoirMass`, added to M.
        symmetric: Whether the extra forms are symmetric.
        redistribute_mass: Give the mass of joint nodes to the body behind them, so that contact
            tractions do not ring (`redistribution`); gravity acts where the mass then is.

    Attributes:
        jointed: The mesh.
        V: Displacement space, an ordinary Lagrange space on the split mesh.
        body: Material fields and stress recovery.
        operator: Joint operator, None without joints.
        contact: Joints with their laws, None without joints.
        bulk: Cells with plastic materials, None without such cells.
        constraints: Constrained dofs.
        absorbing: Groups with a viscous boundary.
        mass: M [kg].
        body_mass: M without the extra form and added masses, what gravity acts on [kg].
        redistribution: Mass redistributed and the nodes concerned, None unless asked for.
        rayleigh: Factors of M and K in C.
        dashpots: What C holds besides, None for nothing [N s/m].
        stiffness: K of bulk, springs and extra forms, in blocks of a node [N/m].
        loads: The loads.

    Raises:
        ValueError: A parameter is out of its range.
        MeshError: A group or joint does not exist, or a joint has no law.
    """

    def __init__(
        self,
        jointed: JointedMesh,
        *,
        material: Material | Mapping[str, Material],
        joints: Law | Mapping[str, Law] | None = None,
        supports: Sequence[Support] = (),
        loads: Sequence[Load] = (),
        damping: Rayleigh | None = None,
        initial_gaps: Mapping[str, InitialGap] | None = None,
        degree: int | None = None,
        quadrature: str | int = "auto",
        plane: str = "strain",
        extra_stiffness: BilinearForm | None = None,
        extra_mass: BilinearForm | None = None,
        extra_damping: BilinearForm | None = None,
        added_mass: Sequence[AddedMass] = (),
        symmetric: bool = True,
        redistribute_mass: bool = False,
    ) -> None:
        """Assemble everything that does not change (collective)."""
        is_mesh = isinstance(jointed, JointedMesh)
        check_kind_of("jointed", jointed, is_mesh, "a mesh from read_msh or split_mesh")
        forms = {"stiffness": extra_stiffness, "mass": extra_mass, "damping": extra_damping}
        check_options(
            degree=degree,
            quadrature=quadrature,
            plane=plane,
            damping=damping,
            forms={f"extra_{name}": form for name, form in forms.items()},
            flags={"symmetric": symmetric, "redistribute_mass": redistribute_mass},
        )
        check_joints(jointed, joints, initial_gaps)
        check_kind_of(
            "supports", supports, isinstance(supports, list | tuple), "a list of supports"
        )
        check_loads(jointed, loads)
        check_added(added_mass)
        rayleigh = damping or Rayleigh()
        self.jointed, self.loads, self.supports = jointed, list(loads), list(supports)
        self.gdim = jointed.mesh.geometry.dim
        degree = jointed.shape.degree if degree is None else int(degree)
        self.V = fem.functionspace(jointed.mesh, ("Lagrange", degree, (self.gdim,)))
        self.body = ElasticBody(jointed, material, plane=plane)
        self.constraints = Constraints(jointed, self.V, list(supports))
        self.operator, self.contact = None, None
        if jointed.joint_names and joints is not None:
            self.operator = JointOperator(jointed, self.V, quadrature=quadrature)
            self.contact = Contact(self.operator, joints, initial_gaps)
        by_group = material if isinstance(material, Mapping) else {"": material}
        check_temperatures(jointed, by_group, self.loads)
        laws = {name: each for name, each in by_group.items() if is_plastic(each)}
        u, v = ufl.TrialFunction(self.V), ufl.TestFunction(self.V)
        bulk = self.body.stiffness_form(u, v)
        springs = [s.form(jointed, u, v) for s in supports if isinstance(s, Spring)]
        self.body_mass = without_zeros(self._matrix(self.body.mass_form(u, v)))
        self.mass = self.body_mass
        if extra_mass is not None or added_mass:
            total = self._matrix(self.body.mass_form(u, v), extra_mass)
            for added in added_mass:
                moved = added.matrix(self)
                total.axpy(1.0, moved, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                moved.destroy()
            self.mass = without_zeros(total)
        self.stiffness = blocked(self._matrix(bulk, extra_stiffness, *springs))
        self.stiffness.setNearNullSpace(self._rigid_modes())
        self.bulk = self._plastic_bulk(laws, plane) if laws else None
        self.redistribution: Redistribution | None = None
        if redistribute_mass and self.operator is not None:
            self.redistribution = self._redistributed(self.mass, self.operator, degree)
            self.body_mass = self.mass = self.redistribution.mass
            if extra_mass is not None or added_mass:
                body = self._matrix(self.body.mass_form(u, v))
                self.body_mass = self._redistributed(body, self.operator, degree).mass
        self.absorbing = absorbing_groups(jointed, self.body, supports)
        dashpots = [
            s.form(jointed, self.body, u, v) for s in supports if isinstance(s, ViscousBoundary)
        ]
        if extra_damping is not None:
            dashpots.append(self._extra(extra_damping))
        self.rayleigh, self.dashpots = rayleigh, None
        if rayleigh.stiffness_factor and (springs or extra_stiffness is not None):
            # Springs and extra forms are part of K but do not damp.
            self.rayleigh = Rayleigh(mass_factor=rayleigh.mass_factor)
            bulk_damping = self._matrix(rayleigh.stiffness_factor * bulk, None, *dashpots)
            self.dashpots = blocked(bulk_damping)
        elif dashpots:
            self.dashpots = blocked(self._matrix(dashpots[0], None, *dashpots[1:]))
        self._symmetric = symmetric

    def _plastic_bulk(self, laws: Mapping[str, Any], plane: str) -> PlasticBulk:
        """The cells with plastic materials."""
        from dolfinx_joints.body.plastic_cells import PlasticBulk

        if self.gdim == 2 and plane == "stress":
            raise ValueError(
                "Plastic materials are for plane='strain' or bodies in space; plane is 'stress'."
            )
        return PlasticBulk(self.jointed, self.V, laws, self.stiffness, self.contact)

    def _redistributed(
        self, mass: PETSc.Mat, operator: JointOperator, degree: int
    ) -> Redistribution:
        """A mass matrix without the mass of joint nodes."""
        owned = self.V.dofmap.index_map.size_local
        nodes = self.V.tabulate_dof_coordinates()[:owned, : self.gdim]
        held = self.constraints.dofs
        return redistributed_mass(mass, self.stiffness, operator, nodes, held, RINGS // degree)

    def _matrix(self, form: Any, extra: BilinearForm | None = None, *more: Any) -> PETSc.Mat:
        """Assembled matrix of a form and what is added to it."""
        if extra is not None:
            form = form + self._extra(extra)
        for term in more:
            form = form + term
        return self._kept(fem_petsc.assemble_matrix(fem.form(form)))

    def _kept(self, assembled: PETSc.Mat) -> PETSc.Mat:
        """The matrix on a communicator that outlives the mesh, which frees its own."""
        assembled.assemble()
        matrix = PETSc.Mat().createAIJ(
            assembled.getSizes(),
            bsize=self.gdim,
            csr=assembled.getValuesCSR(),
            comm=lasting(self.jointed.mesh.comm),
        )
        matrix.assemble()
        assembled.destroy()
        return matrix

    def _rigid_modes(self) -> PETSc.NullSpace:
        """Translations and rotations, which multigrid takes to its coarse levels (collective)."""
        places = self.stiffness.createVecRight()
        points = self.V.tabulate_dof_coordinates()[: places.getLocalSize() // self.gdim]
        places.setArray(points[:, : self.gdim].ravel())
        return PETSc.NullSpace().createRigidBody(places)

    @cached_property
    def damping(self) -> PETSc.Mat:
        """C, added up when first asked for [N s/m] (collective)."""
        return self.system().damping

    def _extra(self, extra: BilinearForm) -> Any:
        """A bilinear form of the user's own."""
        form = extra(ufl.TrialFunction(self.V), ufl.TestFunction(self.V))
        check_form(form, 2, "An extra form must be a bilinear UFL form of (u, v)")
        return form

    def assemble(self, form: Any) -> PETSc.Vec:
        """Nodal forces of a linear form, [N] (collective)."""
        check_form(form, 1, "A load must be a linear UFL form of v")
        vector = fem_petsc.assemble_vector(fem.form(form))
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return without_ghosts(vector, self.mass)

    def inertia_pattern(
        self, acceleration: NDArray[np.float64], *, body_only: bool = False
    ) -> PETSc.Vec:
        """M times a uniform acceleration [m/s^2], [N] (collective).

        Args:
            acceleration: Shape (gdim,), [m/s^2].
            body_only: Leave the extra mass form and added masses out.
        """
        check_vector("acceleration", acceleration, (self.gdim,))
        mass = self.body_mass if body_only else self.mass
        uniform = mass.createVecRight()
        local = uniform.getLocalSize() // self.gdim
        uniform.setArray(np.tile(acceleration, local))
        force = uniform.duplicate()
        mass.mult(uniform, force)
        return force

    def system(
        self, extra_loads: Sequence[Load] = (), *, only: Sequence[Load] | None = None
    ) -> MatrixSystem:
        """The system with the model's loads and ``extra_loads`` (collective).

        Args:
            extra_loads: Loads besides the model's own.
            only: Those of the model's loads that act; all of them unless given.
        """
        check_loads(self.jointed, extra_loads)
        if any(isinstance(load, Temperature) for load in extra_loads):
            raise ValueError(
                "A Temperature was given to a stage; give it to Model(loads=...) with a factor of "
                "time, since stresses are recovered with the temperatures of the model."
            )
        loads = (*(self.loads if only is None else only), *extra_loads)
        each = zip(_names(loads), loads, strict=True)
        named = [(name, pattern) for name, load in each for pattern in load.patterns(self)]
        in_joints = {n: w for n, w in zip(_names(loads), loads, strict=True) if _follows(w)}
        water = None
        if in_joints:
            from dolfinx_joints.loads.water.joint_water_state import JointWaters

            water = JointWaters(self, in_joints)
        return MatrixSystem(
            mass=self.mass,
            stiffness=self.stiffness,
            rayleigh=self.rayleigh,
            dashpots=self.dashpots,
            contact=self.contact,
            bulk=self.bulk,
            patterns=[pattern for _, pattern in named],
            load_names=[name for name, _ in named],
            constrained=self.constraints.dofs,
            values=self.constraints.values if self.constraints.moves else None,
            symmetric=self._symmetric,
            components=self.gdim,
            water=water,
            in_joints=[load for load in loads if hasattr(load, "at_points")],
        )

    def resultant(self, force: PETSc.Vec, group: str) -> NDArray[np.float64]:
        """Sum of nodal forces over the nodes of a facet group, shape (gdim,), [N] (collective).

        Of reactions, the force of a support on the body. Nodes that belong to several groups count
        in each of them.

        Raises:
            MeshError: There is no such group.
        """
        check_nodal("force", force, self.mass)
        nodes = self.nodes(group)
        local = force.getArray(readonly=True).reshape(-1, self.gdim)[nodes].sum(axis=0)
        return np.sum(self.jointed.mesh.comm.allgather(local), axis=0)

    def nodes(self, group: str) -> NDArray[np.int64]:
        """Owned nodes of a facet group, local numbers (collective).

        Raises:
            MeshError: There is no such group.
        """
        facets = self.jointed.facets(group)
        nodes = fem.locate_dofs_topological(self.V, self.jointed.mesh.topology.dim - 1, facets)
        return nodes[nodes < self.V.dofmap.index_map.size_local].astype(np.int64)

    def function(self, vector: PETSc.Vec, name: str = "displacement") -> fem.Function:
        """A vector of the space as a DOLFINx function (collective)."""
        check_nodal("vector", vector, self.mass)
        u = fem.Function(self.V, name=name)
        owned = vector.getLocalSize()
        u.x.array[:owned] = vector.getArray(readonly=True)
        u.x.scatter_forward()
        return u

    @property
    def num_dofs(self) -> int:
        """Displacement dofs on all ranks, constrained ones included."""
        return int(self.V.dofmap.index_map.size_global * self.V.dofmap.index_map_bs)


def _names(loads: Sequence[Load]) -> list[str]:
    """A name for each load: its kind and group, with a number where that is not enough."""
    plain = [
        re.sub(r"[^\w.+-]", "_", "_".join([type(load).__name__, *_group(load)])) for load in loads
    ]
    return [
        name if plain.count(name) == 1 else f"{name}_{plain[: i + 1].count(name)}"
        for i, name in enumerate(plain)
    ]


def _group(load: Any) -> list[str]:
    where = getattr(load, "group", None) or getattr(load, "joint", None)
    return [where] if isinstance(where, str) else []


def _follows(load: Any) -> bool:
    """Whether a load depends on the state of the joints."""
    return hasattr(load, "in_dynamics")
