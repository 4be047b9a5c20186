# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Machine code is used again if and only if nothing has changed that it is made of."""

import importlib
import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import config

pytest.importorskip("mpi4py")

import dolfinx_joints
from dolfinx_joints.common import kernels

PACKAGE = Path(dolfinx_joints.__file__).parent

# A user's two files: loops, and what they are made of.
LEAVES = '''
from typing import NamedTuple
import numba
from numba.extending import overload, register_jitable
from dolfinx_joints.common.kernels import njit, part

FACTOR = 2.0

class Pair(NamedTuple):
    first: float
    second: float

@register_jitable
def leaf(x):
    """Return a number."""
    return x + 10.0

@part
def middle(x):
    return leaf(x)

@njit(cache=True)
def passed(x):
    return x + 20.0

def chosen(x): ...

def _choice(x):
    return x + 30.0

@overload(chosen)
def _(x):
    return _choice

def enclosing(shift):
    @njit(cache=True)
    def enclosed(x):
        return x + shift
    return enclosed

inner = enclosing(40.0)

def unrelated(x):
    return x + 50.0
'''
LOOPS = """
import importlib
import json
import leaves
from leaves import FACTOR, Pair, chosen, inner, middle, passed
from dolfinx_joints.common.kernels import njit

@njit(cache=True)
def by_part(x):
    return middle(x)

@njit(cache=True)
def by_constant(x):
    return FACTOR * x

@njit(cache=True)
def by_module(x):
    return leaves.FACTOR * x

@njit(cache=True)
def by_field(x):
    return x.first

@njit(cache=True)
def by_argument(loop, x):
    return loop(x)

@njit(cache=True)
def by_overload(x):
    return chosen(x)

@njit(cache=True)
def by_closure(x):
    return inner(x)

given = [
    (by_part, (1.0,)), (by_constant, (1.0,)), (by_module, (1.0,)), (by_field, (Pair(1.0, 2.0),)),
    (by_argument, (passed, 1.0)), (by_overload, (1.0,)), (by_closure, (1.0,)),
]
numbers = {loop.__name__: loop(*arguments) for loop, arguments in given}
made = [loop.__name__ for loop, _ in given if not loop.stats.cache_hits]
print(json.dumps([numbers, made]))
"""
NUMBERS = {
    "by_part": 11.0,
    "by_constant": 2.0,
    "by_module": 2.0,
    "by_field": 1.0,
    "by_argument": 21.0,
    "by_overload": 31.0,
    "by_closure": 41.0,
}
# An edit, and the numbers that it changes.
EDITS = {
    "a docstring": ('"""Return a number."""', '"""Return the number."""', {}),
    "the line": ("FACTOR =", "\n\nFACTOR =", {}),
    "another function": ("x + 50.0", "x + 51.0", {}),
    "a leaf": ("x + 10.0", "x + 11.0", {"by_part": 12.0}),
    "a constant": ("FACTOR = 2.0", "FACTOR = 3.0", {"by_constant": 3.0, "by_module": 3.0}),
    "fields": (
        "first: float\n    second: float",
        "second: float\n    first: float",
        {"by_field": 2.0},
    ),
    "a loop that is passed": ("x + 20.0", "x + 21.0", {"by_argument": 22.0}),
    "an overload": ("x + 30.0", "x + 31.0", {"by_overload": 32.0}),
    "a closure": ("enclosing(40.0)", "enclosing(41.0)", {"by_closure": 42.0}),
}


def run(folder, cache, *command):
    """Output of Python in a folder, with this package."""
    paths = [str(PACKAGE.parent), os.environ.get("PYTHONPATH")]
    home = {"PYTHONPATH": os.pathsep.join(filter(None, paths)), "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, *command]
    env = os.environ | home
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def loops(folder, cache, leaves):
    """Numbers of the loops, and the names of those that were compiled."""
    folder.mkdir(exist_ok=True)
    (folder / "leaves.py").write_text(leaves)
    (folder / "loops.py").write_text(LOOPS)
    return run(folder, cache, "loops.py")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A cache in which the loops are, unchanged."""
    cache = tmp_path_factory.mktemp("cache")
    assert loops(cache / "first", cache, LEAVES) == [NUMBERS, list(NUMBERS)]
    return cache


def test_a_second_run_in_another_folder_compiles_nothing(compiled, tmp_path):
    assert loops(tmp_path / "second", compiled, LEAVES) == [NUMBERS, []]


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_recompiles_what_reaches_it(compiled, tmp_path, edit):
    before, after, changed = EDITS[edit]
    assert LEAVES.count(before) == 1
    found = loops(tmp_path / "edited", compiled, LEAVES.replace(before, after))
    assert found == [NUMBERS | changed, list(changed)]


# Functions with one name and other values, compiled in two processes and linked in a third.
ENCLOSED = """
import json, sys
from leaves import enclosing, njit
first, *other = [enclosing(float(each)) for each in sys.argv[1:]]
numbers = [first(0.0)]
if other:
    second = other[0]
    @njit
    def both(x):
        return first(x), second(x)
    numbers = both(0.0)
print(json.dumps(numbers))
"""


def test_closures_of_several_processes_are_told_apart(tmp_path):
    (tmp_path / "leaves.py").write_text(LEAVES)
    (tmp_path / "enclosed.py").write_text(ENCLOSED)
    for shifts in (["2"], ["3"], ["2", "3"]):
        found = run(tmp_path, tmp_path, "enclosed.py", *shifts)
        assert found == [float(each) for each in shifts]


def test_what_cannot_be_described_is_not_kept(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    caplog.set_level(logging.INFO, "dolfinx_joints")

    @numba.vectorize
    def opaque(x):
        return 2.0 * x

    @kernels.njit(cache=True)
    def double(x):
        return opaque(x)

    assert double(1.0) == 2.0
    assert "compiled in each run: it uses" in caplog.text
    assert not list(tmp_path.rglob("*.nbc"))


def test_arrays_enter_by_value():
    def facts(value):
        graph = kernels.CallGraph()
        graph.add(value)
        return graph.facts

    table = np.arange(6.0)
    assert facts(table) == facts(table.copy())
    assert facts(table) != facts(table + 1.0)
    assert facts(table) != facts(table.reshape(2, 3))
    assert facts(1) != facts(1.0) != facts(True)


def test_all_loops_of_this_package_can_be_described():
    described = set()
    for path in PACKAGE.rglob("*.py"):
        if "kernels import" in path.read_text():
            name = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
            for loop in vars(importlib.import_module(name)).values():
                if isinstance(loop, kernels.Dispatcher):
                    kernels.CallGraph().add(loop)
                    described.add(loop.py_func.__name__)
    assert "multiply_blocks" in described
    for loop in importlib.import_module("dolfinx_joints.laws.friction").LOOPS.values():
        kernels.CallGraph().add(loop)
