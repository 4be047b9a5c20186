# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Concurrent runs of one model that share factors and solve for several right-hand sides."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, TypeVar

Made = TypeVar("Made")


class SharedBulk:
    """Factors and compliances that several runs of one model share.

    A `MatrixSystem` whose attribute ``shared`` is this object uses these factors. One block solve
    then serves all runs that wait for a solution.

    Attributes:
        scheduler: Scheduler of the runs.
        lowest_modes: Modes by number, see `MatrixSystem.lowest_modes`.
    """

    def __init__(self) -> None:
        self.scheduler = BatchScheduler()
        self.lowest_modes: dict[int, Any] = {}
        self._made: dict[Hashable, Any] = {}
        self._free = ExitStack()

    def once(
        self, key: Hashable, make: Callable[[], Made], free: Callable[[Made], None] | None = None
    ) -> Made:
        """Return the object of a key; make the object on the first call (collective).

        Args:
            key: Name of the object.
            make: Function that makes the object.
            free: Function that frees the object when all runs have ended.
        """
        if key not in self._made:
            self._made[key] = made = make()
            if free is not None:
                self._free.callback(free, made)
        result: Made = self._made[key]
        return result

    def destroy(self) -> None:
        """Free all objects in reverse order."""
        self._made.clear()
        self._free.close()


class BatchScheduler:
    """Cooperative scheduler that batches identical requests from several concurrent runs.

    Each run has a separate thread. Only one thread is active at a time, until it makes a request or
    ends. When all runs wait, one call computes the most frequent request for all runs that made it;
    deferrable requests come last. The order depends only on the requests, so all ranks have the
    same order.
    """

    def __init__(self) -> None:
        self._back = threading.Semaphore(0)
        self._current: _Run | None = None
        self._abandoned = False

    def run(
        self, functions: Mapping[str, Callable[[], Any]], at_once: int
    ) -> dict[str, Any | Exception]:
        """Return the result or the `Exception` of each function; other exceptions end all runs.

        Args:
            functions: Functions by name, started in this order.
            at_once: Largest number of concurrent functions; one ends, the next one starts.
        """
        runs = {name: _Run(function, self._back) for name, function in functions.items()}
        begin = deque(runs.values())
        ready = deque(begin.popleft() for _ in range(min(at_once, len(begin))))
        waiting: dict[Hashable, list[_Run]] = {}
        try:
            while ready or waiting:
                while ready:
                    run = ready.popleft()
                    self._resume(run)
                    if run.interruption is not None:
                        raise run.interruption
                    if not run.ended:
                        waiting.setdefault(run.key, []).append(run)
                    elif begin:
                        ready.append(begin.popleft())
                if waiting:
                    batch = waiting.pop(
                        max(waiting, key=lambda k: (not waiting[k][0].deferrable, len(waiting[k])))
                    )
                    _compute(batch)
                    ready.extend(batch)
        finally:
            self._abandon(runs.values())
        return {name: run.result for name, run in runs.items()}

    def request(
        self,
        key: Hashable,
        compute: Callable[[list[Any]], Sequence[Any]],
        argument: Any,
        *,
        deferrable: bool = False,
    ) -> Any:
        """Return the result of a request; outside of a run, compute the result at once.

        Args:
            key: Key; requests with equal keys are computed together.
            compute: Function that computes the results of several arguments.
            argument: Argument of this request.
            deferrable: True if the request may wait, to be batched with later ones.
        """
        run = self._current
        if run is None:
            return compute([argument])[0]
        run.key, run.compute, run.argument, run.deferrable = key, compute, argument, deferrable
        self._back.release()
        run.go.acquire()
        if self._abandoned:
            raise _Abandoned
        if run.failure is not None:
            failure, run.failure = run.failure, None
            raise failure
        return run.argument

    def _resume(self, run: _Run) -> None:
        """Let a run continue until it makes a request or ends."""
        self._current = run
        run.resume()
        self._back.acquire()
        self._current = None

    def _abandon(self, runs: Any) -> None:
        """End the threads of all runs, after an interruption."""
        self._abandoned = True
        for run in runs:
            run.end()
        self._abandoned = False


class _Abandoned(BaseException):
    """Raised in an abandoned run to end its thread."""


class _Run:
    """A function, its thread, and its current request."""

    def __init__(self, function: Callable[[], Any], back: threading.Semaphore) -> None:
        self._function, self._back = function, back
        self.go = threading.Semaphore(0)
        self.ended = False
        self.key: Hashable = None
        self.deferrable = False
        self.compute: Callable[[list[Any]], Sequence[Any]]
        self.argument: Any = None  # replaced by the result
        self.failure: Exception | None = None
        self.result: Any = None
        self.interruption: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def resume(self) -> None:
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


def _compute(runs: Sequence[_Run]) -> None:
    """Compute the request of a batch of runs; pass a failure on to each run."""
    try:
        results = runs[0].compute([run.argument for run in runs])
    except Exception as failure:
        for run in runs:
            run.failure = failure
    else:
        for run, result in zip(runs, results, strict=True):
            run.argument = result
