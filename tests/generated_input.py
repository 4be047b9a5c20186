# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated input: how much of it each door gets, what a door may answer, and what was counted.

A door is a public function or class that takes something from outside: a file, a table, a
parameter. ``make test`` gives each a few inputs, ``make fuzz`` as many as ``CAMPAIGN`` says.
"""

from __future__ import annotations

import traceback
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, settings

CAMPAIGN = 10_000  # inputs per cheap door
SHARE_OF_COSTLY = 20  # a door that runs Gmsh or DOLFINx gets one input in so many
LONGEST_SENTENCE = 600
OWN_FOLDERS = tuple(str(Path(__file__).parents[1] / name) for name in ("dolfinx_joints", "geometry"))

# Derandomised: all ranks, and all machines with the same versions, get the same input.
_common = settings(
    derandomize=True,
    database=None,
    deadline=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
settings.register_profile("few", _common, max_examples=60)
settings.register_profile("campaign", _common, max_examples=CAMPAIGN)
settings.load_profile("few")

counts: dict[str, Counter[str]] = defaultdict(Counter)


def cheap() -> settings:
    """How many inputs a door gets that only computes in Python; a decorator below ``@given``."""
    return settings()


def costly() -> settings:
    """How many inputs a door gets that runs Gmsh or DOLFINx; a decorator below ``@given``."""
    return settings(max_examples=max(settings().max_examples // SHARE_OF_COSTLY, 1))


def answer(
    door: str,
    call: Callable[[], Any],
    refusals: type[Exception] | tuple[type[Exception], ...] = ValueError,
    comm: Any = None,
) -> Any:
    """What a door makes of one input, or None where it refuses it; counted under its name.

    A refusal is one sentence, raised by a ``raise`` of the package, not by a library below it.

    Args:
        door: name of the door, for the counts.
        call: hands the input to the door.
        refusals: what the door may raise; the package's own errors for input are ValueErrors.
        comm: ranks that must all get the same answer.

    Raises:
        AssertionError: the refusal is not one of the package's, not one sentence, or ranks differ.
    """
    refused, made = "", None
    try:
        made = call()
    except refusals as refusal:
        refused = _sentence(door, refusal)
    counts[door]["refused" if refused else "taken"] += 1
    if comm is not None and comm.size > 1:
        assert len(set(comm.allgather(refused))) == 1, f"{door}: ranks differ, here {refused!r}"
    return made


def _sentence(door: str, refusal: Exception) -> str:
    """What a door has said, which must be a sentence of the package's own."""
    refused, text = f"{type(refusal).__name__}: {refusal}", str(refusal)
    last = traceback.extract_tb(refusal.__traceback__)[-1]
    assert last.filename.startswith(OWN_FOLDERS), f"{door}: {refused} is from {last.filename}"
    # What C code raises, that of int() or NumPy, is raised by the line that calls it.
    assert (last.line or "").startswith("raise "), f"{door}: {refused} is from {last.line!r}"
    assert text.strip(), f"{door}: {refused!r}"
    assert "\n" not in text, f"{door}: {refused!r}"
    assert len(text) <= LONGEST_SENTENCE, f"{door}: {refused}"
    return refused


def report() -> list[str]:
    """Lines with what each door was given: inputs, taken, refused."""
    lines = [f"{'door':<44}{'inputs':>8}{'taken':>8}{'refused':>9}"]
    for door, count in sorted(counts.items()):
        lines.append(f"{door:<44}{count.total():>8}{count['taken']:>8}{count['refused']:>9}")
    return lines
