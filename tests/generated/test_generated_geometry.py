# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of the geometry scripts from generated parameters, good ones and junk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_input import answer, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, passed_on
from sentences import one_sentence
from test_step import write_step

gmsh = pytest.importorskip("gmsh")
pytestmark = pytest.mark.usefixtures("small_meshes")

from dolfinx_joints.mesh.gmsh_file import load_msh  # noqa: E402
from geometry.ambiesta import ArchDam, ambiesta  # noqa: E402
from geometry.from_step import from_step  # noqa: E402
from geometry.gravity_dam import KOYNA, PINE_FLAT, gravity_dam  # noqa: E402
from geometry.inclined_crack import inclined_crack  # noqa: E402
from geometry.jointed_wall import jointed_wall  # noqa: E402
from geometry.section_table import SectionTable  # noqa: E402
from geometry.sections_dam import sections_dam  # noqa: E402
from geometry.two_blocks import two_blocks  # noqa: E402
from geometry.voussoir_arch import voussoir_arch  # noqa: E402

Options = dict[str, st.SearchStrategy[Any]]
Mesher = Callable[..., Path]

# RuntimeError: cells turned inside out, which the scripts document.
REFUSALS = (ValueError, RuntimeError)

ELEMENTS: Options = {"order": st.sampled_from((1, 2)), "cell": st.sampled_from(("hex", "tet"))}
lengths = st.floats(0.5, 3.0)
some = st.integers(1, 4)
three = st.tuples(some, some, some)


def parts(least: float, most: float) -> st.SearchStrategy[float]:
    """Sizes that give meshes of some hundred cells at most."""
    return st.floats(least, most)


DAMS = st.builds(
    ArchDam,
    height=st.floats(30, 80),
    base_half_angle=st.floats(10, 35),
    crest_half_angle=st.floats(40, 60),
    chord_exponent=st.floats(0.4, 1.0),
    base_thickness=st.floats(4, 15),
    crest_thickness=st.floats(1, 4),
    thickening=st.floats(0, 0.5),
    overhang=st.floats(0, 0.4),
)

SCRIPTS: dict[Mesher, Options] = {
    two_blocks: {
        "length": lengths,
        "width": lengths,
        "lower_height": lengths,
        "upper_height": lengths,
        "angle": st.floats(-15, 15),
        "size": parts(0.5, 4.0),
        **ELEMENTS,
    },
    jointed_wall: {
        "length": lengths,
        "thickness": lengths,
        "height": lengths,
        "joints": st.just(1),
        "divisions": st.tuples(st.sampled_from((2, 4)), some, some),
        "size": st.none() | parts(0.6, 2.0),
        **ELEMENTS,
    },
    voussoir_arch: {
        "radius": st.floats(5, 20),
        "thickness": st.floats(0.5, 4),
        "half_angle": st.floats(30, 120),
        "voussoirs": st.integers(6, 12),
        "width": st.none() | st.floats(0.5, 2),
        "divisions": three,
        "size": st.none() | parts(1.0, 4.0),
        **ELEMENTS,
    },
    inclined_crack: {
        "half_length": st.floats(0.5, 2),
        "angle": st.floats(-180, 180),
        "extent": st.floats(2, 20),
        "lean": st.floats(-45, 45),
        "size": parts(0.3, 2.0),
        "growth": st.floats(1.5, 3.0),
        "order": ELEMENTS["order"],
        "cell": st.sampled_from(("quad", "tri", "hex", "tet")),
    },
    gravity_dam: {
        "section": st.sampled_from((KOYNA, PINE_FLAT)),
        "joints": st.none()
        | st.dictionaries(st.sampled_from("abc"), st.floats(0, 100), max_size=2),
        "width": st.none() | st.floats(5, 30),
        "size": parts(15, 60),
        **ELEMENTS,
    },
    ambiesta: {
        "size": parts(12, 40),
        "joints": st.integers(0, 5),
        "active_height": st.just(1.0) | st.floats(0.3, 0.95),
        "crest_arch": st.booleans(),
        "layers": st.integers(1, 2),
        "parameters": st.none() | DAMS,
        **ELEMENTS,
    },
}
NAMES = [script.__name__ for script in SCRIPTS]


def run(door: str, script: Mesher, folder: Path, options: dict[str, Any]) -> None:
    """Mesh: a whole file that can be read, or none, and no trace in Gmsh."""
    out = folder / "m.msh"
    made = answer(door, one_sentence(passed_on(lambda: script(out, **options)), REFUSALS), REFUSALS)
    assert not gmsh.isInitialized()
    if made is not None:
        assert len(load_msh(made).cells) > 0
        made.unlink()
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("script", SCRIPTS, ids=NAMES)
@costly()
@given(data=st.data())
def test_junk_parameters(script: Mesher, folder: Path, data: st.DataObject) -> None:
    run(f"{script.__name__}, junk", script, folder, data.draw(arguments(SCRIPTS[script])))


@pytest.mark.parametrize("script", SCRIPTS, ids=NAMES)
@costly()
@given(data=st.data())
def test_parameters_within_reason(script: Mesher, folder: Path, data: st.DataObject) -> None:
    options = data.draw(st.fixed_dictionaries(SCRIPTS[script]))
    run(f"{script.__name__}, meshed", script, folder, options)


PLACES = ("m.msh", "M.MSH", "", ".", ".msh", "m.vtk", "no/m.msh", "/proc/m.msh", "m.msh/", "/", "m")
LONG = (
    "a" * 300 + ".msh",
    "a" * 251 + ".msh",
    "\n.msh",
    "\0.msh",
    "m\0.msh",
    "\ud800.msh",
    "é.msh",
)


@costly()
@given(out=st.sampled_from(PLACES + LONG) | st.sampled_from(PLACES).map(Path) | JUNK)
def test_places_of_files(folder: Path, out: Any) -> None:
    call = one_sentence(passed_on(lambda: two_blocks(out, size=1.0)))
    made = answer("two_blocks, file", call)
    if made is not None:
        assert len(load_msh(made).cells) == 2
        made.unlink()
    assert list(folder.iterdir()) == []


COLUMNS = {
    "elevation": np.array([200.0, 215.0, 235.0]),
    "extrados_radius": np.array([60.0, 68.0, 80.0]),
    "crown_thickness": np.array([9.0, 7.5, 6.0]),
    "left_angle": np.array([15.0, 28.0, 38.0]),
    "right_angle": np.array([20.0, 33.0, 45.0]),
}
SECTIONS: Options = {
    "table": st.just(SectionTable(COLUMNS)),
    "size": parts(12, 40),
    "layers": st.integers(1, 2),
    "joints": st.integers(0, 5) | st.lists(st.floats(-40, 35), max_size=3).map(sorted),
    "active_height": st.just(1.0) | st.floats(0.3, 0.95),
    "foundation": st.none() | st.floats(5, 40),
    "spread": st.none() | st.floats(0, 20),
    "perimetral": st.booleans(),
    **ELEMENTS,
}


@costly()
@given(options=arguments(SECTIONS))
def test_sections_dam_of_junk(folder: Path, options: dict[str, Any]) -> None:
    run("sections_dam, junk", sections_dam, folder, options)


@costly()
@given(options=st.fixed_dictionaries(SECTIONS))
def test_sections_dam(folder: Path, options: dict[str, Any]) -> None:
    if options["foundation"] is None:
        options |= {"spread": None, "perimetral": False}
    run("sections_dam, meshed", sections_dam, folder, options)


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two boxes that touch, of 4 x 2 x 3 and 2 x 2 x 2 m."""
    both = {"rock": (0, 0, 0, 4000, 2000, 3000), "pier": (1000, 0, 3000, 2000, 2000, 2000)}
    return write_step(tmp_path_factory.mktemp("step") / "boxes.step", both)


names = st.sampled_from(("rock", "pier", "a", "b", "side", "outside", ""))
pairs = st.sampled_from((("rock", "pier"), ("pier", "rock"))) | st.tuples(names, names)
places = st.sampled_from(("min", "max", 0, 3.0, 5.0)) | st.floats(-1, 6)
STEP: Options = {
    "size": parts(1.0, 5.0),
    "joint_size": st.none() | parts(0.7, 5.0),
    "order": ELEMENTS["order"],
    "solids": st.none()
    | st.dictionaries(
        names, st.tuples(st.floats(0, 4), st.floats(0, 2), st.floats(0, 5)), max_size=1
    ),
    "joints": st.none() | st.dictionaries(names, pairs, max_size=2),
    "tied": st.lists(pairs, max_size=1),
    "surfaces": st.none()
    | st.dictionaries(names, st.tuples(st.sampled_from("xyz"), places), max_size=2),
}


@costly()
@given(options=arguments(STEP))
def test_from_step_with_junk(folder: Path, boxes: Path, options: dict[str, Any]) -> None:
    run("from_step, junk", lambda out, **o: from_step(out, boxes, **o), folder, options)


@costly()
@given(
    size=parts(0.7, 6.0),
    joint_size=st.none() | parts(0.7, 6.0),
    order=ELEMENTS["order"],
    tied=st.sampled_from(((), [("rock", "pier")])),
    surfaces=st.none() | st.just({"base": ("z", "min"), "top": ("z", 5.0)}),
)
def test_from_step(folder: Path, boxes: Path, **options: Any) -> None:
    run("from_step, meshed", lambda out, **o: from_step(out, boxes, **o), folder, options)
