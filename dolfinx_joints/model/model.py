# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model of a jointed body: matrices, joints with laws, supports and loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body import matrices
from dolfinx_joints.body.damping import ModalRatios, Rayleigh
from dolfinx_joints.body.elasticity import ElasticBody
from dolfinx_joints.body.places import nodes_of_facets
from dolfinx_joints.body.supports import Constraints, Spring, Support
from dolfinx_joints.body.viscous_boundary import ViscousBoundary, absorbing_groups
from dolfinx_joints.common.declared import declarations
from dolfinx_joints.common.errors import doubt, refuses_removed
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.common.summary import Rows, Summarised, names, number
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import JointOperator
from dolfinx_joints.laws.law import AnyLaw
from dolfinx_joints.loads.body_and_face_loads import FormLoad
from dolfinx_joints.loads.load import AddedMass, JointLoad, Load, check_loads, load_names
from dolfinx_joints.loads.temperature.thermal_strain import Temperature, check_temperatures
from dolfinx_joints.materials.bulk_law import BulkLaw, Material
from dolfinx_joints.mesh.jointed_mesh import JointedMesh
from dolfinx_joints.model.mass_redistribution import RINGS, Redistribution, redistributed_mass
from dolfinx_joints.model.modal_damping import DampedModes
from dolfinx_joints.model.parts import Body, Joints, by_kind, check_form, check_joints, check_tied
from dolfinx_joints.model.plausibility import warn_of_implausible_values, warn_of_overlaps
from dolfinx_joints.model.system import MatrixSystem, water_in

if TYPE_CHECKING:
    from dolfinx_joints.body.nonlinear_cells import NonlinearBulk
    from dolfinx_joints.loads.water.water import Reservoir
    from dolfinx_joints.model.with_water import BodyAndWater


@refuses_removed
class Model(Summarised):
    """Jointed body M a + C v + K u + B^T w t(B u) = F on a mesh split at its joints.

    Args:
        jointed: The mesh. Without joints the body is monolithic and no joint code runs.
        material: One material, or one per named cell group: `Elastic`, `Orthotropic`, or nonlinear
            such as `DruckerPrager` and `UflMaterial`.
        joints: One law for all joints, one per joint name, or `Joints` with further options. May be
            omitted if the mesh has no joints or ``extra_stiffness`` ties all of them.
        supports: Fixed and prescribed components, springs, viscous boundaries.
        loads: Loads that act in every stage (self weight, tractions, ...).
        damping: `Rayleigh` or `ModalRatios`. Rayleigh's stiffness part applies only to the bulk.
        water: Added masses (`WestergaardMass`, `ReservoirMass`) and at most one reservoir with
            waves (`ReservoirWaves`, `MeshedReservoir`). The waves are unknowns of dynamic stages.
        body: Degree, plane strain or stress, extra forms and mass redistribution: a `Body`.

    Attributes:
        parameters: All arguments except ``jointed``, by name.
        damping: The argument, Rayleigh without factors by default.
        V: Displacement space, an ordinary Lagrange space on the split mesh.
        body: Material fields and stress recovery.
        operator: Joint operator, None without joints.
        contact: Joints with their laws, None without joints.
        bulk: Cells with nonlinear materials, None without such cells.
        constraints: Constrained dofs.
        absorbing: Facet groups with a viscous boundary.
        mass, rayleigh, dashpots, absorption, damped_modes: See `MatrixSystem`.
        body_mass: M without extra forms and added masses; gravity acts on this mass [kg].
        redistribution: Redistributed mass and number of massless nodes, None if not requested.
        stiffness: K of bulk, springs and extra forms, with one block per node [N/m].
        coupled: Unknowns of body and reservoir in dynamic stages, None without a reservoir.
        loads, doubts: The loads; warnings of implausible values, on rank 0.

    Raises:
        MeshError: A group or joint does not exist, or a joint has no law.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> model.num_dofs  # 2 blocks of 3^3 nodes
        162
    """

    def __init__(
        self,
        jointed: JointedMesh,
        *,
        material: Material | Mapping[str, Material],
        joints: Joints | AnyLaw | Mapping[str, AnyLaw] | None = None,
        supports: Sequence[Support] = (),
        loads: Sequence[Load] = (),
        damping: Rayleigh | ModalRatios | None = None,
        water: Reservoir | AddedMass | Sequence[Reservoir | AddedMass] | None = None,
        body: Body | None = None,
    ) -> None:
        """Assemble the constant matrices (collective)."""
        given = locals()
        _check_kinds(given)
        self._options = body = body or Body()
        joints = joints if isinstance(joints, Joints) else Joints(joints)
        given |= {"joints": joints, "body": body}
        self.parameters = {k: v for k, v in given.items() if k not in ("self", "jointed")}
        laws = joints.laws
        check_joints(jointed, laws, joints.initial_gaps)
        check_loads(jointed, loads)
        by_group = material if isinstance(material, Mapping) else {"": material}
        check_temperatures(jointed, by_group, loads)
        self.added_mass, reservoirs = by_kind(water)
        self.reservoir = next(iter(reservoirs), None)
        acting = [*loads, *self.added_mass, *reservoirs]
        self.doubts = warn_of_implausible_values(jointed, by_group, laws, acting)
        self.jointed, self.gdim = jointed, jointed.mesh.geometry.dim
        self.loads, self.supports = list(loads), list(supports)
        self._degree = body.degree or jointed.shape.degree
        self.V = fem.functionspace(jointed.mesh, ("Lagrange", self._degree, (self.gdim,)))
        if jointed.joint_names and laws is None:
            check_tied(jointed, body.forms("extra_stiffness", *self._arguments))
        self._nodes: dict[str, NDArray[np.int64]] = {}
        self.body = ElasticBody(jointed, material, plane=body.plane)
        self.constraints = Constraints(jointed, self.V, self.supports)
        self.absorbing = absorbing_groups(jointed, self.body, self.supports)
        self.operator, self.contact = None, None
        if jointed.joint_names and laws is not None:
            self.operator = JointOperator(jointed, self.V, quadrature=joints.quadrature)
            self.contact = Contact(self.operator, laws, joints.initial_gaps)
            self.doubts += warn_of_overlaps(jointed.mesh.comm, self.contact.overlaps)
        self.stiffness = self._stiffness(body)
        modes = matrices.rigid_modes(self.stiffness, self.V.tabulate_dof_coordinates())
        self.stiffness.setNearNullSpace(modes)
        self.body_mass, self.mass = self._masses()
        self.redistribution: Redistribution | None = None
        if body.redistribute_mass and self.operator is not None:
            self._redistribute(self.operator)
        self.damping, self.damped_modes = damping or Rayleigh(), None
        rayleigh = self.damping
        if isinstance(rayleigh, ModalRatios):
            self.damped_modes, rayleigh = DampedModes(rayleigh), rayleigh.beyond
        self.rayleigh, self.absorption, self.dashpots = self._damping(rayleigh)
        nonlinear = {group: law for group, law in by_group.items() if isinstance(law, BulkLaw)}
        self.bulk = self._nonlinear_bulk(nonlinear) if nonlinear else None
        self.coupled = None if self.reservoir is None else self._coupled_with(self.reservoir)

    def _summary(self) -> Rows:
        joints, degree = self.jointed.joint_names, self.V.ufl_element().degree
        yield "unknowns", f"{number(self.num_dofs)} displacements, degree {degree}"
        yield "joints", f"{len(joints)}: {names(joints)}" if joints else "none"
        if self.contact is not None:
            kinds = dict.fromkeys(type(law).__name__ for law in self.contact.laws.values())
            points = self.contact.operator.num_points
            yield "joint points", f"{number(points)} of {names(kinds)}"
        yield "supports", names(_kinds(self.supports))
        yield "loads", names(load_names(self.loads))
        yield "added masses", names(_kinds(self.added_mass))
        if self.coupled is not None:
            unknowns = number(self.coupled.water.size)
            yield "reservoir", f"{names(_kinds([self.reservoir]))}, {unknowns} unknowns"
        alpha, beta = self.rayleigh.mass_factor, self.rayleigh.stiffness_factor
        terms = [f"{alpha:.4g} 1/s times M"] * bool(alpha) + [f"{beta:.4g} s times K"] * bool(beta)
        if self.damped_modes is not None:
            terms.append(f"ratios of {self.damped_modes.ratios.modes} modes")
        yield "damping", " + ".join(terms)

    def _stiffness(self, options: Body) -> PETSc.Mat:
        """Return K of bulk, extra form and springs."""
        u, v = self._arguments
        springs = [s.form(self.jointed, u, v) for s in self.supports if isinstance(s, Spring)]
        extras = options.forms("extra_stiffness", u, v)
        form = self.jointed.form(sum([*extras, *springs], self.body.stiffness_form(u, v)))
        return matrices.assembled_blocks(form, self.jointed.mesh.comm)

    def _masses(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        """Return M of the body, and M with the extra form and the added masses."""
        form = self.body.mass_form(*self._arguments)
        self.mass = body = self._matrix(form)
        extras = self._options.forms("extra_mass", *self._arguments)
        if not extras and not self.added_mass:
            return body, body
        total = self._matrix(form, *extras)
        for added in self.added_mass:
            added_matrix = added.matrix(self)
            total.axpy(1.0, added_matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            added_matrix.destroy()
        return body, matrices.without_zeros(total)

    def _redistribute(self, operator: JointOperator) -> None:
        """Move the mass of the joint nodes to the body behind them."""
        # Omit the extra form: it may couple nodes across a joint.
        body = self._stiffness(Body()) if self._options.extra_stiffness else self.stiffness
        owned = self.V.dofmap.index_map.size_local
        nodes = self.V.tabulate_dof_coordinates()[:owned, : self.gdim]

        def redistributed(mass: PETSc.Mat) -> Redistribution:
            return redistributed_mass(
                mass, body, operator, nodes, self.constraints.dofs, RINGS // self._degree
            )

        same_mass = self.body_mass is self.mass
        self.redistribution = redistributed(self.mass)
        self.mass = self.redistribution.mass
        self.body_mass = self.mass if same_mass else redistributed(self.body_mass).mass

    def _damping(self, rayleigh: Rayleigh) -> tuple[Rayleigh, PETSc.Mat | None, PETSc.Mat | None]:
        """Return the factors of M and K in C, the viscous boundaries, and all dashpots."""
        u, v = self._arguments
        boundaries = [s for s in self.supports if isinstance(s, ViscousBoundary)]
        absorbing = [s.form(self.jointed, self.body, u, v) for s in boundaries]
        forms = self._options.forms("extra_damping", u, v)
        springs = any(isinstance(s, Spring) for s in self.supports)
        if rayleigh.stiffness_factor and (springs or self._options.extra_stiffness):
            # Springs and extra forms are part of K but do not damp.
            forms.insert(0, rayleigh.stiffness_factor * self.body.stiffness_form(u, v))
            rayleigh = Rayleigh(mass_factor=rayleigh.mass_factor)
        other_dashpots = self._matrix(*forms) if forms else None
        absorption = self._matrix(*absorbing) if absorbing else None
        if other_dashpots is not None and absorption is not None:
            other_dashpots.axpy(1.0, absorption, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        dashpots = absorption if other_dashpots is None else other_dashpots
        return rayleigh, absorption, None if dashpots is None else matrices.blocked(dashpots)

    def _coupled_with(self, reservoir: Reservoir) -> BodyAndWater:
        """Return the unknowns of the body and of the waves in a reservoir."""
        from dolfinx_joints.model.with_water import BodyAndWater

        return BodyAndWater(self.mass.createVecRight(), reservoir.water(self), self.gdim)

    @property
    def _arguments(self) -> tuple[Any, Any]:
        """Trial and test function of the displacement space."""
        return ufl.TrialFunction(self.V), ufl.TestFunction(self.V)

    def _nonlinear_bulk(self, laws: Mapping[str, Any]) -> NonlinearBulk:
        """Return the cells with nonlinear materials."""
        from dolfinx_joints.body.nonlinear_cells import NonlinearBulk

        if self.gdim == 2 and self._options.plane == "stress":
            raise ValueError(
                "Nonlinear materials need plane='strain' or a 3-D mesh; plane is 'stress'."
            )
        return NonlinearBulk(self.jointed, self.V, laws, self.stiffness, self.contact)

    def _matrix(self, *forms: Any) -> PETSc.Mat:
        """Assemble the matrix of the sum of the forms, without zeros."""
        form = self.jointed.form(sum(forms[1:], forms[0]))
        return matrices.assembled_nonzeros(form, self.gdim)

    def assemble(self, form: Any) -> PETSc.Vec:
        """Return the nodal forces of a linear form, [N] (collective)."""
        check_form(form, 1, "A load must be a linear UFL form of v")
        vector = fem_petsc.assemble_vector(self.jointed.form(form))
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return matrices.without_ghosts(vector, self.mass)

    def inertia_pattern(
        self, acceleration: NDArray[np.float64], *, body_only: bool = False
    ) -> PETSc.Vec:
        """Return M, or `body_mass`, times an acceleration (gdim,) [m/s^2], in [N] (collective)."""
        mass = self.body_mass if body_only else self.mass
        uniform, force = mass.createVecRight(), mass.createVecRight()
        uniform.setArray(np.tile(acceleration, uniform.getLocalSize() // self.gdim))
        mass.mult(uniform, force)
        return force

    def system(
        self,
        extra_loads: Sequence[Load] = (),
        *,
        only: Sequence[Load] | None = None,
        static: bool = False,
        waves: float | None = None,
        shared: Any = None,
    ) -> MatrixSystem:
        """Return the system with the model's loads and ``extra_loads`` (collective).

        Args:
            extra_loads: Loads in addition to those of the model.
            only: Loads of the model to apply; all of them by default.
            static: Fix the viscous boundaries, as static stages do.
            waves: Time step [s] of a stage that solves for the waves in the reservoir, or None.
            shared: Data shared with other systems, see `MatrixSystem`.
        """
        check_loads(self.jointed, extra_loads)
        if any(isinstance(load, Temperature) for load in extra_loads):
            raise ValueError(
                "A Temperature was given to a stage. Give it to Model(loads=...) with a factor of "
                "time: stresses are recovered with the temperatures of the model."
            )
        all_loads = [*self.loads, *extra_loads]
        loads = all_loads if only is None else [*only, *extra_loads]
        named = zip(load_names(all_loads), all_loads, strict=True)
        by_name = {name: load for name, load in named if any(load is one for one in loads)}
        patterns = [(n, pattern) for n in by_name for pattern in self._patterns(n, by_name[n])]
        water, in_joints = water_in(self, by_name, waves=waves is not None)
        constraints = self.constraints
        system = MatrixSystem(
            mass=self.mass,
            stiffness=self.stiffness,
            rayleigh=self.rayleigh,
            dashpots=self.dashpots,
            absorption=self.absorption,
            contact=self.contact,
            bulk=self.bulk,
            patterns=[pattern for _, pattern in patterns],
            load_names=[name for name, _ in patterns],
            loads=by_name,
            constrained=constraints.static_dofs if static else constraints.dofs,
            values=partial(constraints.values, static=static) if constraints.moves else None,
            symmetric=self._options.symmetric,
            components=self.gdim,
            water=water,
            in_joints=in_joints,
            shared=shared,
        )
        if self.damped_modes is not None and not static:
            system = self.damped_modes.with_damping(system)
        if waves is None or self.coupled is None:
            return system
        return self.coupled.system(system, by_name, waves)

    def joined(self, force: PETSc.Vec) -> PETSc.Vec:
        """Return a vector of the body extended to all unknowns of a dynamic stage (collective)."""
        return force if self.coupled is None else self.coupled.joined(force)

    def _patterns(self, name: str, load: Load) -> Sequence[Any]:
        """Return the patterns of a load; name the load in errors of user-defined forms."""
        try:
            patterns = load.patterns(self)
        except ValueError as error:
            if isinstance(load, FormLoad):
                raise ValueError(f"{name}: {error}") from error
            raise
        norms = [f.norm() for f, _ in patterns] if isinstance(load, FormLoad | JointLoad) else []
        if norms and not any(norms):
            text = f"{name} exerts no force: its value is zero, or no part of the mesh is loaded."
            doubt(self.jointed.mesh.comm, text)
        return patterns

    def resultant(self, force: PETSc.Vec, group: str) -> NDArray[np.float64]:
        """Return the sum of forces over a facet group or point support, (gdim,), [N] (collective).

        The sum of reactions is the force of the support; a component counts in its first support.
        """
        nodes, owned = self.nodes(group), self.V.dofmap.index_map.size_local * self.gdim
        values = force.getArray(readonly=True)[:owned].reshape(-1, self.gdim)[nodes]
        counted = np.where(self.constraints.counts(group, nodes), values, 0.0).sum(axis=0)
        return summed(self.jointed.mesh.comm, counted)

    def nodes(self, group: str) -> NDArray[np.int64]:
        """Return the owned nodes of a facet group or point support, local numbers (collective)."""
        if group in self.constraints.points:
            return self.constraints.points[group]
        if group not in self._nodes:
            self._nodes[group] = nodes_of_facets(self.jointed, self.V, group)
        return self._nodes[group]

    def function(self, vector: PETSc.Vec, name: str = "displacement") -> fem.Function:
        """Return a vector of the space or of a dynamic stage as a DOLFINx function (collective)."""
        u = fem.Function(self.V, name=name)
        owned = self.V.dofmap.index_map.size_local * self.gdim
        u.x.array[:owned] = vector.getArray(readonly=True)[:owned]
        u.x.scatter_forward()
        return u

    @property
    def num_dofs(self) -> int:
        """Number of displacement dofs on all ranks, constrained ones included."""
        return int(self.V.dofmap.index_map.size_global * self.V.dofmap.index_map_bs)


def _check_kinds(given: Mapping[str, Any]) -> None:
    """Check the types of the arguments of a model."""
    for declaration in declarations(Model):
        declaration.check(given[declaration.name], "Model")
    jointed, damping, body = given["jointed"], given["damping"], given["body"]
    is_mesh = isinstance(jointed, JointedMesh)
    check_kind_of("jointed", jointed, is_mesh, "a split mesh, such as from read_msh")
    is_damping = isinstance(damping, Rayleigh | ModalRatios | None)
    check_kind_of("damping", damping, is_damping, "a Rayleigh or ModalRatios")
    check_kind_of("body", body, isinstance(body, Body | None), "a Body")


def _kinds(objects: Sequence[Any]) -> list[str]:
    """Return the types of objects with the groups that they act on."""
    groups = [getattr(each, "group", None) for each in objects]
    kinds = [type(each).__name__ for each in objects]
    return [kind + (f" ({g})" if g else "") for kind, g in zip(kinds, groups, strict=True)]
