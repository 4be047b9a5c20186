# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures from a results file: histories, Fourier amplitudes, joint tractions, energies.

Every function draws on the axes ``ax`` or on new axes, and returns the axes. Matplotlib's global
state is not used.

- ``point``: name or number of a monitor point;
- ``component``: x (stream), y (cross-valley) or z (up);
- ``reference``: another run that is drawn behind the first;
- ``labels``: names of both runs; by default "with joints" and "linear" if only one run has joints,
  otherwise the file names;
- ``time`` [s]: the nearest recorded state is drawn; by default the state number ``index``;
- ``relative_to``: monitor point or ``"ground"`` (`frames`) whose displacement is subtracted.

Tractions keep the sign of the files: compression is negative.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import ACCELERATION_BAND, STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError, ResultsError
from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.motions.motion import Hertz
from dolfinx_joints.motions.processing import low_pass
from dolfinx_joints.motions.spectra import (
    equally_spaced,
    fourier_amplitude,
    highest_peak,
    response_spectrum,
)
from dolfinx_joints.postprocessing.axes import (
    DampingRatio,
    Periods,
    decorate,
    entitle,
    legend,
    new_axes,
    new_figure,
    pixels,
    plain_periods,
    runs,
)
from dolfinx_joints.postprocessing.energy_lines import WAVES, energy_lines, waves_at_end
from dolfinx_joints.postprocessing.frames import (
    common_frame,
    frame_name,
    ground_motion,
    ground_name,
    has_ground_motion,
    zero_name,
)
from dolfinx_joints.postprocessing.joints.extremes import drawn_series
from dolfinx_joints.postprocessing.joints.figures import TIED_STYLE, draw_map
from dolfinx_joints.postprocessing.joints.figures import joint_maps as joint_maps
from dolfinx_joints.postprocessing.joints.figures import joint_panels as joint_panels
from dolfinx_joints.postprocessing.joints.figures import joint_profiles as joint_profiles
from dolfinx_joints.postprocessing.joints.surface import (
    MAP_LABELS,
    JointSurface,
    Quantity,
    map_limits,
    map_value,
)
from dolfinx_joints.postprocessing.measures import (
    acceleration_history,
    band_name,
    common_band,
    displacement_history,
    joint_extremes,
    joint_shares,
    resolved_frequencies,
)
from dolfinx_joints.postprocessing.palette import BLUE, OPEN
from dolfinx_joints.results.arguments import COMPONENTS, Component, check_results, chosen_state
from dolfinx_joints.results.joint_points import free_areas, since
from dolfinx_joints.results.quantities import row_of
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


@checked
def save(
    figure: Figure | SubFigure,
    path: str | PathLike[str],
    *,
    dpi: Annotated[float, at.Interval(ge=10, le=2400)] = 200,
) -> Path:
    """Write a figure to a file; the suffix of the file determines the format.

    Raises:
        JointsError: The file cannot be written.
    """
    from PIL import Image

    check_kind_of("figure", figure, hasattr(figure, "figure"), "a figure, as panels[0].figure")
    place = Path(path)
    try:
        with replacing(place) as part:
            # savefig draws twice; a figure in a window keeps its canvas
            if place.suffix == ".png" and figure.figure.canvas.manager is None:
                image = Image.fromarray(pixels(figure.figure, dpi))
                opaque = image.getchannel("A").getextrema() == (255, 255)
                image = image.convert("RGB" if opaque else "RGBA")
                image.save(part, "png", compress_level=3, dpi=(dpi, dpi))
            else:
                figure.figure.savefig(part, dpi=dpi, format=place.suffix[1:])
    except OSError as error:
        raise JointsError(f"The figure {place} cannot be written: {error.strerror}.") from None
    return place


@checked
def history(
    results: Results,
    point: int | str,
    component: Component,
    *,
    relative_to: str | None = None,
    from_static: bool = True,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] | None = None,
) -> Axes:
    """Draw the displacement of a monitor point from the static state against time [mm].

    In files without static stages it is the displacement from the first record. With
    ``from_static=False`` it is the displacement from the unloaded body.
    """
    ax, drawn, zeros = ax or new_axes(), list(runs(results, reference, labels)), {}
    for run, style in drawn:
        zeros[style["label"]] = zero_name(run, relative_to, from_static=from_static)
        record = displacement_history(run, point, component, relative_to, from_static=from_static)
        ax.plot(record[0], 1e3 * record[1], **style)
    decorate(ax, "time [s]", f"displacement {component}\n{common_frame(zeros)} [mm]")
    title = f"{point_name(results, point)}: displacement {component}"
    has_reference = reference is not None
    entitle(ax, f"{title}, {_frames(drawn, relative_to)}", over_legend=has_reference)
    ax.margins(x=0.0)
    if has_reference:
        legend(ax, "above")
    return ax


@checked
def fourier(
    results: Results,
    point: int | str,
    component: Component,
    *,
    relative_to: str | None = None,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] | None = None,
    max_frequency: Hertz = 15.0,
) -> Axes:
    """Draw the Fourier amplitude of a monitor point's displacement against frequency [mm s].

    The displacement of the static state is subtracted. Records at unequal steps are interpolated to
    the shortest step. The legend gives the frequency of the highest peak.
    """
    ax = ax or new_axes()
    drawn = runs(results, reference, labels)
    for run, style in drawn:
        dt, values = equally_spaced(*displacement_history(run, point, component, relative_to))
        frequency, amplitude = fourier_amplitude(values, dt)
        shown = frequency <= max_frequency
        frequency, amplitude = frequency[shown], amplitude[shown]
        peak, _ = highest_peak(frequency, amplitude)
        if np.isfinite(peak):
            style["label"] = f"{style['label']}, peak at {peak:.2f} Hz"
        ax.plot(frequency, 1e3 * amplitude, **style)
    decorate(ax, "frequency [Hz]", f"amplitude of {component} [mm s]")
    title = f"{point_name(results, point)}: Fourier amplitude of displacement {component}"
    entitle(ax, f"{title}, {_frames(drawn, relative_to)}")
    ax.set_xlim(0.0, max_frequency)
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return ax


@checked
def response_spectra(
    results: Results,
    point: int | str,
    component: Component,
    *,
    damping_ratio: DampingRatio = 0.05,
    periods: Periods | None = None,
    band: Hertz | None = ACCELERATION_BAND,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] | None = None,
) -> Axes:
    """Draw pseudo-acceleration response spectra of a monitor point and of the ground [g].

    The point's spectrum is computed from its absolute acceleration. The ground of a free field is
    the free surface without the body. Default periods are 0.03 to 3 s. All motions are low-passed
    in the same ``band`` [Hz], at most `measures.common_band`, or raw for None. Periods that the
    runs do not resolve (`measures.resolved_frequencies`) are shaded.
    """
    natural = np.geomspace(0.03, 3.0, 120) if periods is None else np.asarray(periods)
    ax = ax or new_axes(height=3.6)

    drawn = list(runs(results, reference, labels))
    if band is not None:
        band = common_band(*(run for run, _ in drawn), band=band)

    def draw(dt: float, values: Floats, style: dict[str, Any]) -> None:
        spectrum = response_spectrum(values, dt, natural, damping_ratio).pseudo_acceleration
        ax.semilogx(natural, spectrum / STANDARD_GRAVITY, **style)

    for run, style in drawn:
        record = acceleration_history(run, point, component, band=band)
        draw(*equally_spaced(*record), style)
    if has_ground_motion(results):
        time, ground = ground_motion(results)
        dt, ground = equally_spaced(time, ground[:, COMPONENTS.index(component)])
        dashes = {"color": "black", "linewidth": 0.9, "linestyle": "--"}
        dashes["label"] = ground_name(results)
        draw(dt, ground if band is None else low_pass(ground, dt, band), dashes)
    resolved, limit = resolved_frequencies(*(run for run, _ in drawn)).lowest
    if resolved * natural.min() < 1.0:
        ends = natural.min(), min(1.0 / resolved, natural.max())
        name = f"above {resolved:.3g} Hz, not resolved by the {limit}"
        ax.axvspan(*ends, color="0.93", zorder=0, label=name)
    decorate(ax, "period [s]", f"pseudo-acceleration {component} [g]")
    name = point_name(results, point)
    settings = f"{100 * damping_ratio:g}% damping, {band_name(band)}"
    entitle(ax, f"{name}: response spectra in {component}, {settings}")
    plain_periods(ax)
    ax.margins(x=0.0)
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return ax


@checked
def joint_traction(
    results: Results,
    joint: str,
    quantity: Quantity = "normal",
    *,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw a map of the traction on a joint, one patch per joint point.

    Open points are grey, tied points hatched. Axes are the horizontal distance (growing
    downstream) and the elevation in the joint's mean plane; a curved joint is unrolled. The
    mobilised friction is 1 at sliding points. `joint_maps` draws all joints.
    """
    results, number, moment = chosen_state(results, time, index, stage)
    surface = JointSurface(results, joint)
    ax = ax or new_axes(width=4.6, height=5.6)
    values = map_value(results, joint, quantity, number)
    patches = draw_map(ax, surface, values, quantity, map_limits(quantity, values))
    ax.set_aspect("equal", adjustable="datalim")  # keeps room for labels at narrow joints
    ax.set_title(f"{joint} {moment}", fontsize="medium")
    colour_bar = ax.figure.colorbar(patches, ax=ax, shrink=0.85)
    colour_bar.set_label(MAP_LABELS[quantity].replace(", ", "\n"))
    areas = free_areas(results, joint)
    share = float(areas[np.isnan(values)].sum() / areas.sum())
    _open_legend(ax, share, some_tied=bool(surface.tied.any()))
    return ax


def energies(results: Results, *, ax: Axes | None = None) -> Axes:
    """Draw the energies of the ledger against time (`energy_lines`).

    The legend states the largest error relative to the largest energy, and the total energies that
    waves transported in and out through absorbing boundaries. The curve shows their difference.
    """
    terms = energy_lines(results)
    time = results.time("energy")
    ax = ax or new_axes(height=3.6)
    largest = max(float(np.abs(values).max(initial=0.0)) for values in terms.values())
    factor, unit = energy_unit(largest)
    for term, values in terms.items():
        style, colour = row_of("energy", term)[0].style
        label, through = term, waves_at_end(results)
        if term == WAVES and through is not None:
            joule, fitting = energy_unit(max(map(abs, through)))
            inflow, outflow = (f"{energy / joule:.4g} {fitting}" for energy in through)
            label = f"waves, {inflow} in minus {outflow} out"
        if term == "error" and largest > 0.0:
            label = f"error, within {np.abs(values).max() / largest:.1e} of the largest"
        ax.plot(time, values / factor, linestyle=style, color=colour, linewidth=1.2, label=label)
    decorate(ax, "time [s]", f"energy [{unit}]")
    entitle(ax, "energy balance")
    ax.margins(x=0.0)
    legend(ax, "below")
    return ax


def joint_states(results: Results, *, ax: Axes | None = None) -> Axes:
    """Draw the shares of open, sliding and frictionless closed joint points against time [%].

    The last share is drawn only if it is not zero. Tied points are excluded.
    """
    check_results(results)
    time = results.time("histories")
    ax = ax or new_axes()
    for row in joint_shares(results):
        if row.name != "joint_stick":  # follows from the others: the sum is 100 %
            share = row.factor * results.series("histories", row.name)
            ax.plot(time, share, color=row.style[1], linewidth=1.0, label=row.label)
    decorate(ax, "time [s]", "share of joint points [%]")
    entitle(ax, "state of the joints")
    ax.set_ylim(bottom=0.0)
    ax.margins(x=0.0)
    legend(ax, "above")
    return ax


def energy_unit(largest: float) -> tuple[float, str]:
    """Return size [J] and name of the largest unit in which an energy is at least 1, or of J."""
    units = ((1e9, "GJ"), (1e6, "MJ"), (1e3, "kJ"))
    return next(((factor, unit) for factor, unit in units if largest >= factor), (1.0, "J"))


def joint_histories(results: Results, *, figure: Figure | SubFigure | None = None) -> list[Axes]:
    """Draw series of each joint against time, one panel per quantity.

    The quantities are largest opening, slip and pressure, mean pressure and mobilised friction,
    which is 1 / safety: a joint slides at 1. The joint with the largest value is coloured, and the
    legend gives its value and time. The others are grey. The figure is ``panels[0].figure``.
    """
    check_results(results)
    if not results.joints:
        raise ResultsError(f"{results.path} has no joints to draw.")
    extremes_of_joints = {joint: joint_extremes(results, joint) for joint in results.joints}
    rows = drawn_series(extremes_of_joints.values())
    drawn = figure or new_figure(figsize=(6.3, 2.1 * len(rows)), layout="compressed")
    panels: list[Axes] = list(drawn.subplots(len(rows), sharex=True))
    for ax, row in zip(panels, rows, strict=True):
        by_value: dict[float, tuple[str, Floats, Floats]] = {}
        grey, lowest, mobilised = dict[str, Any](), 0.0, row.key == "mobilised"
        for joint, extremes in extremes_of_joints.items():
            values: Floats = row.factor * extremes.values[row.key]
            grey[joint] = ax.plot(extremes.time, values, color="0.75", linewidth=0.7)[0]
            finite = values[np.isfinite(values)]
            if finite.size:
                lowest = min(lowest, float(finite.min()))
                by_value.setdefault(float(finite.max()), (joint, extremes.time, values))
        if by_value:
            extreme = max(by_value)
            joint, time, values = by_value[extreme]
            at_time = time[np.argmax(values == extreme)]
            unit = f" {row.shown}" if row.shown else ""
            label = f"{joint}: {extreme:.3g}{unit} at {at_time:.6g} s"
            ax.plot(time, values, color=BLUE, linewidth=1.1, label=label)
            others = [name for name in grey if name != joint]
            for name in others[:1]:
                grey[name].set_label(name if len(others) == 1 else f"{len(others)} other joints")
            legend(ax, "above")
        heading = row.heading.replace(" [", f"{since(results, row.key)}\n[")
        decorate(ax, "time [s]" if mobilised else "", heading)
        ax.margins(x=0.0)
        ax.set_ylim(bottom=lowest)
    panels[-1].set_ylim(0.0, 1.02 * max([1.0, *by_value]))  # of the mobilised friction
    return panels


def _frames(drawn: list[tuple[Results, dict[str, Any]]], relative_to: str | None) -> str:
    """Return the reference of the displacements, in words."""
    frames = {style["label"]: frame_name(run, relative_to) for run, style in reversed(drawn)}
    return common_frame(frames)


def point_name(results: Results, point: int | str) -> str:
    """Return the name of a monitor point given by its name or number."""
    return results.point_names[results.point_index(point)]


def _open_legend(ax: Axes, share: float, *, some_tied: bool) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(color=OPEN, label=f"open, {share:.0%} of the area")]
    patches += [Patch(label="tied", **TIED_STYLE)] if some_tied else []
    place = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.12), "borderaxespad": 0.0}
    ax.legend(handles=patches, ncols=2, frameon=False, fontsize="small", **place)
