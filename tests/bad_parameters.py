# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is said of bad parameters of every kind at every door, and the page that lists it.

./with-dolfinx python3 tests/bad_parameters.py docs/bad_parameters.md
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from pathlib import Path

from bad_input import Door, Row

# Every module beside this one that has doors.
_NAMES = sorted(path.stem for path in Path(__file__).parent.glob("bad_*.py"))
_MODULES = [import_module(name) for name in _NAMES if name != Path(__file__).stem]
DOORS: tuple[Door, ...] = tuple(
    door for module in _MODULES for door in getattr(module, "DOORS", ())
)


@cache
def refusal(row: Row) -> tuple[type[Exception] | None, str]:
    """Type and sentence that bad input is refused with, None and an empty one where it is taken."""
    try:
        row.call()
    except Exception as error:
        return type(error), str(error)
    return None, ""


def page() -> str:
    """The page of all refusals, in Markdown."""
    lines = ["# Bad parameters", ""]
    lines += [
        "What is said of parameters of every bad kind: one sentence, in an exception of the type "
        "named or of one made from it. On several ranks all of them get the same one. The other "
        "parameters are good ones. What a function of the user's own raises is passed on as it is.",
        "",
        "This page is written by "
        "`./with-dolfinx python3 tests/bad_parameters.py docs/bad_parameters.md`, and "
        "`tests/test_bad_parameters.py` compares it with what is said. "
        "[Malformed files](bad_files.md) have a page of their own.",
    ]
    for door in DOORS:
        lines += ["", f"## {door.title}", "", f"`{door.error.__name__}`", ""]
        lines += ["| kind | given | what is said |", "|---|---|---|"]
        lines += [
            f"| {row.kind} | {_code(row.given)} | {_code(refusal(row)[1])} |" for row in door.rows
        ]
    return "\n".join(lines) + "\n"


def _code(text: str) -> str:
    """Text as code in a cell of a table."""
    return f"`` {text} ``".replace("|", "\\|") if "`" in text else f"`{text}`".replace("|", "\\|")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
