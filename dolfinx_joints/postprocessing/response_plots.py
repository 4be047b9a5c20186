# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of the response: response spectra, spectrogram, effective frequency, joint openings.

Functions draw as those of `plots` do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.parameters import (
    SMALLEST,
    check_choice,
    check_kind_of,
    check_number,
    finite,
    numbers_of,
    shown,
)
from dolfinx_joints.motions.spectra import equally_spaced, response_spectrum, spectrogram
from dolfinx_joints.postprocessing.measures import (
    acceleration_history,
    displacement_history,
    effective_period,
    joint_history,
)
from dolfinx_joints.postprocessing.plots import (
    GREY,
    chosen_axes,
    decorate,
    legend,
    point_name,
    runs,
)
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.requests import Component, check_joint, check_results, check_seconds

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.floating[Any]]


def response_spectra(
    results: Results,
    point: int | str,
    component: Component,
    *,
    damping_ratio: float = 0.05,
    periods: ArrayLike | None = None,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] = ("with joints", "linear"),
) -> Axes:
    """Pseudo-acceleration of oscillators on a monitor point, and on the ground [g].

    Args:
        results: the run.
        point: name or number of the monitor point; its absolute acceleration counts.
        component: ``"x"`` stream, ``"y"`` cross-valley or ``"z"`` up.
        damping_ratio: of the oscillators.
        periods: of the oscillators [s]; 0.03 to 3 s unless given.
        ax: where to draw.
        reference: another run to draw behind it.
        labels: what to call the run and the reference.
    """
    lines = runs(results, reference, labels)
    acceleration_history(results, point, component)
    natural = np.geomspace(0.03, 3.0, 120) if periods is None else checked_periods(periods)
    check_number("damping_ratio", damping_ratio, lambda v: 0.0 <= v < 1.0, "from 0 to below 1")
    ax = chosen_axes(ax, height=3.6)
    for run, style in lines:
        dt, values = equally_spaced(*acceleration_history(run, point, component))
        ax.semilogx(natural, _spectrum(values, dt, natural, damping_ratio), **style)
    dt, ground = equally_spaced(
        results.time("histories"), results.series("histories", "ground_acceleration")
    )
    values = _spectrum(ground[:, "xyz".index(component)], dt, natural, damping_ratio)
    ax.semilogx(natural, values, color="black", linewidth=0.9, linestyle="--", label="ground")
    decorate(ax, "period [s]", f"pseudo-acceleration {component} [g]")
    name = point_name(results, point)
    ax.set_title(
        f"{name}: response spectra in {component}, {damping_ratio:.0%} damping", loc="left"
    )
    plain_periods(ax)
    ax.margins(x=0.0)
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return ax


def displacement_spectrogram(
    results: Results,
    point: int | str,
    component: Component,
    *,
    window: float = 2.0,
    max_frequency: float = 12.0,
    label: str = "",
    ax: Axes | None = None,
) -> Axes:
    """Amplitude of a monitor point's displacement against time and frequency [1e-3 m].

    A white line follows the frequency of the largest amplitude where the amplitude exceeds a
    twentieth of the largest of all.

    Args:
        results: the run.
        point: name or number of the monitor point.
        component: ``"x"`` stream, ``"y"`` cross-valley or ``"z"`` up.
        window: length of the moving window [s].
        max_frequency: end of the frequency axis [Hz].
        label: what to call the run in the title.
        ax: where to draw.
    """
    check_seconds("window", window)
    check_number("max_frequency", max_frequency, lambda v: v > 0.0, "positive", unit="Hz")
    check_kind_of("label", label, isinstance(label, str), "a text")
    time, u = displacement_history(results, point, component)
    dt, values = equally_spaced(time, u)
    drawn = spectrogram(values, dt, window, hop=window / 40.0)
    inside = drawn.frequencies <= max_frequency
    amplitude = 1e3 * drawn.amplitude[:, inside].T
    ax = chosen_axes(ax, height=3.6)
    picture = ax.pcolormesh(
        drawn.times + time[0],
        drawn.frequencies[inside],
        amplitude,
        cmap="viridis",
        shading="nearest",
        rasterized=True,
    )
    followed = effective_period(results, point, component, window, hop=window / 40.0)
    frequency = np.where(
        amplitude.max(axis=0) > 0.05 * amplitude.max(), 1 / followed.periods, np.nan
    )
    line = "frequency of the largest amplitude"
    ax.plot(followed.times, frequency, color="white", linewidth=1.0, label=line)
    decorate(ax, "time, middle of the window [s]", "frequency [Hz]", grid=False)
    ax.set_ylim(0.0, max_frequency)
    name = f"{point_name(results, point)}{', ' if label else ''}{label}"
    ax.set_title(f"{name}: displacement {component}, window {window:g} s", loc="left")
    bar = ax.figure.colorbar(picture, ax=ax)
    bar.set_label(r"amplitude [$10^{-3}$ m]")
    ax.legend(fontsize="small", facecolor=GREY, edgecolor="none", labelcolor="white")
    return ax


def effective_frequency(
    results: Results,
    point: int | str,
    component: Component,
    *,
    quantity: Literal["frequency", "damping"] = "frequency",
    window: float = 2.0,
    band: tuple[float, float] | None = None,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] = ("with joints", "linear"),
) -> Axes:
    """Effective frequency [Hz], or apparent damping ratio [%], of a monitor point against time.

    Args:
        results: the run.
        point: name or number of the monitor point.
        component: ``"x"`` stream, ``"y"`` cross-valley or ``"z"`` up.
        quantity: ``"frequency"`` or ``"damping"``; damping is negative where the motion grows.
        window: length of the moving window [s].
        band: lowest and highest frequency looked at [Hz].
        ax: where to draw.
        reference: another run to draw behind it.
        labels: what to call the run and the reference.
    """
    check_choice("quantity", quantity, ("frequency", "damping"))
    check_seconds("window", window)
    lines = runs(results, reference, labels)
    displacement_history(results, point, component)
    ax = chosen_axes(ax)
    for run, style in lines:
        found = effective_period(run, point, component, window, band=band, hop=window / 40.0)
        damping = 100.0 * found.damping_ratios
        ax.plot(found.times, 1.0 / found.periods if quantity == "frequency" else damping, **style)
    what, unit = ("effective frequency", "Hz")
    if quantity == "damping":
        what, unit = ("apparent damping", "%")
        ax.axhline(0.0, color=GREY, linewidth=0.8)
    decorate(ax, f"time, middle of a window of {window:g} s [s]", f"{what} [{unit}]")
    ax.set_title(f"{point_name(results, point)}: {what}, {component}", loc="left")
    ax.margins(x=0.0)
    if reference is not None:
        legend(ax, "above")
    return ax


def joint_motion(
    results: Results,
    quantity: Literal["opening", "slip"] = "opening",
    *,
    joints: list[str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Largest opening or slip of the points of each joint against time [1e-3 m].

    Args:
        results: the run.
        quantity: ``"opening"``, or ``"slip"`` from the static state.
        joints: names of the joints to draw; all unless given.
        ax: where to draw.
    """
    from matplotlib import colormaps

    check_choice("quantity", quantity, ("opening", "slip"))
    check_results(results)
    names = results.joints if joints is None else joints
    check_kind_of("joints", names, isinstance(names, list | tuple), "a list of names of joints")
    for joint in names:
        check_joint(results, joint)
    if not names:
        raise ValueError(f"{results.path} holds no joints to draw.")
    ax = chosen_axes(ax, height=3.8)
    shades = colormaps["turbo"](np.linspace(0.05, 0.95, len(names)))
    for name, colour in zip(names, shades, strict=True):
        time, opening, slip = joint_history(results, name)
        largest = 1e3 * (opening if quantity == "opening" else slip).max(axis=1)
        label = f"{name.removeprefix('joint_')}: {largest.max():.3g}"
        ax.plot(time, largest, color=colour, linewidth=0.9, label=label)
    decorate(ax, "time [s]", rf"largest {quantity} [$10^{{-3}}$ m]")
    ax.set_title(f"{quantity} of the joints", loc="left")
    ax.margins(x=0.0)
    ax.set_ylim(bottom=0.0)
    ax.legend(
        title=r"joint: most [$10^{-3}$ m]",
        fontsize="small",
        title_fontsize="small",
        frameon=False,
        loc="upper left",
        bbox_to_anchor=(1.0, 1.0),
    )
    return ax


def _spectrum(acceleration: Floats, dt: float, periods: Floats, damping_ratio: float) -> Floats:
    """Pseudo-accelerations [g] of one component."""
    spectrum = response_spectrum(acceleration, dt, periods, damping_ratio)
    found: Floats = spectrum.pseudo_acceleration / STANDARD_GRAVITY
    return found


def checked_periods(periods: Any) -> Floats:
    """Periods of oscillators, shape (n >= 1,), [s].

    Raises:
        ValueError: they are no positive numbers.
    """
    found = numbers_of(periods)
    good = found is not None and found.ndim == 1 and found.size and finite(found)
    if found is None or not good or not (found >= SMALLEST).all():
        got = shown(periods)
        raise ValueError(f"periods is {got}; it must be a list of positive numbers of seconds.")
    return found


def plain_periods(ax: Axes) -> None:
    """Write periods as decimal numbers."""
    from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

    ax.xaxis.set_major_locator(FixedLocator([0.03, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0]))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
