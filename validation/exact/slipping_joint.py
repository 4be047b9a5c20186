# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Harmonic shear wave through a slipping joint.

A wave of stress tau_0 sin(omega t) meets a joint of shear strength tau_s = mu p at a right angle.
The joint sticks while the stress of the wave is below tau_s. Above, the stress behind the joint is
tau_s and the faces slide with velocity 2 (tau - tau_s)/Z until the stress decreases to tau_s. The
wave behind the joint is therefore the incident one cut off at tau_s. With sin(a) = s = tau_s/tau_0

    energy lost / energy of the wave = (4/pi) s (2 cos a - s (pi - 2 a)),
    amplitude at omega behind / before = (2/pi) (a + s cos a),
    slip in half a cycle = (2 tau_0/(Z omega)) (2 cos a - s (pi - 2 a)).

The rock has 25 GPa, nu = 0.25, 2500 kg/m^3 and is 20 m long on either side of the joint. The waves
are 20 m long; cells are 0.5 m, of degree 2, with 800 steps per cycle and four cycles. The joint
has omega Z/k_s = 0.005 and 30 degrees of friction.

The cut-off wave has corners, so the error is of first order. Its rms difference behind the joint,
in % of the strength, is for s = 0.25, 0.5, 0.75 and 0.9: 5.5, 2.4, 1.3 and 0.81 with cells of 1 m;
3.0, 1.3, 0.65 and 0.43 with 0.5 m; 1.2, 0.56, 0.32 and 0.23 with 0.25 m, the fine run.
"""

from __future__ import annotations

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, Row, estimate, new_figure
from validation.strip import Layer, Strip

SOURCE = "exact, derived here; the problem of R. K. Miller, J. Appl. Mech. 44, 1977"

ROCK = dj.Elastic(young=25e9, poisson=0.25, density=2500.0)
WAVE, CYCLES, PRESSURE = 20.0, 4, 1e6  # wavelength [m], number, joint pressure [Pa]
SOFTNESS = 0.005  # omega Z / k_s
# Differences behind the joint over the strength, by s: 0.6 of the differences with cells and steps
# twice as long, as the error is of first order at the corners of the cut-off wave.
CORNERS = {0.25: 0.033, 0.5: 0.0143, 0.75: 0.008, 0.9: 0.0049}


def run(quick: bool, *, fine: bool = False) -> Outcome:
    """Run waves of several amplitudes; ``quick`` runs one, ``fine`` halves cells and steps."""
    rows = []
    figure, (wave_axes, loss_axes) = new_figure(2)
    half = Layer(length=20.0, material=ROCK)
    speed, z = half.speed("S"), half.impedance("S")
    omega = 2.0 * np.pi * speed / WAVE
    stiffness = omega * z / SOFTNESS
    law = dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=30.0
    )
    strength = PRESSURE * np.tan(np.radians(30.0))
    size = 0.25 if fine else 0.5
    overlap = PRESSURE / stiffness
    strip = Strip(layers=[half, half], wave="S", size=size, joint=law, overlap=overlap)
    period = 2.0 * np.pi / omega
    dt = period / (1600.0 if fine else 800.0)
    steps = round(CYCLES / (dt / period)) + round(2 * half.length / speed / dt)
    shares = (0.5,) if quick else (0.25, 0.5, 0.75, 0.9)
    for share in shares:
        height = strength / share / z
        incident = lambda t, v=height: v * float(np.sin(omega * t)) if t > 0.0 else 0.0  # noqa: E731
        sent = strip.send(incident, dt=dt, steps=steps)
        late = sent.middles - 2.0 * half.length / speed
        before = np.array([incident(t) for t in late])
        cut = np.clip(before, -strength / z, strength / z)
        off = np.sqrt(np.mean((sent.far - cut) ** 2)) * z / strength
        rows.append(
            Row(
                quantity=f"wave behind the joint, s = {share:g}, rms difference / strength",
                ours=float(off),
                theirs=0.0,
                **estimate(corners=CORNERS[share]),
                scale=1.0,
            )
        )
        angle = np.arcsin(share)
        bracket = 2.0 * np.cos(angle) - share * (np.pi - 2.0 * angle)
        met = (
            CYCLES + half.length / WAVE
        )  # cycles at the joint until the last recorded one has reached the far end
        of_wave = met * 0.5 * z * height**2 * period * sent.area
        last = (late > (CYCLES - 2) * period) & (late < CYCLES * period)
        turned = np.exp(-1j * omega * late[last])
        moved = np.ptp(sent.slips[-round(2 * period / dt) :]) - 2.0 * strength / stiffness
        lost = sent.outcome.energy.friction / of_wave
        for quantity, ours, theirs in (
            ("energy lost / of the wave", lost, 4 / np.pi * share * bracket),
            (
                "amplitude behind / before",
                abs(turned @ sent.far[last]) / abs(turned @ before[last]),
                2 / np.pi * (angle + share * np.cos(angle)),
            ),
            (
                "slip in half a cycle, without elastic part [m]",
                moved,
                2.0 * height / omega * bracket,
            ),
        ):
            rows.append(
                Row(
                    quantity=f"{quantity}, s = {share:g}",
                    ours=float(ours),
                    theirs=float(theirs),
                    **estimate(softness=SOFTNESS),
                )
            )
        (line,) = wave_axes.plot(late / period, sent.far * z / strength)
        wave_axes.plot(late / period, cut * z / strength, "k:", lw=1)
        loss_axes.plot(share, lost, "o", color=line.get_color(), label=f"s = {share:g}")
    s = np.linspace(0.0, 1.0, 101)
    a = np.arcsin(s)
    loss_axes.plot(
        s, 4 / np.pi * s * (2 * np.cos(a) - s * (np.pi - 2 * a)), "k-", lw=1, label="exact"
    )
    loss_axes.set_xlabel("s = strength / stress of the wave")
    loss_axes.set_ylabel("energy lost / of the wave")
    wave_axes.set_xlim(0.0, 2.0)
    wave_axes.set_xlabel("time / period")
    wave_axes.set_ylabel("stress behind the joint / strength; dotted: exact")
    loss_axes.legend()  # the other axes have no room
    return Outcome(rows=rows, figure=figure)
