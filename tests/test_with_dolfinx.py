# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The set-up script, inside and outside the environment that it provides."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

import dolfinx_joints

PROJECT = Path(__file__).parent.parent
SCRIPT = PROJECT / "with-dolfinx"
USAGE_ERROR = 2
SETUP_FAILED = 125


def run(
    *command: str, cwd: Path | None = None, **variables: str | None
) -> subprocess.CompletedProcess:
    """Run a command in this environment with variables changed, or removed if None.

    A shell in the background lets those that it starts ignore SIGINT.
    """
    environment = {k: v for k, v in os.environ.items() if not k.startswith("DOLFINX_JOINTS_")}
    environment.update({k: v for k, v in variables.items() if v is not None})
    for name in [k for k, v in variables.items() if v is None]:
        environment.pop(name, None)
    return subprocess.run(
        command,
        env=environment,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def run_nested(*command: str, **variables: str | None) -> subprocess.CompletedProcess:
    """Run the script as it is run inside its own environment."""
    return run(str(SCRIPT), *command, DOLFINX_JOINTS_INSIDE="0.9", **variables)


def run_function(
    code: str, *arguments: str, **variables: str | None
) -> subprocess.CompletedProcess:
    """Run shell code that may call the script's functions; the arguments are $1, $2, ..."""
    code = f'. "$1"; shift; set -euo pipefail; {code}'
    return run("bash", "-c", code, "bash", str(SCRIPT), *arguments, **variables)


# ---------------------------------------------------------------- command line


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "which command shall be run?"),
        (["--frobnicate"], "unknown option --frobnicate"),
        (["--dolfinx", "0.10", "true"], "--dolfinx must be 0.9 or 0.11, not '0.10'"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(arguments: list[str], text: str) -> None:
    result = run(str(SCRIPT), *arguments)
    assert result.returncode == USAGE_ERROR
    assert result.stdout == ""
    assert text in result.stderr
    assert result.stderr.count("\n") == 1


def test_folder_for_temporary_files_must_be_there() -> None:
    result = run_nested("true", TMPDIR="/nowhere")
    assert result.returncode == SETUP_FAILED
    assert result.stderr.startswith("with-dolfinx: TMPDIR is '/nowhere', where there is no folder")
    assert len(result.stderr.splitlines()) == 1


# ---------------------------------------------------------------- what the command sees


def test_status_and_arguments_pass_through() -> None:
    assert run_nested("sh", "-c", "exit 7").returncode == 7
    assert run_nested("no-such-command").returncode == 127
    arguments = ["a b", "$HOME", "", "*", "-n"]
    result = run_nested("printf", "[%s]", *arguments)
    assert result.stdout == "".join(f"[{argument}]" for argument in arguments)


def test_command_of_the_package_works_from_a_checkout(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text("raise SystemExit('imported from the current folder')")
    result = run(
        str(SCRIPT), "dolfinx-joints", "--version", cwd=tmp_path, DOLFINX_JOINTS_INSIDE="0.9"
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == f"dolfinx_joints {dolfinx_joints.__version__}\n"


def test_nested_call_cannot_change_the_version() -> None:
    assert run_nested("--dolfinx", "0.9", "echo", "here").stdout == "here\n"
    result = run_nested("--dolfinx", "0.11", "echo", "here")
    assert (result.returncode, result.stdout) == (SETUP_FAILED, "")
    assert "inside the private Debian with DOLFINx 0.9 already" in result.stderr
    assert result.stderr.count("\n") == 1


def test_one_thread_per_process_unless_the_user_says_otherwise() -> None:
    show = ("sh", "-c", "echo $OMP_NUM_THREADS $OPENBLAS_NUM_THREADS")
    unset = run_nested(*show, OMP_NUM_THREADS=None, OPENBLAS_NUM_THREADS=None)
    chosen = run_nested(*show, OMP_NUM_THREADS="4", OPENBLAS_NUM_THREADS=None)
    assert unset.stdout.split() == ["1", "1"]
    assert chosen.stdout.split() == ["4", "1"]


def test_python_path_of_the_user_is_kept_but_for_another_pythons_packages() -> None:
    path = ":".join(
        ["/mine", "/a b", "/env/lib/python3.9/site-packages/", "/usr/lib/python3/dist-packages"]
    )
    code = 'set_common_environment; set_private_environment; echo "$PYTHONPATH"'
    result = run_function(code, PYTHONPATH=path)
    assert result.stdout == f"{PROJECT}:/mine:/a b\n"


# ---------------------------------------------------------------- DOLFINx on the host


@pytest.fixture
def host_python(tmp_path: Path):
    """Give a function that makes a directory with a python3 whose report is the given text."""

    def make(report: str) -> str:
        fake = tmp_path / "bin" / "python3"
        fake.parent.mkdir()
        fake.write_text(f"#!/bin/sh\necho {report}\n")
        fake.chmod(0o755)
        return f"{fake.parent}:{os.environ['PATH']}"

    return make


def test_complete_host_python_is_used_directly(host_python) -> None:
    result = run(str(SCRIPT), "echo", "here", PATH=host_python("ready 0.9.0"))
    assert (result.returncode, result.stdout) == (0, "here\n")


def test_lacking_modules_are_named(host_python) -> None:
    result = run(str(SCRIPT), "true", PATH=host_python("lacks 0.10.0 gmsh tqdm"))
    assert result.returncode == SETUP_FAILED
    assert "has DOLFINx 0.10.0 but not: gmsh tqdm" in result.stderr


def test_home_is_asked_for_where_it_is_needed(host_python) -> None:
    nowhere = {"HOME": None, "XDG_CACHE_HOME": None}
    ready = {**nowhere, "PATH": host_python("ready 0.9.0")}
    assert run(str(SCRIPT), "true", **ready).returncode == 0
    result = run(str(SCRIPT), "true", DOLFINX_JOINTS_PRIVATE="1", **ready)
    assert result.returncode == SETUP_FAILED
    assert result.stderr.startswith("with-dolfinx: HOME is not set; set it, or XDG_CACHE_HOME")
    assert len(result.stderr.splitlines()) == 1


# Names the Debian that a call would build, on a system without DOLFINx as Debian packages.
NAME_ROOT = """
dolfinx_of_this_debian() { :; }
choose_unshared() { :; }
ensure_root() { echo "$1 $suite"; exit 0; }
main "$@"
"""


@pytest.mark.parametrize(
    ("options", "report", "suite"),
    [
        ([], "absent", "trixie"),
        ([], "ready 0.11.0", None),
        (["--dolfinx", "0.9"], "ready 0.9.0", None),
        (["--dolfinx", "0.9"], "ready 0.11.0", "trixie"),
        (["--dolfinx", "0.11"], "ready 0.11.0.post0", None),
        (["--dolfinx", "0.11"], "lacks 0.9.0 gmsh", "sid"),
    ],
)
def test_the_version_asked_for_is_found_or_built(
    options: list[str], report: str, suite: str | None, host_python, tmp_path: Path
) -> None:
    # The host's own python3 is used (None) if and only if its DOLFINx is the one asked for.
    variables = {"PATH": host_python(report), "XDG_CACHE_HOME": str(tmp_path)}
    result = run_function(NAME_ROOT, *options, "echo", "here", **variables)
    assert result.returncode == 0, result.stderr
    if suite is None:
        assert result.stdout == "here\n"
    else:
        folder, name = result.stdout.split()
        assert name == suite
        versions = run_function("root_path; choose_debian 0.11; root_path", **variables)
        assert folder == versions.stdout.split()[suite == "sid"]


# ---------------------------------------------------------------- the private root


def test_mirror_of_the_user_comes_first_and_may_be_one_of_an_earlier_day() -> None:
    code = "debian_mirror; have() { false; }; apt_options; unset DOLFINX_JOINTS_MIRROR; apt_options"
    result = run_function(code, DOLFINX_JOINTS_MIRROR="http://chosen.example/debian")
    first, *options = result.stdout.splitlines()
    assert first == "http://chosen.example/debian"
    assert options == ['--aptopt=Acquire::Check-Valid-Until "false"']


# Replaces the part of a build that needs a network and a minute.
FAKE_BUILD = """
need_build_tools() { :; }
need_space() { :; }
build_into() { mkdir -p "$1/etc"; echo built >>"$XDG_CACHE_HOME/count"; %s; }
ensure_root "$(root_path)"; ls "$(cache_dir)"
"""


def build(cache: Path, behaviour: str = "true") -> subprocess.CompletedProcess:
    """Let the script make sure that a private root is there, with a build that is a mock."""
    return run_function(FAKE_BUILD % behaviour, XDG_CACHE_HOME=str(cache))


def test_root_is_built_once(tmp_path: Path) -> None:
    first, second = build(tmp_path), build(tmp_path)
    assert first.returncode == second.returncode == 0, first.stderr
    assert (tmp_path / "count").read_text() == "built\n"
    assert "this happens once" in first.stderr
    assert second.stderr == ""


@pytest.mark.parametrize(
    ("version", "advice"),
    [("0.9", "DOLFINX_JOINTS_MIRROR"), ("0.11", "https://snapshot.debian.org/archive/debian/")],
)
def test_failed_build_leaves_nothing_and_shows_its_log(
    tmp_path: Path, version: str, advice: str
) -> None:
    code = FAKE_BUILD % "echo 'E: no route to the mirror'; return 1"
    result = run_function(f"choose_debian {version}; {code}", XDG_CACHE_HOME=str(tmp_path))
    assert result.returncode == SETUP_FAILED
    assert "E: no route to the mirror" in result.stderr
    assert advice in result.stderr
    assert not list(tmp_path.glob("dolfinx_joints/*root-*"))


def test_half_built_root_is_not_taken_for_whole(tmp_path: Path) -> None:
    killed = build(tmp_path, "kill -9 $$; sleep 0.2")
    assert killed.returncode < 0
    leftovers = list(tmp_path.glob("dolfinx_joints/building-*"))
    assert len(leftovers) == 1
    assert not list(tmp_path.glob("dolfinx_joints/root-*"))

    again = build(tmp_path)
    assert again.returncode == 0, again.stderr
    assert not leftovers[0].exists()
    assert len(list(tmp_path.glob("dolfinx_joints/root-*"))) == 1
    assert (tmp_path / "count").read_text() == "built\n" * 2


@pytest.mark.parametrize("name", ["INT", "TERM", "HUP"])
def test_interrupted_build_leaves_nothing(tmp_path: Path, name: str) -> None:
    # Ctrl-C and an end of the session reach the whole group of processes, the build as well.
    stopped = build(tmp_path, f"kill -{name} $$; kill -{name} $BASHPID; sleep 5")
    assert stopped.returncode != 0
    assert "nothing half done is kept" in stopped.stderr
    assert not list(tmp_path.glob("dolfinx_joints/*root-*"))
    again = build(tmp_path)
    assert again.returncode == 0, again.stderr
    assert len(list(tmp_path.glob("dolfinx_joints/root-*"))) == 1


def test_concurrent_call_waits_and_says_so(tmp_path: Path) -> None:
    code = f"({FAKE_BUILD % 'sleep 1'}) & sleep 0.4; {FAKE_BUILD % 'true'} wait"
    result = run_function(code, XDG_CACHE_HOME=str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert "waiting for it" in result.stderr
    assert (tmp_path / "count").read_text() == "built\n"


def test_system_directories_are_not_shared(tmp_path: Path) -> None:
    shared = run_function("shared_directories", TMPDIR=str(tmp_path)).stdout.splitlines()
    assert {"/tmp", "/var/tmp"} <= set(shared)
    assert not {"/", "/usr", "/etc", "/var", "/bin", "/lib", "/proc", "/dev", "/sys"} & set(shared)


def test_lack_of_space_or_tools_is_one_clear_error_before_the_build(tmp_path: Path) -> None:
    for code, text in (
        ('root_megabytes=999999999; need_space "$1"', "make room, or choose another place"),
        ("have() { false; }; need_build_tools", "this system lacks mmdebstrap"),
    ):
        result = run_function(code, str(tmp_path))
        assert result.returncode == SETUP_FAILED
        assert text in result.stderr
        assert result.stderr.count("\n") == 1


# ---------------------------------------------------------------- packages from PyPI

# Replaces the part that needs PyPI: $1 is the folder that pip would fill.
FAKE_PIP = """
run_first_example() { :; }
fetch_wheels() { mkdir -p "$1/numba"; echo fetched >>"$XDG_CACHE_HOME/count"; %s; }
PYTHONPATH=/mine; mkdir -p "$1/usr/bin"; ln -sf python3.13 "$1/usr/bin/python3"
ensure_wheels "$1" env; echo "$PYTHONPATH"
"""


def install(tmp_path: Path, behaviour: str = "true") -> subprocess.CompletedProcess:
    """Let the script make sure that the packages are there, with a pip that is a mock."""
    root = str(tmp_path / "root")
    return run_function(FAKE_PIP % behaviour, root, XDG_CACHE_HOME=str(tmp_path))


def test_packages_are_installed_once_and_found_after_those_of_the_user(tmp_path: Path) -> None:
    first, second = install(tmp_path), install(tmp_path)
    assert first.returncode == second.returncode == 0, first.stderr
    (folder,) = tmp_path.glob("dolfinx_joints/wheels-python3.13-*")
    assert (folder / "numba").is_dir()
    assert first.stdout == second.stdout == f"/mine:{folder}\n"
    assert (tmp_path / "count").read_text() == "fetched\n"
    assert second.stderr == ""


def test_failed_or_killed_installation_is_not_taken_for_whole(tmp_path: Path) -> None:
    failed = install(tmp_path, "echo 'ERROR: No matching distribution found'; return 1")
    assert (failed.returncode, failed.stdout) == (SETUP_FAILED, "")
    assert "ERROR: No matching distribution found" in failed.stderr
    assert "pip could not install numba" in failed.stderr
    assert not list(tmp_path.glob("dolfinx_joints/*wheels-*"))
    assert install(tmp_path, "kill -9 $$; sleep 0.2").returncode < 0
    assert [path.name[:15] for path in tmp_path.glob("dolfinx_joints/*wheels-*")] == [
        "building-wheels"
    ]
    again = install(tmp_path)
    assert again.returncode == 0, again.stderr
    assert not list(tmp_path.glob("dolfinx_joints/building-*"))


@pytest.mark.parametrize("status", [0, 1])
def test_the_first_example_is_run_once_and_leaves_what_it_compiled(
    tmp_path: Path, status: int
) -> None:
    # Its failure is told and is no reason to be without an environment.
    fake, kept = tmp_path / "python3", tmp_path / "dolfinx_joints"
    kept.mkdir()
    fake.write_text(f'#!/bin/sh\necho "$PWD $1 $PYTHONPATH"; touch dam.h5; exit {status}\n')
    fake.chmod(0o755)
    code = f"PATH={tmp_path}:$PATH; run_first_example /wheels env"
    result = run_function(code, XDG_CACHE_HOME=str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert ("it failed" in result.stderr) == (status == 1)
    said = f"{kept}/first_example {PROJECT}/demos/00_first_steps.py {PROJECT}:/wheels\n"
    assert (kept / "first_example.log").read_text() == said
    assert not (kept / "first_example").exists()
