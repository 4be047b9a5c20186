# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The parts of a jointed step, measured from outside: methods of the package are wrapped."""

from __future__ import annotations

import statistics
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import StepWatch, petsc_seconds, slowest
from benchmarks.shared.scenes import Scene
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.record import Record
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.interface.solver import InterfaceSolver
from dolfinx_joints.solvers.newton import NewtonSolver

PRODUCTS = ("MatMult", "MatMultTranspose", "MatMultAdd", "MatMultTrAdd")
PARTS = ("back-substitutions", "products", "joint solver", "rest")


class Clocks:
    """Seconds spent in parts of the package, each without what is counted elsewhere."""

    def __init__(self) -> None:
        """Nothing is spent yet."""
        self.solves = self.solve_products = 0.0
        self.own_products = 0.0
        self.joint_solver = 0.0

    def products(self) -> float:
        """Sparse products outside of linear solves [s]."""
        return petsc_seconds(PRODUCTS) - self.solve_products + self.own_products

    def counted(self) -> float:
        """What solves and products have together [s]."""
        return self.solves + self.products()

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Count, while the context lasts, what these methods of the package spend."""
        with (
            _replaced(EffectiveMatrix, "solver", self._timed_solver),
            _replaced(MatrixSystem, "multiply", self._timed_products),
            _replaced(InterfaceSolver, "solve", self._timed_joint_solver),
            _replaced(NewtonSolver, "solve", self._timed_joint_solver),
        ):
            yield

    def _timed_solver(self, original: property) -> property:
        return property(lambda matrix: _TimedSolver(original.__get__(matrix), self))

    def _timed_products(self, original: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> None:
            began, products = clock.perf_counter(), petsc_seconds(PRODUCTS)
            original(*arguments)
            by_petsc = petsc_seconds(PRODUCTS) - products
            self.own_products += clock.perf_counter() - began - by_petsc

        return timed

    def _timed_joint_solver(self, original: Callable[..., Any]) -> Callable[..., Any]:
        def timed(solver: Any, *arguments: Any, **named: Any) -> Any:
            began, counted = clock.perf_counter(), self.counted()
            answer = original(solver, *arguments, **named)
            if solver.name != "linear":
                inside = self.counted() - counted
                self.joint_solver += clock.perf_counter() - began - inside
            return answer

        return timed


class _TimedSolver:
    """A linear solver of the bulk whose solves are counted."""

    def __init__(self, solver: Any, clocks: Clocks) -> None:
        self._solver, self._clocks = solver, clocks

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._solver, name)
        if name not in ("solve", "solve_block"):
            return found

        def timed(*arguments: Any, **named: Any) -> Any:
            began, products = clock.perf_counter(), petsc_seconds(PRODUCTS)
            answer = found(*arguments, **named)
            self._clocks.solves += clock.perf_counter() - began
            self._clocks.solve_products += petsc_seconds(PRODUCTS) - products
            return answer

        return timed


@contextmanager
def _replaced(owner: type, name: str, wrap: Callable[[Any], Any]) -> Iterator[None]:
    """Replace an attribute of a class as long as the context lasts."""
    original = owner.__dict__[name]
    setattr(owner, name, wrap(original))
    try:
        yield
    finally:
        setattr(owner, name, original)


class SplitWatch(StepWatch):
    """Monitor that also keeps the parts of each step."""

    def __init__(self, scene: Scene, clocks: Clocks) -> None:
        """Nothing is seen yet."""
        super().__init__(scene)
        self._clocks = clocks
        self._parts: list[tuple[float, float, float]] = []

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Note where the clocks stand."""
        super().start(model, stage, steps, first)
        self._parts.append(self._now())

    def record(self, record: Record) -> None:
        """Note where the clocks stand."""
        self._parts.append(self._now())
        super().record(record)

    def _now(self) -> tuple[float, float, float]:
        c = self._clocks
        return c.solves, c.products(), c.joint_solver

    def parts_ms(self) -> dict[str, float]:
        """Mean time of each part over the steps but the first, slowest rank [ms] (collective)."""
        spent = 1e3 * (np.array(self._parts[-1]) - self._parts[1]) / (len(self._parts) - 2)
        rest = statistics.mean(self.wall[1:]) - spent.sum()
        return {
            name: slowest(float(value)) for name, value in zip(PARTS, [*spent, rest], strict=True)
        }
