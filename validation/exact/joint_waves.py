# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane waves through elastic joints.

P and S waves meet joints at a right angle, closed under 5 MPa and stuck, in rock of 25 GPa, nu =
0.25 and 2500 kg/m^3. A single joint lets 1/(1 + i omega Z/2k) of a harmonic wave through, in size
2/sqrt(4 + (omega Z/k)^2), with the impedance Z = rho c; three joints, 5 m apart, also what runs to
and fro between them. Cells are 1 m long, of degree 2; a pulse whose spectrum ends where a wave is
10 m long goes 40 m, 400 steps for its length. Runs through three joints last until what runs to
and fro between them has left: after half of that time 0.6 % of the transmission is missing.
"""

from __future__ import annotations

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, curve, estimate, new_figure
from validation.strip import Layer, Strip, pulse

SOURCE = "closed form: linear slip interfaces, Schoenberg 1980; several joints by wave matrices"

ROCK = dj.Elastic(young=25e9, poisson=0.25, density=2500.0)
PULSE = 20.0  # length of the pulse [m]
# Layers [m] and steps, until hardly anything is left between the joints.
RUNS = (((20.0, 20.0), 2400), ((15.0, 5.0, 5.0, 15.0), 16000))
# Relative error by 400 steps in the pulse: a third of that with 200, 0.26 %.
STEPS = 0.0009


def run(quick: bool) -> Outcome:
    """Send pulses through one and three joints; quick takes a P wave through one."""
    rows = []
    waves = "P" if quick else "PS"
    figure, axes = new_figure(len(waves))
    for wave, ax in zip(waves, np.atleast_1d(axes), strict=True):
        whole = Layer(length=1.0, material=ROCK)
        speed, impedance = whole.speed(wave), whole.impedance(wave)
        length = PULSE / speed
        stiffness = impedance * np.pi / length  # omega Z/k = 1 at half a wave per pulse
        law = dj.FrictionNoTension(
            normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=60.0
        )
        frequencies = np.linspace(0.05, 2.0, 40) / length
        for lengths, steps in RUNS[: 1 if quick else 2]:
            strip = Strip(
                layers=[Layer(length=each, material=ROCK) for each in lengths],
                wave=wave,
                size=1.0,
                joint=law,
                overlap=5e6 / stiffness,
            )
            # Velocities are small beside what would open the joint or let it slide.
            incident = pulse(length, height=0.01)
            dt = length / 400.0
            found = strip.send(incident, dt=dt, steps=steps).ratio(frequencies, incident)
            exact = strip.transfer(frequencies, stiffness)
            joints = len(lengths) - 1
            what = f"{wave} wave through {joints} joint{'s' if joints > 1 else ''}"
            rows.append(
                curve(
                    f"transmission, {what}",
                    found,
                    exact,
                    **estimate(steps=STEPS),
                )
            )
            fine = np.linspace(frequencies[0], frequencies[-1], 400)
            line_of = np.abs(strip.transfer(fine, stiffness))
            (line,) = ax.plot(fine * length, line_of, label=f"exact, {joints}")
            ax.plot(frequencies * length, np.abs(found), ".", color=line.get_color())
        ax.set_title(f"{wave} wave")
        ax.set_xlabel("frequency × length of the pulse")
        ax.set_ylabel("|transmission|; dots: ours")
        ax.legend(title="joints")
    return Outcome(rows=rows, figure=figure)
