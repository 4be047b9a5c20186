# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Calibration of the parameters of a model by readings of instruments and natural frequencies.

Readings and parameters are taken as normally distributed. The calibrated parameters minimise (47),
the misfit of readings and parameters; their covariance (48) is that of the model linearised there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear, minimize

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError, doubt
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.common.summary import Rows, Summarised
from dolfinx_joints.gradient.quantity import Quantity
from dolfinx_joints.gradient.reverse_sweep import gradient_of
from dolfinx_joints.gradient.tape import Tape
from dolfinx_joints.model.model import Model
from dolfinx_joints.study.misfit import Misfit

# Change of a parameter in the differences for the posterior, relative to its prior deviation: large
# against rounding errors, small against the changes at which many points open or close.
DIFFERENCE = 0.02

# L-BFGS-B ends if an iteration decreases the misfit by less. The misfit changes by 0.5 at one
# posterior deviation. Gauss-Newton steps then come closer in fewer runs; for 23 parameters of a
# linear model, L-BFGS-B with 0.01 needs twice the runs and ends one posterior deviation away.
DECREASE = 0.1

# Largest numbers of iterations of L-BFGS-B, of Jacobians, and of steps with one Jacobian.
ITERATIONS, JACOBIANS, STEPS = 200, 5, 5

# Estimated distance from the minimum that ends the search, in posterior deviations.
DISTANCE = 0.1

# Largest distance from the parameters of the Jacobian to the result, in posterior deviations. The
# covariance takes the model as linear over this distance anyway.
MOVED = 1.0

# Combinations of parameters with a smaller singular value are known rather from the prior.
UNDETERMINED = 1.0


class Prediction(NamedTuple):
    """Predicted quantity, and its standard deviation due to that of the parameters."""

    value: float
    deviation: float


@dataclass(frozen=True, kw_only=True, repr=False)
class Calibration(Summarised):
    """Calibrated parameters, and what the readings say about them.

    Attributes:
        misfit: The misfit function, with parameters, readings and runs.
        values: Calibrated parameters by name.
        computed: Computed values of all readings, then frequencies, shape (m,).
        jacobian: Derivatives of (computed values / deviations) by x, shape (m, n).
        distance: Estimated distance from the minimum of the misfit, in posterior deviations.
    """

    misfit: Misfit
    values: Mapping[str, float]
    computed: Floats
    jacobian: Floats
    distance: float

    @property
    def covariance(self) -> Floats:
        """Posterior covariance of the parameters (48), shape (n, n)."""
        precision = self.jacobian.T @ self.jacobian + np.eye(len(self.values))
        scale: Floats = self.misfit.deviations
        return np.linalg.inv(precision) * np.outer(scale, scale)

    @property
    def deviations(self) -> dict[str, float]:
        """Posterior standard deviations of the parameters by name."""
        roots = np.sqrt(np.diag(self.covariance))
        return {name: float(roots[i]) for i, name in enumerate(self.values)}

    @property
    def singular_values(self) -> Floats:
        """Singular values of the Jacobian, descending, shape (n,).

        The posterior deviation of a combination of parameters is 1 / sqrt(1 + s^2) of the prior.
        """
        return self._directions()[0]

    @property
    def undetermined(self) -> list[dict[str, float]]:
        """Combinations of the scaled parameters that the readings do not determine.

        Each is a unit vector by parameter name, without entries below 0.1.
        """
        s, directions = self._directions()
        return [
            {n: float(v) for n, v in zip(self.values, row, strict=True) if abs(v) >= 0.1}
            for value, row in zip(s, directions, strict=True)
            if value < UNDETERMINED
        ]

    def _directions(self) -> tuple[Floats, list[Floats]]:
        """Return singular values and right singular vectors, one for each parameter."""
        n = len(self.values)
        padded = np.vstack([self.jacobian, np.zeros((n, n))])
        _, s, directions = np.linalg.svd(padded, full_matrices=False)
        return s, list(directions)

    @property
    def at_bounds(self) -> list[str]:
        """Parameters at one of their bounds, up to rounding."""
        misfit = self.misfit
        named = zip(self.values.items(), misfit.ends, misfit.deviations, strict=True)
        return [
            n for (n, v), ends, s in named if np.isclose(v, ends, rtol=0.0, atol=1e-9 * s).any()
        ]

    @property
    def fits(self) -> dict[str, float]:
        """Root mean square of (computed - measured) / deviation by instrument; 1 is expected."""
        residuals = (self.computed - self.misfit.measured) / self.misfit.errors
        parts = np.split(residuals, np.cumsum(self.misfit.sizes)[:-1])
        named = zip(self.misfit.groups, parts, strict=True)
        return {name: float(np.sqrt(np.mean(part**2))) for name, part in named}

    def model(self) -> Model:
        """Return the calibrated model (collective)."""
        return self.misfit.parametric.model(self.values)

    def predict(self, tape: Tape, quantity: Quantity) -> Prediction:
        """Predict a quantity of a run of the calibrated model (collective).

        Args:
            tape: Tape(..., body=True) of a run of `model`.
            quantity: The quantity. Its deviation is that of the linearised quantity.

        Raises:
            JointsError: The run has other values of the parameters.
        """
        check_kind_of("tape", tape, isinstance(tape, Tape), "a Tape")
        if tape.model is not None and self.misfit.parametric.values_of(tape.model) != self.values:
            raise JointsError("The run has other parameters; run calibration.model().")
        gradient = gradient_of(tape, quantity, self.misfit.parametric)
        slope = np.array([gradient.by_parameter[name] for name in self.values])
        return Prediction(gradient.value, float(np.sqrt(slope @ self.covariance @ slope)))

    def rows(self) -> list[dict[str, Any]]:
        """Return the parameters with prior and posterior, as rows of a table."""
        parameters = self.misfit.parametric.parameters
        return [
            {
                "parameter": name,
                "unit": parameters[name].unit,
                "prior": parameters[name].value,
                "prior deviation": parameters[name].deviation,
                "calibrated": value,
                "deviation": self.deviations[name],
                "at bound": name in self.at_bounds,
            }
            for name, value in self.values.items()
        ]

    def report(self, out: str | Path) -> Path:
        """Write a report, an HTML file with tables and a picture of the readings (collective)."""
        from dolfinx_joints.study.calibration_report import write

        with raised_together(self.misfit.comm):
            if self.misfit.comm.rank == 0:
                write(self, Path(out))
        return Path(out)

    def _summary(self) -> Rows:
        for row in self.rows():
            bound = ", at its bound" if row["at bound"] else ""
            yield (
                row["parameter"],
                f"{row['calibrated']:.5g} +- {row['deviation']:.2g} {row['unit']}{bound} (prior "
                f"{row['prior']:.5g} +- {row['prior deviation']:.2g})",
            )
        for name, fit in self.fits.items():
            yield f"fit of {name}", f"{fit:.2f} deviations"
        yield "not determined", f"{len(self.undetermined)} of {len(self.values)} combinations"
        yield "distance from the minimum", f"{self.distance:.2f} posterior deviations"
        yield "runs", self.misfit.runs


def calibrate(misfit: Misfit) -> Calibration:
    """Minimise a misfit, and compute the posterior (collective).

    SciPy's L-BFGS-B begins at the means. Each of its evaluations is one run and one reverse sweep.
    Then one run per parameter gives the Jacobian, and Gauss-Newton steps with the gradients of
    sweeps lead to the minimum. If they are long, the Jacobian is computed again. Evaluations in the
    folder of the misfit are not repeated, so the same call continues an interrupted search.

    A warning states if the search ends before the minimum.

    Raises:
        JointsError: A run failed; the message has its parameters.
    """
    check_kind_of("misfit", misfit, isinstance(misfit, Misfit), "a Misfit")
    start = np.clip(np.zeros(len(misfit.names)), *np.transpose(misfit.bounds))
    options = {
        "ftol": DECREASE / max(1.0, 0.5 * len(misfit.measured)),
        "gtol": 0.0,
        "maxiter": ITERATIONS,
    }
    x = minimize(
        misfit, start, jac=True, bounds=misfit.bounds, method="L-BFGS-B", options=options
    ).x
    for _ in range(JACOBIANS):
        at, slopes = x, jacobian(misfit, x)
        precision: Floats = slopes.T @ slopes + np.eye(len(x))
        root = np.asarray(np.linalg.cholesky(precision).T, dtype=np.float64)
        x, distance = _gauss_newton(misfit, x, root)
        if distance < DISTANCE and np.linalg.norm(root @ (x - at)) < MOVED:
            break
    else:
        doubt(
            misfit.comm,
            f"The calibration ends about {distance:.2g} posterior deviations from the minimum of "
            "the misfit. The model is very nonlinear in the parameters, or the misfit has kinks.",
        )
    return Calibration(
        misfit=misfit,
        values=misfit.values(x),
        computed=misfit.evaluate(x, gradient=False).computed,
        jacobian=slopes,
        distance=distance,
    )


def _gauss_newton(misfit: Misfit, x: Floats, root: Floats) -> tuple[Floats, float]:
    """Return x after steps with one matrix, and its distance from the minimum (collective).

    Args:
        misfit: The misfit.
        x: Start, shape (n,).
        root: Cholesky factor R of the matrix R^T R, the inverse of the covariance (48).
    """
    lower, upper = np.transpose(misfit.bounds)
    for _ in range(STEPS):
        value, gradient = misfit(x)
        wanted = solve_triangular(root, -gradient, trans=1)
        step = lsq_linear(root, wanted, bounds=(lower - x, upper - x), method="bvls").x
        distance = float(np.linalg.norm(root @ step))
        if distance < DISTANCE:
            break
        for factor in (1.0, 0.5, 0.25, 0.125):
            trial = np.clip(x + factor * step, lower, upper)
            if misfit(trial)[0] < value:
                x = trial
                break
        else:
            break
    return x, distance


def jacobian(misfit: Misfit, x: Floats) -> Floats:
    """Return the derivatives of (computed values / deviations) by x, shape (m, n) (collective).

    They are one-sided differences, one run for each parameter, within the bounds.
    """
    at, columns = misfit.evaluate(x, gradient=False).computed, []
    for i, (lower, upper) in enumerate(misfit.bounds):
        up, down = min(DIFFERENCE, upper - x[i]), min(DIFFERENCE, x[i] - lower)
        step = up if up >= down else -down
        changed = misfit.evaluate(x + step * np.eye(len(x))[i], gradient=False).computed
        columns.append((changed - at) / (step * misfit.errors))
    return np.column_stack(columns)
