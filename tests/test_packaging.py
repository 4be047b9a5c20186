# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Source distribution and wheel: what they hold, and that the wheel works without the project.

They are built here, the wheel from the source distribution, or taken from the folder that
``DOLFINX_JOINTS_DIST`` names (``make dist``).
"""

import os
import shutil
import struct
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_string
from pathlib import Path

import pytest

import dolfinx_joints

pytest.importorskip("setuptools", minversion="77")

PROJECT = Path(__file__).resolve().parents[1]
# What setuptools adds to a source distribution.
ADDED = ("PKG-INFO", "setup.cfg", "dolfinx_joints.egg-info/")


def run(*command: str | Path, folder: Path, **environment: str) -> str:
    """Output of a command that must succeed, in a folder that is not the project's."""
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    outside = os.pathsep.join(path for path in paths if path and Path(path) != PROJECT)
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": outside} | environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def tracked() -> set[str]:
    """Files of the project: names in git's index, which is read here as git may be missing."""
    place = PROJECT / ".git"
    if not place.exists():
        pytest.skip("not a git repository: nothing tells which files belong to the project")
    if place.is_file():
        place = Path(place.read_text().removeprefix("gitdir:").strip())
    index = (place / "index").read_bytes()
    signature, version, number = struct.unpack_from(">4sLL", index)
    if (signature, version) != (b"DIRC", 2):
        pytest.skip(f"git's index has version {version}; this test reads 2")
    names, begin = set(), 12
    for _ in range(number):  # 62 bytes, the name, 1 to 8 zeros up to a multiple of 8
        end = index.index(b"\0", begin + 62)
        names.add(index[begin + 62 : end].decode())
        begin += (end - begin) // 8 * 8 + 8
    return {name for name in names if (PROJECT / name).exists()}


def build(kind: str, source: Path, target: Path) -> Path:
    """Build an ``sdist`` or a ``wheel`` by setuptools alone."""
    code = f"from setuptools import build_meta as b; b.build_{kind}({str(target)!r})"
    run(sys.executable, "-c", code, folder=source)
    (made,) = target.glob("*.tar.gz" if kind == "sdist" else "*.whl")
    return made


@pytest.fixture(scope="module")
def source_archive(tmp_path_factory):
    given = os.environ.get("DOLFINX_JOINTS_DIST")
    if given is not None:
        (made,) = Path(given).glob("*.tar.gz")
        return made
    copy = tmp_path_factory.mktemp("project")
    for name in tracked():
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(PROJECT / name, copy / name, follow_symlinks=False)
    return build("sdist", copy, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(source_archive, tmp_path_factory):
    given = os.environ.get("DOLFINX_JOINTS_DIST")
    if given is not None:
        (made,) = Path(given).glob("*.whl")
        return made
    folder = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(source_archive) as archive:
        archive.extractall(folder, filter="data")
    (source,) = folder.iterdir()
    return build("wheel", source, tmp_path_factory.mktemp("wheel"))


def test_the_source_distribution_is_the_whole_project(source_archive):
    with tarfile.open(source_archive) as archive:
        names = [member.name.partition("/")[2] for member in archive if not member.isdir()]
        modes = {m.name.partition("/")[2]: m.mode for m in archive}
    assert {name for name in names if not name.startswith(ADDED)} == tracked()
    assert modes["with-dolfinx"] & 0o111  # or README's first command fails


def test_the_wheel_is_the_package_and_its_licence(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        information = next(name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = message_from_string(archive.read(information).decode())
        scripts = archive.read(information.replace("METADATA", "entry_points.txt")).decode()
    project = {name for name in tracked() if name != "dolfinx_joints/geometry"}
    package = {name for name in project if name.startswith("dolfinx_joints/")}
    package |= {f"dolfinx_joints/{name}" for name in project if name.startswith("geometry/")}
    about = {name for name in names if ".dist-info/" in name}
    assert names - about == package
    assert {"dolfinx_joints/py.typed", "dolfinx_joints/report/report.js"} <= package
    assert {Path(name).name for name in about} >= {"COPYING", "COPYING.LESSER", "RECORD"}
    assert metadata["License-Expression"] == "LGPL-3.0-or-later"
    assert metadata["Version"] == dolfinx_joints.__version__
    assert "dolfinx-joints = dolfinx_joints.cli:main" in scripts


def test_one_version_everywhere():
    with (PROJECT / "pyproject.toml").open("rb") as file:
        assert tomllib.load(file)["project"]["version"] == dolfinx_joints.__version__
    citation = (PROJECT / "CITATION.cff").read_text("utf-8").splitlines()
    assert f"version: {dolfinx_joints.__version__}" in citation


@pytest.mark.slow
def test_the_first_example_runs_from_the_wheel_in_an_empty_folder(wheel, tmp_path):
    pytest.importorskip("dolfinx")
    run(sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", "venv",
        folder=tmp_path)  # fmt: skip
    binaries, empty = tmp_path / "venv" / "bin", tmp_path / "empty"
    pip = (sys.executable, "-m", "pip", "--python", binaries / "python")
    # From no index: all that the wheel depends on must be there already.
    run(*pip, "install", "--no-index", "--root-user-action=ignore", wheel, folder=tmp_path)
    empty.mkdir()
    python = (binaries / "python", "-c")
    place = run(*python, "import dolfinx_joints as dj; print(dj.__file__)", folder=empty)
    assert place.startswith(str(tmp_path / "venv"))
    example = (PROJECT / "README.md").read_text("utf-8").split("```python\n")[1].split("```")[0]
    assert "steps" in run(*python, example, folder=empty)
    assert {path.name for path in empty.iterdir()} == {"dam.msh", "dam.h5", "first_steps.png"}
    for command in ([binaries / "dolfinx-joints"], [binaries / "python", "-m", "dolfinx_joints"]):
        assert "steps=2000" in run(*command, "info", "dam.h5", folder=empty)
        assert dolfinx_joints.__version__ in run(*command, "--version", folder=empty)
