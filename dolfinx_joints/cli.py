# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command ``dolfinx-joints``, also ``python -m dolfinx_joints``: meshes, reports, tables."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dolfinx_joints import __version__
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.errors import JointsError, PlausibilityWarning
from dolfinx_joints.common.parameters import printable
from dolfinx_joints.common.progress import set_log_level


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 0, 1 if compared runs differ, 2 if a file cannot be used or written.

    Wrong usage exits with 2.
    """
    options = _parser().parse_args(arguments)
    if not options.quiet:
        set_log_level("INFO")
    try:
        with _warnings_in_lines(quiet=options.quiet):
            differs = options.run(options)
        sys.stdout.flush()
    except (JointsError, ValueError) as error:
        print(f"dolfinx-joints: {printable(str(error))}", file=sys.stderr)
        return 2
    except OSError as error:
        if not isinstance(error, BrokenPipeError):  # for example with `| head`
            print(f"dolfinx-joints: The output cannot be written: {error}.", file=sys.stderr)
        # Discard buffered output; flushing it at exit would fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 2
    return int(bool(differs))


@contextmanager
def _warnings_in_lines(*, quiet: bool) -> Iterator[None]:
    """Print each warning once, in one line; with ``quiet`` omit plausibility warnings."""
    printed: set[str] = set()

    def show(message: Any, category: type[Warning], *_: Any, **__: Any) -> None:
        text = printable(" ".join(str(message).split()))
        if text not in printed and not (quiet and issubclass(category, PlausibilityWarning)):
            print(f"dolfinx-joints: {text}", file=sys.stderr)
        printed.add(text)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def _parser() -> Parser:
    parser = Parser(
        prog="dolfinx-joints",
        description="Split meshes at their joints; read, compare, report and export results files.",
    )
    parser.add_argument("--version", action="version", version=f"dolfinx_joints {__version__}")
    parser.add_argument(
        "--quiet", action="store_true", help="suppress progress and plausibility warnings"
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for run, arguments in _COMMANDS.items():
        text, name = str(run.__doc__), run.__name__.strip("_")
        command = commands.add_parser(name, help=text.splitlines()[0], description=text)
        command.set_defaults(run=run)
        for argument, options in arguments:
            command.add_argument(argument, **options)
    return parser


def _report(options: Any) -> None:
    """Write a report on one or several runs: one HTML or PDF file, and a folder of pictures."""
    from dolfinx_joints import report

    atexit.register(gc.freeze)  # a search for garbage at exit takes 0.3 s
    title = {name: getattr(options, name) for name in _TITLE}
    path = report.write(options.results, options.out, with_3d=not options.no_3d, **title)
    folder = report.picture_folder(path)
    pictures = f", pictures in {folder}" if folder.is_dir() else ""
    print(f"{path}, {path.stat().st_size / 1e6:.1f} MB{pictures}")


def _split(options: Any) -> None:
    """Split a Gmsh mesh at its joints, and write it to a file for read_split."""
    from mpi4py import MPI

    from dolfinx_joints.mesh.distribution.split_file import write_split
    from dolfinx_joints.mesh.reading.readers import read_msh

    split = read_msh(options.mesh, MPI.COMM_SELF, joints=options.joints)
    write_split(options.out, split, overwrite=options.force)
    print(printable(f"{options.out}\n{split}"))


def _info(options: Any) -> None:
    """List the contents of a results file."""
    from dolfinx_joints.results.overview import describe, overview

    print(printable(describe(options.file) if options.all else overview(options.file)))


def _compare(options: Any) -> bool:
    """Compare two results files; the exit code is 1 if they differ by more than the tolerance."""
    from dolfinx_joints.export.comparison import compare

    comparison = compare(options.file, options.other, tolerance=options.tolerance)
    print(printable(str(comparison)))
    return not comparison.within


def _csv(options: Any) -> None:
    """Write all tables of a results file as CSV, with units in the headers."""
    from dolfinx_joints.export.tables import write_csv
    from dolfinx_joints.results.reader import Results

    with Results(options.file) as results:
        for path in write_csv(results, options.out, overwrite=options.force):
            print(path)


def _vtk(options: Any) -> None:
    """Write the body and the joints in all recorded states for ParaView (VTKHDF)."""
    from dolfinx_joints.export.paraview import write_vtk
    from dolfinx_joints.results.reader import Results

    file = options.file
    out = options.out or file.with_name(f"{file.name.removesuffix('.h5')}.vtkhdf")
    with Results(file) as results:
        for path in write_vtk(results, out, overwrite=options.force):
            print(path)


def _completion(options: Any) -> None:
    """Print the completion script: eval "$(dolfinx-joints completion bash)"."""
    try:
        import shtab
    except ImportError:
        raise JointsError("Completion needs the package shtab: pip install shtab.") from None
    parser = _parser()
    for command in parser._subparsers._group_actions[0].choices.values():  # type: ignore
        for action in command._actions:
            if action.type is Path:
                action.complete = shtab.FILE
    print(shtab.complete(parser, shell=options.shell))


def _path(metavar: str, text: str, **options: Any) -> dict[str, Any]:
    return {"type": Path, "metavar": metavar, "help": text, **options}


_FLAG = {"action": "store_true"}
_FILE = ("file", _path("FILE", "results file"))
_FORCE = ("--force", _FLAG | {"help": "replace existing files"})
_JOINTS = "joints to split (default: groups named joint...)"
_REPORT = "HTML file, or PDF file if the name ends in .pdf (default report.html)"
_TITLE = {
    "dam": "name of the dam, the title (default: names of the runs)",
    **{name: f"{name} on the title page" for name in ("client", "author", "date")},
}
_TOLERANCE = "largest difference, relative to the largest value of the quantity (default 1e-3)"
# Arguments of each command with their options.
_COMMANDS: dict[Callable[[Any], bool | None], tuple[tuple[str, dict[str, Any]], ...]] = {
    _report: (
        ("results", _path("RESULTS", "results files", nargs="+")),
        ("--out", _path("FILE", _REPORT, default=Path("report.html"))),
        ("--no-3d", _FLAG | {"help": "omit the 3-D view and the pictures of the body"}),
        *((f"--{name}", {"metavar": "TEXT", "help": text}) for name, text in _TITLE.items()),
    ),
    _split: (
        ("mesh", _path("MESH", "Gmsh .msh file")),
        ("out", _path("FILE", "HDF5 file to write")),
        ("--joints", {"nargs": "*", "metavar": "NAME", "help": _JOINTS}),
        _FORCE,
    ),
    _info: (_FILE, ("--all", _FLAG | {"help": "list every array with unit and meaning"})),
    _compare: (
        _FILE,
        ("other", _path("OTHER", "results file of the other run")),
        ("--tolerance", {"type": float, "default": 1e-3, "metavar": "X", "help": _TOLERANCE}),
    ),
    _csv: (_FILE, ("--out", _path("FOLDER", "folder of the tables", required=True)), _FORCE),
    _vtk: (_FILE, ("--out", _path("NAME", "name of the files (default: that of FILE)")), _FORCE),
    _completion: (("shell", {"choices": ("bash", "zsh", "tcsh"), "help": "name of the shell"}),),
}
