# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small faults put into the package by cosmic-ray: a sample of them, and the tests that reach one.

`make mutants` runs it in a copy of the last commit; docs/decisions/mutants.md says what came of it.
As a plugin of pytest it notes which tests run a line, and how long they take.
"""

import ast
import json
import random
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

REACH = Path("build/reach.json")  # {"seconds": {test: s}, "lines": {file: {line: [tests]}}}
ORIGINAL = Path("build/original")  # the package without a fault
MOST = 40.0  # processor time that a mutant's tests may take, [s]
SECONDS: dict[str, float] = {}


def pytest_runtest_logreport(report):
    SECONDS[report.nodeid] = SECONDS.get(report.nodeid, 0.0) + report.duration
    if report.outcome != "passed":
        SECONDS[report.nodeid] = float("inf")


def pytest_runtest_setup(item):
    import coverage

    coverage.Coverage.current().switch_context(item.nodeid)


def pytest_sessionfinish():
    import coverage

    data = coverage.Coverage.current().get_data()
    lines = {
        str(Path(file).relative_to(Path.cwd())): data.contexts_by_lineno(file)
        for file in data.measured_files()
    }
    REACH.write_text(json.dumps({"seconds": SECONDS, "lines": lines}), encoding="utf-8")


def sample(session: str, size: str, seed: str) -> None:
    """Leave a sample of a session: places drawn with equal chances, at each one of its mutants."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator
    from cosmic_ray.work_db import use_db

    with use_db(session) as db:
        places, chosen = defaultdict(list), []
        for item in db.pending_work_items:
            (mutant,) = item.mutations
            place = str(mutant.module_path), *mutant.start_pos
            places[place].append((mutant.operator_name, mutant.occurrence, item))
        draw = random.Random(int(seed))
        for place in draw.sample(sorted(places), len(places)):
            operator, occurrence, item = draw.choice(sorted(places[place], key=lambda m: m[:2]))
            source = Path(place[0]).read_text(encoding="utf-8")
            try:
                mutated = mutate_code(source, get_operator(operator)(), occurrence)
                compile(mutated, place[0], "exec")
            except SyntaxError:  # no interpreter would take it
                continue
            chosen.append(item)
            if len(chosen) == int(size):
                break
        db.clear()
        db.add_work_items(chosen)


def changed() -> tuple[str, int]:
    """File and line of the fault; the first law's where there is none."""
    for path in Path("dolfinx_joints").rglob("*.py"):
        lines = (ORIGINAL / path).read_text(encoding="utf-8").splitlines()
        mutated = path.read_text(encoding="utf-8").splitlines()
        for number, (one, other) in enumerate(zip(lines, mutated, strict=True), start=1):
            if one != other:
                return str(path), number
    return "dolfinx_joints/laws/friction.py", 1


def reaching(file: str, line: int) -> list[str]:
    """Tests that run the statement of a line, the quickest first; of all lines where none does."""
    reach = json.loads(REACH.read_text(encoding="utf-8"))
    lines, seconds = reach["lines"].get(file, {}), reach["seconds"]
    source = (ORIGINAL / file).read_text(encoding="utf-8")
    statements = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.stmt)]
    around = [n for n in statements if n.lineno <= line <= n.end_lineno] or statements[:1]
    inner = max(around, key=lambda node: node.lineno)
    near = {t for n in range(inner.lineno, inner.end_lineno + 1) for t in lines.get(str(n), ())}
    found = near - {""} or {test for tests in lines.values() for test in tests} - {""}
    if is_compiled(file):  # of which coverage sees nothing: all that call compiled code of the wing
        beside = [reach["lines"][f] for f in reach["lines"] if Path(f).parent == Path(file).parent]
        found = {test for each in beside for tests in each.values() for test in tests} - {""}
    spent, tests = 0.0, []
    for test in sorted(found, key=lambda test: seconds.get(test, float("inf"))):
        spent += seconds.get(test, float("inf")) + 0.1
        if spent > MOST:
            break
        tests.append(test)
    return tests


def is_compiled(file: str) -> bool:
    """Whether a module has functions that numba compiles."""
    return "jit" in (ORIGINAL / file).read_text(encoding="utf-8")


def test() -> int:
    """Run the tests that reach the fault; loops that it is part of are compiled anew."""
    tests = reaching(*changed())
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    return subprocess.run(command, check=False).returncode if tests else 0


if __name__ == "__main__":
    sys.exit({"sample": sample, "test": test}[sys.argv[1]](*sys.argv[2:]))
