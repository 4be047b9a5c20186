# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two layers of ground on rock under a rising wave.

The upper layer is 12 m with G = 45 MPa and 1800 kg/m^3 (158 m/s), the lower one 16 m with 200 MPa
and 2000 kg/m^3 (316 m/s). They are on rock with 2 GPa and 2200 kg/m^3 (953 m/s); nu = 0.3. A pulse
of S or P waves rises in the rock. The ratio of the free surface's motion to the incident wave is
compared up to the fourth resonance. The rock is modelled 10 m deep, and the wave enters through
dashpots at its end. Cells are 1 m, of degree 2; a pulse has 400 steps.
"""

from __future__ import annotations

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, Row, curve, estimate, new_figure
from validation.strip import Layer, Strip, pulse

SOURCE = "closed form: transfer function of layered ground, Haskell 1953"

# Relative error by steps: by second order, twice a quarter of the error with steps twice as long.
STEPS = 0.0025


def ground(shear_modulus: float, density: float) -> dj.Elastic:
    """Return the material of a layer, nu = 0.3."""
    return dj.Elastic(young=2.6 * shear_modulus, poisson=0.3, density=density)


LAYERS = (
    Layer(length=10.0, material=ground(2e9, 2200.0)),
    Layer(length=16.0, material=ground(2e8, 2000.0)),
    Layer(length=12.0, material=ground(4.5e7, 1800.0)),
)


def run(quick: bool) -> Outcome:
    """Run rising pulses; ``quick`` runs only an S wave, with steps twice as long."""
    rows = []
    figure, ax = new_figure()
    for wave in "S" if quick else "SP":
        strip = Strip(layers=LAYERS, wave=wave, size=1.0, open_end=True)
        first = LAYERS[2].speed(wave) / 48.0  # resonance of the uppermost layer alone [Hz]
        length = 1.0 / (2.5 * first)
        incident = pulse(length)
        dt = length / (200.0 if quick else 400.0)
        sent = strip.send(incident, dt=dt, steps=round(16.0 / first / dt))
        frequencies = np.linspace(0.1, 4.5, 177) * first
        ratios = sent.ratio(frequencies, incident)
        exact = strip.transfer(frequencies)
        rows.append(
            curve(
                f"free surface / incident wave, {wave}",
                ratios,
                exact,
                **estimate(steps=4.0 * STEPS if quick else STEPS),
            )
        )
        low = frequencies < first
        peaks = [frequencies[low][np.abs(r[low]).argmax()] for r in (ratios, exact)]
        rows.append(
            Row(
                quantity=f"first resonance [Hz], {wave}",
                ours=float(peaks[0]),
                theirs=float(peaks[1]),
                tolerance=0.02,
                reason="the same of the frequencies compared, which are 3.3 % apart",
            )
        )
        (line,) = ax.plot(frequencies, np.abs(exact), label=f"exact, {wave}")
        ax.plot(frequencies[::4], np.abs(ratios[::4]), ".", color=line.get_color())
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("|free surface / incident|; dots: ours")
    ax.legend()
    return Outcome(rows=rows, figure=figure)
