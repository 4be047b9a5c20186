# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statements of the paper on the Ambiesta dam, and whether a pair of runs agrees.

Bolognini, Masarati, Dusi and Galimberti (1992), sections 4 and 5. Each statement is a number of
the runs that must be within bounds. If the paper says "about", "a bit" or "almost", the bounds are
our choice and are printed next to the verdict.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report.page import Html, Section, bullets, paragraph, plain, table
from dolfinx_joints.report.runs import Addition, Run

CASE = "ambiesta"
POINT = "mid-crest"
SHORTEST = 10.0  # of the paper's 11.165 s [s]
BIN = 1.0 / (2288 * 0.00488)  # frequency interval of the paper's spectra [Hz]
BELOW = 5.0 - BIN  # "lower than 5.0 Hz", excluding the peak at 5.0 Hz [Hz]
CREST = 0.9  # relative height above which a node belongs to the crest arch

# Parameters of the discretisation; runs that differ only in these give the error estimate.
_DISCRETISATION = ("size", "order", "cell", "layers", "time_step", "scheme")
# Facts of the machine and the files, and consequences of the discretisation.
_NEITHER = {
    *("run", "steps", "stage", "point_names", "dofs", "cells", "joint_points", "ranks", "units"),
    *("solver", "out", "every", "workers", "envelopes", "manifest"),
}

# Metadata that must equal the paper's: dam, joints and motion.
_PAPER = {
    "height": 57.0,
    "crest_length": 144.6,
    "crest_arch": True,
    "friction_angle_deg": 30.0,
    "gap": 0.0,
    "scale": 1.0,
}

Verdict = Literal["agrees", "does not agree", "not comparable"]


@dataclass(frozen=True)
class Pair:
    """Runs of a case without and with joints, on the same mesh and with the same steps."""

    linear: Run
    joints: Run

    def __iter__(self) -> Iterator[Run]:
        """Yield the linear run, then the run with joints."""
        return iter((self.linear, self.joints))

    @property
    def discretisation(self) -> str:
        """Text that describes mesh and step."""
        facts = self.joints.results.metadata
        words = [f"{key.replace('_', ' ')} {facts[key]}" for key in _DISCRETISATION if key in facts]
        return ", ".join(words)


@dataclass(frozen=True)
class Check:
    """Number of a pair of runs, with the bounds that correspond to the paper's statement.

    Attributes:
        statement: The paper's statement.
        quantity: Name of the number, with its unit.
        rule: Text on the bounds.
        low: Lower bound.
        high: Upper bound.
        measure: Function that returns the number, NaN if the files lack the data.
        response: Whether the number depends on model and motion, and not only on the program.
    """

    statement: str
    quantity: str
    rule: str
    low: float
    high: float
    measure: Callable[[Pair], float]
    response: bool = True


@dataclass(frozen=True)
class Judgement:
    """Result of a check.

    Attributes:
        check: The check.
        value: The number.
        verdict: ``agrees``, ``does not agree`` or ``not comparable``.
        reason: Reason why the number is not comparable, or empty.
    """

    check: Check
    value: float
    verdict: Verdict
    reason: str = ""


def add_statements(runs: Sequence[Run]) -> Addition:
    """Return report sections on the statements; further pairs of runs estimate the error."""
    run_pairs = pairs(runs)
    if not run_pairs:
        return Addition()
    judgements = [judged(pair) for pair in run_pairs]
    return Addition(
        first=[section(run_pairs, judgements)],
        last=[departures()],
        note=count(judgements[0]),
        reference=run_pairs[0].linear,
        main=run_pairs[0].joints,
    )


def pairs(runs: Sequence[Run]) -> list[Pair]:
    """Return pairs of a linear and a jointed run with the first pair's physics and duration.

    Args:
        runs: The runs; the first linear and jointed runs that match are the first pair.
    """
    chosen = [run for run in runs if run.results.metadata.get("case") == CASE]
    linear = [run for run in chosen if run.results.metadata.get("run") == "linear"]
    joints = [run for run in chosen if run.results.metadata.get("run") == "joints"]
    matched: list[Pair] = []
    for one in joints:
        partner = next((other for other in linear if _comparable(one, other, same_mesh=True)), None)
        if partner is not None and all(
            _comparable(one, other.joints, same_mesh=False) for other in matched[:1]
        ):
            matched.append(Pair(partner, one))
    return matched


def _comparable(one: Run, other: Run, *, same_mesh: bool) -> bool:
    """Return True if two runs of equal duration differ only in joints, or also in mesh and step."""
    first, second = one.results.metadata, other.results.metadata
    left_out = _NEITHER if same_mesh else {*_NEITHER, *_DISCRETISATION}
    keys = (set(first) | set(second)) - left_out
    step = max((_step(run) for run in (one, other)), default=0.0)
    return all(first.get(key) == second.get(key) for key in keys) and bool(
        abs(one.end - other.end) <= 1.5 * step
    )


def _step(run: Run) -> float:
    if not run.has("histories") or run.results.rows("histories") < 2:
        return 0.0
    return float(np.diff(run.results.time("histories")[:2])[0])


def judged(pair: Pair) -> list[Judgement]:
    """Judge every statement of the paper on one pair of runs."""
    unlike = departure(pair)
    judgements = []
    for check in CHECKS:
        has_point = all(run.moves and POINT in run.results.point_names for run in pair)
        value = check.measure(pair) if has_point or not check.response else math.nan
        if math.isnan(value):
            reason = "the files lack the data"
        else:
            reason = unlike if check.response else _unfinished(pair)
        if reason:
            judgements.append(Judgement(check, value, "not comparable", reason))
        else:
            inside = check.low <= value <= check.high
            judgements.append(Judgement(check, value, "agrees" if inside else "does not agree"))
    return judgements


def departure(pair: Pair) -> str:
    """Return why a pair's response is not comparable with the paper's, empty if it is."""
    facts = pair.joints.results.metadata
    if unfinished := _unfinished(pair):
        return unfinished
    if pair.joints.end < SHORTEST:
        return f"the runs last {plain(pair.joints.end)} s, but the paper's about 11 s"
    record = str(facts.get("record"))
    if not any(name in record.upper() for name in ("TMZ", "TOLMEZZO")):
        return f"the motion, {record}, is not the record of Tolmezzo"
    for key, value in _PAPER.items():
        if facts.get(key, value) != value:
            return f"{key} is {plain(facts[key])}, but the paper's is {plain(value)}"
    if not facts.get("active_height", 0.0) < 1.0:
        return "the joints are active up to the crest, but in the paper only in the lower part"
    return ""


def count(judgements: Sequence[Judgement]) -> str:
    """Return the numbers of statements that agree and do not, in one sentence."""
    verdicts = Counter(j.verdict for j in judgements)
    return (
        f"Of {len(judgements)} numbers behind the paper's statements {verdicts['agrees']} agree, "
        f"{verdicts['does not agree']} do not, {verdicts['not comparable']} are not comparable."
    )


def section(pairs: Sequence[Pair], judgements: Sequence[Sequence[Judgement]]) -> Section:
    """Return the section with the table of the paper's statements and our numbers.

    Args:
        pairs: The judged pair, then pairs of the same case with other meshes or steps.
        judgements: The judgements of each pair.
    """
    rows: list[list[Any]] = []
    for number, judgement in enumerate(judgements[0]):
        check, spread = judgement.check, _spread(number, judgements)
        if number == 0 or judgements[0][number - 1].check.statement != check.statement:
            rows.append([check.statement])
        error = "not estimated" if spread is None else f"± {spread:.2g}"
        verdict = _verdict(judgement, spread)
        rows.append([check.quantity, judgement.value, error, check.rule, verdict])
    others = [f"{pair.joints.label} ({pair.discretisation})" for pair in pairs[1:]]
    estimate = (
        "There is only one mesh and one step, so the error is not estimated."
        if not others
        else "The error estimate is the largest difference from the number in these runs with "
        f"another mesh, step or scheme: {'; '.join(others)}."
    )
    main = pairs[0]
    return Section(
        "paper",
        "The paper and these runs",
        [
            paragraph(
                f"L. Bolognini, P. Masarati, A. Dusi and C. Galimberti, Arch dams non-linear "
                f"seismic analysis using a joint finite element (1992), against "
                f"{main.linear.label} and {main.joints.label} ({main.discretisation}). "
                + count(judgements[0])
            ),
            paragraph(estimate),
            table("The paper's statements and our values", _HEAD, rows),
        ],
    )


def departures() -> Section:
    """Return the section on differences from the paper and on what they can explain."""
    return Section(
        "departures",
        "Departures from the paper, and what they can explain",
        [bullets(_DEPARTURES), paragraph(_UNKNOWN)],
    )


_HEAD = (
    "the paper's statement; measured quantity",
    "our value",
    "error estimate",
    "agreement bounds",
    "verdict",
)

_DEPARTURES = (
    "Record. The paper names an earthquake of 6/7/1976 at a nearby site, which some read as "
    "7 June. The record of Tolmezzo of 6 May 1976 has almost the printed peaks: 0.395 g after a "
    "rotation by 25° and 0.277 g vertically, compared with 0.4 g and 0.3 g. We therefore assume "
    "that the date is a misprint. The rotation of the paper's components is not known.",
    "Geometry. The height, 57.0 m, and the length of the crest, 144.6 m, are published. The shape "
    "and the thicknesses are fitted to the paper's peak frequencies; base and abutments are "
    "fixed. The agreement of the linear frequencies is therefore not an independent result.",
    "Materials. The paper gives neither the elastic constants of the concrete nor the stiffness "
    "of the joints; we chose them.",
    "Joints. Their number, their places and their active height are read from a small figure. "
    "They are active in the lower part, here below a given fraction of the height. This fraction "
    "governs the response: on this dam the paper's statements agree best with joints active up to "
    "0.5 or 0.6 of the height and closed after self weight.",
    "Self weight. The paper does not state whether it acted before or after the joints were "
    "closed. On the finished dam it opens the joints before the earthquake, because the crown "
    "overhangs upstream.",
    "Signs. Compression is positive in the paper and negative in these files.",
    "Sliding. At 30° the ratio of shear to pressure is tan 30° = 0.57735; the paper's figure 7 "
    "has 0.578.",
    "Time scheme. The paper uses a constant step and an implicit scheme that it does not name, "
    "and it does not define its energy error. The energy-consistent scheme used here balances "
    "energies by construction; runs with Newmark's scheme are closer to the paper's.",
    "Element. The paper does not name its elements; its mesh is coarser.",
)
_UNKNOWN = (
    "The record and its rotation affect every amplitude, and the ratio of x and z (symmetric "
    "modes) to y. The thicknesses affect the frequencies and the part of the load that the crest "
    "arch carries. The influence of mesh and step is the error estimated in the table. The damping "
    "matrix, 2 % at 5 Hz, is the paper's. The paper does not state whether it is proportional to "
    "stiffness, mass or both, which affects the response after the strong motion. The few numbers "
    "in the paper cannot separate these influences."
)


def _spread(number: int, judgements: Sequence[Sequence[Judgement]]) -> float | None:
    """Return the largest difference of a number from the other pairs', None without others."""
    values = [judgement[number].value for judgement in judgements]
    differences = [abs(v - values[0]) for v in values[1:] if not math.isnan(v)]
    return max(differences) if differences else None


def _verdict(judgement: Judgement, spread: float | None) -> Html:
    kind = judgement.verdict.replace(" ", "-")
    words = f": {judgement.reason}" if judgement.reason else ""
    check, value = judgement.check, judgement.value
    if not judgement.reason and spread is not None:
        near = min(abs(value - bound) for bound in (check.low, check.high))
        if near <= spread:
            words = "; the error estimate includes the bound"
    label = f'<span class="verdict {kind}">{judgement.verdict}</span>'
    return Html(label + paragraph(words)[3:-4])


def _unfinished(pair: Pair) -> str:
    for run in pair:
        if not run.results.complete:
            return f"{run.label} is incomplete"
    return ""


def _fourier(run: Run, component: str) -> measures.FourierPeaks:
    return measures.fourier_peaks(run.results, POINT, component, below=BELOW)  # type: ignore[arg-type]


def _peak(run: Run, component: str, phase: str) -> float:
    until = measures.strong_phase_end(run.results)
    return measures.peaks(run.results, POINT, strong_until=until)[component][phase]


def _ratio(measure: Callable[[Run], float]) -> Callable[[Pair], float]:
    """Return the ratio of a measure with joints to without, NaN if it is undefined."""

    def of(pair: Pair) -> float:
        linear, joints = (measure(run) for run in pair)
        return joints / linear if linear else math.nan

    return of


def _crest_stress(run: Run) -> float:
    """Return the largest arch tension or compression in the crest arch [Pa], or NaN."""
    if not run.has("envelopes", "arch_max", "arch_min"):
        return math.nan
    nodes = run.results.static("mesh/nodes")
    height = nodes[run.results.static("envelopes/nodes"), 2]
    crest = height >= CREST * nodes[:, 2].max() + (1.0 - CREST) * nodes[:, 2].min()
    values = np.abs(
        [run.results.series("envelopes", name, -1)[crest] for name in ("arch_max", "arch_min")]
    )
    return float(np.nanmax(values)) if np.isfinite(values).any() else math.nan


def _frequency_checks() -> list[Check]:
    found = []
    for component, wanted in (("x", 5.22), ("y", 5.0), ("z", 5.22)):
        for name in ("linear", "joints"):

            def measure(pair: Pair, name: str = name, component: str = component) -> float:
                return _fourier(getattr(pair, name), component).frequency

            found.append(
                Check(
                    "The maximum peak frequencies are identical: 5.22 Hz (x, z), 5.0 Hz (y)",
                    f"{component}, {name}: frequency of the largest Fourier amplitude [Hz]",
                    f"{wanted} ± {BIN:.2f} Hz, one frequency interval",
                    wanted - BIN,
                    wanted + BIN,
                    measure,
                )
            )
    return found


def _ratio_check(
    statement: str,
    quantity: str,
    bounds: tuple[float, float],
    measure: Callable[[Run], float],
) -> Check:
    low, high = bounds
    rule = f"{low:g} to {high:g}"
    if high == math.inf:
        rule = f"above {low:g}"
    elif low == -math.inf:
        rule = f"below {high:g}"
    return Check(statement, f"{quantity}, joints / linear", rule, low, high, _ratio(measure))


def _component_checks(
    statement: str,
    quantity: str,
    bounds: dict[str, tuple[float, float]],
    measure: Callable[[Run, str], float],
) -> list[Check]:
    def of(component: str) -> Callable[[Run], float]:
        return lambda run: measure(run, component)

    return [
        _ratio_check(statement, f"{component}: {quantity}", limits, of(component))
        for component, limits in bounds.items()
    ]


def _program_checks() -> list[Check]:
    """Return the checks of energy errors and cost, which do not depend on the motion."""

    def error(name: str) -> Callable[[Pair], float]:
        return lambda pair: 100.0 * _number(getattr(pair, name).results.summary.get("energy_error"))

    cost = "About 6 h of cpu time for the linear analysis and 40 h with joints, a ratio of 6.7"
    return [
        Check(
            f"The error in the energy content is below {bound:g} % ({name})",
            "energy error / largest energy [%]",
            f"below {bound:g} %",
            -math.inf,
            bound,
            error(which),
            response=False,
        )
        for bound, name, which in ((2.0, "linear", "linear"), (4.0, "non-linear", "joints"))
    ] + [
        Check(
            cost,
            "seconds, joints / linear (hours on another machine are not comparable)",
            "3.3 to 13.3, within a factor of 2",
            6.667 / 2.0,
            6.667 * 2.0,
            _ratio(lambda run: _number(run.seconds)),
            response=False,
        )
    ]


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


CHECKS: tuple[Check, ...] = (
    *_frequency_checks(),
    *_component_checks(
        "The maximum peak grows by about 30 % for x and z, and is more than halved for y",
        "largest Fourier amplitude",
        {"x": (1.2, 1.4), "z": (1.2, 1.4), "y": (-math.inf, 0.5)},
        lambda run, component: _fourier(run, component).amplitude,
    ),
    *_component_checks(
        "Peaks below 5 Hz are almost identical for x and z, a bit increased for y",
        f"largest Fourier peak below {BELOW:.2f} Hz",
        {"x": (0.9, 1.1), "z": (0.9, 1.1), "y": (1.0, 1.5)},
        lambda run, component: _fourier(run, component).amplitude_below,
    ),
    *_component_checks(
        "The maxima are almost identical during the strong motion",
        "largest displacement in the strong phase",
        dict.fromkeys("xyz", (0.9, 1.1)),
        lambda run, component: _peak(run, component, "strong"),
    ),
    *_component_checks(
        "Afterwards x and z are greater with joints",
        "largest displacement after the strong phase",
        dict.fromkeys("xz", (1.0, math.inf)),
        lambda run, component: _peak(run, component, "later"),
    ),
    _ratio_check(
        "Joints have scarce influence on the crest arch",
        f"largest arch stress above {CREST:.0%} of the height",
        (0.85, 1.15),
        _crest_stress,
    ),
    *_program_checks(),
)
