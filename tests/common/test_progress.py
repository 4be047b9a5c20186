# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines that tell how far work is: who writes them, when, and the time left."""

import logging
import subprocess
import sys

import pytest

from dolfinx_joints.common import kernels, progress
from dolfinx_joints.common.progress import Progress, duration


def test_the_time_left_does_not_count_the_first_part(monkeypatch, caplog):
    clock = iter([0.0, 100.0, 103.0, 109.0, 117.0])  # 100 s to compile; then 3 and 6 s a part
    monkeypatch.setattr(progress, "perf_counter", lambda: next(clock))
    caplog.set_level(logging.INFO, "dolfinx_joints")
    work = Progress("statics", 4, "steps")
    for _ in range(3):
        work.advance()
    # Two in 3 s, hence 6 s for two more; three in 9 s without the first, 4.5 s for the last.
    expected = ["statics: 2 of 4 steps, 6.0 s left", "statics: 3 of 4 steps, 4.5 s left"]
    assert caplog.messages == expected
    work.finish()
    assert caplog.messages[-1] == "statics: 3 steps in 1 min 57 s"


def test_compiling_is_told_once_and_only_of_loops_of_this_package(monkeypatch, caplog):
    caplog.set_level(logging.INFO, "dolfinx_joints")
    monkeypatch.setattr(kernels._LISTENER, "logged", False)
    for module, lines in (
        ("other", 0),
        (None, 0),
        ("dolfinx_joints.any", 1),
        ("dolfinx_joints.any", 1),
    ):

        def double(x):
            return 2.0 * x

        double.__module__ = module
        assert kernels.njit(double)(1.0) == 2.0
        assert len(caplog.messages) == lines, module


def test_a_part_that_was_cut_is_none(monkeypatch, caplog):
    clock = iter([0.0, 1.0, 8.0, 9.0])
    monkeypatch.setattr(progress, "perf_counter", lambda: next(clock))
    caplog.set_level(logging.INFO, "dolfinx_joints")
    work = Progress("statics", 3, "steps", done=1)
    work.advance()
    work.advance(0)  # 7 s later, without another step
    work.finish()
    assert caplog.messages == ["statics: 1 steps in 9.0 s"]


def test_other_ranks_are_silent(caplog):
    caplog.set_level(logging.INFO, "dolfinx_joints")
    work = Progress("statics", 1, "steps", rank=1)
    work.advance()
    work.finish()
    assert caplog.messages == []


@pytest.mark.parametrize(
    ("seconds", "text"), [(4.24, "4.2 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 5 min")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(("level", "lines"), [("INFO", 1), ("WARNING", 0)])
def test_a_script_tells_on_standard_error_what_it_is_asked_to(level, lines):
    code = (
        "import dolfinx_joints as dj; from dolfinx_joints.common.progress import Progress\n"
        f"dj.set_log_level('{level}'); dj.set_log_level('{level}')\n"
        "Progress('work', 1, 'parts').finish()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == lines
    assert lines == 0 or done.stderr.rstrip().endswith("work: 0 parts in 0.0 s")
