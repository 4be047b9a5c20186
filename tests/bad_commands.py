# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad command lines of the package, the geometry scripts, a demo, studies and benchmarks."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from importlib import import_module
from typing import Any

from bad_input import Door, Row
from commands import loaded, spoken

from dolfinx_joints import cli


class ExitCode2(Exception):  # noqa: N818, a program's code and no exception
    """A program has ended with code 2 and one line on the standard error."""


def program(
    title: str, start: str, main: Callable[[], Callable[[list[str]], Any]], lines: dict[str, str]
) -> Door:
    """A program and its bad command lines.

    Args:
        title: its name.
        start: how a command line begins.
        main: gives what is called with the words of the line.
        lines: what is wrong, and the words after the start.
    """

    def row(kind: str, words: str) -> Row:
        def call() -> None:
            code, said = spoken(main(), shlex.split(words))
            if code == 2:
                raise ExitCode2(said.partition(": ")[2])

        return Row(kind, f"{start} {words}".strip(), call)

    return Door(title, ExitCode2, tuple(row(kind, words) for kind, words in lines.items()))


def geometry(name: str, lines: dict[str, str]) -> Door:
    """A script that makes a mesh."""
    path = f"geometry/{name}.py"
    return program(
        path,
        f"python3 {path}",
        lambda: import_module(f"geometry.{name}").main,
        {
            "unknown option": "--colour red",
            "shortened option": "--siz 1",
            "option without a value": "--size",
            "no number": "--size coarse",
            "not a number": "--size nan",
            "infinite": "--size inf",
            "zero": "--size 0",
            "negative": "--size -1",
            "unknown order": "--order 3",
            "order that is no number": "--order two",
            "no folder": "--out nowhere/dam.msh",
            "wrong suffix": "--out dam.vtk",
            **lines,
        },
    )


CELLS = {"unknown cell": "--cell prism"}
JOINTS = {"negative count": "--joints -1", "count that is none": "--joints 1.5"}
COMMAND = {
    "no command": "",
    "unknown command": "draw run.h5",
    "no file": "info",
    "no such file": "info none.h5",
    "empty name": "info ' '",
    "a folder": "info nowhere/",
    "unknown option": "info none.h5 --colour",
    "no folder for tables": "csv none.h5",
    "no such file for tables": "csv none.h5 --out tables",
    "no report": "report none.h5 --out report.pdf",
    "no such file for a report": "report none.h5",
    "nothing to report": "report",
}
STUDIES = {
    "demos/03_ambiesta.py": {
        "not a number": "--size nan",
        "zero": "--size 0",
        "no steps": "--steps 0",
        "unknown cell": "--cell prism",
        "unknown solver": "--solver magic",
        "unknown option": "--colour red",
        "out of range": "--active-height 1.5",
        "infinite": "--scale inf",
        "friction of a wall": "--friction 95",
    },
    "studies/follow_ups.py": {
        "no such case": "--only nothing",
        "no steps": "--steps 0",
        "negative": "--size -1",
        "no workers": "--workers 0",
        "unknown option": "--colour red",
    },
    "studies/paper.py": {
        "out of range": "--active-height 2",
        "no workers": "--workers none",
        "unknown option": "--colour red",
    },
    "studies/convergence.py": {"no workers": "--workers -1", "unknown option": "--colour red"},
    "studies/thermal_opening.py": {
        "not a number": "--cooling nan",
        "negative": "--cooling -8",
        "no steps": "--steps 0",
    },
    "studies/gravity_dams.py": {"unknown option": "--fast"},
    "benchmarks/jointed_wall.py": {
        "unknown mesh": "--mesh enormous",
        "no repetition": "--repeat 0",
        "unknown solver": "--solver magic",
    },
    "benchmarks/agreement.py": {"unknown scene": "--scenes moon", "no steps": "--steps 0"},
    "benchmarks/scaling.py": {"unknown series": "--series moon", "no ranks": "--ranks 0"},
}


def called(path: str) -> str:
    """How a program is called; studies are modules."""
    module = path.removesuffix(".py").replace("/", ".")
    return f"python3 -m {module}" if path.startswith("studies") else f"python3 {path}"


def doors() -> tuple[Door, ...]:
    """Every program."""
    several = {"two numbers": "--divisions 4 1", "no whole number": "--divisions 4 1 x"}
    heights = {
        "unknown section": "--section hoover",
        "no height": "--joint neck",
        "height that is none": "--joint neck=high",
        "not a height": "--joint neck=nan",
        "above the crest": "--joint neck=200",
        "one name twice": "--joint a=5 --joint a=9",
    }
    return (
        program("dolfinx-joints", "dolfinx-joints", lambda: cli.main, COMMAND),
        geometry("two_blocks", {**CELLS, "too steep": "--angle 80"}),
        geometry("jointed_wall", {**CELLS, **JOINTS, **several}),
        geometry("voussoir_arch", {**CELLS, **several, "none": "--voussoirs 0"}),
        geometry("inclined_crack", {**CELLS, "no growth": "--growth 1"}),
        geometry("gravity_dam", {**CELLS, **heights}),
        geometry("ambiesta", {**CELLS, **JOINTS, "out of range": "--active-height 0"}),
        *(
            program(path, called(path), lambda path=path: loaded(path).main, lines)
            for path, lines in STUDIES.items()
        ),
    )


DOORS = doors()
