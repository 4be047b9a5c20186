# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command line: what it prints, and its errors."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from written_runs import write_run

from dolfinx_joints import __version__, cli
from dolfinx_joints.export.grids import uniform_grid
from dolfinx_joints.export.paraview import VtkFile
from dolfinx_joints.results.overview import overview
from dolfinx_joints.results.writer import ResultsWriter


def test_completion_knows_the_commands(capsys):
    pytest.importorskip("shtab")
    assert cli.main(["completion", "zsh"]) == 0
    assert capsys.readouterr().out.startswith("#compdef dolfinx-joints")
    assert cli.main(["completion", "bash"]) == 0
    script = capsys.readouterr().out + 'COMP_WORDS=(dolfinx-joints ""); COMP_CWORD=1\n'
    script += 'COMPREPLY=(); _shtab_dolfinx_joints; echo "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert {"report", "split", "info", "csv", "vtk", "completion"} <= set(done.stdout.split())


def write_file(path: Path) -> Path:
    """Write a results file without records."""
    with ResultsWriter(path, {"title": "wall"}) as writer:
        writer.start()
        writer.finish("complete", {})
    return path


def test_a_file_for_paraview_is_called_that(tmp_path, capsys):
    path = tmp_path / "run.vtkhdf"
    VtkFile(path, uniform_grid(np.eye(4, 3), np.arange(4)[None], 10, {}))  # a tetrahedron
    assert cli.main(["info", str(path)]) == 2
    text = "is a file for ParaView; give the .h5 file of ResultsMonitor instead."
    assert capsys.readouterr().err == f"dolfinx-joints: {path} {text}\n"


def test_a_warning_is_one_line_unless_it_is_to_be_quiet(tmp_path, capsys):
    # Steps of 0.01 s resolve 10 Hz; the table of peaks asks for six accelerations up to 25 Hz.
    path, out = write_run(tmp_path / "run.h5", seconds=0.1), str(tmp_path / "tables")
    assert cli.main(["csv", str(path), "--out", out]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"dolfinx-joints: {path}: accelerations are shown up to 25 Hz, but ")
    assert cli.main(["--quiet", "csv", str(path), "--out", out, "--force"]) == 0
    assert capsys.readouterr().err == ""


def test_report_says_where_it_is(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("plotly")
    out = tmp_path / "sub" / "r.html"
    path = write_file(tmp_path / "r.h5")
    assert cli.main(["report", str(path), "--out", str(out), "--no-3d"]) == 0
    assert out.is_file()
    said = capsys.readouterr().out
    assert str(out) in said
    assert "pictures in" not in said  # the file has nothing to draw


def test_version_and_help(capsys):
    for option, words in (("--version", __version__), ("--help", "report")):
        with pytest.raises(SystemExit) as ended:
            cli.main([option])
        assert ended.value.code == 0
        assert words in capsys.readouterr().out


def test_split_writes_what_read_split_reads(wall_file, comm, tmp_path, capsys):
    from dolfinx_joints import read_split

    out, names = tmp_path / "wall.h5", ["joint_1", "joint_2"]
    arguments = ["split", str(wall_file()), str(out), "--joints", *names]
    assert cli.main(arguments) == 0
    assert list(read_split(out, comm).joint_names) == names
    assert capsys.readouterr().out.startswith(f"{out}\nJointedMesh\n")
    assert cli.main(arguments) == 2
    assert "exists already; replace it by --force" in capsys.readouterr().err
    assert cli.main([*arguments, "--force"]) == 0


def test_bad_file_is_one_line_and_status_2(tmp_path):
    bad = tmp_path / "text.h5"
    bad.write_text("no results")
    done = subprocess.run(
        [sys.executable, "-m", "dolfinx_joints", "info", str(bad)],
        cwd=Path(__file__).resolve().parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"dolfinx-joints: {bad} is not an HDF5 file.\n"


@pytest.mark.parametrize("arguments", [[], ["info"], ["draw"], ["info", "a", "b"]])
def test_wrong_usage_is_status_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert message.startswith("dolfinx-joints")
    assert message.endswith("; see --help for the allowed values.\n")
    assert message.count("\n") == 1


def info_to(output, path):
    """The command on a file in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "dolfinx_joints", "info", str(path)],
        cwd=Path(__file__).resolve().parents[1],
        stdout=output,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )


def test_a_reader_that_has_enough_is_no_error(tmp_path):
    end, output = os.pipe()
    os.close(end)
    assert info_to(output, write_file(tmp_path / "r.h5")).stderr == ""
    os.close(output)


def test_a_full_disk_below_the_output_is_one_line(tmp_path):
    path = write_file(tmp_path / "r.h5")
    with open("/dev/full", "w") as full:
        done = info_to(full, path)
    assert done.returncode == 2
    assert done.stderr.startswith("dolfinx-joints: The output cannot be written: ")
    assert done.stderr.count("\n") == 1


def test_info_tells_each_law_once_and_each_stage_in_its_line(tmp_path):
    made = {
        "versions": {"numpy": "2.2"},
        "joint_laws": {"joint_1": "Law(a=1)", "joint_2": "Law(a=1)", "joint_3": "Law(a=2)"},
        "loads": ["Gravity()"],
        "static_stages": {"weight": "Gravity; inactive: joint_1", "all": "Gravity"},
        "petsc_options": {},
    }
    with ResultsWriter(tmp_path / "r.h5", {"manifest": made, "title": "wall"}) as writer:
        writer.start()
        writer.finish("complete", {})
    lines = overview(tmp_path / "r.h5").splitlines()
    assert lines[1:] == [
        "settings      title=wall",
        "versions      numpy=2.2",
        "joint_laws    joint_1, joint_2: Law(a=1)",
        "              joint_3: Law(a=2)",
        "loads         Gravity()",
        "static_stages weight: Gravity; inactive: joint_1",
        "              all: Gravity",
    ]
