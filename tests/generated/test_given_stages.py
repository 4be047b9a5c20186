# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated arguments of stages, modes, temperatures and monitors, and laws that misbehave."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_input import answer, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, numbers, passed_on, raising, returning, shared

import dolfinx_joints as dj
from dolfinx_joints.laws.law import Response

pytestmark = pytest.mark.mpi

REFUSALS = (ValueError, dj.JointsError)
SOLID = dj.Elastic(young=1e10, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
WEIGHT, PUSH = dj.Gravity(), dj.Pressure(group="top", value=1e5)
MOTION = dj.synthetic_motion(duration=2.0, dt=0.02, band=(1.0, 10.0))
FEW = st.integers(-1, 2)


def few(values: Any) -> Any:
    """Values without whole numbers that would only take long."""
    return values.filter(lambda v: not isinstance(v, int | np.integer) or not 3 < v < 2**31)


@pytest.fixture(scope="module")
def blocks(read: Callable[..., Any], two_rectangles_file: Callable[..., Any]) -> Any:
    """Two cells with a joint between them."""
    return read(two_rectangles_file(divisions=1))


def body(blocks: Any, **options: Any) -> dj.Model:
    """The blocks on their base, with weight."""
    held = [dj.Fixed(group="base")]
    given = {"material": SOLID, "joints": LAW, "supports": held, "loads": [WEIGHT, PUSH]}
    return dj.Model(blocks, **{**given, **options})


@pytest.fixture(scope="module")
def model(blocks: Any) -> dj.Model:
    """The same."""
    return body(blocks)


@pytest.fixture(scope="module")
def found_modes(model: dj.Model) -> dj.Modes:
    """A mode of the blocks."""
    return dj.modes(model.system(), 1)


class Odd:
    """A monitor, scheme or checkpoint whose methods give nothing."""

    start = record = finish = advance = conserves = keeper = staticmethod(returning(None))


@shared(costly(), 3)
@given(
    given=arguments(
        {},
        {
            "monitors": st.sampled_from([(), [dj.ProgressMonitor], [Odd], [None]]),
            "newton": st.sampled_from([None, dj.SolverOptions(max_iterations=5)]),
            "solver": st.sampled_from(["auto", "condensed", "monolithic"]),
        },
    ),
    other=st.none() | st.none() | JUNK,
)
def test_simulation(model: dj.Model, comm: Any, given: dict[str, Any], other: Any) -> None:
    of = model if other is None else other
    answer("Simulation", passed_on(lambda: dj.Simulation(of, **given)), REFUSALS, comm)


STATICS: dict[str, tuple[Any, Any]] = {
    "statics": (
        {},
        {
            "steps": few(FEW),
            "loads": st.sampled_from([None, [WEIGHT], (), [dj.Gravity()]]),
            "joints": st.sampled_from(["active", "free"]),
        },
    ),
    "grout": ({}, {"joints": st.sampled_from([None, [], ["joint_1"], ["j"]]), "gap": numbers(0.0)}),
    "quasi_statics": ({"times": st.lists(numbers(0.0, 1.0), max_size=2)}, {}),
    "save_static": ({"path": st.just("")}, {}),
    "load_static": ({"path": st.just("no/such/file")}, {}),
}


@pytest.mark.parametrize("name", STATICS)
@shared(costly(), len(STATICS))
@given(data=st.data(), first=st.sampled_from([None, "active", "free"]))
def test_static_stages(model: dj.Model, comm: Any, name: str, data: Any, first: Any) -> None:
    needed, optional = STATICS[name]
    junk = few(JUNK)
    if name == "save_static":  # texts would become files
        junk = junk.filter(lambda value: not isinstance(value, str | Path))
    given = data.draw(arguments(needed, optional, junk))
    run = dj.Simulation(model)
    if first is not None:
        run.statics(joints="active")
    answer(f"Simulation.{name}", passed_on(lambda: getattr(run, name)(**given)), REFUSALS, comm)


GROUND = st.sampled_from([MOTION, lambda t: (t, 0.0), raising]) | JUNK.map(returning)
DYNAMICS = {
    "motion": st.none() | GROUND,
    "loads": st.sampled_from(
        [(), [dj.Pressure(group="top", value=1.0, factor=math.sin)], [dj.Gravity], [dj.Rayleigh()]]
    ),
    "scheme": st.sampled_from(
        [None, dj.EnergyConsistent(), dj.ImplicitContact(), dj.Newmark(), dj.Newmark]
    ),
    "control": st.sampled_from(
        [None, dj.StepControl(max_halvings=1), dj.StepControl(landing=True)]
    ),
    "velocity": st.none(),
    "start": st.none(),
    "resume": st.booleans(),
    "checkpoint": st.none(),
}


@shared(costly(), 3)
@given(given=arguments({"dt": numbers(1e-3, 1e-2), "steps": FEW}, DYNAMICS, few(JUNK)))
def test_dynamics(model: dj.Model, comm: Any, given: dict[str, Any]) -> None:
    run = dj.Simulation(model)
    answer("Simulation.dynamics", passed_on(lambda: run.dynamics(**given)), REFUSALS, comm)


@shared(costly(), 3)
@given(data=st.data(), other=st.none() | st.none() | st.none() | JUNK)
def test_modes(model: dj.Model, comm: Any, data: Any, other: Any) -> None:
    system = model.system() if other is None else other
    given = data.draw(arguments({"count": st.integers(-1, 20)}))
    found = answer("modes", lambda: dj.modes(system, **given), REFUSALS, comm)
    junk = data.draw(JUNK) if found is None else found
    answer("modal_damping", passed_on(lambda: dj.modal_damping(system, junk)), REFUSALS, comm)
    forces = passed_on(lambda: dj.JointForces(model if other is None else other))
    answer("JointForces", forces, REFUSALS, comm)


@shared(costly(), 3)
@given(
    given=arguments(
        {"modes": st.just(None), "model": st.just(None)},
        {
            "metadata": st.none() | st.dictionaries(st.text(max_size=3), JUNK, max_size=2),
            "overwrite": st.booleans(),
        },
    ),
    path=st.just("") | st.sampled_from(["/proc/modes.h5", "/no/modes.h5", "/"]),
)
def test_write_modes(
    model: dj.Model,
    found_modes: dj.Modes,
    comm: Any,
    new_path: Callable[[str], Path],
    given: dict[str, Any],
    path: str,
) -> None:
    whole = {"modes": found_modes, "model": model}
    given |= {name: of for name, of in whole.items() if given[name] is None}
    place = Path(path) if path else new_path("modes.h5")
    answer("write_modes", passed_on(lambda: dj.write_modes(**given, path=place)), REFUSALS, comm)
    comm.barrier()
    if comm.rank == 0 and place.is_file():
        assert dj.Results(place).status == "complete"
        place.unlink()


@shared(costly(), 3)
@given(given=arguments({"coordinates": st.none()}, {"rings": few(st.integers(-1, 4))}, few(JUNK)))
@pytest.mark.filterwarnings("ignore:.* joint nodes keep their mass")
def test_redistribute(model: dj.Model, comm: Any, given: dict[str, Any]) -> None:
    if given["coordinates"] is None:
        owned = model.V.dofmap.index_map.size_local
        given["coordinates"] = model.V.tabulate_dof_coordinates()[:owned, :2]
    redistribute = passed_on(lambda: dj.redistribute(model.system(), **given))
    answer("redistribute", redistribute, REFUSALS, comm)


FACES = st.dictionaries(
    st.sampled_from(["base", "top", "sides", "nowhere"]),
    numbers(10.0, -5.0)
    | st.just(dj.AnnualWave(mean=10.0, amplitude=5.0))
    | st.just(lambda x: x[:, 0])
    | JUNK.map(returning)
    | JUNK,
    min_size=1,
)


@shared(costly(), 3)
@given(given=arguments({"faces": FACES}))
def test_steady_temperature(blocks: Any, comm: Any, given: dict[str, Any]) -> None:
    solve = passed_on(lambda: dj.steady_temperature(blocks, **given))
    answer("steady_temperature", solve, REFUSALS, comm)


@shared(costly(), 3)
@given(
    given=arguments(
        {"faces": FACES, "reference": numbers(5.0), "expansion": numbers(1e-5)},
        {"diffusivity": st.sampled_from([1e-6, 2e-6, 1e-90, 1e70]), "day": numbers(15.0)},
    )
)
def test_seasonal_temperatures(blocks: Any, comm: Any, given: dict[str, Any]) -> None:
    solve = passed_on(lambda: dj.seasonal_temperatures(blocks, **given))
    answer("seasonal_temperatures", solve, REFUSALS, comm)


METHODS = ("backward_euler", "step", "stored_energy", "closed_stiffness", "initial_variables")


def own_law(spoiled: dict[str, Any], parts: dict[str, Any]) -> Any:
    """A law of the user's own of which methods give junk, or responses with junk in them."""

    class Own:
        internal_variables = spoiled.pop("internal_variables", ())

        def backward_euler(self, gap: Any, state: Any) -> Any:
            answer = LAW.backward_euler(gap, state)
            given = {name: getattr(answer, name) for name in Response.__dataclass_fields__}
            return Response(**{**given, **parts})

        stored_energy = staticmethod(LAW.stored_energy)
        closed_stiffness = staticmethod(LAW.closed_stiffness)

    own = Own()
    for name, odd in spoiled.items():
        setattr(own, name, odd if callable(odd) else returning(odd))
    return own


@shared(costly(), 3)
@given(
    spoiled=st.dictionaries(st.sampled_from([*METHODS, "internal_variables"]), JUNK, max_size=2),
    parts=st.dictionaries(
        st.sampled_from(["traction", "tangent", "state", "dissipation", "status"]),
        JUNK,
        max_size=1,
    ),
    dynamic=st.booleans(),
)
def test_laws_of_the_users_own(
    blocks: Any, comm: Any, spoiled: Any, parts: Any, dynamic: bool
) -> None:
    def work() -> None:
        run = dj.Simulation(body(blocks, joints=own_law(spoiled, parts)))
        if dynamic:
            run.dynamics(dt=1e-3, steps=1, control=dj.StepControl(max_halvings=0))
        else:
            run.statics()

    answer("a law of the user's own", passed_on(work), REFUSALS, comm)


@pytest.fixture(scope="module")
def results(new_path: Callable[[str], Path]) -> Path:
    """A results file that each run replaces."""
    return new_path("monitored.h5")


PLACE = st.sampled_from([[0.5, 0.0], (0.5, 2.0), [0.5, 0.0, 0.0], [9.0, 9.0], np.array([0.0, 1.0])])


@shared(costly(), 3)
@given(
    given=arguments(
        {"points": st.dictionaries(st.text(max_size=2), PLACE, max_size=2)},
        {
            "every": few(FEW),
            "metadata": st.dictionaries(st.text(max_size=3), JUNK, max_size=2),
            "envelopes": st.sampled_from([False, True, ["base"], ["nowhere"]]),
            "resultants": st.booleans(),
        },
    )
)
def test_results_monitor(model: dj.Model, comm: Any, results: Path, given: dict[str, Any]) -> None:
    def work() -> None:
        monitor = dj.ResultsMonitor(results, overwrite=True, **given)
        dj.Simulation(model, monitors=[monitor]).dynamics(dt=1e-3, steps=1)

    answer("ResultsMonitor in a run", passed_on(work), REFUSALS, comm)
