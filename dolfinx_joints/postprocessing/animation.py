# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Film of the deformed body during an earthquake."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.postprocessing.axes import new_figure, pixels
from dolfinx_joints.postprocessing.body import Body, Deformed
from dolfinx_joints.postprocessing.frames import nodal_displacement
from dolfinx_joints.postprocessing.rendering import round_scale
from dolfinx_joints.postprocessing.views import DOWNSTREAM, Elevation
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.reader import Results

Pixels = NDArray[np.uint8]
_DPI = 100


@checked
def animate(
    results: Results,
    path: str | PathLike[str],
    *,
    start: Annotated[float, at.Unit("s")] = 0.0,
    end: Annotated[float, at.Unit("s")] | None = None,
    frames: Annotated[int, at.Ge(2)] = 60,
    per_second: Annotated[int, at.Ge(1)] = 12,
    scale: float | None = None,
    relative_to: str | None = None,
    groups: Collection[str] | None = None,
    azimuth_deg: float = DOWNSTREAM,
    elevation_deg: Elevation = 24.0,
) -> Path:
    """Write a film of the deformed body as a GIF, or as MP4 if ffmpeg is installed.

    All pictures have the same range of colours, scale and frame.

    Args:
        results: The run.
        path: File ending in ``.gif`` or ``.mp4``.
        start: Time of the first state.
        end: Time of the last state; the end of the run by default.
        frames: Largest number of pictures; if there are more states, evenly spaced ones are drawn.
        per_second: Pictures per second of the film.
        scale: Factor of the displacements; by default a round number for the largest displacement.
        relative_to: Reference of the displacements, as in `views.deformed`.
        groups: Cell groups that are drawn opaque, as in `views.deformed`.
        azimuth_deg: Azimuth of the viewpoint.
        elevation_deg: Elevation of the viewpoint.

    Raises:
        JointsError: Fewer than two states from ``start`` to ``end``, or ffmpeg is missing.
    """
    check_results(results)
    place = Path(path)
    writer = _writer(place, per_second)
    times = results.time("states")
    end = times[-1] if end is None else end
    rows = np.flatnonzero((times >= start) & (times <= end))
    if len(rows) < 2:
        raise JointsError(
            f"{results.path} has {len(rows)} states from {start:g} to {end:g} s; a film needs two."
        )
    chosen = rows[np.unique(np.linspace(0, len(rows) - 1, min(frames, len(rows))).astype(int))]
    states = {k: nodal_displacement(results, int(k), relative_to) for k in chosen}
    body = Body(results, groups)
    largest = max(float(np.linalg.norm(u[body.seen], axis=1).max()) for u, _ in states.values())
    factor = round_scale(body.nodes[body.seen], largest) if scale is None else scale
    bodies = {k: Deformed(body, u, factor) for k, (u, _) in states.items()}
    room = np.concatenate([shape.places for shape in bodies.values()])
    (camera,) = body.cameras([azimuth_deg], elevation_deg)
    limits = (0.0, 1e3 * largest or 1.0)
    progress, pictures = Progress("film", len(chosen), "pictures"), []
    for k, (_, frame) in states.items():
        title = f"t = {times[k]:.3f} s, displacements x {factor:g}"
        figure = bodies[k].draw([camera], frame, title, limits=limits, room=room)
        pictures.append(pixels(figure, _DPI)[..., :3])
        progress.advance()
    _write(pictures, writer, place)
    progress.finish()
    return place


def _writer(place: Path, per_second: int) -> Any:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if place.suffix.lower() == ".gif":
        return PillowWriter(fps=per_second)
    if place.suffix.lower() != ".mp4":
        raise JointsError(f"The file of a film must end in .gif or .mp4, got {place}.")
    if shutil.which("ffmpeg") is None:
        raise JointsError("MP4 needs the program ffmpeg; install it, or write a .gif.")
    return FFMpegWriter(fps=per_second)


def _write(pictures: list[Pixels], writer: Any, place: Path) -> None:
    height, width, _ = pictures[0].shape
    film = new_figure(figsize=(width / _DPI, height / _DPI))
    shown = film.figimage(pictures[0])
    with writer.saving(film, str(place), dpi=_DPI):
        for picture in pictures:
            shown.set_data(picture)
            writer.grab_frame()
