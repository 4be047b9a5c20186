#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether runs with checkpoints survive signal 9 at any moment, and end as one left alone.

A small dam with joints is shaken by a script that writes states of the results file and
checkpoints at every second step (`_killed_job.py`). It is killed, on several ranks all processes
at once, started again, killed again, until it ends. A third of the moments are drawn from the time
that a whole run takes, a third from the steps that are left, and a third hit inside a write or a
short part of the start-up. While the run lives its results file is opened now and then: what it
shows must be the first records of the run left alone. The finished results file and the last
checkpoint are compared with those of that run: bit by bit on one rank, to 1e-10 of the largest
entry on several.

A line for each kill says what it hit, where the run stood and how much had to be computed again.
Exit status 1 if a run could not be continued or ended otherwise.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import sys
import time as clock
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks._killed_job import PHASES, Trace
from benchmarks._processes import POLL, Process, Starter, kill
from benchmarks._same_files import DamagedError, checkpoint, content, difference, records, scales
from dolfinx_joints import Results, ResultsError

BOUND = 1e-10  # on several ranks, of the largest entry
START_UP = PHASES[: PHASES.index("step")]
AIMS = ("results written", "checkpoint written", "records", "statics", "results begun")
AIMS_CONTINUED = ("results written", "checkpoint written", "records", "results copied")
WITHIN = 0.004  # seconds after a write has begun in which an aimed kill hits
LOOK = 0.5  # seconds between two looks at the results file


@dataclass(kw_only=True)
class Kill:
    """What a kill met.

    Attributes:
        run: Number of the run that was killed.
        ranks: Its processes.
        seconds: Time from its start [s].
        aim: What it waited for.
        phase: What the run was doing.
        computed: Last step that the run had recorded, -1 before its dynamic stage.
        on_disk: Last step that the results file holds, -1 without one.
        kept: Step of the checkpoint, -1 without one.
        resumed: Step that the run went on from, 0 if it began anew.
        identical: Whether it ended as the run left alone, in the end.
    """

    run: int
    ranks: int
    seconds: float
    aim: str
    phase: str
    computed: int
    on_disk: int
    kept: int
    resumed: int | None = None
    identical: bool | None = None

    @property
    def again(self) -> int | None:
        """Steps that had to be computed again, None if it was not gone on from."""
        return None if self.resumed is None else max(self.computed - self.resumed, 0)

    def __str__(self) -> str:
        """A line of the log."""
        return (
            f"run {self.run:3d} on {self.ranks}: {self.seconds:6.2f} s, {self.phase:18}"
            f" step {self.computed:4d}, on disk {self.on_disk:4d}, checkpoint {self.kept:4d},"
            f" resumed from {self.resumed!s:>4}, {self.again} again, "
            + {True: "identical", False: "NOT IDENTICAL", None: "NOT CONTINUED"}[self.identical]
        )


class Whole:
    """A run that is left alone, and what later ones are compared with.

    Args:
        folder: Where it runs.
        starter: Starts it.
    """

    def __init__(self, folder: Path, starter: Starter) -> None:
        """Run twice, as the first time compiles what later runs find; the second is timed."""
        self.ranks, self.steps, self.start = starter.ranks, starter.steps, starter.start
        for _ in range(2):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            began = clock.perf_counter()
            process = self.start(folder)
            process.wait()
            self.seconds = clock.perf_counter() - began
            if process.returncode:
                raise SystemExit(f"kills: the run left alone failed.\n{said(folder)}")
        self.content = content(folder / "run.h5")
        self._checkpoint = checkpoint(folder / "run.ckpt")
        self._scale = scales(self.content)

    def compare(self, folder: Path) -> float:
        """Largest relative difference of a finished run; 0 if all bits are the same."""
        results = difference(content(folder / "run.h5"), self.content, self._scale)
        kept = checkpoint(folder / "run.ckpt")
        return max(results, difference(kept, self._checkpoint, scales(self._checkpoint)))

    def compare_begun(self, path: Path) -> int:
        """Last step of a results file, whose records must be the first ones of the run.

        Raises:
            DamagedError: They are not.
        """
        with Results(path) as results:
            found = records(results)
        expected = {name: self.content[name][: len(value)] for name, value in found.items()}
        off = difference(found, expected, self._scale)
        if off > (BOUND if self.ranks > 1 else 0.0):
            raise DamagedError(f"{path.name}, not finished, differs by {off:.1e}")
        return len(found["histories/time"]) - 1


def said(folder: Path) -> str:
    """What the last process of a run wrote on its error stream."""
    return (folder / "said").read_text(errors="replace")[-2000:]


@dataclass(frozen=True, kw_only=True)
class Moment:
    """When a run is killed.

    Attributes:
        seconds: Not before so long a time from its start [s].
        step: Not before this step was recorded.
        phase: Not before it does this; None for anything.
        then: So much later [s].
    """

    seconds: float = 0.0
    step: int = -1
    phase: str | None = None
    then: float = 0.0

    @property
    def name(self) -> str:
        """What is waited for."""
        return self.phase or (f"step {self.step}" if self.step >= 0 else "a time")

    def has_come(self, trace: Trace, seconds: float) -> bool:
        """Whether it is there, but for ``then``."""
        there = trace.step >= self.step and self.phase in (None, trace.phase)
        return there and seconds >= self.seconds


class Campaign:
    """Kills runs and looks at what is left.

    Args:
        folder: Where they run.
        whole: The run left alone.
        chance: Draws the moments.
    """

    def __init__(self, folder: Path, whole: Whole, chance: random.Random) -> None:
        """No run is started yet."""
        self._folder, self._whole, self._chance = folder, whole, chance
        self.kills: list[Kill] = []
        self.looks = 0
        self.lost: list[str] = []

    def run(self, wanted: int) -> None:
        """Kill so many times; every run that was begun is also finished."""
        number = 0
        while len(self.kills) < wanted:
            number += 1
            folder = self._folder / f"{self._whole.ranks}_{number}"
            folder.mkdir()
            first = len(self.kills)
            try:
                self._finish(folder, number, wanted)
                off = self._whole.compare(folder)
                identical = off <= (BOUND if self._whole.ranks > 1 else 0.0)
                problem = None if identical else f"differs by {off:.1e}"
            except (DamagedError, ResultsError, OSError, KeyError) as error:
                identical, problem = False, f"{type(error).__name__}: {error}"
            for each in self.kills[first:]:
                each.identical = identical and each.resumed is not None
                print(each, flush=True)
            if problem is not None:
                self.lost.append(f"run {number} on {self._whole.ranks}: {problem}")
                print(f"LOST, {self.lost[-1]}\n{said(folder)}", flush=True)
            else:
                shutil.rmtree(folder)

    def _finish(self, folder: Path, number: int, wanted: int) -> None:
        """Start a run again and again until it ends."""
        waiting: list[Kill] = []  # not yet gone on from
        kept = -1
        while True:
            process = self._whole.start(folder)
            trace = Trace(folder / "trace")
            may = len(self.kills) < wanted
            try:
                met = self._watch(folder, process, trace, kept) if may else None
                if met is None:
                    process.wait()
            finally:
                if process.poll() is None:
                    kill(process)
            if trace.first >= 0:
                for each in waiting:
                    each.resumed = trace.first
                if trace.first != max(kept, 0):
                    raise DamagedError(f"went on from step {trace.first}, not from {kept}")
                waiting.clear()
            if met is None:
                if process.returncode:
                    raise DamagedError(f"could not be continued, status {process.returncode}")
                return
            met.run = number
            met.kept = kept = self._step_kept(folder)
            met.on_disk = self._look(folder, kept)
            self.kills.append(met)
            waiting.append(met)

    def _watch(self, folder: Path, process: Process, trace: Trace, kept: int) -> Kill | None:
        """Let the run go until its moment, and kill it; None if it ended before."""
        began, looked = clock.perf_counter(), 0.0
        moment = self._moment(kept)
        while not moment.has_come(trace, clock.perf_counter() - began):
            if process.poll() is not None:
                return None
            # Looking takes longer than a write: not while one is waited for.
            if moment.phase is None and clock.perf_counter() > looked + LOOK:
                self._look(folder, kept)
                looked = clock.perf_counter()
            clock.sleep(POLL)
        clock.sleep(moment.then)
        if process.poll() is not None:
            return None
        seconds = clock.perf_counter() - began
        kill(process)
        if process.returncode == 0:
            return None
        return Kill(
            run=0,
            ranks=self._whole.ranks,
            seconds=seconds,
            aim=moment.name,
            phase=trace.phase,
            computed=trace.step,
            on_disk=-1,
            kept=-1,
        )

    def _moment(self, kept: int) -> Moment:
        """When to kill; a third each by the time, by the step and in a phase."""
        chance, steps = self._chance, self._whole.steps
        begun = min(max(kept, 0), steps - 1)
        kind = chance.choice(("time", "step", "phase"))
        if kind == "time":
            return Moment(seconds=chance.random() * self._whole.seconds)
        if kind == "step":
            within = 2.0 * chance.random() * self._whole.seconds / steps
            return Moment(step=chance.randint(begun, steps - 1), then=within)
        phase = chance.choice(AIMS if kept < 0 else AIMS_CONTINUED)
        first = -1 if phase in START_UP else chance.randint(begun, steps - 1)
        return Moment(step=first, phase=phase, then=WITHIN * chance.random())

    def _look(self, folder: Path, kept: int) -> int:
        """Last step that the results file shows, -1 if there is none yet.

        Args:
            folder: Of the run.
            kept: Step of its checkpoint when it was last dead, -1 without one: from then on there
                is a results file at every moment, which goes at least so far.

        Raises:
            DamagedError: The file is not the first part of the whole run's.
        """
        self.looks += 1
        try:
            last = self._whole.compare_begun(folder / "run.h5")
        except ResultsError as error:
            if kept < 0:
                return -1
            raise DamagedError(f"beside a checkpoint of step {kept}: {error}") from error
        if last < kept:
            raise DamagedError(f"results end at step {last}, the checkpoint is of step {kept}")
        return last

    @staticmethod
    def _step_kept(folder: Path) -> int:
        path = folder / "run.ckpt"
        return int(checkpoint(path)["memory/step"]) if path.exists() else -1


def print_table(campaigns: list[Campaign]) -> dict[str, Any]:
    """What all kills came to; the same as numbers."""
    kills = [each for campaign in campaigns for each in campaign.kills]
    ranks = sorted({each.ranks for each in kills})
    print(f"\n{'what was hit':20}" + "".join(f"{f'{n} ranks':>9}" for n in ranks))
    for phase in PHASES:
        counts = [sum(k.phase == phase and k.ranks == n for k in kills) for n in ranks]
        if any(counts):
            print(f"{phase:20}" + "".join(f"{count:9d}" for count in counts))
    again = Counter(k.again for k in kills if k.again is not None)
    found = {
        "kills": len(kills),
        "on_several_ranks": sum(k.ranks > 1 for k in kills),
        "resumed": sum(k.resumed is not None for k in kills),
        "identical": sum(k.identical is True for k in kills),
        "lost": sum(len(campaign.lost) for campaign in campaigns),
        "looks": sum(campaign.looks for campaign in campaigns),
        "phases": Counter(k.phase for k in kills),
        "steps_again": {str(steps): again[steps] for steps in sorted(again)},
    }
    print(
        f"\n{found['kills']} kills, {found['on_several_ranks']} of them on several ranks: "
        f"{found['resumed']} gone on from, {found['identical']} identical in the end, "
        f"{found['lost']} lost; {found['looks']} looks at results files.\nSteps to be computed "
        "again: " + ", ".join(f"{k} after {n} kills" for k, n in found["steps_again"].items())
    )
    return found


def main(arguments: list[str] | None = None) -> int:
    """Kill, print, and return 1 if a run was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=165, help="on one rank")
    parser.add_argument("--rank-kills", type=int, default=35, help="on several ranks")
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="3 kills on one rank, 40 steps")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args(sys.argv[1:] if arguments is None else arguments)
    if options.quick:
        options.kills, options.rank_kills, options.steps = 3, 0, 40
    campaigns = []
    with TemporaryDirectory() as folder:
        for ranks, kills in ((1, options.kills), (options.ranks, options.rank_kills)):
            if not kills:
                continue
            starter = Starter(ranks, options.steps)
            whole = Whole(Path(folder) / f"whole_{ranks}", starter)
            print(f"A run of {options.steps} steps on {ranks} takes {whole.seconds:.1f} s.")
            campaign = Campaign(Path(folder), whole, random.Random(options.seed + ranks))
            campaign.run(kills)
            campaigns.append(campaign)
            starter.close()
    found = print_table(campaigns)
    if options.json:
        kills = (each for campaign in campaigns for each in campaign.kills)
        every = [{**asdict(each), "again": each.again} for each in kills]
        print(json.dumps({**found, "log": every}))
    return int(found["lost"] > 0 or found["identical"] < found["kills"])


if __name__ == "__main__":
    raise SystemExit(main())
