# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of ground motions and responses: histories, spectra, frequency responses.

Functions draw on the axes ``ax`` or on new axes, and return them. ``reference`` is a second motion
that is drawn behind the first. Components are x (stream), y (cross-valley) and z (up).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.spectra import response_spectrum
from dolfinx_joints.motions.spectrum_matching import SpectrumMatch, component_numbers
from dolfinx_joints.postprocessing.axes import (
    DampingRatio,
    Periods,
    decorate,
    entitle,
    legend,
    new_axes,
    plain_periods,
)
from dolfinx_joints.postprocessing.palette import BLUE, GREEN, GREY, RED, RUNS
from dolfinx_joints.results.arguments import COMPONENTS, Component

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Quantity = Literal["acceleration", "velocity", "displacement"]
_UNITS = {"acceleration": "g", "velocity": "m/s", "displacement": "m"}
_COLOURS = {"x": BLUE, "y": RED, "z": GREEN}
_AXES = {"x": "stream", "y": "cross-valley", "z": "up"}


@checked
def history(
    motion: Motion,
    component: Component,
    quantity: Quantity = "acceleration",
    *,
    ax: Axes | None = None,
    reference: Motion | None = None,
    labels: tuple[str, str] = ("processed", "as recorded"),
) -> Axes:
    """Draw acceleration [g], velocity [m/s] or displacement [m] of the ground against time.

    Velocity and displacement are integrated from rest and show the drift of a record.
    """
    ax = ax or new_axes()
    for curve, label, colour in ((reference, labels[1], GREY), (motion, labels[0], BLUE)):
        if curve is None:
            continue
        velocity, displacement = curve.integrated()
        values = {
            "acceleration": curve.acceleration / STANDARD_GRAVITY,
            "velocity": velocity,
            "displacement": displacement,
        }[quantity][:, COMPONENTS.index(component)]
        ax.plot(curve.time, values, color=colour, linewidth=0.8, label=label)
    decorate(ax, "time [s]", f"{quantity} {component} [{_UNITS[quantity]}]")
    entitle(ax, f"{motion.name}: {quantity} {component}")
    ax.margins(x=0.0)
    if reference is not None:
        legend(ax)
    return ax


@checked
def response_spectra(
    motion: Motion,
    *,
    components: str = "xyz",
    damping_ratio: DampingRatio = 0.05,
    periods: Periods | None = None,
    target: tuple[Sequence[float] | Floats, Sequence[float] | Floats] | None = None,
    ax: Axes | None = None,
    reference: Motion | None = None,
    reference_label: str = "as recorded",
) -> Axes:
    """Draw the pseudo-acceleration response spectra [g] of a ground motion.

    Default periods are 0.03 to 3 s; ``target`` is periods [s] and pseudo-accelerations [m/s^2].
    """
    columns = component_numbers(components)
    natural = np.geomspace(0.03, 3.0, 120) if periods is None else np.asarray(periods)
    ax = ax or new_axes(height=3.6)
    for curve, line in ((reference, "--"), (motion, "-")):
        if curve is None:
            continue
        spectra = response_spectrum(curve.acceleration, curve.dt, natural, damping_ratio)
        for component, column in zip(components, columns, strict=True):
            name = f"{component}, {_AXES[component]}"
            label = f"{component}, {reference_label}" if curve is reference else name
            values = spectra.pseudo_acceleration[:, column] / STANDARD_GRAVITY
            style = {"color": _COLOURS[component], "linestyle": line, "label": label}
            ax.semilogx(natural, values, linewidth=0.9 if curve is reference else 1.2, **style)
    if target is not None:
        ax.plot(target[0], np.asarray(target[1]) / STANDARD_GRAVITY, color="black", label="target")
    decorate(ax, "period [s]", "pseudo-acceleration [g]")
    entitle(ax, f"{motion.name}: response spectra, {100 * damping_ratio:g}% damping")
    plain_periods(ax)
    ax.set_xlim(natural.min(), natural.max())
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return ax


def spectrum_match(match: SpectrumMatch, *, ax: Axes | None = None) -> Axes:
    """Draw response spectra before and after matching, and the target with its tolerance."""
    ax = response_spectra(
        match.with_rest(match.motion),
        components=match.components,
        damping_ratio=match.damping_ratio,
        periods=[float(period) for period in match.periods],
        target=(match.periods, match.target),
        reference=match.with_rest(match.record),
        reference_label="as given",
        ax=ax,
    )
    low, high = ((1.0 + s * match.tolerance) * match.target / STANDARD_GRAVITY for s in (-1, 1))
    label = f"target ± {100 * match.tolerance:g}%"
    ax.fill_between(match.periods, low, high, color="black", alpha=0.15, linewidth=0, label=label)
    legend(ax)
    return ax


@checked
def frequency_response(
    frequencies: Sequence[float] | Floats,
    accelerations: Mapping[str, NDArray[Any]],
    *,
    first: Annotated[float, at.Gt(0), at.Unit("Hz")] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the ratio of accelerations to the ground acceleration against frequency.

    Args:
        frequencies: Frequencies [Hz], shape (n,).
        accelerations: Ratios to the ground acceleration by label, real or complex, shape (n,).
        first: Frequency that scales the axis, such as the first mode of the empty dam [Hz].
        ax: Axes to draw on.
    """
    ax = ax or new_axes()
    abscissa = np.asarray(frequencies) / (first or 1.0)
    for i, (label, values) in enumerate(accelerations.items(), start=1):
        ax.plot(abscissa, np.abs(values), color=RUNS[i % len(RUNS)], linewidth=1.2, label=label)
    decorate(ax, "f / f₁" if first else "frequency [Hz]", "acceleration / ground acceleration")
    ax.set_xlim(abscissa.min(), abscissa.max())
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return ax
