# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural frequencies and mode shapes, computed with SLEPc."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import JointTangent
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.model.system import MatrixSystem, as_aij, check_system

# Modes whose frequencies differ by less than this relative value form a group.
SAME_FREQUENCY = 1e-6

# Shift of omega^2 relative to its mean over the mesh; it makes K regular for unsupported blocks.
SHIFT = 1e-8

# Frequencies below this fraction of the shift's frequency are set to zero.
ZERO = 1e-3

# Stiffness of a rigid-body motion due to rounding errors, relative to phi.diag(K) phi.
RIGID_BODY_ROUNDING = 1e-13


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Undamped modes, K phi = omega^2 M phi, normalised to phi.M phi = 1.

    Attributes:
        frequencies: Frequencies [Hz], ascending, shape (n,).
        shapes: Mode shapes, n vectors.
        participation: Participation factors phi.M iota per axis, shape (n, gdim).
        mass: iota.M iota, shape (gdim,), [kg]; iota is a unit translation along each axis.
    """

    frequencies: NDArray[np.float64]
    shapes: list[PETSc.Vec]
    participation: NDArray[np.float64]
    mass: NDArray[np.float64]

    @property
    def effective_mass(self) -> NDArray[np.float64]:
        """Effective modal masses per axis, shape (n, gdim), [kg].

        The sum over all modes is the mass at unconstrained dofs.
        """
        return self.participation**2

    @property
    def effective_share(self) -> NDArray[np.float64]:
        """Effective modal masses as shares of ``mass``, shape (n, gdim)."""
        return self.effective_mass / self.mass

    def report(self) -> str:
        """Return a table of frequencies, effective masses and their sums."""
        axes = "xyz"[: self.participation.shape[1]]
        lines = ["mode  frequency  " + "  ".join(f"mass {axis}" for axis in axes)]
        for i, frequency in enumerate(self.frequencies):
            shares = "  ".join(
                f"{100 * share:4.1f} %" for share in self.effective_share[i].tolist()
            )
            lines.append(f"{i + 1:4d} {frequency:7.3f} Hz {shares}")
        total = "  ".join(f"{100 * s:4.1f} %" for s in self.effective_share.sum(axis=0))
        return "\n".join([*lines, f"all             {total}"])


@checked
def modes(system: MatrixSystem, count: Annotated[int, at.Ge(1)]) -> Modes:
    """Compute the lowest modes with all joints closed and sticking (collective).

    Args:
        system: The system; its joints have their elastic stiffness k_n, k_s.
        count: Number of modes.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=1e13, poisson=0.0, density=2400.0)  # 4800 kg, nearly rigid
        >>> law = dj.KeyedJoint(normal_stiffness=1e13, shear_stiffness=1e13)
        >>> guide = dj.Fixed(group="sides", components="xy")
        >>> spring = dj.Spring(group="base", normal_stiffness=4800.0 * (2 * 3.14159 * 5.0) ** 2)
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[guide, spring])
        >>> dj.modes(model.system(), 1).frequencies.round(2)  # sqrt(k / m) / (2 pi) [Hz]
        array([5.])
    """
    check_system(system)
    mode_count = number_of_modes(system)
    if count > mode_count:
        raise ValueError(f"count is {count}; the system has {mode_count} modes.")
    return _lowest(system, count, 0.0)


def whole_groups(system: MatrixSystem, count: int) -> Modes:
    """Return at most ``count`` of the lowest modes without splitting a group (collective).

    A group has equal frequencies, and the order of its modes depends on rounding. Unsupported
    blocks are allowed; their rigid-body modes have the frequency zero.
    """
    mode_count = number_of_modes(system)
    traces = [float(m.getDiagonal().sum()) for m in (system.stiffness, system.mass)]
    shift = SHIFT * traces[0] / traces[1] or 1.0
    lowest = _lowest(system, min(count + 1, mode_count), -shift)
    rounding = ZERO * math.sqrt(shift) / (2.0 * math.pi)
    frequencies = np.where(lowest.frequencies < rounding, 0.0, lowest.frequencies)
    kept = len(frequencies)
    if kept > count:
        kept = int(np.count_nonzero(frequencies < (1.0 - SAME_FREQUENCY) * frequencies[count]))
    shapes, factors = lowest.shapes[:kept], lowest.participation[:kept]
    return replace(lowest, frequencies=frequencies[:kept], shapes=shapes, participation=factors)


def too_few(system: MatrixSystem, count: int) -> ValueError:
    """Return the error for a ``count`` that splits the lowest group of modes (collective)."""
    requested, mode_count = count, number_of_modes(system)
    frequencies: NDArray[np.float64] = np.empty(0)
    while not frequencies.size:
        requested = min(2 * requested, mode_count)
        frequencies = whole_groups(system, requested).frequencies
    ends = np.flatnonzero(frequencies[:-1] < (1.0 - SAME_FREQUENCY) * frequencies[1:])
    least = int(ends[0]) + 1 if ends.size else len(frequencies)
    return ValueError(
        f"exact_modes is {count}, but the lowest {least} modes have equal frequencies; give at "
        f"least {least}."
    )


def number_of_modes(system: MatrixSystem) -> int:
    """Return the number of unconstrained dofs with mass (collective)."""
    without = np.union1d(system.constrained, system.massless)
    count = system.mass.getLocalSize()[0] - len(without)
    return int(sum(system.mass.comm.tompi4py().allgather(count)))


def closed_stiffness(body: PETSc.Mat, contact: Contact | None) -> PETSc.Mat:
    """Return K of a body with all joints closed and sticking, (34), a new matrix (collective)."""
    stiffness = as_aij(body)
    if contact is not None:
        ones = stiffness.createVecRight()
        ones.set(1.0)
        joint = JointTangent(contact.operator, ones)
        stiffness.axpy(1.0, joint.assemble(contact.closed_tangent()))
    return stiffness


def _check_supported(stiffness: PETSc.Mat, lowest: Modes) -> None:
    """Raise an error if a part of the body can move without any force (collective)."""
    shape = lowest.shapes[0]
    size = stiffness.getDiagonal()
    size.pointwiseMult(size, shape)
    if (2.0 * math.pi * lowest.frequencies[0]) ** 2 < RIGID_BODY_ROUNDING * size.dot(shape):
        raise JointsError(
            "The body or one of its blocks is unsupported: it can move without any force. Add "
            "supports, springs or joints."
        )


def _lowest(system: MatrixSystem, count: int, target: float) -> Modes:
    """Return the modes with omega^2 closest to a target <= 0 that is no eigenvalue (collective)."""
    from slepc4py import SLEPc

    stiffness, mass = closed_stiffness(system.stiffness, system.contact), as_aij(system.mass)
    rows = (system.constrained + stiffness.getOwnershipRange()[0]).astype(PETSc.IntType)
    stiffness.zeroRowsColumns(rows, diag=1.0)
    mass.zeroRowsColumns(rows, diag=0.0)
    solver = SLEPc.EPS().create(mass.comm)
    solver.setOptionsPrefix("dolfinx_joints_modes_")
    solver.setOperators(stiffness, mass)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setDimensions(count)
    solver.setTarget(target)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTolerances(tol=1e-10)
    transform = solver.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    ksp = transform.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("cholesky")
    ksp.getPC().setFactorSolverType("mumps")
    solver.setFromOptions()
    values: list[float] = []
    shapes: list[PETSc.Vec] = []
    _find(solver, count, values, shapes)
    # A Krylov space may miss some modes of equal frequency. Deflate the modes found so far and
    # search for another one at the same frequency.
    mode_count, last = number_of_modes(system), values[-1] - target
    while len(values) < mode_count:
        solver.setDeflationSpace(shapes)
        solver.setDimensions(1)
        _find(solver, 1, values, shapes)
        if values[-1] - target > (1.0 - SAME_FREQUENCY) * last:
            break
        last = sorted(values)[count - 1] - target
    order = np.argsort(values, kind="stable")[:count]
    lowest = _collected(system, [values[i] for i in order], [shapes[i] for i in order])
    if target == 0.0:
        _check_supported(stiffness, lowest)
    return lowest


def _find(solver: Any, count: int, values: list[float], shapes: list[PETSc.Vec]) -> None:
    """Append omega^2 and the shapes of the modes closest to the target (collective)."""
    try:
        solver.solve()
    except (PETSc.Error, SystemError) as exc:
        code = dolfinx_versions.petsc_code(exc)
        raise JointsError(
            "The modes could not be computed: the stiffness cannot be factored, or the body has no "
            f"mass (SLEPc error code {code})."
        ) from None
    if solver.getConverged() < count:
        raise ConvergenceError(stage=f"modal ({solver.getConverged()} of {count} modes)")
    for i in range(count):
        shapes.append(solver.getOperators()[0].createVecRight())
        values.append(solver.getEigenpair(i, shapes[-1], None).real)


def _collected(system: MatrixSystem, values: list[float], shapes: list[PETSc.Vec]) -> Modes:
    """Return the modes with normalised shapes and participation factors (collective)."""
    factors = []
    work = system.mass.createVecRight()
    for shape in shapes:
        system.mass.mult(shape, work)
        norm = math.sqrt(shape.dot(work))
        shape.scale(1.0 / norm)
        work.scale(1.0 / norm)
        local = work.getArray(readonly=True).reshape(-1, system.components).sum(axis=0)
        factors.append(np.sum(work.comm.tompi4py().allgather(local), axis=0))
    return Modes(
        frequencies=np.sqrt(np.maximum(values, 0.0)) / (2.0 * math.pi),
        shapes=shapes,
        participation=np.array(factors),
        mass=_masses(system),
    )


def _masses(system: MatrixSystem) -> NDArray[np.float64]:
    """Return iota.M iota for each axis (collective)."""
    nodes = system.mass.getLocalSize()[0] // system.components
    along = [system.vector(np.tile(axis, nodes)) for axis in np.eye(system.components)]
    return np.array([float(one.dot(system.mass * one)) for one in along])
