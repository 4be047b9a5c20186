# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sample of small faults that cosmic-ray puts into the package, and the tests that run each fault.

`make mutants` runs this in a copy of the last commit; docs/decisions/mutants.md has the results.
As a plugin of pytest this module records which tests run a line, and how long they take.
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
MOST = 40.0  # largest processor time of a mutant's tests [s]
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
    """Reduce a session to a random sample of places, with one mutant at each place."""
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
            except SyntaxError:  # not valid Python
                continue
            chosen.append(item)
            if len(chosen) == int(size):
                break
        db.clear()
        db.add_work_items(chosen)


def changed() -> tuple[str, int]:
    """Return file and line of the fault; without a fault, the first line of the friction law."""
    for path in Path("dolfinx_joints").rglob("*.py"):
        lines = (ORIGINAL / path).read_text(encoding="utf-8").splitlines()
        mutated = path.read_text(encoding="utf-8").splitlines()
        for number, (one, other) in enumerate(zip(lines, mutated, strict=True), start=1):
            if one != other:
                return str(path), number
    return "dolfinx_joints/laws/friction.py", 1


def reaching(file: str, line: int) -> list[str]:
    """Return the tests that run the statement of a line, quickest first; all tests if none does."""
    reach = json.loads(REACH.read_text(encoding="utf-8"))
    lines, seconds = reach["lines"].get(file, {}), reach["seconds"]
    source = (ORIGINAL / file).read_text(encoding="utf-8")
    statements = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.stmt)]
    around = [n for n in statements if n.lineno <= line <= n.end_lineno] or statements[:1]
    inner = max(around, key=lambda node: node.lineno)
    near = {t for n in range(inner.lineno, inner.end_lineno + 1) for t in lines.get(str(n), ())}
    reached = near - {""} or {test for tests in lines.values() for test in tests} - {""}
    # Coverage does not see compiled code: take all tests that run a module of the same folder.
    if is_compiled(file):
        folder = [reach["lines"][f] for f in reach["lines"] if Path(f).parent == Path(file).parent]
        reached = {t for module in folder for tests in module.values() for t in tests} - {""}
    spent, tests = 0.0, []
    for test in sorted(reached, key=lambda test: seconds.get(test, float("inf"))):
        spent += seconds.get(test, float("inf")) + 0.1
        if spent > MOST:
            break
        tests.append(test)
    return tests


def is_compiled(file: str) -> bool:
    """Return True if a module has functions that numba compiles."""
    return "jit" in (ORIGINAL / file).read_text(encoding="utf-8")


def test() -> int:
    """Run the tests that reach the fault. Compiled loops that contain it are compiled again."""
    tests = reaching(*changed())
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    return subprocess.run(command, check=False).returncode if tests else 0


if __name__ == "__main__":
    sys.exit({"sample": sample, "test": test}[sys.argv[1]](*sys.argv[2:]))
