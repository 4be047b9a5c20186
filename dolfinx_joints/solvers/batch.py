# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of one model side by side: they share factors, and solve with them in blocks."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, TypeVar

Made = TypeVar("Made")


class SharedBulk:
    """Keeps what the first of several runs has made for the others.

    A `MatrixSystem` that has one as ``shared`` takes its factors from there, and solves with them
    in blocks of all runs that wait for a solution. All runs must be of one model.

    Attributes:
        rounds: Runs them side by side.
        lowest_modes: Modes by number, see `MatrixSystem.lowest_modes`.
    """

    def __init__(self) -> None:
        """Begin with an empty store."""
        self.rounds = Rounds()
        self.lowest_modes: dict[int, Any] = {}
        self._made: dict[Hashable, Any] = {}
        self._free = ExitStack()

    def once(
        self, key: Hashable, make: Callable[[], Made], free: Callable[[Made], None] | None = None
    ) -> Made:
        """Return the object of a key, made if it is missing (collective).

        Args:
            key: Name of the object.
            make: Makes it.
            free: Frees it when all runs have ended.
        """
        if key not in self._made:
            self._made[key] = made = make()
            if free is not None:
                self._free.callback(free, made)
        found: Made = self._made[key]
        return found

    def destroy(self) -> None:
        """Free all of it, the last first."""
        self._made.clear()
        self._free.close()


class Rounds:
    """Runs functions in turns.

    Each has a thread of its own, but only one of them runs at any time: until it asks or ends. When
    all wait, what most of them ask is answered for all who ask it, in one call; what is dear to
    answer only when nobody asks anything else. The order follows from the questions alone, so that
    it is the same on all ranks.
    """

    def __init__(self) -> None:
        """Nothing runs yet."""
        self._back = threading.Semaphore(0)
        self._current: _Turn | None = None
        self._abandoned = False

    def run(
        self, functions: Mapping[str, Callable[[], Any]], most: int
    ) -> dict[str, Any | Exception]:
        """What each function returns or raises; what is no `Exception` ends all of them.

        Args:
            functions: By name, begun in this order.
            most: Functions that run at once; others begin when one has ended.
        """
        turns = {name: _Turn(function, self._back) for name, function in functions.items()}
        begin = deque(turns.values())
        ready = deque(begin.popleft() for _ in range(min(most, len(begin))))
        asked: dict[Hashable, list[_Turn]] = {}
        try:
            while ready or asked:
                while ready:
                    turn = ready.popleft()
                    self._let(turn)
                    if turn.interruption is not None:
                        raise turn.interruption
                    if not turn.ended:
                        asked.setdefault(turn.key, []).append(turn)
                    elif begin:
                        ready.append(begin.popleft())
                if asked:
                    together = asked.pop(
                        max(asked, key=lambda key: (not asked[key][0].dear, len(asked[key])))
                    )
                    _answer(together)
                    ready.extend(together)
        finally:
            self._abandon(turns.values())
        return {name: turn.result for name, turn in turns.items()}

    def ask(
        self,
        key: Hashable,
        answer: Callable[[list[Any]], Sequence[Any]],
        question: Any,
        *,
        dear: bool = False,
    ) -> Any:
        """The answer to a question, from within a function that runs; alone it is answered at once.

        Args:
            key: What questions have in common that are answered together.
            answer: Answers such questions.
            question: The question.
            dear: Whether it can wait for others that may come to ask the same.
        """
        turn = self._current
        if turn is None:
            return answer([question])[0]
        turn.key, turn.answer, turn.question, turn.dear = key, answer, question, dear
        self._back.release()
        turn.go.acquire()
        if self._abandoned:
            raise _Abandoned
        if turn.failure is not None:
            failure, turn.failure = turn.failure, None
            raise failure
        return turn.question

    def _let(self, turn: _Turn) -> None:
        """Let a function run until it asks or ends."""
        self._current = turn
        turn.let()
        self._back.acquire()
        self._current = None

    def _abandon(self, turns: Any) -> None:
        """End the threads of functions that have not ended, after an interruption."""
        self._abandoned = True
        for turn in turns:
            turn.end()
        self._abandoned = False


class _Abandoned(BaseException):
    """Ends a function whose answer nobody waits for."""


class _Turn:
    """A function, its thread, and what it asks."""

    def __init__(self, function: Callable[[], Any], back: threading.Semaphore) -> None:
        self._function, self._back = function, back
        self.go = threading.Semaphore(0)
        self.ended = False
        self.key: Hashable = None
        self.dear = False
        self.answer: Callable[[list[Any]], Sequence[Any]]
        self.question: Any = None  # then the answer
        self.failure: Exception | None = None
        self.result: Any = None
        self.interruption: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def let(self) -> None:
        if self._thread.is_alive():
            self.go.release()
        else:
            self._thread.start()

    def end(self) -> None:
        if self._thread.is_alive():
            self.go.release()
            self._thread.join()

    def _run(self) -> None:
        try:
            self.result = self._function()
        except Exception as failure:
            self.result = failure
        except _Abandoned:
            pass
        except BaseException as interruption:
            self.interruption = interruption
        self.ended = True
        self._back.release()


def _answer(turns: Sequence[_Turn]) -> None:
    """Answer what turns ask alike; a failure is raised where each of them asked."""
    try:
        answers = turns[0].answer([turn.question for turn in turns])
    except Exception as failure:
        for turn in turns:
            turn.failure = failure
    else:
        for turn, answer in zip(turns, answers, strict=True):
            turn.question = answer
