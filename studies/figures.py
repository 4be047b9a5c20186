# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures 3 to 19 of the 1992 paper, from the results of runs without and with joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.special import entr

from dolfinx_joints import Results
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.axes import entitle
from studies.profiles import traction_profile
from studies.tables import POINT


def largest_time(results: Results) -> float:
    """Return the time of the largest mid-crest displacement from the static state [s]."""
    u = np.stack([measures.displacement_history(results, POINT, c)[1] for c in measures.COMPONENTS])
    return float(results.time("histories")[np.argmax(np.linalg.norm(u, axis=0))])


def mixed_time(results: Results, joint: str) -> float:
    """Return the time [s] at which open, sliding and sticking points are most evenly mixed.

    It is the recorded time with the largest entropy of the three shares. As in maps of tractions,
    a point without traction is open. A point slides if its ratio of shear to pressure is within 1 %
    of the largest ratio of the run.
    """
    traction = results.series("states", f"joints/{joint}/traction")
    pressure, shear = -traction[..., 0], np.linalg.norm(traction[..., 1:], axis=-1)
    is_open = pressure == 0.0
    ratio = np.divide(shear, pressure, out=np.zeros_like(shear), where=~is_open)
    sliding = ratio > 0.99 * ratio.max()
    shares = [flags.mean(axis=1) for flags in (is_open, sliding, ~is_open & ~sliding)]
    return float(results.time("states")[np.argmax(entr(shares).sum(axis=0))])


def shown_joint(results: Results) -> str:
    """Return the joint closest to the middle of the dam."""
    across = {j: abs(results.static(f"joints/{j}/points")[:, 1].mean()) for j in results.joints}
    return min(across, key=lambda name: across[name])


def body_figures(joints: Results, out: Path) -> list[Path]:
    """Draw figure 3, the mesh with its joints, and 4, the shape at the largest displacement."""
    from dolfinx_joints.postprocessing import views

    return [
        plots.save(views.mesh(joints), out / "figure_03.png"),
        plots.save(views.deformed(joints, time=largest_time(joints)), out / "figure_04.png"),
    ]


def joint_figures(joints: Results, out: Path) -> list[Path]:
    """Draw figures 5 to 7: tractions on the middle joint at the time of figure 4, and friction.

    Figure 5 is two files: normal and tangential traction. Figure 7 is the mobilised friction; the
    paper draws -|t_s|/|t_n| instead.
    """
    moment, name = largest_time(joints), shown_joint(joints)
    maps = (("normal", "05_normal"), ("tangential", "05_tangential"))
    written = []
    for quantity, number in maps:
        ax = plots.joint_traction(joints, name, quantity, time=moment)
        written.append(plots.save(ax.figure, out / f"figure_{number}.png"))
    for quantity, number in (("tractions", "06"), ("mobilised", "07")):
        ax = traction_profile(joints, name, quantity, time=moment)
        written.append(plots.save(ax.figure, out / f"figure_{number}.png"))
    return written


def response_figures(linear: Results, joints: Results, out: Path) -> list[Path]:
    """Draw figures 8 to 13, histories, and 14 to 19, Fourier amplitudes: x, y, z, linear first.

    The two figures of a component have the same axes for comparison.
    """
    written, names = [], ("linear", "with joints")
    for start, draw in ((8, plots.history), (14, plots.fourier)):
        for k, component in enumerate(measures.COMPONENTS):
            axes = [
                draw(run, POINT, component, labels=(name, ""))
                for run, name in zip((linear, joints), names, strict=True)
            ]
            low, high = np.array([ax.get_ylim() for ax in axes]).T
            for j, (ax, name) in enumerate(zip(axes, names, strict=True)):
                ax.set_ylim(low.min(), high.max())
                entitle(ax, f"{ax.get_title(loc='left')}\n{name}")
                number = start + 2 * k + j
                written.append(plots.save(ax.figure, out / f"figure_{number:02d}.png"))
    return written


def paper_figures(linear: Results, joints: Results, out: Path) -> list[Path]:
    """Draw all figures, ``figure_03.png`` to ``figure_19.png``."""
    out.mkdir(parents=True, exist_ok=True)
    return [
        *body_figures(joints, out),
        *joint_figures(joints, out),
        *response_figures(linear, joints, out),
    ]


def moment_figures(joints: Results, out: Path) -> list[Path]:
    """Draw the dam at its largest displacement, and joints at the middle joint's `mixed_time`."""
    from dolfinx_joints.postprocessing import views

    name = shown_joint(joints)
    moment = mixed_time(joints, name)
    shape = views.deformed(joints, time=largest_time(joints))
    written = [plots.save(shape, out / "deformed.png")]
    for quantity in ("mobilised", "normal"):
        figure = plots.joint_maps(joints, quantity, time=moment)
        written.append(plots.save(figure, out / f"all_joints_{quantity}.png"))
    for quantity in ("normal", "tangential", "mobilised"):
        ax = plots.joint_traction(joints, name, quantity, time=moment)
        written.append(plots.save(ax.figure, out / f"traction_{quantity}.png"))
    for quantity in ("tractions", "mobilised"):
        ax = traction_profile(joints, name, quantity, time=moment)
        written.append(plots.save(ax.figure, out / f"profile_{quantity}.png"))
    return written


def comparison_figures(linear: Results, joints: Results, out: Path) -> list[Path]:
    """Draw responses with both runs in one picture, energies, and states of the joints."""
    written = []
    for component in measures.COMPONENTS:
        ax = plots.history(joints, POINT, component, reference=linear)
        written.append(plots.save(ax.figure, out / f"history_{component}.png"))
        ax = plots.fourier(joints, POINT, component, reference=linear)
        written.append(plots.save(ax.figure, out / f"fourier_{component}.png"))
    written.append(plots.save(plots.energies(joints).figure, out / "energies.png"))
    written.append(plots.save(plots.joint_states(joints).figure, out / "joint_states.png"))
    return written
