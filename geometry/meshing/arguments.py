# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parameters of the models, their command lines, and limits of meshes and files."""

from __future__ import annotations

import inspect
import os
import re
import types
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types as at

from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.declared import REQUIRED, declarations

MAX_CELLS = 5_000_000
MAX_JOINTS = 1000

Length = Annotated[float, at.Gt(0), at.Unit("m")]
Order = Literal[1, 2]
Cell = Literal["hex", "tet"]
NumberOfJoints = Annotated[int, at.Interval(ge=0, le=MAX_JOINTS)]
NumberOfLayers = Annotated[int, at.Interval(ge=1, le=100)]
Share = Annotated[float, at.Interval(gt=0, le=1)]


def cells_along(length: float, size: float) -> int:
    """Return the number of cells of approximately the given size that fill a length.

    The result is at most `MAX_CELLS` + 1, which `check_fine` rejects.
    """
    return max(1, round(min(length / size, MAX_CELLS + 1.0)))


def check_fine(count: float) -> None:
    """Raise ValueError if a mesh would have more than `MAX_CELLS` cells."""
    if not count <= MAX_CELLS:
        raise ValueError(
            f"The mesh would have {count:.3g} cells, but at most {MAX_CELLS} are allowed: choose a "
            "larger size, or fewer divisions."
        )


def mesh_path(out: str | os.PathLike[str]) -> Path:
    """Return the path of a .msh file to be written.

    Raises:
        ValueError: if the path does not end in ".msh", its folder is missing, or it is a folder.
    """
    path = Path(out)
    if path.suffix != ".msh":
        raise ValueError(f"out is {str(out)!r}, but its name must end in '.msh'.")
    if not path.parent.is_dir():
        raise ValueError(f"out is {str(out)!r}, but the folder {str(path.parent)!r} is missing.")
    if path.is_dir():
        raise ValueError(f"out is {str(out)!r}, but that is a folder.")
    return path


def argument_parser(model: Callable[..., Path], description: str, out: str) -> Parser:
    """Return a parser with the flags of a model, see `add_flags`, and ``--out``.

    Args:
        model: function that writes the mesh.
        description: first line of the help.
        out: default name of the file.
    """
    parser = Parser(description=description)
    parser.add_argument(
        "--out", type=Path, default=Path(out), help="mesh file to write (default: %(default)s)"
    )
    add_flags(parser, model)
    return parser


def add_flags(parser: Parser, of: Callable[..., Any]) -> None:
    """Add a flag for each number, choice and switch among the parameters of a function or class.

    Defaults are those of the parameters, help texts those of the docstring.
    """
    entries = re.sub(r"\n {5,}", " ", inspect.getdoc(of) or "").replace("%", "%%")
    texts = dict(re.findall(r"^ {4}(\w+): (.+)$", entries, re.M))
    for item in declarations(of):
        name, kind, text = (
            item.name.replace("_", "-"),
            item.kind,
            texts.get(item.name, "").rstrip("."),
        )
        options: dict[str, Any] = {"dest": item.name, "help": f"{text} (default: %(default)s)"}
        options["default"] = item.default
        if item.default is REQUIRED or item.default is None:
            options |= {"required": item.default is REQUIRED, "default": None, "help": text}
        if get_origin(kind) in (Union, types.UnionType):
            kind = get_args(kind)[0]
        if get_origin(kind) is tuple:
            options["nargs"], kind = len(get_args(kind)), get_args(kind)[0]
        if kind is bool and not item.default:
            parser.add_argument(f"--{name}", action="store_true", dest=item.name, help=text)
        elif kind is bool:
            text = f"do not {text}"
            parser.add_argument(f"--no-{name}", action="store_false", dest=item.name, help=text)
        elif kind in (int, float):
            parser.add_argument(f"--{name}", type=kind, **options)
        elif get_origin(kind) is Literal:
            parser.add_argument(f"--{name}", type=type(get_args(kind)[0]), **options)
