# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Calibration: closed forms of the posterior, resumed searches, readings and their files."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from boxes import box
from scipy.optimize import minimize

import dolfinx_joints as dj
from dolfinx_joints.gradient.quantity import History
from dolfinx_joints.study.misfit import Evaluation

DAYS = 86400.0
PRESSURE, STIFFNESS = 1e5, 1e9
GAPS = {"gap": "j"}


def column(fails_at=None, **bounds):
    """Return a parametric model of a column, and its run; the top pressure grows with the time.

    The flexibility f = 1 / k_n is the parameter. So the mean gap -p f t / day is linear in it.
    """
    mesh = box(
        (1.0, 2.0), (1, 2), joints={"j": (1, 1.0)}, groups={"base": (1, 0.0), "top": (1, 2.0)}
    )
    solid = dj.Elastic(young=24e9, poisson=0.0, density=2400.0)
    base = dj.Model(
        mesh,
        material=solid,
        joints=dj.frictionless(normal_stiffness=STIFFNESS),
        supports=[dj.Fixed(group="base"), dj.Fixed(group="top", components="x")],
        loads=[dj.Pressure(group="top", value=PRESSURE, factor=lambda t: t / DAYS)],
    )

    def build(values):
        stiffness = 1.0 / values["flexibility"]
        return dj.changed_model(base, joints=dj.frictionless(normal_stiffness=stiffness))

    calls = []

    def run(model, tape):
        calls.append(model)
        if len(calls) == fails_at:
            raise dj.JointsError("power failure")
        dj.Simulation(model, monitors=[tape]).quasi_statics(DAYS * np.arange(1.0, 5.0))

    flexibility = dj.Parameter(
        value=1.0 / STIFFNESS, deviation=0.3 / STIFFNESS, unit="m/Pa", **bounds
    )
    return dj.ParametricModel(build, {"flexibility": flexibility}), run, calls


def readings(factor=1.2, deviation=1e-5, times=(1.0, 2.5, 4.0), **options):
    """Return readings of a joint with ``factor`` times the mean flexibility."""
    times = DAYS * np.array(times)
    values = -PRESSURE * factor / STIFFNESS * times / DAYS
    return dj.Readings(
        of="gap", component=0, series=(times, values), deviation=deviation, **options
    )


def misfit(folder, given=None, **options):
    parametric, run, calls = column(**options)
    return dj.Misfit(parametric, run, given or [readings()], gaps=GAPS, folder=folder), calls


@pytest.mark.mpi
def test_linear_regression(new_path):
    """Compare with the posterior of a linear model: precision 1 / s0^2 + sum (a / s)^2."""
    calibration = dj.calibrate(misfit(new_path("calibration"))[0])
    slopes = -PRESSURE * np.array([1.0, 2.5, 4.0])
    prior, error = 0.3 / STIFFNESS, 1e-5
    precision = 1.0 / prior**2 + (slopes**2).sum() / error**2
    data = 1.2 / STIFFNESS * (slopes**2).sum() / error**2 + 1.0 / STIFFNESS / prior**2
    assert calibration.values["flexibility"] == pytest.approx(data / precision, rel=1e-6)
    expected = precision**-0.5
    assert calibration.deviations["flexibility"] == pytest.approx(expected, rel=1e-6)
    whitened = np.linalg.norm(slopes) * prior / error
    assert calibration.singular_values == pytest.approx([whitened], rel=1e-6)
    assert calibration.undetermined == calibration.at_bounds == []
    tape = dj.Tape(gaps=GAPS, body=True)
    calibration.misfit.run(calibration.model(), tape)
    value, deviation = calibration.predict(tape, dj.Quantity.at_end("gap", 0))
    assert value == pytest.approx(-4.0 * PRESSURE * data / precision, rel=1e-6)
    assert deviation == pytest.approx(4.0 * PRESSURE * expected, rel=1e-6)
    text = str(calibration)
    assert all(part in text for part in ("flexibility", "m/Pa", "0 of 1 combinations"))


def test_other_optimisers(tmp_path):
    """SciPy's BFGS takes the misfit as it is; the gradient equals a central difference."""
    function, _ = misfit(tmp_path)
    found = minimize(function, np.zeros(1), jac=True, method="BFGS")
    assert found.x == pytest.approx([dj_x(dj.calibrate(function))], rel=1e-4)
    step = np.array([1e-4])
    slope = (function(0.5 + step)[0] - function(0.5 - step)[0]) / 2e-4
    assert function(np.array([0.5]))[1] == pytest.approx([slope], rel=1e-6)


def dj_x(calibration):
    """Return x of a calibrated flexibility."""
    return (calibration.values["flexibility"] * STIFFNESS - 1.0) / 0.3


def test_bound(tmp_path):
    function, _ = misfit(tmp_path, upper=1.1 / STIFFNESS)
    calibration = dj.calibrate(function)
    assert calibration.at_bounds == ["flexibility"]
    assert calibration.values["flexibility"] == 1.1 / STIFFNESS
    assert "at its bound" in str(calibration)
    assert calibration.fits["gap, component 0"] > 1.0


def test_bounds_closer_than_the_differences(tmp_path):
    """The Jacobian is a / s times the prior deviation, also if differences must be short."""
    bounds = {"lower": 0.9999 / STIFFNESS, "upper": 1.0001 / STIFFNESS}
    calibration = dj.calibrate(misfit(tmp_path, **bounds)[0])
    exact = -PRESSURE * np.array([1.0, 2.5, 4.0]) * 0.3 / STIFFNESS / 1e-5
    assert calibration.jacobian[:, 0] == pytest.approx(exact, rel=1e-6)
    assert calibration.at_bounds == ["flexibility"]


def test_user_errors_name_the_parameters(tmp_path):
    with pytest.raises(ValueError, match="normal_stiffness is -") as caught:
        dj.calibrate(misfit(tmp_path, [readings(factor=-30.0)])[0])
    assert any("The run had flexibility = -" in note for note in caught.value.__notes__)
    function, _ = misfit(tmp_path / "bounds", upper=1.1 / STIFFNESS)
    for x in ([0.5], [0.0, 0.0], [np.nan], "a"):
        with pytest.raises(ValueError, match="within misfit.bounds"):
            function(x)


def test_two_series_of_one_instrument(tmp_path):
    series = [readings(), readings(times=(2.0, 3.0))]
    calibration = dj.calibrate(misfit(tmp_path, series)[0])
    assert list(calibration.fits) == ["gap, component 0", "gap, component 0 (2)"]


def test_prediction_of_another_run(tmp_path):
    calibration = dj.calibrate(misfit(tmp_path)[0])
    tape = dj.Tape(gaps=GAPS, body=True)
    calibration.misfit.run(calibration.misfit.parametric.model(), tape)
    with pytest.raises(dj.JointsError, match="The run has other parameters"):
        calibration.predict(tape, dj.Quantity.at_end("gap", 0))


class Regression(dj.Misfit):
    """Misfit of a linear model with a given Jacobian, without runs."""

    def __init__(self, slopes, measured):
        self.slopes, self.measured, self.errors = slopes, measured, np.ones(len(measured))
        self.names = [f"p{i}" for i in range(slopes.shape[1])]
        self.means, self.deviations = np.zeros(len(self.names)), np.ones(len(self.names))
        self.ends, self.known = [(-np.inf, np.inf)] * len(self.names), []

    @property
    def bounds(self):
        return self.ends

    def evaluate(self, x, *, gradient=True):
        computed = self.slopes @ x
        residuals = computed - self.measured
        value = 0.5 * (residuals @ residuals + x @ x)
        return Evaluation(computed, value, self.slopes.T @ residuals + x)


def test_coverage():
    """95.4 % of true parameters are within 2 deviations, and the search ends at the minimum.

    Singular values from 1000 to 0.1: L-BFGS-B alone ends several posterior deviations away.
    """
    random, inside, n, cases = np.random.default_rng(0), 0, 12, 60
    for _ in range(cases):
        left, right = (np.linalg.qr(random.standard_normal((rows, n)))[0] for rows in (300, n))
        slopes = left * np.geomspace(1e3, 0.1, n) @ right.T
        truth = random.standard_normal(n)
        measured = slopes @ truth + random.standard_normal(300)
        found = dj.calibrate(Regression(slopes, measured))
        values = np.array(list(found.values.values()))
        root = np.vstack([slopes, np.eye(n)])
        exact = np.linalg.lstsq(root, np.append(measured, np.zeros(n)), rcond=None)[0]
        assert np.linalg.norm(root @ (values - exact)) < 0.1
        deviations = np.array(list(found.deviations.values()))
        inside += int((np.abs(values - truth) < 2.0 * deviations).sum())
    # Standard deviation of the share, binomial with as many independent numbers as parameters.
    assert inside / (n * cases) == pytest.approx(
        0.954, abs=3 * (0.954 * 0.046 / (n * cases)) ** 0.5
    )


def test_coverage_with_an_unknown_zero():
    """Zeroed readings have the error of the first reading in common; the deviations include it."""
    random, inside, cases = np.random.default_rng(1), 0, 2000
    times = np.arange(150.0)
    signal = 1.0 - np.cos(2.0 * np.pi * times / 52.0)  # computed value per parameter
    history = History(times=times, static=150, values={"a": np.outer(signal, [1.0, 0.0, 0.0])})
    for _ in range(cases):
        values = 1.5 * signal + 0.5 * random.standard_normal(150)
        given = dj.Readings(
            of="a",
            component=0,
            series=(times, values - values[0]),
            deviation=0.5,
            relative=True,
        )
        slope = given.computed(history)
        estimate = slope @ given.measured / (slope @ slope)
        inside += abs(estimate - 1.5) < 2.0 * 0.5 / np.linalg.norm(slope)
    assert inside / cases == pytest.approx(0.954, abs=3 * (0.954 * 0.046 / cases) ** 0.5)


def test_uninformative_readings(tmp_path):
    """With errors far above the effect of the parameter, the posterior is the prior."""
    function, _ = misfit(tmp_path, [readings(deviation=1.0)])
    calibration = dj.calibrate(function)
    assert calibration.undetermined == [{"flexibility": pytest.approx(1.0, abs=1e-12)}] or (
        calibration.undetermined == [{"flexibility": pytest.approx(-1.0, abs=1e-12)}]
    )
    assert calibration.deviations["flexibility"] == pytest.approx(0.3 / STIFFNESS, rel=1e-6)


def test_resumed_search(tmp_path):
    """A failed run is named; the repeated call runs only what is missing."""
    whole, calls = misfit(tmp_path / "whole")
    expected = dj.calibrate(whole)
    count = len(calls)
    function, _ = misfit(tmp_path / "resumed", fails_at=3)
    with pytest.raises(dj.JointsError, match="The run with flexibility = .* failed: power failure"):
        dj.calibrate(function)
    again, calls = misfit(tmp_path / "resumed")
    assert again.runs == 2
    calibration = dj.calibrate(again)
    assert len(calls) == count - 2
    assert calibration.values == expected.values
    assert (calibration.covariance == expected.covariance).all()
    parametric, run, _ = column()
    without_load = dj.ParametricModel(
        lambda v: dj.changed_model(parametric.model(v), loads=[]), parametric.parameters
    )
    with pytest.raises(dj.JointsError, match="other parameters, readings, model or mesh"):
        dj.Misfit(without_load, run, [readings()], gaps=GAPS, folder=tmp_path / "resumed")
    for other in (readings(factor=1.3), readings(relative=True)):
        with pytest.raises(dj.JointsError, match="contains a calibration with other parameters"):
            misfit(tmp_path / "resumed", [other])
    (tmp_path / "resumed" / "run_0002.npz").write_bytes(b"damaged")
    with pytest.raises(dj.JointsError, match="run_0002.npz is missing, damaged or of another"):
        misfit(tmp_path / "resumed")
    (tmp_path / "resumed" / "settings.npz").unlink()
    with pytest.raises(dj.JointsError, match="settings.npz is missing.* give another folder"):
        misfit(tmp_path / "resumed")


def test_frequencies(tmp_path):
    """One frequency with a small error determines the modulus: f is proportional to sqrt(E)."""
    mesh = box((1.0, 4.0), (1, 4), joints={"j": (1, 1.0)}, groups={"base": (1, 0.0)})

    def build(values):
        solid = dj.Elastic(young=values["E"], poisson=0.0, density=2400.0)
        guide = dj.Fixed(group="base")
        law = dj.KeyedJoint(normal_stiffness=1e15, shear_stiffness=1e15)
        return dj.Model(mesh, material=solid, joints=law, supports=[guide])

    parametric = dj.ParametricModel(build, {"E": dj.Parameter(value=20e9, deviation=5e9)})
    (exact,), _ = dj.frequencies(parametric, {"E": 25e9}, 1)
    function = dj.Misfit(
        parametric,
        lambda model, tape: None,
        [],
        measured_frequencies=[(exact, 1e-4 * exact)],
        folder=tmp_path,
    )
    calibration = dj.calibrate(function)
    assert calibration.values["E"] == pytest.approx(25e9, rel=1e-3)
    assert calibration.deviations["E"] == pytest.approx(2.0 * 1e-4 * 25e9, rel=0.05)
    assert list(calibration.fits) == ["frequencies"]


def test_interpolation_and_relative_readings():
    """Values between steps are linear; of several steps at a time, the last counts."""
    history = History(
        times=np.array([0.0, 0.0, 1.0, 3.0]),
        static=4,
        values={"a": np.array([[9.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [6.0, 0, 0]])},
    )

    def computed(times, **options):
        series = np.array(times), np.zeros(len(times))
        given = dj.Readings(of="a", component=0, series=series, deviation=1.0, **options)
        return given.computed(history)

    assert computed([0.0, 0.5, 2.0, 3.0]) == pytest.approx([1.0, 1.5, 4.0, 6.0])
    assert computed([0.5, 2.0, 3.0], relative=True) == pytest.approx([-7 / 3, 1 / 6, 13 / 6])
    with pytest.raises(ValueError, match="the time 3.5 s is outside of the run, 0 to 3 s"):
        computed([3.5])


def test_refused(tmp_path):
    parametric, run, _ = column()
    good = {"gaps": GAPS, "folder": tmp_path}
    for arguments, message in (
        ((None, run, [readings()]), "parametric is None"),
        ((parametric, None, [readings()]), "run is None"),
        ((parametric, run, readings()), "readings is .* a sequence of Readings"),
        ((parametric, run, []), "has no readings and no frequencies"),
    ):
        with pytest.raises(ValueError, match=message):
            dj.Misfit(*arguments, **good)
    for pairs in ([1.0, 2.0], [(1.0, 0.0)], [(1.0, np.nan)], "ab"):
        with pytest.raises(ValueError, match="measured_frequencies is"):
            dj.Misfit(parametric, run, [], measured_frequencies=pairs, **good)
    with pytest.raises(ValueError, match="misfit is None; it must be a Misfit"):
        dj.calibrate(None)
    other = dj.Readings(of="crest", component=0, series=([1.0], [0.0]), deviation=1.0)
    with pytest.raises(ValueError, match="'crest' is not observed; the names are gap"):
        dj.Misfit(parametric, run, [other], **good)
    given = {"of": "a", "component": 0, "series": ([1.0, 2.0], [0.0, 0.0]), "deviation": 1.0}
    for change, message in (
        ({"component": 3}, "component is 3"),
        ({"component": 1.0}, "component is 1.0"),
        ({"of": 3}, "of is 3"),
        ({"series": ([1.0], [0.0]), "relative": True}, "two or more values"),
        ({"series": ([2.0, 1.0], [0.0, 0.0])}, "series"),
        ({"series": ([1.0, 2.0], [0.0])}, "series"),
        ({"series": ([1.0, 2.0], [0.0, np.nan])}, "series"),
        ({"series": 3.0}, "series"),
        ({"deviation": 0.0}, "deviation"),
        ({"deviation": [1.0, 1.0, 1.0]}, "deviation"),
    ):
        with pytest.raises(ValueError, match=message):
            dj.Readings(**(given | change))


CSV = """date, crest [mm], level [m], air [C]
2024-01-01, 0.5, 100.0, -3
2024-01-03T12:00, , 101.0, 4
2024-01-11, -2.5, 102.5,
"""


def test_file(tmp_path):
    path = tmp_path / "readings.csv"
    path.write_text(CSV)
    series = dj.read_series(path)
    assert list(series) == ["crest", "level", "air"]
    assert series["crest"][0].tolist() == [0.0, 10.0 * DAYS]
    assert series["crest"][1].tolist() == pytest.approx([0.5e-3, -2.5e-3])
    assert series["level"][0].tolist() == [0.0, 2.5 * DAYS, 10.0 * DAYS]
    assert series["air"][1].tolist() == [-3.0, 4.0]
    times, _ = dj.read_series(path, start="2023-12-31")["crest"]
    assert times.tolist() == [DAYS, 11.0 * DAYS]
    path.write_text("time [d], crest [m]\n1, 2\n2, 3\n")
    assert dj.read_series(path)["crest"][0].tolist() == [DAYS, 2.0 * DAYS]
    with pytest.raises(ValueError, match="start is '2024-01-01', but .* has times"):
        dj.read_series(path, start="2024-01-01")
    path.write_text("Date;crest [mm];air [°C]\n\n2024-01-01 ;0,5;-3\n2024-01-02;1,5;\n;;\n")
    assert dj.read_series(path)["crest"][1].tolist() == pytest.approx([0.5e-3, 1.5e-3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time [d], a [mm]\n", "at least one line of values"),
        ("time [week], a [mm]\n1, 2\n", r"the column 'time \[week\]' needs a name and a unit"),
        ("time [d], a\n1, 2\n", "the column 'a' needs"),
        ("level [m], a [mm]\n1, 2\n", r"the column 'level \[m\]' needs .* one of s, h, d"),
        ("time [d], a [mm], a [mm]\n1, 2, 3\n", "two columns have the name 'a'"),
        ("time [d], a [mm]\n\n\n1, x\n", "line 4: a is 'x'"),
        ("date, a [mm]\n2024-01-01T00:00Z, 2\n", "a date without time zone"),
        ("time [d], a [mm]\n1, 2, 3\n", "line 2: 3 cells for 2 columns"),
        ("time [d], a [mm]\n1, x\n", "line 2: a is 'x'; it must be a number"),
        ("time [d], a [mm]\n1, nan\n", "line 2: a is 'nan'; it must be a number"),
        ("time [d], a [mm]\n, 1\n", "line 2: time is ''; it must be a number"),
        ("time [d], a [mm]\n1, 2\n2, 2\n2, 3\n", "line 4: the time is not later"),
        (
            "date, a [mm]\n1.2.24, 2\n",
            "line 2: date is '1.2.24'; it must be a date without time zone",
        ),
    ],
)
def test_files_with_errors(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(dj.RecordError, match=message):
        dj.read_series(path)
    with pytest.raises(dj.RecordError, match="cannot be read"):
        dj.read_series(tmp_path / "none.csv")


def test_report(tmp_path):
    """Numbers of the page are those of the calibration."""
    calibration = dj.calibrate(misfit(tmp_path / "runs", upper=1.1 / STIFFNESS)[0])
    page = calibration.report(tmp_path / "calibration.html").read_text()
    value, deviation = (calibration.values, calibration.deviations)
    for text in (
        "flexibility",
        "m/Pa",
        f"{value['flexibility']:.5g}",
        f"{deviation['flexibility']:.2g}",
        f"{calibration.fits['gap, component 0']:.2f}",
        f"{calibration.singular_values[0]:.3g}",
        "gap, component 0",
        "data:image/png",
        ">yes<",
    ):
        assert text in page
    assert (tmp_path / "calibration_files" / "readings.png").exists()
