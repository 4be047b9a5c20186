# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tests in processes of their own, and which of them reach a line, for ``mutants``."""

from __future__ import annotations

import ast
import contextlib
import ctypes
import hashlib
import json
import os
import resource
import signal
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coverage
import dolfinx.fem.petsc  # noqa: F401  loaded once, for all tests that are forked from here
import numba  # noqa: F401
import pytest
import scipy.sparse.linalg  # noqa: F401

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "dolfinx_joints"
BUILD = PROJECT / "build" / "mutants"
KERNEL = {"njit", "register_jitable"}  # what makes a function a kernel
DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux


def processor_time() -> float:
    """Of this process and of those it has waited for, [s]."""
    return sum(os.times()[:4])


def run_tests(tests: list[str], *plugins: object, stop: bool = True) -> int:
    """Run pytest in this process, where nothing of the package has been imported yet."""
    options = ["-q", "--color=no", "-p", "no:cacheprovider", "-m", "not slow", *["-x"] * stop]
    return int(pytest.main([*options, *tests], plugins=list(plugins)))


def in_child(work: Callable[[], int], log: Path, seconds: float) -> int | None:
    """What ``work`` returns in a process of its own; None if it takes too long."""
    child = os.fork()
    if child == 0:
        code = 3
        try:
            os.setsid()
            ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL)
            for stream in (1, 2):
                os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
            code = work()
        except BaseException:
            traceback.print_exc()
        os._exit(code)
    deadline = time.monotonic() + 5.0 * seconds
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > deadline:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # what it may have left running
    code = os.waitstatus_to_exitcode(status)
    return None if -code in (signal.SIGXCPU, signal.SIGKILL) else code


class Watch:
    """Notes for each test the lines that it runs, its processor time, and whether it passed."""

    def __init__(self, lines: coverage.Coverage) -> None:
        self._lines = lines
        self.seconds: dict[str, float] = {}
        self.unfit: set[str] = set()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        start = processor_time()
        self._lines.switch_context(item.nodeid)
        result = yield
        self._lines.switch_context("")
        self.seconds[item.nodeid] = processor_time() - start
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self.unfit.add(report.nodeid)


def watch(job: Job, out: Path) -> int:
    """Write which lines of the modules each test of a file runs."""
    included = [str(PACKAGE / f"{module}.py") for module in job.modules]
    lines = coverage.Coverage(data_file=None, include=included, config_file=False)
    lines.start()
    watched = Watch(lines)
    code = run_tests([f"tests/{job.file}.py"], watched, stop=False)
    lines.stop()
    data, reached = lines.get_data(), defaultdict(list)
    for path in data.measured_files():
        for line, tests in data.contexts_by_lineno(path).items():
            for test in tests:
                reached[test].append(f"{Path(path).stem}:{line}")
    fit = {
        test: [seconds, reached[test]]
        for test, seconds in watched.seconds.items()
        if test not in watched.unfit
    }
    out.write_text(json.dumps(fit), encoding="utf-8")
    return code


@dataclass(frozen=True)
class Job:
    """A file of tests to be watched.

    Attributes:
        file: Name below ``tests``.
        modules: Those whose lines are noted.
    """

    file: str
    modules: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Tests to be run together, with their processor time [s]."""

    tests: list[str]
    seconds: float


def reach_of(job: Job) -> dict[str, Any]:
    """Tests of a file with their seconds and lines, measured if that has not been done yet."""
    tests = PROJECT / "tests"
    files = [*PACKAGE.glob("*.py"), tests / "conftest.py", tests / f"{job.file}.py"]
    known = b"".join(path.read_bytes() for path in sorted(files)) + str(job).encode()
    name = f"{Path(job.file).name}-{hashlib.sha256(known).hexdigest()[:16]}"
    out = BUILD / f"{name}.json"
    if not out.exists():
        start = time.monotonic()
        code = in_child(lambda: watch(job, out), BUILD / f"{name}.log", 900.0)
        seconds = time.monotonic() - start
        print(f"watched {job.file}: {seconds:.0f} s, pytest {code}", flush=True)
    return json.loads(out.read_text(encoding="utf-8")) if out.exists() else {}


def spans(source: str, line: int) -> Iterator[tuple[int, int, ast.stmt]]:
    """First and last line of the statements that a line is in, of ``if`` and the like the head."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.stmt) and not isinstance(node, ast.ClassDef):
            last = node.end_lineno
            body = getattr(node, "body", None)
            if body and not isinstance(node, ast.FunctionDef):
                last = max(node.lineno, body[0].lineno - 1)
            if node.lineno <= line <= last:
                yield node.lineno, last, node


def is_kernel(function: ast.AST) -> bool:
    """Whether numba compiles a function."""
    decorators = getattr(function, "decorator_list", [])
    return any(getattr(getattr(d, "func", d), "id", "") in KERNEL for d in decorators)


class Reach:
    """Which tests reach a line.

    Args:
        pool: Processes that watch the tests.
        files: Files of tests below ``tests``.
        modules: Whose lines are asked for.
        most: Processor time that the tests of a line may take together, [s].
    """

    def __init__(
        self, pool: Any, *, files: tuple[str, ...], modules: tuple[str, ...], most: float
    ) -> None:
        self._most = most
        self._seconds: dict[str, float] = {}
        self._tests: dict[str, set[str]] = defaultdict(set)
        for tests in pool.imap(reach_of, [Job(name, modules) for name in files], 1):
            for test, (seconds, lines) in tests.items():
                self._seconds[test] = seconds
                for line in lines:
                    self._tests[line].add(test)

    def chosen(self, module: str, line: int) -> Chosen:
        """Tests that reach a line, the quickest first.

        A line in a function is reached by what runs its statement, a default by what runs the
        function. A line outside of functions, and one of a kernel, in which nothing is seen, is
        reached by what runs anything of the module.
        """
        source = (PACKAGE / f"{module}.py").read_text(encoding="utf-8")
        around = list(spans(source, line))
        functions = [node for *_, node in around if isinstance(node, ast.FunctionDef)]
        first, last = 1, len(source.splitlines())
        if functions and not any(is_kernel(node) for node in functions):
            first, last, _ = max(around, key=lambda span: span[0])
        places = (f"{module}:{number}" for number in range(first, last + 1))
        found = set().union(*(self._tests.get(place, ()) for place in places))
        return self._affordable(found, f"tests/test_{module}.py")

    def _affordable(self, found: set[str], own: str) -> Chosen:
        """The quickest tests; those of the module's own file come first unless they are long."""
        chosen: list[str] = []
        files: set[str] = set()
        spent, seconds = 0.0, self._seconds
        for test in sorted(found, key=lambda t: seconds[t] * (0.2 if t.startswith(own) else 1.0)):
            file = test.partition("::")[0]
            more = seconds[test] + (0.0 if file in files else 0.3)  # to read the file
            if spent + more > self._most and chosen:
                break
            spent += more
            files.add(file)
            chosen.append(test)
        return Chosen(tests=chosen, seconds=spent)
