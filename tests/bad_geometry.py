# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad arguments of the geometry scripts."""

from __future__ import annotations

import math
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from bad_input import NO_CHOICE, NO_COUNT, NO_FLAG, NO_LIST, NO_NUMBER, Door, door, without
from test_step import BOXES, write_step

from geometry.ambiesta import ambiesta
from geometry.arch import ArchDam, mid_crest
from geometry.from_step import from_step
from geometry.gravity_dam import KOYNA, GravitySection, battered_section, gravity_dam
from geometry.inclined_crack import inclined_crack
from geometry.jointed_wall import jointed_wall
from geometry.section_table import SectionTable, read_sections
from geometry.sections_dam import sections_dam
from geometry.two_blocks import two_blocks
from geometry.voussoir_arch import voussoir_arch

# With the ends of what a mesh may be: lengths from 1e-6 to 1e9 m, 5 million cells, 1000 joints.
LENGTH = without(NO_NUMBER, zero="0.0", negative="-1.0", too_small="1e-9", too_large="1e12")
SIZE = {**LENGTH, "too fine": "1e-6"}
OPTIONAL = without(LENGTH, "nothing")
OPTIONAL_SIZE = without(SIZE, "nothing")
ANGLE = without(NO_NUMBER, out_of_range="1000.0")
FAR = without(NO_NUMBER, too_small="1.0", too_large="1e5")
SHARE = without(NO_NUMBER, zero="0.0", negative="-0.5", above_one="1.5", nearly_one="0.99999")
JOINTS = without(NO_COUNT, negative="-1", too_many="10**9")
COUNT = without(NO_COUNT, zero="0", negative="-1", too_many="10**9")
ORDER = without(NO_COUNT, unknown="3", a_float="2.0")
OUT = {
    "nothing": "None",
    "number": "7",
    "bytes": "b'dam.msh'",
    "empty": "''",
    "wrong suffix": "'dam.vtk'",
    "no folder": "'nowhere/dam.msh'",
    "not printable": "'dam\\x00.msh'",
    "not writable": "'/proc/dam.msh'",
}
DIVISIONS = {
    "text": "'4 1 4'",
    "number": "4",
    "nothing": "None",
    "wrong length": "(4, 1)",
    "zero": "(4, 0, 1)",
    "not whole": "(4, 1.5, 1)",
    "not a number": "(4, math.nan, 1)",
    "too fine": "(4000, 4000, 4000)",
}
ELEMENTS = {"order": ORDER, "cell": NO_CHOICE, "gui": NO_FLAG}
FACE = {
    "text": "'vertical'",
    "nothing": "None",
    "wrong shape": "((0.0, 0.0, 0.0), (9.0, 0.0, 0.0))",
    "one corner": "((0.0, 0.0),)",
    "not from 0": "((1.0, 0.0), (9.0, 0.0))",
    "not rising": "((0.0, 0.0), (9.0, 0.0), (5.0, 0.0))",
    "not a number": "((0.0, math.nan), (9.0, 0.0))",
    "infinite": "((0.0, math.inf), (9.0, 0.0))",
    "complex": "((0.0, 1j), (9.0, 0.0))",
    "another height": "((0.0, 0.0), (8.0, 0.0))",
}
COLUMNS: dict[str, Any] = {
    "elevation": np.array([200.0, 230.0]),
    "extrados_radius": np.array([50.0, 50.0]),
    "crown_thickness": np.array([4.0, 4.0]),
    "left_angle": np.array([40.0, 40.0]),
    "right_angle": np.array([60.0, 60.0]),
}


@cache
def names() -> dict[str, Any]:
    """What the rows refer to."""
    folder = tempfile.TemporaryDirectory()
    found = globals() | {"columns": COLUMNS, "table": SectionTable(COLUMNS), "folder": folder}
    found["step"] = write_step(Path(folder.name) / "pier.step", BOXES)
    return found


def scripts() -> tuple[Door, ...]:
    """Scripts that make boxes, arches and sections."""
    out = {"out": "'dam.msh'"}
    blocks = {name: LENGTH for name in ("length", "width", "lower_height", "upper_height")}
    crack = {"half_length": LENGTH, "angle": ANGLE, "extent": FAR, "lean": ANGLE}
    return (
        door(
            "two_blocks",
            out,
            {"out": OUT, **blocks, "angle": ANGLE, "size": SIZE, **ELEMENTS},
            names,
            together={"a joint through the base": "angle=80.0; length=4.0"},
        ),
        door(
            "jointed_wall",
            out,
            {
                **dict.fromkeys(("length", "thickness", "height"), LENGTH),
                "joints": JOINTS,
                "divisions": DIVISIONS,
                "size": OPTIONAL_SIZE,
                **ELEMENTS,
            },
            names,
            together={"joints between cells": "joints=2; divisions=(4, 1, 4)"},
        ),
        door(
            "voussoir_arch",
            out,
            {
                "radius": LENGTH,
                "thickness": LENGTH,
                "half_angle": without(LENGTH, "too large", out_of_range="121.0"),
                "voussoirs": COUNT,
                "width": OPTIONAL,
                "divisions": DIVISIONS,
                "size": OPTIONAL_SIZE,
                **ELEMENTS,
            },
            names,
            together={
                "thicker than its radius": "radius=2.0; thickness=5.0",
                "cells that span too much": "voussoirs=1; divisions=(1, 1, 1)",
            },
        ),
        door(
            "inclined_crack",
            out,
            {
                **crack,
                "size": SIZE,
                "growth": without(NO_NUMBER, one="1.0", out_of_range="4.0"),
                **ELEMENTS,
            },
            names,
        ),
    )


def dams() -> tuple[Door, ...]:
    """Scripts that make dams, and the shapes that they take."""
    out = {"out": "'dam.msh'"}
    dam = {
        "section": {"text": "'koyna'", "nothing": "None", "number": "103.0"},
        "joints": {
            **NO_LIST,
            "list": "[5.0]",
            "not a name": "{'a b': 5.0}",
            "number for a name": "{7: 5.0}",
            "text for a height": "{'a': 'neck'}",
            "not a number": "{'a': math.nan}",
            "negative": "{'a': -1.0}",
            "above the crest": "{'a': 103.0}",
            "twice": "{'a': 5.0, 'b': 5.0}",
            "too near": "{'a': 5.0, 'b': 5.000001}",
        },
        "width": OPTIONAL,
        "size": SIZE,
        **ELEMENTS,
    }
    del dam["joints"]["nothing"]
    arch = {name: LENGTH for name in ("height", "base_half_chord", "crest_half_chord")}
    arch |= {name: LENGTH for name in ("base_thickness", "crest_thickness", "chord_exponent")}
    arch |= dict.fromkeys(
        ("base_half_angle", "crest_half_angle"), without(LENGTH, "too large", out_of_range="90.0")
    )
    loose = ("thickening", "thickening_decay", "overhang", "overhang_return")
    arch |= dict.fromkeys(loose, without(NO_NUMBER, out_of_range="1e3"))
    faces = {name: name_ for name, name_ in (("upstream", FACE), ("downstream", FACE))}
    good = {"upstream": "((0.0, 0.0), (9.0, 0.0))", "downstream": "((0.0, 9.0), (9.0, 5.0))"}
    battered = {"height": "10.0", "base": "8.0", "crest": "1.0", "upstream_slope": "0.1"}
    battered |= {"upstream_break": "5.0", "downstream_slope": "0.8"}
    slope = without(NO_NUMBER, negative="-0.5", out_of_range="100.0")
    return (
        door("gravity_dam", out, dam, names),
        door("GravitySection", good, faces, names),
        door(
            "battered_section",
            battered,
            {
                **dict.fromkeys(("height", "base", "crest", "upstream_break"), LENGTH),
                **dict.fromkeys(("upstream_slope", "downstream_slope"), slope),
            },
            names,
            together={"a break above the crest": "upstream_break=12.0; base=8.0"},
        ),
        door(
            "ambiesta",
            out,
            {
                "size": SIZE,
                "joints": JOINTS,
                "active_height": SHARE,
                "crest_arch": NO_FLAG,
                "layers": COUNT,
                "parameters": {"text": "'ambiesta'", "dictionary": "{'height': 57.0}"},
                **ELEMENTS,
            },
            names,
        ),
        door(
            "ArchDam",
            {},
            arch,
            names,
            together={
                "a valley that closes": "base_half_chord=70.0; crest_half_chord=63.0",
                "thicker than its radius": "base_thickness=90.0; crest_thickness=80.0",
                "thinner than nothing": "thickening=-5.0; thickening_decay=0.0",
            },
        ),
        door("ArchDam.of_crest", {"length": "144.6"}, {"length": LENGTH}, names),
        door("mid_crest", {}, {"parameters": {"text": "'ambiesta'", "number": "57.0"}}, names),
        table_dam(),
        door(
            "SectionTable",
            {"columns": "columns"},
            {
                "columns": {
                    "nothing": "None",
                    "list": "[200.0, 230.0]",
                    "empty": "{}",
                    "unknown column": "{**columns, 'depth': columns['elevation']}",
                    "number": "{**columns, 'left_angle': 40.0}",
                    "texts": "{**columns, 'left_angle': np.array(['40', '40'])}",
                    "wrong length": "{**columns, 'left_angle': np.array([40.0])}",
                    "wrong shape": "{**columns, 'left_angle': np.eye(2)}",
                    "not a number": "{**columns, 'left_angle': np.array([40.0, math.nan])}",
                    "infinite": "{**columns, 'left_angle': np.array([40.0, math.inf])}",
                    "zero": "{**columns, 'extrados_radius': np.zeros(2)}",
                    "out of range": "{**columns, 'left_angle': np.array([40.0, 90.0])}",
                    "not rising": "{**columns, 'elevation': np.array([230.0, 200.0])}",
                    "of no size": "{**columns, 'extrados_radius': np.array([1e12, 1e12])}",
                }
            },
            names,
        ),
        door(
            "read_sections",
            {},
            {"path": {"nothing": "None", "number": "7", "no such file": "'none.csv'"}},
            names,
        ),
        step(),
    )


def table_dam() -> Door:
    """A dam from a table of sections."""
    angles = {
        "falling": "[10.0, 5.0]",
        "beyond the crest": "[50.0]",
        "too near": "[0.0, 1e-9]",
        "texts": "['10']",
        "nested": "[[10.0]]",
        "a number that is none": "[math.nan]",
    }
    return door(
        "sections_dam",
        {"out": "'dam.msh'", "table": "table"},
        {
            "table": {"nothing": "None", "number": "7", "no such file": "'none.csv'"},
            "size": SIZE,
            "layers": COUNT,
            "joints": {**JOINTS, **angles},
            "active_height": SHARE,
            "perimetral": NO_FLAG,
            "foundation": without(OPTIONAL, "too large", too_deep="60.0"),
            **ELEMENTS,
        },
        names,
        together={
            "a joint with nothing": "perimetral=True; foundation=None",
            "a reach of nothing": "spread=3.0; foundation=None",
            "a reach that is none": "spread='3.0'; foundation=20.0",
            "a negative reach": "spread=-3.0; foundation=20.0",
            "a reach beyond the axis": "spread=46.0; foundation=20.0",
        },
    )


def step() -> Door:
    """Solids of a STEP file."""
    pairs = {
        "list": "['rock']",
        "text": "'rock,pier'",
        "no pair": "{'a': 'rock'}",
        "unknown": "{'a': ('rock', 'dam')}",
        "apart": "{'a': ('pier', 'side')}",
        "not a name": "{'a b': ('rock', 'pier')}",
    }
    return door(
        "from_step",
        {"out": "'dam.msh'", "step": "step", "size": "2.0"},
        {
            "step": {"nothing": "None", "number": "7", "no such file": "'none.step'"},
            "size": without(LENGTH, too_fine="1e-3"),
            "joint_size": without(OPTIONAL, too_fine="1e-3"),
            "order": ORDER,
            "gui": NO_FLAG,
            "solids": {
                "list": "[(2.0, 1.0, 1.0)]",
                "too short": "{'a': (2.0, 1.0)}",
                "text": "{'a': 'middle'}",
                "not a number": "{'a': (2.0, 1.0, math.nan)}",
                "outside": "{'a': (9.0, 9.0, 9.0)}",
                "not a name": "{'a b': (2.0, 1.0, 1.0)}",
            },
            "joints": pairs,
            "tied": {"text": "'rock'", "number": "7", "no pair": "['rock']"},
            "surfaces": {
                "list": "['base']",
                "text": "{'base': 'z=0'}",
                "unknown axis": "{'base': ('w', 0.0)}",
                "unknown place": "{'base': ('z', 'low')}",
                "not a number": "{'base': ('z', math.nan)}",
                "no face": "{'base': ('z', 4.0)}",
                "not a name": "{'a b': ('z', 'min')}",
            },
        },
        names,
    )


DOORS = (*scripts(), *dams())
__all__ = [
    "DOORS",
    "KOYNA",
    "ArchDam",
    "GravitySection",
    "ambiesta",
    "battered_section",
    "from_step",
    "gravity_dam",
    "inclined_crack",
    "jointed_wall",
    "math",
    "mid_crest",
    "read_sections",
    "sections_dam",
    "two_blocks",
    "voussoir_arch",
]
