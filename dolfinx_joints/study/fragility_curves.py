# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fragility: how probable it is that a limit is exceeded at an intensity of the ground motion."""

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
    """A lognormal fragility curve, P(IM) = Phi(ln(IM / median) / dispersion).

    Attributes:
        median: Intensity at which the limit is exceeded in half of the runs, in its unit.
        dispersion: Standard deviation of its logarithm.
        intensity: Intensities of the runs, shape (runs,).
        exceeded: Which of them exceeded the limit, shape (runs,).
    """

    median: float
    dispersion: float
    intensity: Floats
    exceeded: Floats

    def __call__(self, intensity: ArrayLike) -> Floats:
        """Probability at intensities, of their shape."""
        from scipy.stats import norm

        logarithm = np.log(np.asarray(intensity, dtype=np.float64) / self.median)
        return np.asarray(norm.cdf(logarithm / self.dispersion))

    def draw(self, label: str, *, ax: Axes | None = None) -> Axes:
        """Draw the curve and the runs, at 0 or 1; ``label`` is the intensity with its unit."""
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
        intensity: Of each run, positive, such as a column of `MotionSuite.table`.
        exceeded: Whether its response exceeded the limit, or in what share of runs at this
            intensity, from 0 to 1; of the same shape.

    Raises:
        ValueError: Shapes or values are others, or the runs do not tell how steep the curve is:
            none exceeds the limit, all do, or all below an intensity do not and all above do; or
            they do not exceed it more often at higher intensities.
    """
    whether = np.asarray(exceeded)
    x = numbers_of(intensity)
    share = numbers_of(whether.astype(float) if whether.dtype == bool else exceeded)
    if (
        (x is None or share is None or x.ndim != 1 or x.shape != share.shape)
        or not np.all(x > 0.0)
        or not np.all((share >= 0.0) & (share <= 1.0))
    ):
        raise ValueError(
            f"fragility takes positive intensities and as many shares from 0 to 1; got "
            f"{shown(intensity)} and {shown(exceeded)}."
        )
    yes, no = x[share > 0.0], x[share < 1.0]
    if not len(yes):
        where = "no run"
    elif not len(no):
        where = "every run"
    elif yes.min() >= no.max():
        where = f"every run above {no.max():.4g} and in none below"
    elif (share - share.mean()) @ np.log(x) > 1e-9:  # if not, no finite dispersion is likeliest
        return _fitted(x, share)
    else:
        raise ValueError(
            "The limit is not exceeded more often at higher intensities: add motions or scalings, "
            "or take another intensity."
        )
    raise ValueError(
        f"The limit is exceeded in {where}: a curve needs runs of both kinds that overlap; add "
        "motions or scalings."
    )


def _fitted(x: Floats, share: Floats) -> Fragility:
    """The parameters that make the runs most likely."""
    from scipy.optimize import minimize
    from scipy.stats import norm

    logarithm = np.log(x)
    middle, width = float(logarithm.mean()), float(logarithm.std())

    def unlikely(parameters: Any) -> float:  # convex in these two, as it is not in the other two
        z = parameters[0] + parameters[1] * (logarithm - middle) / width
        return -float(share @ norm.logcdf(z) + (1.0 - share) @ norm.logsf(z))

    limits = {"xatol": 1e-10, "fatol": 1e-13}
    level, slope = minimize(unlikely, [0.0, 1.0], method="Nelder-Mead", options=limits).x
    dispersion = float(width / slope)
    median = float(np.exp(middle - level * dispersion))
    return Fragility(median=median, dispersion=dispersion, intensity=x, exceeded=share)
