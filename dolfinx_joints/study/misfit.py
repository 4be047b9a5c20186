# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misfit of readings, natural frequencies and parameters (47), with its gradient."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_kind_of, finite, numbers_of
from dolfinx_joints.gradient.model_slopes import frequencies
from dolfinx_joints.gradient.parametric import ParametricModel
from dolfinx_joints.gradient.quantity import History, Quantity, not_observed
from dolfinx_joints.gradient.reverse_sweep import gradient_of
from dolfinx_joints.gradient.tape import Tape
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.modes import modes
from dolfinx_joints.simulation.fingerprint import Parameters
from dolfinx_joints.study.readings import Readings


class Evaluation(NamedTuple):
    """Computed values of a run, the misfit, and its derivatives by x (NaN if not computed)."""

    computed: Floats
    misfit: float
    gradient: Floats


class Misfit:
    """Misfit (47) as a function of x = (parameter - mean) / deviation, shape (n,), within `bounds`.

    It can be passed to optimisers that need a function which returns value and gradient, such as
    ``scipy.optimize.minimize(misfit, x, jac=True)``. The attribute ``known`` has x and the
    `Evaluation` of each run.

    Args:
        parametric: The parametric model.
        run: Function of a model and a tape that runs a `Simulation` with the tape as a monitor.
        readings: Readings of the instruments.
        points: Points of the tape.
        gaps: Gaps of the tape.
        measured_frequencies: Lowest natural frequencies and their standard deviations [Hz], shape
            (m, 2); those of the model are computed with closed joints.
        folder: Folder of the evaluations. Evaluations that exist are read and not repeated. Use
            another folder if ``run`` changes.
    """

    def __init__(
        self,
        parametric: ParametricModel,
        run: Callable[[Model, Tape], Any],
        readings: Sequence[Readings],
        *,
        points: Mapping[str, Any] | None = None,
        gaps: Mapping[str, Any] | None = None,
        measured_frequencies: Any = (),
        folder: str | Path,
    ) -> None:
        """Check the arguments, and read the evaluations in the folder (collective)."""
        kind = isinstance(parametric, ParametricModel)
        check_kind_of("parametric", parametric, kind, "a ParametricModel")
        check_kind_of("run", run, callable(run), "a function of a model and a tape")
        good = isinstance(readings, Sequence) and all(isinstance(r, Readings) for r in readings)
        check_kind_of("readings", readings, good, "a sequence of Readings")
        pairs = _pairs(measured_frequencies)
        if not readings and not len(pairs):
            raise ValueError("The calibration has no readings and no frequencies.")
        self.parametric, self.run, self.readings = parametric, run, list(readings)
        self._observed: dict[str, Any] = {"points": points, "gaps": gaps}
        names = {*Tape(**self._observed).probes, *(gaps or {})} if readings else set()
        for reading in readings:
            if reading.of not in names:
                raise ValueError(not_observed(reading.of, sorted(names)))
        self.names = list(parametric.parameters)
        of_parameters = parametric.parameters.values()
        self.means = np.array([p.value for p in of_parameters])
        self.deviations = np.array([p.deviation for p in of_parameters])
        self.ends = [(p.lower, p.upper) for p in of_parameters]
        self.groups: list[str] = []
        for r in self.readings:  # several series of one instrument are numbered
            name = f"{r.of}, component {r.component}"
            same = sum(g.partition(" (")[0] == name for g in self.groups)
            self.groups.append(f"{name} ({same + 1})" if same else name)
        self.sizes = [len(r.series[0]) for r in self.readings]
        self.modes = len(pairs)
        if self.modes:
            self.groups, self.sizes = [*self.groups, "frequencies"], [*self.sizes, self.modes]
        self.measured = np.concatenate([*(r.measured for r in self.readings), pairs[:, 0]])
        self.errors = np.concatenate([*(np.ravel(r.deviation) for r in self.readings), pairs[:, 1]])
        model = parametric.model()
        self.comm = model.jointed.mesh.comm
        self._folder, self.known = Path(folder), self._read(Path(folder), model)

    @property
    def runs(self) -> int:
        """Number of runs, those of earlier calls included."""
        return len(self.known)

    def values(self, x: Floats) -> dict[str, float]:
        """Return the parameters by name; round-off beyond the bounds is removed."""
        numbers = np.clip(self.means + self.deviations * x, *np.transpose(self.ends))
        return dict(zip(self.names, numbers.tolist(), strict=True))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of x."""
        parameters = self.parametric.parameters.values()
        return [
            ((p.lower - p.value) / p.deviation, (p.upper - p.value) / p.deviation)
            for p in parameters
        ]

    def __call__(self, x: Any) -> tuple[float, Floats]:
        """Return the misfit and its gradient (collective)."""
        evaluation = self.evaluate(x)
        return evaluation.misfit, evaluation.gradient.copy()

    def evaluate(self, x: Any, *, gradient: bool = True) -> Evaluation:
        """Run the model, or return the evaluation of a former run (collective)."""
        given = numbers_of(x)
        good = given is not None and given.shape == self.means.shape and finite(given)
        if good:
            lower, upper = np.transpose(self.bounds)
            good = bool(((given >= lower - 1e-9) & (given <= upper + 1e-9)).all())
        wanted = f"{len(self.means)} finite numbers within misfit.bounds"
        check_kind_of("x", x, good, wanted)
        x = np.array(x, dtype=float)
        for former, evaluation in self.known:
            if np.array_equal(former, x) and (not gradient or finite(evaluation.gradient)):
                return evaluation
        try:
            evaluation = self._computed(x, gradient)
        except JointsError as error:
            raise JointsError(f"The run with {self._text(x)} failed: {error}") from error
        except Exception as error:  # of user-defined functions, such as a law with k_n < 0
            error.add_note(f"The run had {self._text(x)}.")
            raise
        evaluation = Evaluation(*self.comm.bcast(evaluation))
        self.known.append((x, evaluation))
        with raised_together(self.comm):
            if self.comm.rank == 0:
                number = len(self.known)
                while (path := self._folder / f"run_{number:04d}.npz").exists():
                    number += 1
                # An interrupted write leaves no incomplete run.
                unfinished = self._folder / "unfinished.npz"
                np.savez(unfinished, x=x, **evaluation._asdict())
                os.replace(unfinished, path)
        return evaluation

    def _text(self, x: Floats) -> str:
        """Return the parameters for a message."""
        return ", ".join(f"{n} = {v:.6g}" for n, v in self.values(x).items())

    def _computed(self, x: Floats, gradient: bool) -> Evaluation:
        """Run the model, and sweep back for the gradient (collective)."""
        values, model = self.values(x), self.parametric.model(self.values(x))
        slope: Floats = np.zeros(len(x))
        computed: Floats = np.empty(0)
        tape = Tape(**self._observed, body=gradient) if self.readings else None
        if tape is not None:
            self.run(model, tape)
            history = tape.history()
            computed = np.concatenate([r.computed(history) for r in self.readings])
        count, slopes = len(computed), slope
        if self.modes and gradient:
            f, slopes = frequencies(self.parametric, values, self.modes)
            computed = np.append(computed, f)
        elif self.modes:
            lowest = modes(model.system(only=()), self.modes)
            computed = np.append(computed, lowest.frequencies)
        residuals = (computed - self.measured) / self.errors
        misfit = 0.5 * float(residuals @ residuals + x @ x)
        if not gradient:
            return Evaluation(computed, misfit, np.full(len(x), np.nan))
        if self.modes:
            slope += (residuals / self.errors)[count:] @ slopes
        if tape is not None:
            swept = gradient_of(tape, self._quantity(residuals / self.errors), self.parametric)
            slope += np.array([swept.by_parameter[name] for name in self.names])
        return Evaluation(computed, misfit, self.deviations * slope + x)

    def _quantity(self, weights: Floats) -> Quantity:
        """Return the sum of weights times computed values; its derivative is that of (47)."""

        def derivative(history: History) -> dict[str, Floats]:
            total: dict[str, Floats] = {}
            start = 0
            for reading, size in zip(self.readings, self.sizes, strict=False):
                part = weights[start : start + size] @ reading.weights(history)
                start += size
                array = total.setdefault(reading.of, np.zeros_like(history.values[reading.of]))
                array[:, reading.component] += part
            return total

        def value(history: History) -> float:
            return float(sum((w * history.values[n]).sum() for n, w in derivative(history).items()))

        return Quantity(value=value, derivative=derivative)

    def _read(self, folder: Path, model: Model) -> list[tuple[Floats, Evaluation]]:
        """Return the evaluations in a folder, after a check of their settings (collective)."""
        settings = {
            "names": np.array(self.names),
            "means": self.means,
            "deviations": self.deviations,
            "measured": self.measured,
            "errors": self.errors,
            "groups": np.array(self.groups),
            "times": np.concatenate([[], *(r.series[0] for r in self.readings)]),
            "relative": np.array([r.relative for r in self.readings]),
            "sizes": np.array(self.sizes),
        }
        facts = Parameters()
        for name, value in (model.parameters | self._observed).items():
            facts.add(name, value)
        settings["model"] = np.array(
            sorted(f"{name}: {fact}" for name, fact in facts.facts.items())
        )
        # Norms of K and M depend on the number of ranks by rounding.
        norms = [matrix.norm() for matrix in (model.stiffness, model.mass)]
        read: list[tuple[Floats, Evaluation]] = []
        with raised_together(self.comm):
            if self.comm.rank == 0:
                folder.mkdir(parents=True, exist_ok=True)
                path, files = folder / "settings.npz", sorted(folder.glob("run_*.npz"))
                if not (files or path.exists()):
                    np.savez(path, **settings, norms=norms)
                stored = _stored(path, [*settings, "norms"])
                same = all(np.array_equal(stored[n], s) for n, s in settings.items())
                if not (same and np.allclose(stored["norms"], norms, rtol=1e-9, atol=0.0)):
                    raise JointsError(
                        f"{folder} contains a calibration with other parameters, readings, "
                        "model or mesh; give another folder."
                    )
                for file in files:
                    s = _stored(file, ["x", *Evaluation._fields])
                    parts = s["computed"], float(s["misfit"]), s["gradient"]
                    read.append((s["x"], Evaluation(*parts)))
        of_all_ranks: list[tuple[Floats, Evaluation]] = self.comm.bcast(read)
        return of_all_ranks


def _stored(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return arrays of a file by name."""
    try:
        with np.load(path) as file:
            return {name: file[name] for name in names}
    except Exception:  # damaged archives raise errors of several modules
        raise JointsError(
            f"{path} is missing, damaged or of another version. Delete a damaged run to repeat it; "
            "without settings.npz, give another folder."
        ) from None


def _pairs(given: Any) -> Floats:
    """Return measured frequencies and their deviations, shape (m, 2)."""
    pairs = numbers_of(given)
    if pairs is not None and not pairs.size:
        return np.empty((0, 2))
    good = pairs is not None and pairs.ndim == 2 and pairs.shape[1] == 2
    good = good and finite(np.asarray(pairs)) and bool((np.asarray(pairs) > 0.0).all())
    wanted = "pairs of a positive frequency and its deviation"
    check_kind_of("measured_frequencies", given, good, wanted)
    return np.asarray(pairs, dtype=float)
