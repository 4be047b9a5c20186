# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fragility: probability that a limit is exceeded at a given ground-motion intensity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtr, ndtri

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.common.summary import Rows, Summarised

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NORMAL = float(ndtri(0.975))  # half the width of a 95 % interval, in standard deviations


@dataclass(frozen=True, kw_only=True, repr=False)
class Fragility(Summarised):
    """Lognormal fragility curve, P(IM) = Phi(ln(IM / median) / dispersion).

    Confidence intervals have a level of 95 %. They follow from the Fisher information of a probit
    regression (McCullagh and Nelder 1989, chapter 4). The runs are assumed to be independent: the
    intervals are too narrow if a few records are run at many scales.

    Attributes:
        median: Intensity with a probability of exceedance of 0.5, in the unit of the intensities.
        dispersion: Standard deviation of the logarithm of the intensity.
        intensity: Intensities of the runs, shape (runs,).
        exceeded: 1 for a run that exceeded the limit, otherwise 0, shape (runs,).
        limit: Limit of the response; None if only exceedances are known.
        response_name: Name and unit of the response and of its limit.
        intensity_name: Name and unit of the intensity.
        failed: Number of runs that did not end.
        left_out: Number of runs without a response.
    """

    median: float
    dispersion: float
    intensity: Floats
    exceeded: Floats
    limit: float | None = None
    response_name: str = "response [-]"
    intensity_name: str = "intensity [-]"
    failed: int = 0
    left_out: int = 0

    def __call__(self, intensity: ArrayLike) -> Floats:
        """Return the probabilities of exceedance at intensities, of the same shape."""
        return np.asarray(ndtr(self._score(intensity)))

    def _score(self, intensity: ArrayLike) -> Floats:
        """Return z = ln(IM / median) / dispersion."""
        return np.log(np.asarray(intensity, dtype=np.float64) / self.median) / self.dispersion

    def _covariance(self) -> Floats:
        """Return the covariance of a and b in P = Phi(a + b z), at a = 0 and b = 1, (2, 2)."""
        z = self._score(self.intensity)
        weights = np.exp(-(z**2) - log_ndtr(z) - log_ndtr(-z)) / (2.0 * np.pi)
        basis = np.stack([np.ones_like(z), z])
        return np.linalg.inv((weights * basis) @ basis.T)

    def band(self, intensity: ArrayLike) -> tuple[Floats, Floats]:
        """Return the lower and upper limit of the probabilities, with 95 % confidence at each."""
        z, c = self._score(intensity), self._covariance()
        error = np.sqrt(c[0, 0] + 2.0 * c[0, 1] * z + c[1, 1] * z**2)
        return ndtr(z - _NORMAL * error), ndtr(z + _NORMAL * error)

    def row(self) -> dict[str, Any]:
        """Return the limit, the numbers of runs, the fit and its intervals, as a row of a table."""
        z, share = self._score(self.intensity), self.exceeded
        constant = ndtri(share.mean()) * np.ones_like(z)
        # The band contains 0.5 where z^2 <= (_NORMAL error)^2; everywhere if b may be zero.
        a, b, _, slope = np.ravel(_NORMAL**2 * self._covariance())
        ends = np.array([-np.inf, np.inf])
        if slope < 1.0:
            ends = (b + np.array([-1.0, 1.0]) * np.sqrt(b**2 + (1.0 - slope) * a)) / (1.0 - slope)
        low, high = map(float, self.median * np.exp(self.dispersion * ends))
        factor = float(np.exp(np.sqrt(slope)))
        return {
            "response": self.response_name,
            "limit": self.limit,
            "runs": len(z),
            "exceeded": float(share.sum()),
            "failed": self.failed,
            "left_out": self.left_out,
            "fit": "lognormal by maximum likelihood",
            "pseudo_r2": 1.0 - _misfit(z, share) / _misfit(constant, share),  # McFadden (1974)
            "intensity": self.intensity_name,
            "median": self.median,
            "median_low": low,
            "median_high": high,
            "dispersion": self.dispersion,
            "dispersion_low": self.dispersion / factor,
            "dispersion_high": self.dispersion * factor,
        }

    def _summary(self) -> Rows:
        for name, value in self.row().items():
            yield name, f"{value:.4g}" if isinstance(value, float) else value

    def draw(self, label: str | None = None, *, ax: Axes | None = None) -> Axes:
        """Draw the curve, its band and the runs; ``label`` replaces the name of the intensity."""
        from dolfinx_joints.postprocessing.axes import decorate, legend, new_axes
        from dolfinx_joints.postprocessing.palette import BLUE

        ax = ax or new_axes()
        shown_at = np.linspace(0.0, 1.1 * self.intensity.max(), 200)[1:]
        text = f"median {self.median:.3g}, dispersion {self.dispersion:.2f}"
        ax.plot(shown_at, self(shown_at), color=BLUE, label=text)
        low, high = self.band(shown_at)
        ax.fill_between(shown_at, low, high, color=BLUE, alpha=0.15, lw=0, label="95 % confidence")
        text = f"{len(self.intensity)} runs, {self.exceeded.sum():g} exceeded"
        ax.plot(self.intensity, self.exceeded, "|", color="0.3", markersize=9.0, label=text)
        name, _, unit = self.response_name.partition(" [")
        limit = "" if self.limit is None else f"{name} > {self.limit:g} {unit[:-1]}"
        probability = f"P({limit.rstrip(' -')}) [-]" if limit else "probability of exceedance [-]"
        decorate(ax, label or self.intensity_name, probability)
        ax.set_xlim(left=0.0)
        legend(ax, "above")
        return ax


@checked
def fragility(
    intensity: ArrayLike,
    response: ArrayLike,
    *,
    limit: float | None = None,
    response_name: str = "response [-]",
    intensity_name: str = "intensity [-]",
    failed: Annotated[int, at.Ge(0)] = 0,
) -> Fragility:
    """Fit a fragility curve by maximum likelihood (Baker 2015, Earthquake Spectra 31, eq. 11).

    Args:
        intensity: Intensity of each run, positive, such as a column of `MotionSuite.table`.
        response: Response of each run, of the same shape. Without ``limit``, True (or 1) for each
            run that exceeded the limit and False (or 0) for others. Runs with NaN are left out.
        limit: Limit that the response exceeds, in the unit of the response.
        response_name: Name of the response with its unit, such as ``opening [m]``.
        intensity_name: Name of the intensity with its unit.
        failed: Number of runs that did not end; they are reported, not fitted.

    Raises:
        ValueError: A shape or value is not allowed, or the runs do not determine the curve: no run,
            every run, or exactly the runs above some intensity exceed the limit, or exceedances do
            not increase with intensity.
    """
    flags = np.asarray(response)
    positive = numbers_of(intensity)
    value = numbers_of(flags.astype(float) if flags.dtype == bool and limit is None else response)
    if value is not None and limit is not None:
        value = np.where(np.isnan(value), np.nan, value > limit)
    if (
        (positive is None or value is None or positive.ndim != 1 or positive.shape != value.shape)
        or not np.all((positive > 0.0) & np.isfinite(positive))
        or not np.all(np.isin(value, (0.0, 1.0)) | np.isnan(value))
    ):
        rule = " Without limit, each response must be True or False. Pass limit= for responses."
        raise ValueError(
            "fragility needs finite, positive intensities and as many responses; got "
            f"{shown(intensity)} and {shown(response)}.{rule if limit is None else ''}"
        )
    has_value = ~np.isnan(value)
    x: Floats = positive[has_value]
    share: Floats = value[has_value]
    yes, no = x[share > 0.0], x[share < 1.0]
    if not len(yes):
        exceeding = "no run"
    elif not len(no):
        exceeding = "every run"
    elif yes.min() >= no.max():
        exceeding = f"every run above {no.max():.4g} and in no run below"
    elif (share - share.mean()) @ np.log(x) > 1e-9:  # else the most likely dispersion is infinite
        names = {"response_name": response_name, "intensity_name": intensity_name}
        counts = {"failed": failed, "left_out": int(np.sum(~has_value))}
        return _fitted(x, share, limit=limit, **names, **counts)
    else:
        raise ValueError(
            "The limit is not exceeded more often at higher intensities: add motions or scalings, "
            "or use another intensity measure."
        )
    raise ValueError(
        f"The limit is exceeded in {exceeding} ({len(x)} runs). A curve needs runs with and "
        "without exceedance in an overlapping range of intensities; add motions or scalings."
    )


def _misfit(z: Floats, share: Floats) -> float:
    """Return -ln L of the probabilities Phi(z)."""
    return -float(share @ log_ndtr(z) + (1.0 - share) @ log_ndtr(-z))


def _fitted(x: Floats, share: Floats, **given: Any) -> Fragility:
    """Return the curve with maximum likelihood."""
    from scipy.optimize import minimize

    logarithm = np.log(x)
    middle, width = float(logarithm.mean()), float(logarithm.std())

    def misfit(parameters: Any) -> float:  # convex in level and slope
        return _misfit(parameters[0] + parameters[1] * (logarithm - middle) / width, share)

    limits = {"xatol": 1e-10, "fatol": 1e-13}
    level, slope = minimize(misfit, [0.0, 1.0], method="Nelder-Mead", options=limits).x
    dispersion = float(width / slope)
    median = float(np.exp(middle - level * dispersion))
    return Fragility(median=median, dispersion=dispersion, intensity=x, exceeded=share, **given)
