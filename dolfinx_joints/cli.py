# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command ``dolfinx-joints``, also ``python -m dolfinx_joints``: meshes, reports, tables."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dolfinx_joints import __version__
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.errors import JointsError, PlausibilityWarning
from dolfinx_joints.common.parameters import printable
from dolfinx_joints.common.progress import set_log_level


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 0, or 2 if a file cannot be used or written.

    Wrong usage exits with 2.
    """
    options = _parser().parse_args(arguments)
    if not options.quiet:
        set_log_level("INFO")
    try:
        with _warnings_in_lines(quiet=options.quiet):
            options.run(options)
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
    return 0


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
        description="Split meshes at their joints; read, report and export results files.",
    )
    parser.add_argument("--version", action="version", version=f"dolfinx_joints {__version__}")
    parser.add_argument(
        "--quiet", action="store_true", help="suppress progress and plausibility warnings"
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for add in (_add_report, _add_split, _add_info, _add_csv, _add_vtk, _add_completion):
        add(commands)
    return parser


def _add_report(commands: Any) -> None:
    report = commands.add_parser(
        "report",
        help="write a report on one or several runs",
        description="Write one HTML file, which needs no network, and a folder of pictures.",
    )
    report.add_argument("results", nargs="+", type=Path, metavar="RESULTS", help="results files")
    report.add_argument(
        "--out", type=Path, default=Path("report.html"), help="HTML file (default %(default)s)"
    )
    report.add_argument(
        "--no-3d", action="store_true", help="omit the 3-D view and the pictures of the body"
    )
    report.set_defaults(run=_report)


def _report(options: Any) -> None:
    from dolfinx_joints import report

    atexit.register(gc.freeze)  # a search for garbage at exit takes 0.3 s
    path = report.write(options.results, options.out, with_3d=not options.no_3d)
    folder = report.picture_folder(path)
    pictures = f", pictures in {folder}" if folder.is_dir() else ""
    print(f"{path}, {path.stat().st_size / 1e6:.1f} MB{pictures}")


def _add_split(commands: Any) -> None:
    split = commands.add_parser(
        "split",
        help="split a Gmsh mesh at its joints",
        description="Split a mesh at its joints and write it to a file. read_split reads it in "
        "parallel: each rank reads only its part.",
    )
    split.add_argument("mesh", type=Path, metavar="MESH", help="Gmsh .msh file")
    split.add_argument("out", type=Path, metavar="FILE", help="HDF5 file to write")
    split.add_argument(
        "--joints",
        nargs="*",
        metavar="NAME",
        help="joints to split (default: groups named joint...)",
    )
    split.add_argument("--force", action="store_true", help="replace an existing file")
    split.set_defaults(run=_split)


def _split(options: Any) -> None:
    from mpi4py import MPI

    from dolfinx_joints.mesh.distribution.split_file import write_split
    from dolfinx_joints.mesh.reading.readers import read_msh

    split = read_msh(options.mesh, MPI.COMM_SELF, joints=options.joints)
    write_split(options.out, split, overwrite=options.force)
    print(printable(f"{options.out}\n{split}"))


def _add_info(commands: Any) -> None:
    info = commands.add_parser(
        "info",
        help="list the contents of a results file",
        description="List the contents of a results file.",
    )
    info.add_argument("file", type=Path, metavar="FILE", help="results file")
    info.add_argument("--all", action="store_true", help="list every array with unit and meaning")
    info.set_defaults(run=_info)


def _info(options: Any) -> None:
    from dolfinx_joints.results.overview import describe, overview

    print(printable(describe(options.file) if options.all else overview(options.file)))


def _add_csv(commands: Any) -> None:
    tables = commands.add_parser(
        "csv",
        help="write CSV tables",
        description="Write histories, energies, joint measures, resultants and all other tables of "
        "a results file as CSV, with units in the headers.",
    )
    tables.add_argument("file", type=Path, metavar="FILE", help="results file")
    tables.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="folder of the tables"
    )
    tables.add_argument("--force", action="store_true", help="replace existing files")
    tables.set_defaults(run=_csv)


def _csv(options: Any) -> None:
    from dolfinx_joints.export.csv_files import write_csv
    from dolfinx_joints.results.reader import Results

    with Results(options.file) as results:
        for path in write_csv(results, options.out, overwrite=options.force):
            print(path)


def _add_vtk(commands: Any) -> None:
    fields = commands.add_parser(
        "vtk",
        help="write files for ParaView",
        description="Write the body and the joints in all recorded states as VTKHDF.",
    )
    fields.add_argument("file", type=Path, metavar="FILE", help="results file")
    fields.add_argument(
        "--out", type=Path, metavar="NAME", help="write NAME.vtkhdf (default: the name of FILE)"
    )
    fields.add_argument("--force", action="store_true", help="replace existing files")
    fields.set_defaults(run=_vtk)


def _vtk(options: Any) -> None:
    from dolfinx_joints.export.paraview import write_vtk
    from dolfinx_joints.results.reader import Results

    file = options.file
    out = options.out or file.with_name(f"{file.name.removesuffix('.h5')}.vtkhdf")
    with Results(file) as results:
        for path in write_vtk(results, out, overwrite=options.force):
            print(path)


def _add_completion(commands: Any) -> None:
    completion = commands.add_parser(
        "completion",
        help="print the shell completion script",
        description='Print the completion script: eval "$(dolfinx-joints completion bash)".',
    )
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="name of the shell")
    completion.set_defaults(run=_completion)


def _completion(options: Any) -> None:
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
