# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid dam with compressible water.

A vertical face 100 m high with 16 elements is shaken by a pulse along the stream or upwards. The
water has 1000 kg/m^3 and 1440 m/s. The reservoir is endless, or ends at a wall that moves with the
ground. Its bottom reflects three quarters of a wave or all of it. The complex force on the face per
unit of acceleration is compared, from 0.02 to 3 times the reservoir's first frequency c/4H =
3.6 Hz. If the bottom reflects everything, the force has poles at the odd multiples of it; 3 %
around the poles are left out.
"""

from __future__ import annotations

import numpy as np

from benchmarks.reservoir_waves import DENSITY, HEIGHT, NEAR_POLES, spectrum
from validation.atlas import Outcome, Row, curve, new_figure

SOURCE = "closed form: Chopra 1967, with an absorbing bottom as in Fenves and Chopra 1984"

# Direction, reflection, length and absorbing length over the height, far end, steps, layers.
CASES = {
    "endless": ("stream", 0.75, 10.0, 0.0, "radiating", 2000, None),
    "upwards": ("upwards", 0.75, 1.0, 0.0, "radiating", 2500, None),
    "wall at 2 H": ("stream", 0.75, 2.0, 0.0, "rigid", 2000, 48),
    "endless, bottom reflects all": ("stream", 1.0, 30.0, 25.0, "radiating", 12000, None),
}
WESTERGAARD = 0.5429  # of rho H^2, force on incompressible water


def run(quick: bool) -> Outcome:
    """Shake the face; ``quick`` runs only the endless reservoir."""
    rows, scale = [], DENSITY * HEIGHT**2
    figure, ax = new_figure(height=4.2)
    for name, case in list(CASES.items())[: 1 if quick else None]:
        ratio, computed, exact, _ = spectrum(*case)
        rows.append(
            curve(
                f"force, {name}",
                computed,
                exact,
                tolerance=0.015,
                reason="second order: 16 elements in the height, 40 steps in the shortest period",
            )
        )
        if name == "endless":
            rows.append(
                Row(
                    quantity="force at 0.02 of the first frequency / (rho H^2), endless",
                    ours=float(np.abs(computed[0])) / scale,
                    theirs=WESTERGAARD,
                    tolerance=0.01,
                    reason="16 elements; Westergaard's series for incompressible water",
                )
            )
        shown = np.where(np.diff(ratio, append=ratio[-1]) > NEAR_POLES, np.nan, np.abs(exact))
        (line,) = ax.plot(ratio, shown / scale, label=f"exact, {name}")
        ax.plot(ratio[::4], np.abs(computed[::4]) / scale, ".", color=line.get_color(), ms=4)
    ax.set_ylim(0.0, 4.0)
    ax.set_xlabel("frequency / first frequency of the reservoir")
    ax.set_ylabel("|force| / (ρ H² acceleration); dots: ours")
    ax.legend(fontsize=8, title="bottom reflects 0.75 unless stated", title_fontsize=8)
    return Outcome(rows=rows, figure=figure)
