# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small faults put into the heart of the package, one at a time: which do the tests notice?

``make mutants`` runs it; docs/decisions/mutants.md has its results. The faults are cosmic-ray's.
A mutated module is never written: the interpreter that runs the tests loads it from memory. Which
tests reach a line is measured first and kept in ``build/mutants`` until package or tests change.
Kernels of a mutated module are compiled anew; those of the others come from numba's cache.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import multiprocessing
import os
import random
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.provider import OperatorProvider
from reach import BUILD, PACKAGE, PROJECT, Chosen, Reach, in_child, processor_time, run_tests

SEED = 1992
SAMPLE = 320
SECONDS_OF_TESTS = 40.0  # processor time that a mutant's tests may take
MODULES = (
    *("laws", "midpoint_law", "end_point_law", "law_options", "mohr_coulomb"),
    *("joints", "jointpoints", "joint_surface", "contact", "redistribution"),
    *("schemes", "states", "stepping"),
    *("solver", "tangent", "resistance", "condensed", "joint_step", "interface", "corrections"),
    *("compliance", "lowrank", "row_matrix", "gmres", "linear", "krylov", "joint_springs"),
    *("unit_forces", "solver_choice"),
)
TESTS = (  # files whose tests are tried
    *("test_laws", "test_law_options", "test_law_tangents", "test_midpoint_law"),
    *("test_mohr_coulomb", "test_gmres", "test_lowrank", "test_corrections", "test_joints"),
    *("test_plots", "test_views", "test_laws_in_models", "test_redistribution", "test_schemes"),
    *("test_stepping", "test_energy", "test_simulation", "test_solver", "test_interface"),
    *("test_compliance", "test_linear", "test_joint_springs", "test_faults", "test_model"),
    *("test_checkpoint", "test_construction", "verification/test_law_paths"),
    *("verification/test_sliding_block", "verification/test_bouncing_bar"),
    *("verification/test_bar_on_wall", "verification/test_plasticity"),
    *("verification/test_loose_blocks", "verification/test_shaking_base"),
)
# An operator is replaced by one of its own family: others mostly end in a TypeError at once.
FAMILIES = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
    {"Delete", "USub", "Invert", "Not"},
)


@dataclass(frozen=True, order=True)
class Mutant:
    """The ``occurrence``-th place in a module where a cosmic-ray operator applies."""

    module: str
    line: int
    column: int
    operator: str
    occurrence: int

    @property
    def source(self) -> str:
        """The module as it is."""
        return (PACKAGE / f"{self.module}.py").read_text(encoding="utf-8")

    def mutated(self) -> str:
        """The module with the fault."""
        return mutate_code(self.source, OperatorProvider()[self.operator](), self.occurrence)

    def diff(self) -> str:
        """What the fault changes, without context."""
        lines = difflib.unified_diff(
            self.source.splitlines(), self.mutated().splitlines(), n=0, lineterm=""
        )
        return "\n".join(line for line in lines if not line.startswith(("---", "+++", "@@")))


# ---------------------------------------------------------------- which mutants there are


def operators() -> Iterator[tuple[str, Any]]:
    """cosmic-ray's operators that are used, by name."""
    for name in OperatorProvider():
        operator = OperatorProvider()[name]
        first, *kinds = name.split("_")
        replaced = first.startswith("Replace") and len(kinds) == 2
        if replaced and not any(set(kinds) <= family for family in FAMILIES):
            continue
        if first == "ReplaceUnaryOperator" and kinds[0] != "Delete":
            continue
        if first != "RemoveDecorator" and not operator.arguments():
            yield name, operator()


def is_left_out(node: Any) -> bool:
    """Whether a place is in an annotation or a decorator, which compute nothing."""
    while node.parent is not None:
        child, node = node, node.parent
        if node.type == "decorator" or (node.type == "annassign" and child is node.children[1]):
            return True
        if node.type == "tfpdef" or (node.type == "funcdef" and child is node.annotation):
            return True
    return False


def mutants_of(module: str) -> Iterator[Mutant]:
    """All mutants of a module."""
    tree = get_ast((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    nodes = list(ast_nodes(tree))
    for name, operator in operators():
        places = ((n, start) for n in nodes for start, _ in operator.mutation_positions(n))
        for occurrence, (node, start) in enumerate(places):
            if not is_left_out(node):
                yield Mutant(module, *start, name, occurrence)


def sample(size: int, seed: int) -> list[Mutant]:
    """Places drawn from all modules with equal chances, at each one of its mutants."""
    places = defaultdict(list)
    for module in MODULES:
        for mutant in mutants_of(module):
            places[mutant.module, mutant.line, mutant.column].append(mutant)
    draw = random.Random(seed)
    chosen = []
    for place in draw.sample(sorted(places), len(places)):
        mutant = draw.choice(sorted(places[place]))
        with contextlib.suppress(SyntaxError):  # nothing that an interpreter would take
            compile(mutant.mutated(), mutant.module, "exec")
            chosen.append(mutant)
        if len(chosen) == size:
            break
    return chosen


class InMemory(importlib.abc.MetaPathFinder, importlib.machinery.SourceFileLoader):
    """Loads one module of the package with a fault.

    Numba's cache knows a kernel by its file, which is as it was: it must not be asked.
    """

    def __init__(self, mutant: Mutant) -> None:
        name, path = f"dolfinx_joints.{mutant.module}", str(PACKAGE / f"{mutant.module}.py")
        super().__init__(name, path)
        fresh = mutant.mutated().replace("@njit(cache=True", "@njit(cache=False")
        self._code = compile(fresh, path, "exec")

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        """The fault's module and no other."""
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self)

    def get_code(self, fullname: str) -> Any:
        """The code with the fault."""
        return self._code


def outcome(job: tuple[Mutant | None, Chosen]) -> str:
    """What becomes of a mutant; of the package as it is where there is none."""
    mutant, chosen = job
    if not chosen.tests:
        return "not reached"

    def work() -> int:
        if mutant is not None:
            sys.meta_path.insert(0, InMemory(mutant))
        # A few tests first: most mutants need no more, and not what the others' files import.
        few = len(chosen.tests) // 8
        parts = [part for part in (chosen.tests[:few], chosen.tests[few:]) if part]
        return next(filter(None, (run_tests(part) for part in parts)), 0)

    code = in_child(work, BUILD / f"last-{os.getpid()}.log", 15.0 + 2.0 * chosen.seconds)
    if code is None:
        return "timed out"
    return "killed" if code else "survived"


def table(outcomes: dict[Mutant, str]) -> str:
    """Counts by module, and the diffs of what was not killed."""
    counts = defaultdict(Counter)
    for mutant, what in outcomes.items():
        counts[mutant.module][what] += 1
    counts["all"] = sum(counts.values(), Counter())
    lines = [
        "| module | mutants | killed | survived | not reached | timed out |",
        "|---|" + "---|" * 5,
    ]
    for module in (*(m for m in MODULES if m in counts), "all"):
        numbers = counts[module]
        columns = [numbers[w] for w in ("killed", "survived", "not reached", "timed out")]
        lines.append("| " + " | ".join(map(str, (module, numbers.total(), *columns))) + " |")
    for mutant, what in sorted(outcomes.items()):
        if what in ("survived", "not reached"):
            lines.append(f"\n{mutant.module}.py:{mutant.line} {what}\n{mutant.diff()}")
    return "\n".join(lines)


def main() -> None:
    """Draw the mutants, try them, print what became of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--sample", type=int, default=SAMPLE, help="number of mutants")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS_OF_TESTS, help="of tests for a mutant"
    )
    parser.add_argument(
        "--again", action="store_true", help="only those that the last run did not kill"
    )
    options = parser.parse_args()
    os.chdir(PROJECT)
    sys.path.insert(0, str(PROJECT))
    BUILD.mkdir(parents=True, exist_ok=True)
    results = BUILD / "outcomes.json"
    mutants = sample(options.sample, options.seed)
    known = json.loads(results.read_text()) if options.again else {}
    outcomes = {m: known[str(m)] for m in mutants if str(m) in known}
    todo = [m for m in mutants if outcomes.get(m) not in ("killed", "timed out")]
    start = processor_time()
    with multiprocessing.get_context("fork").Pool(options.jobs) as pool:
        reach = Reach(pool, files=TESTS, modules=MODULES, most=options.seconds)
        jobs = [(m, reach.chosen(m.module, m.line)) for m in todo]
        controls = [(None, chosen) for _, chosen in jobs[::25]]
        for (_, chosen), what in zip(controls, pool.imap(outcome, controls, 1), strict=True):
            if what in ("killed", "timed out"):
                sys.exit(f"the package without any fault was {what} by {chosen.tests}")
        for count, what in enumerate(pool.imap(outcome, jobs, 1)):
            mutant = todo[count]
            outcomes[mutant] = what
            place = f"{mutant.module}.py:{mutant.line} {mutant.operator}"
            print(f"{count + 1}/{len(todo)} {place}: {what}", flush=True)
            results.write_text(json.dumps({str(m): w for m, w in outcomes.items()}))
        pool.close()
        pool.join()
    print(table(outcomes))
    print(f"\n{processor_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    main()
