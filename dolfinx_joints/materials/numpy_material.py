# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials given by their stress at the end of a step, and their evaluation in time schemes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import finite, is_plain_name, numbers_of, shown
from dolfinx_joints.materials.bulk_law import BulkResponse, BulkState, BulkStatus, product
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.materials.orthotropic import Orthotropic

# A difference of energies below this part of its terms is rounding error.
_ROUNDING = 16.0 * float(np.finfo(float).eps)

# Strain at which new materials are evaluated after zero strain: small, without equal components.
_TEST_STRAIN = np.array([[-3e-7, 1e-7, 2e-7, 7e-8, -5e-8, 1.1e-7]])

# Growth of this strain for the derivative of an energy, and its tolerance: exact for quadratics.
_GROWTH = 1e-3

# Largest stress at zero strain, and largest negative stiffness there, divided by the elastic
# stiffness: a strain of 1e-9. The limit of the energy is the square.
_AT_REST = 1e-9


class PointResponse(NamedTuple):
    """Response of n points to a strain at the end of a step.

    Attributes:
        stress: Stress, shape (n, 6), [Pa].
        tangent: d stress / d strain, with changing variables, shape (n, 6, 6), [Pa].
        energy: Stored energy per volume, shape (n,), [J/m^3], or None.
        internal: New internal variables, shape (n, m).
    """

    stress: Floats
    tangent: Floats
    energy: Floats | None = None
    internal: Floats | None = None


class EndPointMaterial:
    """Material whose `function` returns the stress at the end of a step; see `BulkLaw`.

    Without internal variables and with an energy the material is reversible. Energy-consistent
    steps then use the discrete gradient of Gonzalez (2000). Otherwise they use the mean of start
    and end stress; the loss is the work of this mean minus the change of the stored energy.

    Attributes:
        elastic: Elastic material for the density, the matrix K, modes and damping.
        function: See `NumpyMaterial`.
        initials: Initial values of the internal variables: arrays, or functions of cell sizes.
        reversible: True if the stress is the derivative of an energy.
    """

    elastic: Any
    function: Callable[..., Any]
    initials: Mapping[str, Any]
    reversible: bool

    @property
    def internal_variables(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the internal variables by name."""
        return {name: value.shape[1:] for name, value in self._values(np.ones(1)).items()}

    def initial_variables(self, sizes: Floats) -> Floats:
        """Return the internal variables at rest in cells of given sizes [m], shape (n, m)."""
        count, values = len(sizes), self._values(sizes).values()  # zero on ranks without points
        columns = [v.reshape(count, int(np.prod(v.shape[1:]))) for v in values]
        return np.hstack([np.zeros((count, 0)), *columns])

    def _values(self, sizes: Floats) -> dict[str, Floats]:
        """Return the initial value of each variable, shape (n, ...)."""
        values = {}
        for name, initial in self.initials.items():
            given = numbers_of(initial(sizes) if callable(initial) else [initial])
            count = len(sizes) if callable(initial) else 1
            valid = given is not None and finite(given) and given.shape[:1] == (count,)
            if given is None or not valid or 0 in given.shape[1:]:
                raise ValueError(
                    f"{type(self).__name__}: the initial value of {shown(name)} is {shown(initial)}"
                    "; it must be a number, an array, or a function of n cell sizes to n values."
                )
            values[name] = np.broadcast_to(given, (len(sizes), *given.shape[1:]))
        return values

    def backward_euler(self, strain: Floats, state: BulkState, dt: float = 0.0) -> BulkResponse:
        """Return the response at the end of a step at a strain (n, 6)."""
        return self._step(strain, state, dt, whole=False)

    def discrete_gradient(self, strain: Floats, state: BulkState, dt: float = 0.0) -> BulkResponse:
        """Return the response over a step to a strain (n, 6), with an exact energy balance."""
        return self._step(strain, state, dt, whole=True)

    def _step(self, strain: Floats, state: BulkState, dt: float, *, whole: bool) -> BulkResponse:
        """Return the response at the end of a step, or over the whole step."""
        stress, tangent, energy, internal = self._respond(strain, state.internal, dt)
        zero = np.zeros(len(strain))
        energy = zero if energy is None else energy.copy()  # the function may reuse its arrays
        internal = state.internal if internal is None else internal
        # The solver checks the stress only, so a point with any other NaN gets a stress of NaN.
        sums = tangent.sum(axis=(1, 2)) + energy + internal.sum(axis=1)
        stress = np.where(np.isfinite(sums)[:, None], stress, np.nan)
        after = BulkState(strain=strain.copy(), stress=stress, energy=energy, internal=internal)
        mean = 0.5 * (state.stress + stress)
        loss = product(mean, strain - state.strain) - (after.energy - state.energy)
        if whole and self.reversible:
            (stress, tangent), loss = self._discrete_gradient(state, after), zero
        elif whole:
            stress, tangent = mean, 0.5 * tangent
        changed = (after.internal != state.internal).any(axis=1)
        return BulkResponse(
            stress=stress,
            tangent=tangent,
            state=after,
            dissipation=zero if self.reversible else loss,
            numerical=loss if self.reversible else zero,
            status=np.where(changed, BulkStatus.YIELD, BulkStatus.ELASTIC).astype(np.int8),
        )

    def _discrete_gradient(self, start: BulkState, end: BulkState) -> tuple[Floats, Floats]:
        """Return the stress (12p), whose work equals the change of energy, and its derivative."""
        change = end.strain - start.strain
        middle = self._respond(0.5 * (start.strain + end.strain), start.internal, 0.0)
        terms = middle.stress * change
        excess = end.energy - start.energy - terms.sum(axis=1)
        size = np.abs(terms).sum(axis=1) + np.abs(start.energy) + np.abs(end.energy)
        stress, tangent = middle.stress.copy(), 0.5 * middle.tangent
        points = np.flatnonzero(np.abs(excess) > _ROUNDING * size)
        matrix, change, slope = self.elastic.stiffness_matrix(), change[points], tangent[points]
        direction = change @ matrix
        norm = product(direction, change)
        factor = (excess[points] / norm)[:, None]
        gradient = end.stress[points] - middle.stress[points] - 2.0 * factor * direction
        gradient -= np.einsum("ni,nij->nj", change, slope)
        stress[points] += factor * direction
        tangent[points] += factor[:, :, None] * matrix
        tangent[points] += np.einsum("ni,nj->nij", direction, gradient / norm[:, None])
        return stress, tangent

    def _respond(self, strain: Floats, internal: Floats, dt: float) -> PointResponse:
        """Return the response, checked for its shapes."""
        owner, count = type(self).__name__, len(strain)
        if dt < 0.0:
            raise ValueError(
                f"{owner}: the time decreases by {-dt:g} s; times of quasi_statics must increase."
            )
        given = self.function(strain.copy(), internal.copy(), dt)
        if not isinstance(given, tuple) or len(given) not in (2, 3, 4):
            wanted = "(stress, tangent[, energy[, internal variables]])"
            raise ValueError(f"{owner} returned {shown(given)}; it must return {wanted}.")
        answer: Any = PointResponse(*given)
        shapes = [(count, 6), (count, 6, 6), (count,), internal.shape]
        for name, value, shape in zip(PointResponse._fields, answer, shapes, strict=True):
            if value is None and (name == "energy" or 0 in shape):
                continue
            if getattr(value, "dtype", None) != np.float64 or value.shape != shape:
                an_array = isinstance(value, np.ndarray)
                given = f"{value.dtype} of shape {value.shape}" if an_array else shown(value)
                raise ValueError(
                    f"{owner}: {name} is {given}; for {count} points it must be an array of "
                    f"float64 of shape {shape}."
                )
        return PointResponse(*answer)

    def _check(self) -> PointResponse:
        """Check the elastic part, and the response near zero strain; return the latter.

        Raises:
            ValueError: A value is not finite, or one at zero strain is not that of a body at rest.
        """
        owner, elastic = type(self).__name__, self.elastic
        if not isinstance(elastic, Elastic | Orthotropic):
            raise ValueError(
                f"{owner}: elastic is {shown(elastic)}; it must be an Elastic or an Orthotropic."
            )
        strain = np.concatenate([np.zeros((1, 6)), _TEST_STRAIN])
        answer = self._respond(strain, self.initial_variables(np.ones(2)), 0.0)
        for name, value in answer._asdict().items():
            if value is not None and not finite(value):
                at = f"the strain {_TEST_STRAIN[0].tolist()}" if finite(value[0]) else "zero strain"
                raise ValueError(
                    f"{owner}: {name} is NaN or infinite at {at}. Avoid, for example, sqrt(x) "
                    "with infinite slope at x = 0 by sqrt(x + 1e-30), and division by dt = 0."
                )
        scale = float(np.abs(elastic.stiffness_matrix()).max())
        for name, limit in (("stress", _AT_REST * scale), ("energy", _AT_REST**2 * scale)):
            value = getattr(answer, name)
            if value is not None and (largest := np.abs(value[0]).max()) > limit:
                raise ValueError(
                    f"{owner}: {name} at zero strain is {largest:.3g} Pa; it must be zero. Give "
                    "initial stresses by loads, and energies relative to zero strain."
                )
        least = np.linalg.eigvalsh(0.5 * (answer.tangent[0] + answer.tangent[0].T)).min()
        if least < -_AT_REST * scale:
            raise ValueError(
                f"{owner}: the tangent at zero strain has the eigenvalue {least:.3g} Pa; it must "
                "not be negative. Check the sign of the stress or of the energy."
            )
        return answer


@dataclass(frozen=True, eq=False)
@checked
class NumpyMaterial(EndPointMaterial):
    """Material given by a NumPy function of the strain, as with external operators of DOLFINx.

    Example::

        def respond(strain, internal, dt):  # (n, 6), (n, m), seconds
            return strain @ c, np.tile(c, (len(strain), 1, 1))  # stress and tangent


        material = NumpyMaterial(respond, elastic=elastic)

    Strains and stresses are vectors (xx, yy, zz, yz, xz, xy) with shear angles 2 eps_yz etc.

    Attributes:
        function: Function of strain (n, 6), internal variables (n, m) at the start of the step and
            step length [s] that returns the values of `PointResponse`, at least the first two. It
            is called with any number of points.
        elastic: Elastic material for the density, the matrix K, modes and damping.
        internal: Initial value of each internal variable by name: a number, an array, or a
            function of the sizes of the cells, shape (n,), [m].

    Raises:
        ValueError: The function returns arrays of other shapes, NaN, a stress at zero strain, or
            derivatives of stress or (without internal variables) energy that are not correct.
    """

    function: Callable[..., Any]
    elastic: Elastic | Orthotropic = field(kw_only=True)
    internal: Mapping[str, Any] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        check_internal(type(self).__name__, self.internal, "a dict by name")
        try:
            signature(self.function).bind(*"123")
        except (TypeError, ValueError):
            raise ValueError(
                f"NumpyMaterial: function is {shown(self.function)}; it must be a function of "
                "strain, internal variables and step length."
            ) from None
        object.__setattr__(self, "initials", self.internal)
        answer = self._check()
        object.__setattr__(self, "reversible", answer.energy is not None and not self.internal)
        self._check_derivatives(answer)

    def _check_derivatives(self, answer: PointResponse) -> None:
        """Check that stress and energy have the returned derivatives as the test strain grows."""
        strain, e = _TEST_STRAIN * np.array([[1.0 - _GROWTH], [1.0 + _GROWTH]]), _TEST_STRAIN[0]
        near = self._respond(strain, self.initial_variables(np.ones(2)), 0.0)
        derivatives: list[Any] = [("tangent", answer.tangent[1] @ e, "stress", near.stress)]
        if self.reversible:
            derivatives.append(("stress", answer.stress[1] @ e, "energy", near.energy))
        for name, slope, of, ends in derivatives:
            change = (ends[1] - ends[0]) / (2.0 * _GROWTH)
            if not np.abs(change - slope).max() <= _GROWTH * np.abs([change, slope]).max():
                raise ValueError(
                    f"{type(self).__name__}: {name} is not the derivative of {of}: for the strains "
                    f"x e with e = {e.tolist()}, d {of} / dx is {shown(change.tolist())} at x = 1, "
                    f"but {name} : e is {shown(slope.tolist())}."
                )


def check_internal(
    owner: str, internal: Any, wanted: str, fits: Callable[[Any], bool] = lambda item: True
) -> None:
    """Check that internal variables are a mapping from plain names to values that fit."""
    valid = isinstance(internal, Mapping) and all(isinstance(name, str) for name in internal)
    if not (valid and all(map(is_plain_name, internal)) and all(map(fits, internal.values()))):
        raise ValueError(f"{owner}: internal is {shown(internal)}; it must be {wanted}.")
