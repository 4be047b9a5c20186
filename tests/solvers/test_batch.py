# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Concurrent runs whose identical requests are computed in batches."""

from __future__ import annotations

import threading

import pytest

from dolfinx_joints.solvers.batch import BatchScheduler


class Squares:
    """Request squares, and keep the batches."""

    def __init__(self):
        self.scheduler, self.batches = BatchScheduler(), []

    def compute(self, numbers):
        self.batches.append(list(numbers))
        return [n * n for n in numbers]

    def __call__(self, number, **options):
        return self.scheduler.request("square", self.compute, number, **options)


def test_identical_requests_are_computed_together():
    square = Squares()

    def twice(n):
        return lambda: square(square(n))

    found = square.scheduler.run({str(n): twice(n) for n in range(5)}, at_once=3)
    assert found == {str(n): n**4 for n in range(5)}
    # Three runs at a time; the next ones start as these end.
    assert square.batches == [[0, 1, 2], [0, 1, 4], [3, 4], [9, 16]]
    assert square(7) == 49  # outside of a run


def test_deferrable_requests_wait_for_all():
    square, order = Squares(), []

    def cheap(n):
        order.append(n)
        return [square.scheduler.request("cheap", lambda numbers: numbers, i) for i in range(n)]

    found = square.scheduler.run(
        {str(n): lambda n=n: (cheap(n), square(n, deferrable=True))[1] for n in (0, 2, 1)},
        at_once=9,
    )
    assert square.batches == [[0, 1, 2]]
    assert found == {"0": 0, "2": 4, "1": 1}
    assert order == [0, 2, 1]


def test_a_failure_of_a_run_stays_with_it_and_one_of_a_request_reaches_its_batch():
    square = Squares()

    def fails():
        square(1)
        raise ValueError("mine")

    found = square.scheduler.run({"good": lambda: square(3), "bad": fails}, at_once=2)
    assert found["good"] == 9
    assert isinstance(found["bad"], ValueError)
    found = square.scheduler.run({"one": lambda: square("x"), "two": lambda: square(2)}, at_once=2)
    assert all(isinstance(each, TypeError) for each in found.values())


def test_an_interruption_ends_all():
    square, ended = Squares(), []

    def waits():
        try:
            square(1)
        finally:
            ended.append("waits")

    def interrupted():
        square(2)
        raise KeyboardInterrupt

    threads = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        square.scheduler.run({"stop": interrupted, "last": lambda: [waits(), waits()]}, at_once=2)
    assert threading.active_count() == threads
    assert ended
