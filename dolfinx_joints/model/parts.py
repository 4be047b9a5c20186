# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments of a model for joints, water and body, with their checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import ufl

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_kind_of, offers, shown
from dolfinx_joints.joints.contact import InitialGap
from dolfinx_joints.laws.law import AnyLaw
from dolfinx_joints.loads.load import AddedMass
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

if TYPE_CHECKING:
    from dolfinx_joints.loads.water.water import Reservoir

BilinearForm = Callable[[Any, Any], Any]


@dataclass(frozen=True)
@checked
class Joints:
    """Laws of the joints, with the options that apply only to joints.

    Args:
        laws: One law for all joints, or one per joint name.
        initial_gaps: Initial normal gap of named joints, a number or a function of the points [m].
        quadrature: Rule on the joints: ``auto``, ``nodal``, ``gauss``, or the polynomial degree
            that a Gauss rule integrates exactly; see `facet_rule`.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> base = [dj.Fixed(group="base")]
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> joints = dj.Joints(law, initial_gaps={"joint_1": 0.001})  # open by 1 mm
        >>> loads = [dj.Pressure(group="top", value=1e5)]
        >>> model = dj.Model(mesh, material=solid, joints=joints, supports=base, loads=loads)
        >>> state = dj.Simulation(model).statics()
        >>> round(state.displacement.min()[1], 4)  # the upper block closes the gap [m]
        -0.001
    """

    laws: AnyLaw | Mapping[str, AnyLaw] | None
    _: KW_ONLY
    initial_gaps: Mapping[str, InitialGap] = field(default_factory=dict)
    quadrature: str | int = "auto"


@dataclass(frozen=True, kw_only=True)
@checked
class Body:
    """Options of the body: its discretisation, user-defined forms and mass redistribution.

    Args:
        degree: Degree of the displacement; by default that of the mesh.
        plane: ``strain`` or ``stress`` in 2-D.
        extra_stiffness: Bilinear form (u, v) added to K, also on joints (`JointedMesh.dS`).
        extra_mass: Bilinear form (u, v) added to M.
        extra_damping: Bilinear form (u, v) added to C.
        symmetric: Whether the extra forms are symmetric.
        redistribute_mass: Move the mass of joint nodes to the body behind them, so that contact
            tractions do not oscillate (`Model.redistribution`). Gravity acts on the moved mass.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11)
        >>> dj.Model(mesh, material=solid, joints=law).num_dofs  # 2 blocks of 3^3 nodes
        162
        >>> dj.Model(mesh, material=solid, joints=law, body=dj.Body(degree=2)).num_dofs  # 5^3
        750
    """

    degree: Literal[1, 2] | None = None
    plane: Literal["strain", "stress"] = "strain"
    extra_stiffness: BilinearForm | None = None
    extra_mass: BilinearForm | None = None
    extra_damping: BilinearForm | None = None
    symmetric: bool = True
    redistribute_mass: bool = False

    def forms(self, name: str, u: Any, v: Any) -> list[Any]:
        """Return a list of the named user-defined form, empty if this form is not given."""
        extra = getattr(self, name)
        if extra is None:
            return []
        form = extra(u, v)
        check_form(form, 2, f"{name} must return a bilinear UFL form of (u, v)")
        return [form]


def by_kind(water: Any) -> tuple[list[AddedMass], list[Reservoir]]:
    """Return the added masses, and the reservoirs with waves (at most one), of a model."""
    given = list(water) if isinstance(water, Sequence) else [] if water is None else [water]
    for item in given:
        is_water = offers(item, "water") or offers(item, "matrix")
        check_kind_of("water", item, is_water, "a reservoir, an added mass, or a sequence of them")
    reservoirs = [item for item in given if offers(item, "water")]
    if len(reservoirs) > 1:
        raise ValueError("water has more than one reservoir with waves; a model can have only one.")
    return [item for item in given if not offers(item, "water")], reservoirs


def check_form(form: Any, arguments: int, requirement: str) -> None:
    """Check the number of arguments of a UFL form, and that numbered parts have tags."""
    count = len(form.arguments()) if isinstance(form, ufl.Form) else 0
    if count != arguments:
        raise ValueError(f"{requirement}; the form has {count} arguments: {shown(form, str)}.")
    for integral in form.integrals():
        if integral.subdomain_data() is None and integral.subdomain_id() not in (
            "everywhere",
            "otherwise",
        ):
            part = f"the part {shown(integral.subdomain_id())} of a measure without tags"
            raise ValueError(
                f"{requirement}; the form integrates over {part}; use jointed.ds(NAME)."
            )


def check_tied(jointed: JointedMesh, forms: list[Any]) -> None:
    """Raise a MeshError if a joint without a law is not in the extra forms of K (collective)."""
    over = [jointed.joints_of(integral) or () for form in forms for integral in form.integrals()]
    tied = {position for positions in over for position in positions}
    untied = [name for i, name in enumerate(jointed.joint_names) if i not in tied]
    if untied:
        raise MeshError(
            f"The mesh has joints ({', '.join(untied)}) but no law was given. Pass joints=, tie "
            "them by an extra_stiffness over jointed.dS(), or read the mesh with joints=[] for a "
            "monolithic body."
        )


def check_joints(jointed: JointedMesh, joints: Any, initial_gaps: Any) -> None:
    """Check that laws and gaps are given only if the mesh has joints."""
    for kind, given in (("laws", joints), ("initial gaps", initial_gaps)):
        if not jointed.joint_names and isinstance(given, Mapping) and given:
            names = ", ".join(map(str, given))
            raise MeshError(f"The mesh has no joints, but {kind} were given for {names}.")
    if not jointed.joint_names and joints is not None and not isinstance(joints, Mapping):
        raise MeshError(
            f"The mesh has no joints, but Model was given the law {type(joints).__name__}. Name "
            "the surface group of each joint 'joint...' in the mesh or list it in joints= of the "
            "reader. For a monolithic body, omit joints= in Model."
        )
