# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Good files changed at random, and what never was one."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import note
from hypothesis import strategies as st

SEEDS = st.integers(0, 2**64 - 1)
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+)?")
# What is no number, or one that a careless reader takes for another.
TOKENS = (
    *("nan", "inf", "-inf", "1e999", "-1", "0", "-0", "1e-320", "5e-324", "1e308", "1.8e308"),
    *("9" * 18, "9" * 40, "18446744073709551616", "2147483648", "-2147483649", "1_0", "0x10"),
    *(
        "1,5",
        "1.2.3",
        "--1",
        "1e",
        "1d5",
        "+",
        "",
        " ",
        "None",
        "True",
        "²",
        "٣",
        "１",
        "é",
        "\x00",
    ),
    *("a" * 200, "1" * 500, "1e5", "0.5", "2", "3", "1000000", "%s%n", "{0}", "\\", '"', "''", "#"),
)
ENDINGS = ("\r\n", "\r", "\n\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", " \n", "\t\n", "\x00")


def _other_number(rng: random.Random, text: str) -> str:
    """One number becomes another, or no number; in files of fixed widths as wide, at times."""
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    # Headers come first, and are what a reader has to believe.
    place = found[rng.randrange(min(len(found), rng.choice((10, 80, len(found)))))]
    token = rng.choice(TOKENS) if rng.random() < 0.8 else str(rng.randint(-20, 200))
    if rng.random() < 0.5:
        token = token[: len(place[0])].rjust(len(place[0]))
    return text[: place.start()] + token + text[place.end() :]


def _other_word(rng: random.Random, text: str) -> str:
    words = list(re.finditer(r"\S+", text))
    if not words:
        return text
    place = words[rng.randrange(min(len(words), rng.choice((20, len(words)))))]
    return text[: place.start()] + rng.choice(TOKENS) + text[place.end() :]


def _empty_field(rng: random.Random, text: str) -> str:
    found = list(re.finditer(r"(?<=[,:=(])[^,:=()\n]+", text))
    if not found:
        return text
    place = rng.choice(found)
    return text[: place.start()] + text[place.end() :]


def _of_lines(rng: random.Random, text: str) -> str:
    """Lines dropped, doubled, swapped, joined or put elsewhere."""
    lines = text.split("\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[i : i + rng.choice((1, 1, 1, 5))]
        case 1:
            lines[i:i] = lines[i : i + 1] * rng.choice((1, 1, 3))
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i : i + 2] = ["".join(lines[i : i + 2])]
        case 4:
            lines.insert(j, lines.pop(i))
    return "\n".join(lines)


def _other_endings(rng: random.Random, text: str) -> str:
    return text.replace("\n", rng.choice(ENDINGS), rng.choice((-1, 1, 3)))


def _truncated(rng: random.Random, text: str) -> str:
    return text[: rng.randrange(len(text) + 1)]


def _inserted(rng: random.Random, text: str) -> str:
    place = rng.randrange(len(text) + 1)
    return text[:place] + rng.choice((*TOKENS, *ENDINGS, "\ufeff", ",", "\t")) + text[place:]


def _bytes_of(rng: random.Random, content: bytes) -> bytes:
    """Bytes flipped, set, left out or repeated."""
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if not changed:
            break
        place = rng.randrange(len(changed))
        match rng.randrange(5):
            case 0:
                changed[place] ^= 1 << rng.randrange(8)
            case 1:
                changed[place] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
            case 2:
                del changed[place : place + rng.choice((1, 4, 64))]
            case 3:
                changed[place:place] = changed[place : place + rng.choice((1, 8, 64))]
            case 4:
                changed[place : place + 8] = rng.choice((b"\xff", b"\0", b"\x7f")) * 8
    return bytes(changed)


_OF_TEXT: tuple[Callable[[random.Random, str], str], ...] = (
    *(_other_number,) * 4,
    _other_word,
    _empty_field,
    *(_of_lines,) * 2,
    _other_endings,
    _truncated,
    _inserted,
)


def changed_text(seed: int, good: str, others: Sequence[str] = ()) -> bytes:
    """A good text file with 1 to 3 changes, at times with the end of another file as its own."""
    rng, text = random.Random(seed), good
    if others and rng.random() < 0.05:
        other = rng.choice(others)
        text = text[: rng.randrange(len(text))] + other[rng.randrange(len(other)) :]
    for _ in range(rng.choice((1, 1, 2, 3))):
        text = rng.choice(_OF_TEXT)(rng, text)
    content = text.encode(rng.choice(("utf-8", "utf-8", "utf-8-sig", "latin-1")), "replace")
    return shown(_bytes_of(rng, content) if rng.random() < 0.15 else content)


def changed_bytes(seed: int, good: bytes) -> bytes:
    """A good file of any kind with some of its bytes changed, or cut off."""
    rng = random.Random(seed)
    content = good[: rng.randrange(len(good) + 1)] if rng.random() < 0.1 else good
    return shown(_bytes_of(rng, content))


def mostly(good: Sequence[Any], others: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """One of the good values, or else anything."""
    return st.booleans().flatmap(lambda is_good: st.sampled_from(good) if is_good else others)


def shown(content: bytes) -> bytes:
    """The same, told where a test fails."""
    note(content)
    return content


def junk(seed: int, good: str | bytes) -> bytes:
    """Bytes or text of no kind, at times after the start of a good file."""
    rng = random.Random(seed)
    start = good.encode() if isinstance(good, str) else good
    head = start[: rng.choice((0, 0, 8, 60, len(start) // 2))]
    match rng.randrange(3):
        case 0:
            body = rng.randbytes(rng.choice((0, 1, 20, 300)))
        case 1:
            points = (rng.randrange(rng.choice((128, 0xD800))) for _ in range(rng.randrange(100)))
            body = "".join(map(chr, points)).encode()
        case _:
            words = (*TOKENS, *ENDINGS, "1 2 3\n", "# x\n", "$", "\n", " ", ",")
            body = "".join(rng.choices(words, k=rng.randrange(30))).encode()
    return shown(head + body)
