# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane waves through elastic joints.

P and S waves pass joints at a right angle. The joints are closed under 5 MPa and stick. The rock
has 25 GPa, nu = 0.25 and 2500 kg/m^3. A single joint transmits 1/(1 + i omega Z/2k) of a harmonic
wave, with the modulus 2/sqrt(4 + (omega Z/k)^2) and the impedance Z = rho c. Between three joints,
5 m apart, there are also multiple reflections. Cells are 1 m long, of degree 2. A pulse with
wavelengths down to 10 m travels 40 m, with 400 steps per pulse length. Runs with three joints last
until the multiple reflections have left; with half this time 0.6 % of the transmission is missing.
"""

from __future__ import annotations

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, curve, estimate, new_figure
from validation.strip import Layer, Strip, pulse

SOURCE = "closed form: linear slip interfaces, Schoenberg 1980; several joints by wave matrices"

ROCK = dj.Elastic(young=25e9, poisson=0.25, density=2500.0)
PULSE = 20.0  # length of the pulse [m]
# Lengths of the layers [m] and number of steps, until the reflections between joints have decayed.
RUNS = (((20.0, 20.0), 2400), ((15.0, 5.0, 5.0, 15.0), 16000))
# Relative error with 400 steps per pulse: a third of the error with 200 steps, 0.26 %.
STEPS = 0.0009


def run(quick: bool) -> Outcome:
    """Run pulses through one and three joints; ``quick`` runs only a P wave through one joint."""
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
                layers=[Layer(length=part, material=ROCK) for part in lengths],
                wave=wave,
                size=1.0,
                joint=law,
                overlap=5e6 / stiffness,
            )
            # The velocity is too small to open the joint or to make it slide.
            incident = pulse(length, height=0.01)
            dt = length / 400.0
            transmitted = strip.send(incident, dt=dt, steps=steps).ratio(frequencies, incident)
            exact = strip.transfer(frequencies, stiffness)
            joints = len(lengths) - 1
            label = f"{wave} wave through {joints} joint{'s' if joints > 1 else ''}"
            rows.append(
                curve(
                    f"transmission, {label}",
                    transmitted,
                    exact,
                    **estimate(steps=STEPS),
                )
            )
            fine = np.linspace(frequencies[0], frequencies[-1], 400)
            line_of = np.abs(strip.transfer(fine, stiffness))
            (line,) = ax.plot(fine * length, line_of, label=f"exact, {joints}")
            ax.plot(frequencies * length, np.abs(transmitted), ".", color=line.get_color())
        ax.set_title(f"{wave} wave")
        ax.set_xlabel("frequency × length of the pulse")
        ax.set_ylabel("|transmission|; dots: ours")
        ax.legend(title="joints")
    return Outcome(rows=rows, figure=figure)
