# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions that run in turns and have answered together what they ask alike."""

from __future__ import annotations

import threading

import pytest

from dolfinx_joints.solvers.batch import Rounds


class Squares:
    """Answers with squares, and keeps what was asked together."""

    def __init__(self):
        self.rounds, self.asked = Rounds(), []

    def answer(self, numbers):
        self.asked.append(list(numbers))
        return [n * n for n in numbers]

    def __call__(self, number, **options):
        return self.rounds.ask("square", self.answer, number, **options)


def test_alike_questions_are_answered_together():
    square = Squares()

    def twice(n):
        return lambda: square(square(n))

    found = square.rounds.run({str(n): twice(n) for n in range(5)}, most=3)
    assert found == {str(n): n**4 for n in range(5)}
    # Three at once; the next ones begin as these end.
    assert square.asked == [[0, 1, 2], [0, 1, 4], [3, 4], [9, 16]]
    assert square(7) == 49  # outside of a round


def test_what_is_dear_waits_for_all():
    square, order = Squares(), []

    def cheap(n):
        order.append(n)
        return [square.rounds.ask("cheap", lambda numbers: numbers, i) for i in range(n)]

    found = square.rounds.run(
        {str(n): lambda n=n: (cheap(n), square(n, dear=True))[1] for n in (0, 2, 1)}, most=9
    )
    assert square.asked == [[0, 1, 2]]
    assert found == {"0": 0, "2": 4, "1": 1}
    assert order == [0, 2, 1]


def test_a_failure_stays_with_its_function_and_a_wrong_answer_with_all_who_asked():
    square = Squares()

    def fails():
        square(1)
        raise ValueError("mine")

    found = square.rounds.run({"good": lambda: square(3), "bad": fails}, most=2)
    assert found["good"] == 9
    assert isinstance(found["bad"], ValueError)
    found = square.rounds.run({"one": lambda: square("x"), "two": lambda: square(2)}, most=2)
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
        square.rounds.run({"stop": interrupted, "last": lambda: [waits(), waits()]}, most=2)
    assert threading.active_count() == threads
    assert ended
