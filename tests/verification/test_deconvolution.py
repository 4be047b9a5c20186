# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of the base of layered rock against closed forms and against a column in time.

Measured in the column: the surface differs by 0.5 % (S) and 0.2 % (P) of the largest velocity from
the record, up to the highest frequency that is kept.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows, box

import dolfinx_joints as dj
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError
from dolfinx_joints.motions.processing import fall, integrate

SOIL = dj.Elastic(young=1.5e9, poisson=0.3, density=2000.0)
ROCK = dj.Elastic(young=6e9, poisson=0.25, density=2400.0)
FREQUENCY = np.linspace(0.0, 25.0, 101)


def modulus(material, wave):
    shear = material.shear_modulus
    return shear if wave == "S" else material.first_lame("strain") + 2.0 * shear


@pytest.mark.parametrize("wave", ["S", "P"])
def test_one_damped_layer_on_elastic_rock(wave):
    """Kramer, Geotechnical Earthquake Engineering, 1996, eq. 7.29: cos k*H + i alpha* sin k*H.

    Within the rock, at the base of the layer, the motion is cos k*H of that of the surface.
    """
    layer = dj.RockLayer(thickness=30.0, material=SOIL, damping_ratio=0.05)
    column = dj.RockColumn(layers=[layer], half_space=ROCK)
    stiffness = modulus(SOIL, wave) * (1.0 + 0.1j)
    speed = np.sqrt(stiffness / SOIL.density)
    alpha = SOIL.density * speed / np.sqrt(ROCK.density * modulus(ROCK, wave))
    phase = 2.0 * np.pi * FREQUENCY * 30.0 / speed
    outcrop = np.cos(phase) + 1j * alpha * np.sin(phase)
    np.testing.assert_allclose(column.transfer(FREQUENCY, wave=wave), outcrop, rtol=1e-12)
    within = column.transfer(FREQUENCY, wave=wave, kind="within")
    np.testing.assert_allclose(within, np.cos(phase), rtol=1e-10)


def test_layers_of_one_material_are_one_layer_and_rock_alone_a_delay():
    one = dj.RockColumn(
        layers=[dj.RockLayer(thickness=50.0, material=SOIL, damping_ratio=0.03)], half_space=ROCK
    )
    parts = [
        dj.RockLayer(thickness=h, material=SOIL, damping_ratio=0.03) for h in (10.0, 15.0, 25.0)
    ]
    three = dj.RockColumn(layers=parts, half_space=ROCK)
    np.testing.assert_allclose(one.transfer(FREQUENCY), three.transfer(FREQUENCY), rtol=1e-10)
    rock = dj.RockColumn(layers=[dj.RockLayer(thickness=100.0, material=ROCK)], half_space=ROCK)
    # The outcrop moves as the surface did before the travel time: 100 m at 1000 m/s.
    delay = np.exp(2j * np.pi * FREQUENCY * 0.1)
    np.testing.assert_allclose(rock.transfer(FREQUENCY), delay, rtol=1e-10)


def surface_of_a_column(comm, axis, damping, base, kind):
    """Times and velocities of the surface of 20 m of soil on 30 m of rock above the moving base."""
    groups = {"base": (1, 0.0), "top": (1, 50.0), "left": (0, 0.0), "right": (0, 2.0)}
    cells = {"rock": (0.0, 30.0), "soil": (30.0, 50.0)}
    jointed = box([2.0, 50.0], [1, 25], groups=groups, cells=cells, comm=comm)
    on_base = dj.ViscousBoundary(group="base") if kind == "outcrop" else dj.Fixed(group="base")
    sides = [dj.Fixed(group=group, components="yx"[axis]) for group in groups]
    model = dj.Model(
        jointed,
        material={"rock": ROCK, "soil": SOIL},
        supports=[on_base, *sides],
        damping=damping,
        body=dj.Body(degree=2),
    )
    nodes = model.nodes("top")
    top = Rows(lambda record: (record.time, record.velocity.array.reshape(-1, 2)[nodes[0], axis]))
    simulation = dj.Simulation(model, monitors=[top])
    driven = {"motion": base}
    if kind == "outcrop":
        wave = dj.FreeField(groups=["base"], incident=dj.incident_wave(base), surface=50.0)
        driven = {"loads": [wave]}
    simulation.dynamics(dt=base.dt, steps=round(base.duration / base.dt), **driven)
    times, velocities = np.array(top.rows).T
    if kind == "within":  # displacements are relative to the base
        velocities = velocities + base.integrated()[0][: len(times), 2 * axis]
    return times, velocities


@pytest.mark.parametrize("kind", ["outcrop", "within"])
@pytest.mark.parametrize(("wave", "axis"), [("S", 0), ("P", 1)])
def test_the_column_gives_the_record_back(wave, axis, kind):
    """Dashpots stand for the half space; both layers have the damping of the model."""
    record = dj.synthetic_motion(duration=4.0, dt=0.0025, band=(0.5, 12.0))
    damping = dj.stiffness_proportional(ratio=0.03, frequency=5.0)
    layers = [
        dj.RockLayer(thickness=20.0, material=SOIL),
        dj.RockLayer(thickness=30.0, material=ROCK),
    ]
    column = dj.RockColumn(layers=layers, half_space=ROCK, damping=damping)
    base = column.deconvolved(record, kind=kind, highest_frequency=10.0)
    times, velocities = surface_of_a_column(MPI.COMM_SELF, axis, damping, base, kind)
    # The kept part of the record, at the times of the base.
    lead = round(0.5 * (base.duration - record.duration) / record.dt)
    padded = np.pad(record.acceleration[:, 2 * axis], (lead, lead))
    gain = fall(np.fft.rfftfreq(2 * len(padded), record.dt), 8.0, 10.0)
    kept = np.fft.irfft(np.fft.rfft(padded, 2 * len(padded)) * gain)[: len(padded)]
    integrals, _ = integrate(kept[:, None], record.dt)
    expected = np.interp(times, record.dt * np.arange(len(padded)), integrals[:, 0])
    error = np.abs(velocities - expected).max() / np.abs(expected).max()
    print(f"{wave} {kind} error {error:.2e}")
    assert error < 0.01


def test_what_cannot_be_deconvolved_is_an_error():
    layer = dj.RockLayer(thickness=200.0, material=SOIL, damping_ratio=0.1)
    column = dj.RockColumn(layers=[layer], half_space=ROCK)
    record = dj.synthetic_motion(duration=4.0)
    # |cos k*H + ...| grows by exp(xi k H): 10 near k H = ln(2 * 10) / 0.1 = 30, at 13 Hz.
    with pytest.raises(RecordError, match=r"From 1\d.\d Hz the base would move more than 10 times"):
        column.deconvolved(record, kind="outcrop", highest_frequency=30.0)
    assert column.deconvolved(record, kind="outcrop", highest_frequency=10.0).peak.max() > 0.0
    with pytest.raises(RecordError, match=r"to 100 Hz \(half the sampling rate\)"):
        column.deconvolved(record, kind="outcrop", highest_frequency=101.0)
    with pytest.raises(ValueError, match="kind"):
        column.deconvolved(record, kind="base", highest_frequency=10.0)
    with pytest.raises(ValueError, match="damping is .* it must be proportional to stiffness"):
        dj.RockColumn(
            layers=[layer],
            half_space=ROCK,
            damping=dj.mass_proportional(ratio=0.02, frequency=5.0),
        )
    massless = dj.Elastic(young=1e9, poisson=0.2, density=0.0)
    with pytest.raises(ValueError, match="density=0.0.*; it must be an Elastic with mass"):
        dj.RockColumn(layers=[layer], half_space=massless)
    with pytest.raises(ValueError, match="is 3.0; it must be an Elastic with mass"):
        dj.RockColumn(layers=[layer], half_space=3.0)
    with pytest.raises(ValueError, match="it must be 0 or more"):
        column.transfer([-1.0])
    with pytest.raises(ValueError, match="thickness"):
        dj.RockLayer(thickness=0.0, material=SOIL)


def test_a_highest_frequency_below_most_of_the_record_is_a_warning():
    """Half of the squared acceleration of two equal sines is at 8 Hz; a whole number of periods."""
    time = 0.005 * np.arange(2001)
    column = dj.RockColumn(layers=[dj.RockLayer(thickness=20.0, material=SOIL)], half_space=ROCK)
    values = np.sin(4.0 * np.pi * time) + np.sin(16.0 * np.pi * time)
    record = dj.Motion(acceleration=values[:, None] * [1.0, 0.0, 0.0], dt=0.005, name="R")
    with pytest.warns(PlausibilityWarning, match=r"'R': highest_frequency=5 removes (49|50)"):
        column.deconvolved(record, kind="outcrop", highest_frequency=5.0)
    with warnings.catch_warnings(action="error"):
        column.deconvolved(record, kind="outcrop", highest_frequency=20.0)
