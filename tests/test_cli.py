# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command line: what it prints, and how it refuses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dolfinx_joints import __version__, cli
from dolfinx_joints.results_overview import overview
from dolfinx_joints.results_writer import ResultsWriter


def write_file(path: Path) -> Path:
    """Write a results file without records."""
    with ResultsWriter(path, {"title": "wall"}) as writer:
        writer.start()
        writer.finish("complete", {})
    return path


def test_info_prints_what_the_file_holds(tmp_path, capsys):
    path = write_file(tmp_path / "r.h5")
    assert cli.main(["info", str(path)]) == 0
    assert capsys.readouterr().out.strip() == overview(path)


def test_report_says_where_it_is(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("plotly")
    out = tmp_path / "sub" / "r.html"
    path = write_file(tmp_path / "r.h5")
    assert cli.main(["report", str(path), "--out", str(out), "--no-3d"]) == 0
    assert out.is_file()
    assert str(out) in capsys.readouterr().out


def test_version_and_help(capsys):
    for option, words in (("--version", __version__), ("--help", "report")):
        with pytest.raises(SystemExit) as ended:
            cli.main([option])
        assert ended.value.code == 0
        assert words in capsys.readouterr().out


@pytest.mark.parametrize("command", ["info", "report"])
def test_bad_file_is_one_line_and_status_2(tmp_path, command):
    bad = tmp_path / "text.h5"
    bad.write_text("no results")
    done = subprocess.run(
        [sys.executable, "-m", "dolfinx_joints", command, str(bad)],
        cwd=Path(__file__).resolve().parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"dolfinx-joints: {bad} is not an HDF5 file.\n"


@pytest.mark.parametrize(
    "arguments", [[], ["info"], ["report"], ["draw"], ["info", "a", "b"], ["csv", "a"]]
)
def test_wrong_usage_is_status_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    assert "usage: dolfinx-joints" in capsys.readouterr().err
