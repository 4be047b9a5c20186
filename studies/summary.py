# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Summary of a run as one table row."""

from __future__ import annotations

import numpy as np

from dolfinx_joints import Results
from dolfinx_joints.common.constants import ACCELERATION_BAND
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing.frames import usual_reference


def summary_row(
    results: Results,
    *,
    strong_until: float | None = None,
    band: float | None = ACCELERATION_BAND,
) -> dict[str, float]:
    """Return a table row of a run; runs with the same points have the same columns.

    - For each point and component C: ``POINT/C/peak_strong``, ``POINT/C/peak_later`` [m],
      ``POINT/C/acceleration, BAND`` (the largest absolute value in a band such as ``low-passed at
      25 Hz``) [m/s^2], ``POINT/C/frequency`` [Hz] and ``POINT/C/amplitude`` [m s] of the Fourier
      peak. Displacements are relative to the ground, or to the free surface under incident waves.
      They are absolute only if supports move (`frames`).
    - ``joints/NAME`` of `all_joints`.
    - ``stress/NAME`` of `measures.stress_extremes`.
    - ``strong_until`` [s], ``energy_error``, ``iterations``, ``steps``, ``seconds``: NaN if the
      file's summary lacks them.

    Args:
        results: The run.
        strong_until: End of the strong motion [s]. By default it is computed from the file's ground
            motion, or is the end of the run if the ground does not move.
        band: Cut-off frequency of the accelerations [Hz], at most `measures.common_band`; None for
            raw accelerations.
    """
    if band is not None:
        band = measures.common_band(results, band=band)
    acceleration = f"acceleration, {measures.band_name(band)}"
    until = measures.strong_phase_end(results) if strong_until is None else strong_until
    base = usual_reference(results)
    row = {"strong_until": until}
    for point in results.point_names:
        largest = measures.peaks(results, point, strong_until=until, relative_to=base)
        for component in measures.COMPONENTS:
            where = f"{point}/{component}"
            spectrum = measures.fourier_peaks(results, point, component, relative_to=base)
            row[f"{where}/peak_strong"] = largest[component]["strong"]
            row[f"{where}/peak_later"] = largest[component]["later"]
            a = measures.acceleration_history(results, point, component, band=band)[1]
            row[f"{where}/{acceleration}"] = float(np.abs(a).max())
            row[f"{where}/frequency"], row[f"{where}/amplitude"] = spectrum[:2]
    row |= {f"joints/{name}": value for name, value in all_joints(results).items()}
    row |= {f"stress/{name}": value for name, value in measures.stress_extremes(results).items()}
    summary = results.summary
    for name in ("energy_error", "iterations", "steps"):
        row[name] = float(summary.get(name, np.nan))
    row["seconds"] = float(sum(summary["seconds"].values())) if "seconds" in summary else np.nan
    return row


def all_joints(results: Results) -> dict[str, float]:
    """Return measures over all joints: the largest value, or for shares the mean over the area.

    The names are those of ``measures.JOINT_MEASURES`` without times; all are zero without joints.
    """
    names = [name for name in measures.JOINT_MEASURES if not name.endswith("_time")]
    by_joint = measures.joint_measures(results)
    if not by_joint:
        return dict.fromkeys(names, 0.0)
    areas = np.array([results.static(f"joints/{joint}/areas").sum() for joint in by_joint])
    combined = {}
    for name in names:
        values = np.array([of_joint[name] for of_joint in by_joint.values()])
        shared = name.startswith("share_")
        combined[name] = float(values @ areas / areas.sum() if shared else values.max())
    return combined
