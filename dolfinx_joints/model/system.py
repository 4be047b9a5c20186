# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Algebraic system of statics and time stepping: matrices, joints, loads, constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from petsc4py import PETSc

from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.body.halves import Halves
from dolfinx_joints.body.matrices import from_rows
from dolfinx_joints.common.parameters import check_kind_of, check_vector, finite, number_at
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.internal_forces import InternalForces, JointInternalForces
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.laws.law import AnyLaw
from dolfinx_joints.loads.load import FollowsJoints, JointLoad, Load, VaryingLoad
from dolfinx_joints.mesh.cells import Floats, Ints

if TYPE_CHECKING:
    from dolfinx_joints.body.nonlinear_cells import NonlinearBulk
    from dolfinx_joints.loads.load import LoadedBody
    from dolfinx_joints.loads.water.pressures_in_joints import JointWaters

Pattern = tuple[PETSc.Vec, Callable[[float], float]]


@dataclass(frozen=True, kw_only=True)
class MatrixSystem:
    """System M a + C v + K u + B^T w t(B u) = F(time) with constrained dofs.

    `Model.system` builds a system from a mesh, `from_arrays` from dense matrices.

    Attributes:
        mass: M [kg].
        stiffness: K of the bulk and its springs [N/m].
        rayleigh: Factors of M and K in C.
        dashpots: Part of C that is neither Rayleigh nor modal damping [N s/m], or None.
        absorption: Part of ``dashpots`` that is due to viscous boundaries [N s/m], or None.
        damped_modes: Part of C that is due to damping ratios of modes (`DampedModes`), or None.
        contact: The joints, or None.
        bulk: Cells with nonlinear materials, or None. K contains their elastic stiffness.
        patterns: Nodal forces [N] with their factors, functions of time [s].
        load_names: Name of the load that each pattern belongs to; ``load`` for all by default.
        loads: The acting loads by name.
        constrained: Owned constrained dofs, local numbers.
        values: Displacements [m] of the constrained dofs at a time [s]; zero by default.
        symmetric: Whether K and C are symmetric, apart from the coupling with reservoir waves.
        components: Displacement components per node.
        water: Water pressures that depend on the state of the joints, or None.
        in_joints: All loads that are water in joints, for monitors that record their pressures.
        shared: Data shared by runs of the same model (`SharedBulk`), or None.
        varying_loads: Loads whose pattern varies in time.
        control: Load f [N] with an unknown factor, and c of the prescribed displacement c.x (28f),
            both zero at constrained dofs; None without a controlled load.
        coupled: Unknowns of body and reservoir (`BodyAndWater`), None without reservoir waves.
        lowest_modes: Cache of the modes computed for ``exact_modes``, by their number.
    """

    mass: PETSc.Mat
    stiffness: PETSc.Mat
    rayleigh: Rayleigh = field(default_factory=Rayleigh)
    dashpots: PETSc.Mat | None = None
    absorption: PETSc.Mat | None = None
    damped_modes: Any = None
    contact: Contact | None = None
    bulk: NonlinearBulk | None = None
    patterns: Sequence[Pattern] = ()
    load_names: Sequence[str] = ()
    loads: Mapping[str, Load] = field(default_factory=dict)
    constrained: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    values: Callable[[float], Floats] | None = None
    symmetric: bool = True
    components: int = 1
    water: JointWaters | None = None
    in_joints: Sequence[Any] = ()
    shared: Any = None
    varying_loads: Sequence[VaryingLoad] = ()
    control: tuple[PETSc.Vec, PETSc.Vec] | None = None
    coupled: Any = None
    lowest_modes: dict[int, Any] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def from_arrays(
        cls,
        *,
        mass: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike | None = None,
        load: Callable[[float], ArrayLike] | None = None,
        gap: ArrayLike | None = None,
        law: AnyLaw | None = None,
        initial_gap: float = 0.0,
        areas: ArrayLike | None = None,
    ) -> MatrixSystem:
        """Return a small system made from dense arrays, on one process.

        Args:
            mass: M, shape (n, n), [kg].
            stiffness: K, shape (n, n), [N/m].
            damping: C, shape (n, n), [N s/m]; zero by default.
            load: F at a time, shape (n,), [N]; zero by default.
            gap: B, three rows (n, s1, s2) per joint point, shape (3 p, n); no joint by default.
            law: Law of the joint points.
            initial_gap: Initial normal gap [m].
            areas: Area of each point, shape (p,), [m^2]; 1 by default.
        """
        m, k = _dense("mass", mass), _dense("stiffness", stiffness)
        c = np.zeros_like(k) if damping is None else _dense("damping", damping)
        size = len(m)
        if not m.shape == k.shape == c.shape == (size, size):
            raise ValueError(
                f"mass, stiffness and damping have shapes {m.shape}, {k.shape}, {c.shape}; they "
                "must be square and of equal size."
            )
        contact = None
        if gap is not None:
            b = _dense("gap", gap)
            if law is None or b.shape[1] != size or b.shape[0] % 3:
                raise ValueError(
                    f"gap has shape {b.shape}; it needs {size} columns, three rows per joint "
                    "point, and a law."
                )
            points = len(b) // 3
            w = np.ones(points) if areas is None else check_vector("areas", areas, (points,))
            operator = GapOperator(_matrix(b), w, np.zeros(points, dtype=np.int64), ("joint",))
            contact = Contact(operator, law, {"joint": initial_gap})
        elif law is not None:
            raise ValueError("A law is given without gap; pass gap too, or omit law.")
        matrix_m = _matrix(m)
        return cls(
            mass=matrix_m,
            stiffness=_matrix(k),
            dashpots=None if damping is None else _matrix(c),
            contact=contact,
            patterns=[] if load is None else _components(load, matrix_m),
        )

    @cached_property
    def internal_forces(self) -> InternalForces | None:
        """Forces of joints, nonlinear cells, or both; None for a linear system."""
        if self.bulk is not None:
            return self.bulk
        return None if self.contact is None else JointInternalForces(self.contact)

    @cached_property
    def massless(self) -> Ints:
        """Owned dofs without mass, local numbers."""
        diagonal = self.mass.getDiagonal().getArray(readonly=True)
        return np.flatnonzero(diagonal == 0.0)

    @cached_property
    def damping(self) -> PETSc.Mat:
        """C without `damped_modes` [N s/m], assembled on first access (collective)."""
        return self.combined(0.0, 1.0, 0.0)

    def combined(self, mass: float, damping: float, stiffness: float) -> PETSc.Mat:
        """Return mass M + damping C + stiffness K in the solvers' matrix format (collective)."""
        of_mass, of_stiffness = self.coefficients(mass, damping, stiffness)
        total = as_aij(self.stiffness)
        total.scale(of_stiffness)
        for factor, matrix in ((of_mass, self.mass), (damping, self.dashpots)):
            if factor and matrix is not None:
                added = as_aij(matrix)
                total.axpy(factor, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                added.destroy()
        return total

    def coefficients(self, mass: float, damping: float, stiffness: float) -> tuple[float, float]:
        """Return the factors of M and K in mass M + damping C + stiffness K, without dashpots."""
        return (
            mass + damping * self.rayleigh.mass_factor,
            stiffness + damping * self.rayleigh.stiffness_factor,
        )

    def bulk_terms(self, joints: Any) -> tuple[float, float, float]:
        """Return energies of nonlinear cells [J] (collective).

        The energies are the stored energy minus its part in u.K u / 2, and the loss and the
        numerical loss of a step. ``joints`` is the response of joints and cells, or None.
        """
        if self.bulk is None or joints is None:
            return 0.0, 0.0, 0.0
        return self.bulk.excess_energy(joints.state), *self.bulk.losses(joints)

    def norm(self, displacement: PETSc.Vec) -> float:
        """Return the 2-norm over the body's dofs, without water unknowns [m] (collective)."""
        of_body = displacement if self.coupled is None else self.coupled.body(displacement)
        return float(of_body.norm())

    def multiply(self, x: PETSc.Vec, mass: PETSc.Vec, stiffness: PETSc.Vec) -> None:
        """Write M x to ``mass`` and K x to ``stiffness`` (collective)."""
        if self._halves is not None:
            self._halves.multiply(x, mass, stiffness)
            return
        self.mass.mult(x, mass)
        self.stiffness.mult(x, stiffness)

    @cached_property
    def _halves(self) -> Halves | None:
        """Upper halves of M and K for faster products, None to use PETSc's (collective)."""
        make = partial(Halves.of, self.mass, self.stiffness)
        return make() if self.shared is None else self.shared.once("halves", make)

    def damping_force(self, velocity: PETSc.Vec, out: PETSc.Vec) -> PETSc.Vec:
        """Write C v to ``out`` [N] and return it (collective)."""
        of_mass, of_stiffness = self.coefficients(0.0, 1.0, 0.0)
        work = out.duplicate()
        out.set(0.0)
        terms = ((of_mass, self.mass), (of_stiffness, self.stiffness), (1.0, self.dashpots))
        for factor, matrix in terms:
            if factor and matrix is not None:
                matrix.mult(velocity, work)
                out.axpy(factor, work)
        if self.damped_modes is not None:
            self.damped_modes.add_force(velocity, out)
        return out

    def load(self, time: float, out: PETSc.Vec) -> PETSc.Vec:
        """Write the nodal loads at a time [s] to ``out`` [N] and return it (collective)."""
        out.set(0.0)
        for factor, (vector, _) in zip(self.factors(time), self.patterns, strict=True):
            out.axpy(float(factor), vector)
        for varying in self._without_patterns:
            varying.add(out, time)
        return out

    def loads_by_name(self, time: float, scale: float) -> dict[str, PETSc.Vec]:
        """Return the nodal forces of each load at a time [s], times ``scale``, [N] (collective).

        For static stages: the forces at the far end of a reservoir with waves are omitted.
        """
        factors = scale * self.factors(time)
        forces: dict[str, PETSc.Vec] = {}
        for name, factor, (vector, _) in zip(
            self.names_of_patterns, factors, self.patterns, strict=True
        ):
            if name in forces:
                forces[name].axpy(float(factor), vector)
            else:
                forces[name] = float(factor) * vector
        return forces | ({} if self.water is None else self.water.by_load(time, scale))

    def work_of_loads(self, x: PETSc.Vec, start: float, end: float) -> dict[str, float]:
        """Return the work of each load's mean in a step on a displacement x [J] (collective)."""
        names = self.names_of_patterns
        works = dict.fromkeys(names, 0.0)
        means = 0.5 * (self.factors(start) + self.factors(end))
        for name, mean, (vector, _) in zip(names, means, self.patterns, strict=True):
            if mean:
                works[name] += float(mean * vector.dot(x))
        for varying in self._without_patterns:
            works |= varying.work(x, start, end)
        return works

    @property
    def names_of_patterns(self) -> Sequence[str]:
        """Name of the load that each pattern belongs to."""
        return self.load_names or ["load"] * len(self.patterns)

    @property
    def names_of_works(self) -> list[str]:
        """Names of the loads in `work_of_loads`."""
        fixed = dict.fromkeys(self.load_names or ["load"])
        return [*fixed, *chain(*(varying.names for varying in self._without_patterns))]

    @property
    def _without_patterns(self) -> list[Any]:
        """Loads that are not a fixed pattern times a factor of time."""
        return [*([] if self.water is None else [self.water]), *self.varying_loads]

    @cached_property
    def factors(self) -> Callable[[float], Floats]:
        """Function that returns the patterns' factors at a time [s]; it caches two times."""
        named = list(zip(self.names_of_patterns, self.patterns, strict=True))

        def factors(time: float) -> Floats:
            return np.array([number_at(f"The factor of {n}", f, time) for n, (_, f) in named])

        return lru_cache(maxsize=2)(factors)

    def prescribed_rates(
        self, time: float, interval: float, *, late: float = 0.0
    ) -> tuple[NDArray[Any], NDArray[Any]] | None:
        """Return velocities [m/s] and accelerations [m/s^2] of the constrained dofs.

        They are finite differences of the displacements at four times, exact for cubic motions.
        The result is None if the dofs do not move.

        Args:
            time: Time of the velocities [s].
            interval: Length of the interval of the four times [s]. It ends at ``time``; if it is
                negative, it begins there.
            late: Fraction of the interval by which the accelerations are earlier than ``time``.
        """
        if self.values is None:
            return None
        spacing = interval / 3.0
        values = np.array([self.values(time - k * spacing) for k in range(4)])
        velocity = np.array([11.0, -18.0, 9.0, -2.0]) @ values / (6.0 * spacing)
        at_end = np.array([2.0, -5.0, 4.0, -1.0])
        return velocity, ((1.0 - late) * at_end + late * at_end[::-1]) @ values / spacing**2

    def prescribed(self, time: float, *, scale: float = 1.0) -> Floats:
        """Return the displacements of the constrained dofs at a time [s], times ``scale``, [m]."""
        if self.values is None:
            return np.zeros(len(self.constrained))
        return scale * self.values(time)

    def vector(self, rows: ArrayLike = 0.0) -> PETSc.Vec:
        """Return a vector of all unknowns with these owned rows, zero by default."""
        vector = self.stiffness.createVecRight()
        vector.getArray()[:] = rows
        return vector

    def unknowns(self, body: PETSc.Vec | None) -> PETSc.Vec:
        """Return a copy of a nodal vector of the body extended to all unknowns; zero if None."""
        if body is None:
            return self.vector()
        return body.copy() if self.coupled is None else self.coupled.joined(body).copy()


def check_system(system: Any) -> None:
    """Check that the argument is a system, not a model."""
    good = isinstance(system, MatrixSystem)
    check_kind_of("system", system, good, "a MatrixSystem, such as model.system()")


def as_aij(matrix: PETSc.Mat) -> PETSc.Mat:
    """Return a copy in PETSc's AIJ format, which supports all operations (collective)."""
    return matrix.convert("aij", PETSc.Mat())


def _components(
    load: Callable[[float], ArrayLike], mass: PETSc.Mat
) -> list[tuple[PETSc.Vec, Callable[[float], float]]]:
    """Return a unit vector and its time-dependent factor for each entry of a load."""
    size = mass.getSize()[0]

    @lru_cache(maxsize=1)
    def forces(time: float) -> Floats:
        return check_vector(f"load({time:g})", np.atleast_1d(load(time)), (size,))

    def component(i: int) -> tuple[PETSc.Vec, Callable[[float], float]]:
        unit = mass.createVecRight()
        unit.setArray(np.eye(size)[i])
        return unit, lambda time: float(forces(time)[i])

    return [component(i) for i in range(size)]


def _dense(name: str, values: Any) -> Floats:
    """Return the values as a matrix of finite numbers, or raise an error."""
    numbers = np.atleast_2d(np.asarray(values, dtype=np.float64))
    check_kind_of(name, values, finite(numbers), "a matrix of finite numbers")
    return numbers


def _matrix(dense: Floats) -> PETSc.Mat:
    """Return a PETSc matrix on this process that stores every entry."""
    rows, columns = dense.shape
    starts = np.arange(0, rows * columns + 1, columns)
    numbers = np.tile(np.arange(columns), rows)
    return from_rows((rows, columns), (starts, numbers, dense.ravel()), PETSc.COMM_SELF)


def water_in(
    model: LoadedBody, loads: Mapping[str, Load], *, waves: bool
) -> tuple[JointWaters | None, Sequence[Any]]:
    """Return the pressures that depend on the joints, and all loads by water in joints.

    (Collective.) The modules are imported only if there are such loads.
    """
    if not any(isinstance(load, JointLoad) for load in loads.values()):
        return None, []
    from dolfinx_joints.loads.water.pressures_in_joints import JointWaters, water_in_joints

    following = {n: load for n, load in loads.items() if isinstance(load, FollowsJoints)}
    water = JointWaters(model, following, waves=waves) if following else None
    return water, water_in_joints(loads.values())
