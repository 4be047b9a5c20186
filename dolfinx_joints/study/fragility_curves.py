# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fragility: probability that a limit is exceeded at a given ground-motion intensity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import numbers_of, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fragility:
    """Lognormal fragility curve, P(IM) = Phi(ln(IM / median) / dispersion).

    Attributes:
        median: Intensity with a probability of exceedance of 0.5, in the unit of the intensities.
        dispersion: Standard deviation of the logarithm of the intensity.
        intensity: Intensities of the runs, shape (runs,).
        exceeded: Fraction of exceedance of each run, 0 to 1, shape (runs,).
    """

    median: float
    dispersion: float
    intensity: Floats
    exceeded: Floats

    def __call__(self, intensity: ArrayLike) -> Floats:
        """Return the probabilities of exceedance at intensities, of the same shape."""
        from scipy.stats import norm

        logarithm = np.log(np.asarray(intensity, dtype=np.float64) / self.median)
        return np.asarray(norm.cdf(logarithm / self.dispersion))

    def draw(self, label: str, *, ax: Axes | None = None) -> Axes:
        """Draw the curve and the fraction of each run; ``label`` is the intensity with its unit."""
        from dolfinx_joints.postprocessing.axes import decorate, legend, new_axes
        from dolfinx_joints.postprocessing.palette import BLUE

        ax = ax or new_axes()
        shown_at = np.linspace(0.0, 1.1 * self.intensity.max(), 200)[1:]
        text = f"median {self.median:.3g}, dispersion {self.dispersion:.2f}"
        ax.plot(shown_at, self(shown_at), color=BLUE, label=text)
        ax.plot(self.intensity, self.exceeded, "|", color="0.3", markersize=9.0, label="runs")
        decorate(ax, label, "probability of exceedance [-]")
        ax.set_xlim(left=0.0)
        legend(ax, "above")
        return ax


@checked
def fragility(intensity: ArrayLike, exceeded: ArrayLike) -> Fragility:
    """Fit a fragility curve by maximum likelihood (Baker 2015, Earthquake Spectra 31, eq. 11).

    Args:
        intensity: Intensity of each run, positive, such as a column of `MotionSuite.table`.
        exceeded: Whether each run exceeded the limit, or the fraction of the runs at this intensity
            that exceeded the limit, from 0 to 1; of the same shape.

    Raises:
        ValueError: A shape or value is not allowed, or the runs do not determine the curve: no run,
            every run, or exactly the runs above some intensity exceed the limit, or exceedances do
            not increase with intensity.
    """
    flags = np.asarray(exceeded)
    x = numbers_of(intensity)
    share = numbers_of(flags.astype(float) if flags.dtype == bool else exceeded)
    if (
        (x is None or share is None or x.ndim != 1 or x.shape != share.shape)
        or not np.all(x > 0.0)
        or not np.all((share >= 0.0) & (share <= 1.0))
    ):
        raise ValueError(
            f"fragility needs positive intensities and as many fractions from 0 to 1; got "
            f"{shown(intensity)} and {shown(exceeded)}."
        )
    yes, no = x[share > 0.0], x[share < 1.0]
    if not len(yes):
        exceeding = "no run"
    elif not len(no):
        exceeding = "every run"
    elif yes.min() >= no.max():
        exceeding = f"every run above {no.max():.4g} and in no run below"
    elif (share - share.mean()) @ np.log(x) > 1e-9:  # else the most likely dispersion is infinite
        return _fitted(x, share)
    else:
        raise ValueError(
            "The limit is not exceeded more often at higher intensities: add motions or scalings, "
            "or use another intensity measure."
        )
    raise ValueError(
        f"The limit is exceeded in {exceeding}. A curve needs runs with and without exceedance in "
        "an overlapping range of intensities; add motions or scalings."
    )


def _fitted(x: Floats, share: Floats) -> Fragility:
    """Return the curve with maximum likelihood."""
    from scipy.optimize import minimize
    from scipy.stats import norm

    logarithm = np.log(x)
    middle, width = float(logarithm.mean()), float(logarithm.std())

    def misfit(parameters: Any) -> float:  # -log likelihood; convex in level and slope
        z = parameters[0] + parameters[1] * (logarithm - middle) / width
        return -float(share @ norm.logcdf(z) + (1.0 - share) @ norm.logsf(z))

    limits = {"xatol": 1e-10, "fatol": 1e-13}
    level, slope = minimize(misfit, [0.0, 1.0], method="Nelder-Mead", options=limits).x
    dispersion = float(width / slope)
    median = float(np.exp(middle - level * dispersion))
    return Fragility(median=median, dispersion=dispersion, intensity=x, exceeded=share)
