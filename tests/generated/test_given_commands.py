# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command lines of the package, the geometry scripts, a demo, the studies and the benchmarks."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from commands import loaded, spoken
from generated_input import LONGEST_SENTENCE, costly, counts
from hypothesis import given
from hypothesis import strategies as st
from test_sections import CYLINDER, write
from test_step import BOXES, write_step

pytest.importorskip("dolfinx")
gmsh = pytest.importorskip("gmsh")

from dolfinx_joints import cli
from dolfinx_joints.common.command_line import Parser  # noqa: E402
from dolfinx_joints.results.reader import Results  # noqa: E402

# Numbers, names and files that some of the options take, and others do not.
NUMBERS = ("0", "1", "2", "3", "12", "20", "0.5", "-1", "nan", "inf", "-inf", "1e300", "1e-300")
TEXTS = (
    "1_0",
    "0x1",
    "\u0663",
    "hex",
    "tet",
    "quad",
    "ec",
    "a=5",
    "a=nan",
    "=",
    "a,b",
    "",
    " ",
    "--",
)
ODD = ("-", "-x", "\n", "a\nb", "x" * 3000, "no/file", "out", "\ud800", "RUN", "STEP", "9" * 400)
inside = st.text(max_size=6).filter(lambda text: not text.startswith(("/", "..", "~")))
values = st.sampled_from((*NUMBERS, *TEXTS, *ODD)) | inside


class Started(Exception):  # noqa: N818, no error
    """Options were taken; what they ask for would take long."""


def stop(*_: Any, **__: Any) -> None:
    raise Started


def line(door: str, main: Callable[[list[str]], Any], words: list[str]) -> None:
    """Run a command: refused by code 2 and one line, or taken."""
    try:
        code, said = spoken(main, words)
    except Started:
        code, said = 0, ""
    if code == 2:
        assert said.endswith("."), f"{door}: {said!r}"
        assert "\n" not in said, f"{door}: {said!r}"
        assert len(said) <= LONGEST_SENTENCE, f"{door}: {said!r}"
    else:
        assert not isinstance(code, int) or code == 0, f"{door}: {code}"
    counts[door]["refused" if code == 2 else "taken"] += 1


def words(flags: dict[str, int], starts: tuple[str, ...] = ("",)) -> st.SearchStrategy[list[str]]:
    """Words of a command line: a start, flags with as many values as they take, and others."""

    def with_values(flag: str) -> st.SearchStrategy[list[str]]:
        count = flags[flag]
        return st.lists(values, min_size=count, max_size=count).map(lambda v: [flag, *v])

    part = st.sampled_from(sorted(flags)).flatmap(with_values)
    parts = st.lists(part | part | st.lists(values, max_size=1), max_size=3)
    start = st.sampled_from(starts).map(str.split)
    return st.builds(lambda first, rest: sum(rest, first), start, parts)


COMMANDS = {"info": 1, "csv": 1, "report": 1, "--out": 1, "--force": 0, "--all": 0, "--no-3d": 0}
COMMANDS |= {"--help": 0, "--version": 0}
STARTS = ("info RUN", "info RUN --all", "csv RUN --out out", "report RUN --no-3d", "info none.h5")


@costly()
@given(given_words=words(COMMANDS, (*STARTS, "")))
def test_the_command(
    folder: Path,
    results: Results,
    given_words: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("dolfinx_joints.report.report.pairs", stop)
    named = [str(results.path) if word == "RUN" else word for word in given_words]
    line("dolfinx-joints", cli.main, named)
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


SCRIPTS = ("two_blocks", "jointed_wall", "voussoir_arch", "inclined_crack", "gravity_dam")
SCRIPTS += ("ambiesta", "sections_dam", "from_step")
STARTS_OF = {
    "from_step": ["STEP", "--size", "4"],
    "sections_dam": ["TABLE", "--size", "20", "--order", "1"],
    "ambiesta": ["--size", "20", "--order", "1"],
}
FLAGS = dict.fromkeys(("--size", "--order", "--cell", "--length", "--height", "--angle"), 1)
FLAGS |= dict.fromkeys(("--joints", "--width", "--layers", "--thickness", "--section"), 1)
FLAGS |= dict.fromkeys(("--joint", "--tied", "--surface", "--solid", "--active-height"), 1)
FLAGS |= {"--divisions": 3, "--joint-angles": 2, "--perimetral": 0, "--foundation": 1}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Files that scripts read, by the word that stands for them."""
    folder = tmp_path_factory.mktemp("inputs")
    table = write(folder, CYLINDER)
    return {"STEP": str(write_step(folder / "pier.step", BOXES)), "TABLE": str(table)}


@pytest.mark.parametrize("name", SCRIPTS)
@costly()
@given(given_words=words(FLAGS))
def test_scripts_of_geometry(
    name: str,
    folder: Path,
    inputs: dict[str, str],
    given_words: list[str],
    small_meshes: None,
) -> None:
    named = [inputs.get(word, word) for word in STARTS_OF.get(name, []) + given_words]
    line(f"geometry/{name}.py", import_module(f"geometry.{name}").main, named)
    assert not gmsh.isInitialized()
    for path in folder.iterdir():
        assert path.suffix == ".msh"
        path.unlink()


# What a program does first with options that it takes.
PROGRAMS = {
    "demos/03_ambiesta.py": "models",
    "studies/convergence.py": "Study",
    "studies/follow_ups.py": "make_study",
    "studies/paper.py": "make_study",
    "studies/thermal_opening.py": "run",
    "studies/gravity_dams.py": "frequencies",
}
OPTIONS = dict.fromkeys(("--size", "--order", "--steps", "--scale", "--friction", "--cell"), 1)
OPTIONS |= dict.fromkeys(("--record", "--records", "--active-height", "--workers", "--only"), 1)
OPTIONS |= dict.fromkeys(("--cooling", "--rotate", "--stiffness", "--solver", "--out"), 1)
OPTIONS |= dict.fromkeys(("--list", "--quick", "--again", "--retry-failed"), 0)


@pytest.mark.parametrize("path", PROGRAMS)
@costly()
@given(given_words=words(OPTIONS))
def test_demo_and_studies(
    path: str,
    folder: Path,
    given_words: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = loaded(path)
    monkeypatch.setattr(module, PROGRAMS[path], stop)
    line(path, module.main, given_words)


BENCHMARKS = ("agreement", "compliances", "joint_operator", "jointed_wall", "quadrature_rules")
BENCHMARKS += ("ranks", "scaling", "stability", "stiffness_range", "work_precision")
CHOICES = {"--steps": 1, "--scenes": 1, "--repeat": 1, "--repeats": 1, "--only": 1, "--plot": 1}
CHOICES |= {"--quick": 0, "--json": 0, "--mesh": 1, "--solver": 1, "--ranks": 2, "--joints": 1}
CHOICES |= {"--divisions": 3, "--long": 1, "--angle": 1, "--factor": 1, "--history": 1}


@pytest.mark.parametrize("name", BENCHMARKS)
@costly()
@given(given_words=words(CHOICES))
def test_benchmarks(
    name: str,
    folder: Path,
    given_words: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = sys.modules.get(f"benchmarks.{name}") or import_module(f"benchmarks.{name}")
    parse = Parser.parse_args

    def parse_only(parser: Parser, *given_arguments: Any, **options: Any) -> None:
        parse(parser, *given_arguments, **options)
        raise Started

    monkeypatch.setattr(Parser, "parse_args", parse_only)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *given_words])
    line(f"benchmarks/{name}.py", lambda _: module.main(), given_words)
