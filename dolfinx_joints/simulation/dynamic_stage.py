# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of a dynamic stage: state, energies, counts, records for monitors, outcome."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.constants import LARGE_ENERGY_ERROR, LARGE_IMBALANCE, LARGE_LOCAL_ERROR
from dolfinx_joints.common.errors import warn
from dolfinx_joints.common.memory import peak_mb
from dolfinx_joints.common.mpi import OF_ERRORS, all_fail, lasting
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.laws.law import DISCRETE_GRADIENT
from dolfinx_joints.loads.ground_motion import in_axes
from dolfinx_joints.loads.load import Load
from dolfinx_joints.loads.oblique_field import rising_waves
from dolfinx_joints.loads.wave_levels import warn_of_sides
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.differing_ground import DifferingGround
from dolfinx_joints.simulation.monitor import Monitor, ending
from dolfinx_joints.simulation.outcome import Outcome
from dolfinx_joints.simulation.record import Record
from dolfinx_joints.time_integration.scheme import StepReport
from dolfinx_joints.time_integration.states import DynamicState, with_means
from dolfinx_joints.time_integration.substeps import Stepper

if TYPE_CHECKING:
    from dolfinx_joints.loads.water.pressures_in_joints import WaterPressures


# Attributes of an outcome that are stored unchanged in results files.
_SUMMARY = ("steps", "iterations", "solver", "energy_error", "imbalance", "local_error")


class DynamicRun:
    """State, energies and counts of a dynamic stage, and its monitors.

    Pass a stepper whose energy ledger has not been started. ``warnings`` are texts of the set-up,
    which the monitors receive at the end. The attribute ``state`` is the state after ``step``
    steps, and ``origin`` is the displacement at the start of the stage [m].
    """

    def __init__(
        self,
        model: Model,
        stepper: Stepper,
        state: DynamicState,
        steps: int,
        *,
        ground: Mapping[str, Any],
        monitors: Sequence[Monitor],
        watch: SmallDisplacements,
        warnings: Sequence[str],
    ) -> None:
        """Start the ledger (collective)."""
        self.model, self.state, self.step, self._steps = model, state, 0, steps
        self.monitors, self._watch, self._ground = monitors, watch, ground
        watch.begin()
        self._stepper, self._solver, self._ledger = stepper, stepper.solver, stepper.ledger
        scheme, solver = stepper.scheme, stepper.solver
        self._conserves = scheme.conserves(solver.system)
        self._ledger.start(state)
        contact = solver.system.contact
        whole = scheme.rule == DISCRETE_GRADIENT
        self._backward_euler_laws = contact.without_balance if contact and whole else ()
        self._laws_without_losses = contact.without_losses(scheme.rule) if contact else ()
        self._iterations = 0
        self._local_error = self._largest = 0.0
        self.origin = state.displacement.copy()
        self._work = state.displacement.duplicate()
        self._started: list[Monitor] = []
        self._warnings = [*warnings, *([] if ground["motion"] is None else warn_of_sides(model))]
        self._of_errors = lasting(model.jointed.mesh.comm, OF_ERRORS)
        self._acting: DynamicState | None = None

    def start(self, **facts: Any) -> None:
        """Start the monitors; ``facts`` are settings and static stages, as in `Record`."""
        first = replace(self._record(0), **facts)
        for monitor in self.monitors:
            monitor.start(self.model, "dynamic", self._steps, first)
            self._started.append(monitor)

    def state_dict(self) -> dict[str, Any]:
        """Return the data for a restart, except vectors (collective)."""
        return {
            "step": self.step,
            "iterations": self._iterations,
            "local_error": self._local_error,
            "largest": self._largest,
            "watch": self._watch.state_dict(),
            "solver": self._solver.state_dict(),
            "steps": self._stepper.state_dict(),
            "energy": self._ledger.state_dict(),
            "monitors": {str(i): monitor.state_dict() for i, monitor in enumerate(self.monitors)},
        }

    def resume(self, state_dict: Mapping[str, Any], origin: PETSc.Vec) -> None:
        """Continue the run that returned ``state_dict``, including the monitors (collective).

        Create this object with the saved state; ``origin`` is the initial displacement [m].
        """
        self.origin, self.step = origin, state_dict["step"]
        self._iterations = state_dict["iterations"]
        self._local_error, self._largest = state_dict["local_error"], state_dict["largest"]
        self._watch.load_state_dict(state_dict["watch"])
        self._solver.load_state_dict(state_dict["solver"])
        self._stepper.load_state_dict(state_dict["steps"])
        self._ledger.load_state_dict(state_dict["energy"])
        last = self._record(self.step)
        for i, monitor in enumerate(self.monitors):
            monitor.resume(self.model, "dynamic", self._steps, last, state_dict["monitors"][str(i)])
            self._started.append(monitor)

    def advance(self, dt: float, end: float) -> StepReport:
        """Compute a step of length dt to the time ``end`` [s]; record all substeps."""
        self._substeps, self._acting = 0, None
        progress = self._progress
        for after, report, row in self._stepper.substeps(self.state, dt, end):
            self._ledger.record(row)
            for monitor in self.monitors:
                monitor.substep(self._stepper, self.state, after, report)
            self.state = after
            if after.joints is not None:
                self._watch.record(after.joints.state.gap)
            if report.dt < dt and self._stepper.forces_over_steps:
                self._acting = with_means(self._acting, after, report.dt / dt)
            self._substeps += 1
            self._iterations += report.solve.iterations
            self._local_error = max(self._local_error, report.local_error)
            self._largest = max(self._largest, self._distance(after))
        self.step += 1
        progress.advance()
        if self.step == self._steps:
            progress.finish()
        return report

    @cached_property
    def _progress(self) -> Progress:
        """Progress display, created in the first step."""
        rank = self.model.jointed.mesh.comm.rank
        return Progress("dynamic stage", self._steps, "steps", rank, self.step)

    def _distance(self, state: DynamicState) -> float:
        """Return the 2-norm of the displacement since the start of the stage [m] (collective)."""
        self._work.waxpy(-1.0, self.origin, state.displacement)
        return self._solver.system.norm(self._work)

    def show(self, report: StepReport) -> None:
        """Pass a step to the monitors."""
        record = self._record(self.step, report)
        for monitor in self.monitors:
            monitor.record(record)

    def _record(self, step: int, report: StepReport | None = None) -> Record:
        in_joints, coupled = self._solver.system.in_joints, self._solver.system.coupled
        state, last = self._acting or self.state, self.state
        facts: dict[str, Any] = {
            n: getattr(state, n) for n in ("displacement", "velocity", "reaction")
        }
        if coupled is not None:
            facts = {name: coupled.body(vector) for name, vector in facts.items()}
            facts["reservoir_force"] = coupled.force(last.velocity)
            facts["reservoir_pressure"] = partial(coupled.pressures, last.velocity)
        if in_joints:
            facts["wet_joints"] = tuple(dict.fromkeys(load.joint for load in in_joints))
            facts["pressure"] = lambda: self._pressures(last.time, last.water)
        return Record(
            stage="dynamic",
            step=step,
            time=last.time,
            joints=state.joints,
            **self._ground,
            solve=report.solve if report else None,
            energy=self._ledger.row,
            substeps=self._substeps if report else 0,
            **facts,
        )

    @cached_property
    def _pressures(self) -> WaterPressures:
        """Pressures of the water in joints, set up at first use (collective)."""
        from dolfinx_joints.loads.water.pressures_in_joints import WaterPressures

        return WaterPressures(self.model, self._solver.system.in_joints)

    def warn_of_slip(self) -> None:
        """Warn of joints whose slip has become too large since the last call (collective).

        Results files store the warnings, even if Python's filters hide them.
        """
        self._warnings += self._watch.warn(f"by t = {self.state.time:.4g} s")

    @contextmanager
    def finishing_monitors(self, seconds: Mapping[str, float]) -> Iterator[None]:
        """Finish the monitors with the status of the stage, also after an error on all ranks.

        The monitors receive the wall time by phase, ``seconds`` [s].
        """
        try:
            yield
            self.warn_of_slip()
            texts = _accuracy_warnings(self.outcome())
            if self.model.jointed.mesh.comm.rank == 0:
                self._warnings += texts
                for text in texts:
                    warn(text)
        except BaseException as error:
            if all_fail(self._of_errors, error):
                status, text = ending(error)
                self._finish(status, {"seconds": dict(seconds), "error": text})
            raise
        peak = self.model.jointed.mesh.comm.allreduce(peak_mb())
        self._finish("complete", {"seconds": dict(seconds), "peak_mb": peak})

    def _finish(self, status: str, extra: dict[str, Any]) -> None:
        outcome = self.outcome()
        summary = {
            **{name: getattr(outcome, name) for name in _SUMMARY},
            **asdict(outcome.counts),
            "laws_without_losses": list(outcome.laws_without_losses),
            **({"warnings": self._warnings} if self._warnings else {}),
            **extra,
        }
        failures: list[Exception] = []
        for monitor in self._started:
            try:
                monitor.finish(status, summary)
            except Exception as failure:  # The other monitors must still finish their files.
                failures.append(failure)
        if failures:
            raise failures[0]

    def outcome(self) -> Outcome:
        """Return the results so far."""
        # If the body stays at rest, error and displacement are rounding errors.
        has_moved = self._largest > 1e-10 * self._solver.system.norm(self.origin)
        return Outcome(
            state=self.state,
            energy=self._ledger.row,
            energy_error=self._ledger.relative_error,
            imbalance=self._ledger.relative_imbalance if self._conserves else None,
            local_error=self._local_error / self._largest if has_moved else 0.0,
            steps=self._steps,
            counts=self._stepper.counts,
            iterations=self._iterations,
            solver=self._solver.name,
            backward_euler_laws=self._backward_euler_laws,
            chatter=self._stepper.chatter.joints(),
            laws_without_losses=self._laws_without_losses,
        )


def ground_motions(
    model: Model, motion: Any, loads: Sequence[Load], differing: DifferingGround | None
) -> dict[str, Any]:
    """Return the ground motion in the axes of the model, as entries of `Record` (collective).

    Args:
        model: The model.
        motion: Ground acceleration, None if the ground is fixed.
        loads: Loads in addition to the loads of the model.
        differing: Ground with different motions at its supports, None for uniform motion.
    """
    rising = rising_waves([*model.loads, *loads])
    if motion is not None:
        motion = lru_cache(maxsize=1)(in_axes(motion, model.gdim))
        motion(0.0)
        if rising:
            raise ValueError(
                "Both motion and a FreeField are given, and each moves the ground; give only one."
            )
    waves = [load.surface_velocity(model) for load in rising]
    return {
        "motion": motion,
        "free_surface": (lambda t: np.sum([wave(t) for wave in waves], axis=0)) if waves else None,
        "static_part": differing.static_part if differing else None,
    }


def _accuracy_warnings(outcome: Outcome) -> list[str]:
    """Return the warnings about the accuracy of a run."""
    texts, at_end = [], ", ".join(outcome.backward_euler_laws)
    advice = "scheme and time step; use EnergyConsistent, or a smaller step"
    if at_end:  # The scheme is EnergyConsistent.
        advice = f"time step ({at_end} is evaluated at its end); use a smaller step"
    if outcome.energy_error > LARGE_ENERGY_ERROR:
        texts.append(
            f"The energy error is {100 * outcome.energy_error:.3g} % of the largest energy: joints "
            f"open and close too fast for this {advice}."
        )
    if outcome.imbalance is not None and outcome.imbalance > LARGE_IMBALANCE:
        texts.append(
            f"The energy balance does not close: {outcome.imbalance:.1e} of the largest energy is "
            "missing. Tractions, stored_energy and dissipation of a joint law are inconsistent "
            "with each other."
        )
    if outcome.local_error > LARGE_LOCAL_ERROR:
        texts.append(
            f"The estimated error of a single step is {100 * outcome.local_error:.3g} % of the "
            "largest displacement; use a smaller step."
        )
    if outcome.chatter:
        worst = max(outcome.chatter, key=lambda name: outcome.chatter[name])
        note = " Since then, steps are not shortened for accuracy." if outcome.counts.held else ""
        texts.append(
            f"Joint {worst!r} chatters: {100 * outcome.chatter[worst]:.2g} % of its normal impulse "
            "comes from repeated contacts that last a few steps. The mean friction may be too low, "
            "and shorter steps do not help. Damp the shortest waves of the body: choose the factor "
            f"of K in the damping near the travel time of sound through an element.{note}"
        )
    return texts
