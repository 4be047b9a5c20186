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
USAGE_ERROR, SETUP_FAILED = 2, 125
INSIDE = {"DOLFINX_JOINTS_INSIDE": "0.9"}  # as the script is run in its own environment


def run(*command, cwd=None, **variables):
    """Run a command in this environment with variables changed, or removed if None.

    A shell in the background lets those that it starts ignore SIGINT.
    """
    given = {k: v for k, v in os.environ.items() if not k.startswith("DOLFINX_JOINTS_")} | variables
    return subprocess.run(
        command,
        env={k: v for k, v in given.items() if v is not None},
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def run_function(code, *arguments, **variables):
    """Run shell code that may call the script's functions; the arguments are $1, $2, ..."""
    code = f'. "$1"; shift; set -euo pipefail; {code}'
    return run("bash", "-c", code, "bash", str(SCRIPT), *arguments, **variables)


@pytest.fixture
def host_python(tmp_path):
    """Give a function that makes a directory with a python3 whose report is the given text."""

    def make(report):
        fake = tmp_path / "bin" / "python3"
        fake.parent.mkdir()
        fake.write_text(f"#!/bin/sh\necho {report}\n")
        fake.chmod(0o755)
        return f"{fake.parent}:{os.environ['PATH']}"

    return make


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "no command is given"),
        (["--frobnicate"], "unknown option --frobnicate"),
        (["--dolfinx", "0.10", "true"], "--dolfinx must be 0.9 or 0.11, not '0.10'"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(arguments, text):
    result = run(str(SCRIPT), *arguments)
    assert (result.returncode, result.stdout) == (USAGE_ERROR, "")
    assert text in result.stderr
    assert result.stderr.count("\n") == 1


READY = {"report": "ready 0.9.0", "DOLFINX_JOINTS_PRIVATE": "1"}
SET_UP_ERRORS = [
    ({**INSIDE, "TMPDIR": "/nowhere"}, [], "TMPDIR is '/nowhere', which is not a folder"),
    (INSIDE, ["--dolfinx", "0.11"], "inside the private Debian with DOLFINx 0.9 already"),
    ({"report": "lacks 0.10.0 gmsh tqdm"}, [], "has DOLFINx 0.10.0 but not: gmsh tqdm"),
    ({**READY, "HOME": None, "XDG_CACHE_HOME": None}, [], "HOME is not set; set it or XDG_CACHE"),
]


@pytest.mark.parametrize(("variables", "options", "text"), SET_UP_ERRORS)
def test_what_cannot_be_set_up_is_said(variables, options, text, host_python):
    variables = dict(variables)
    if "report" in variables:
        variables["PATH"] = host_python(variables.pop("report"))
    result = run(str(SCRIPT), *options, "echo", "here", **variables)
    assert (result.returncode, result.stdout) == (SETUP_FAILED, "")
    assert result.stderr.startswith("with-dolfinx: ")
    assert text in result.stderr


def test_status_and_arguments_pass_through():
    assert run(str(SCRIPT), "sh", "-c", "exit 7", **INSIDE).returncode == 7
    assert run(str(SCRIPT), "no-such-command", **INSIDE).returncode == 127
    arguments = ["a b", "$HOME", "", "*", "-n"]
    result = run(str(SCRIPT), "printf", "[%s]", *arguments, **INSIDE)
    assert result.stdout == "".join(f"[{argument}]" for argument in arguments)


def test_command_of_the_package_works_from_a_checkout(tmp_path):
    (tmp_path / "random.py").write_text("raise SystemExit('imported from the current folder')")
    result = run(str(SCRIPT), "dolfinx-joints", "--version", cwd=tmp_path, **INSIDE)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == f"dolfinx_joints {dolfinx_joints.__version__}\n"


@pytest.mark.parametrize(("chosen", "threads"), [(None, "1"), ("4", "4")])
def test_one_thread_per_process_unless_the_user_says_otherwise(chosen, threads):
    show = ("sh", "-c", "echo $OMP_NUM_THREADS $OPENBLAS_NUM_THREADS")
    variables = {"OMP_NUM_THREADS": chosen, "OPENBLAS_NUM_THREADS": None}
    assert run(str(SCRIPT), *show, **INSIDE, **variables).stdout.split() == [threads, "1"]


@pytest.mark.parametrize(
    ("code", "variables", "shown"),
    [
        (
            'set_common_environment; set_private_environment; echo "$PYTHONPATH"',
            {"PYTHONPATH": "/mine:/a b:/env/lib/python3.9/site-packages/"},
            f"{PROJECT}:/mine:/a b",
        ),
        ("debian_mirror", {"DOLFINX_JOINTS_MIRROR": "http://mine/debian"}, "http://mine/debian"),
    ],
)
def test_paths_and_mirror_of_the_user_are_used(code, variables, shown):
    assert run_function(code, **variables).stdout == f"{shown}\n"


# Names the Debian that a call would build, on a system without DOLFINx as Debian packages.
NAME_ROOT = """
dolfinx_of_this_debian() { :; }
choose_unshared() { :; }
ensure_root() { echo "$suite"; exit 0; }
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
def test_the_version_asked_for_is_found_or_built(options, report, suite, host_python, tmp_path):
    # The host's own python3 is used (None) if and only if its DOLFINx is the one asked for.
    variables = {"PATH": host_python(report), "XDG_CACHE_HOME": str(tmp_path)}
    result = run_function(NAME_ROOT, *options, "echo", "here", **variables)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"{suite or 'here'}\n"


# Replaces the part of a build that needs a network and a minute.
FAKE_BUILD = """
need_build_tools() { :; }
need_space() { :; }
build_into() { mkdir -p "$1/etc"; echo built >>"$XDG_CACHE_HOME/count"; %s; }
ensure_root "$(root_path)"; ls "$(cache_dir)"
"""


def build(cache, behaviour="true"):
    """Let the script make sure that a private root is there, with a build that is a mock."""
    return run_function(FAKE_BUILD % behaviour, XDG_CACHE_HOME=str(cache))


@pytest.mark.parametrize(
    ("version", "advice"),
    [("0.9", "DOLFINX_JOINTS_MIRROR"), ("0.11", "https://snapshot.debian.org/archive/debian/")],
)
def test_failed_build_leaves_nothing_and_shows_its_log(tmp_path, version, advice):
    code = FAKE_BUILD % "echo 'E: no route to the mirror'; return 1"
    result = run_function(f"choose_debian {version}; {code}", XDG_CACHE_HOME=str(tmp_path))
    assert result.returncode == SETUP_FAILED
    assert "E: no route to the mirror" in result.stderr
    assert advice in result.stderr
    assert not list(tmp_path.glob("dolfinx_joints/*root-*"))


@pytest.mark.parametrize("name", ["KILL", "INT"])
def test_half_built_root_is_not_taken_for_whole(tmp_path, name):
    # Ctrl-C reaches the whole group of processes, the build as well; signal 9 the script alone.
    group = "sleep 0.2" if name == "KILL" else "kill -INT $BASHPID; sleep 5"
    stopped = build(tmp_path, f"kill -{name} $$; {group}")
    assert stopped.returncode != 0
    assert ("removing the incomplete files" in stopped.stderr) == (name == "INT")
    assert not list(tmp_path.glob("dolfinx_joints/root-*"))
    again, once_more = build(tmp_path), build(tmp_path)
    assert again.returncode == once_more.returncode == 0, again.stderr
    assert "this happens once" in again.stderr
    assert once_more.stderr == ""
    assert not list(tmp_path.glob("dolfinx_joints/building-*"))
    assert len(list(tmp_path.glob("dolfinx_joints/root-*"))) == 1
    assert (tmp_path / "count").read_text() == "built\n" * 2


def test_concurrent_call_waits_and_says_so(tmp_path):
    code = f"({FAKE_BUILD % 'sleep 1'}) & sleep 0.4; {FAKE_BUILD % 'true'} wait"
    result = run_function(code, XDG_CACHE_HOME=str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert "waiting for it" in result.stderr
    assert (tmp_path / "count").read_text() == "built\n"


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ('root_megabytes=999999999; need_space "$1"', "free some space, or choose another place"),
        ("have() { false; }; need_build_tools", "this system lacks mmdebstrap"),
    ],
)
def test_lack_of_space_or_tools_is_one_clear_error_before_the_build(tmp_path, code, text):
    result = run_function(code, str(tmp_path))
    assert result.returncode == SETUP_FAILED
    assert text in result.stderr
    assert result.stderr.count("\n") == 1


# Replaces the part that needs PyPI: $1 is the folder that pip would fill.
FAKE_PIP = """
run_first_example() { :; }
fetch_wheels() { mkdir -p "$1/numba"; echo fetched >>"$XDG_CACHE_HOME/count"; %s; }
PYTHONPATH=/mine; mkdir -p "$1/usr/bin"; ln -sf python3.13 "$1/usr/bin/python3"
ensure_wheels "$1" env; echo "$PYTHONPATH"
"""


def install(tmp_path, behaviour="true"):
    """Let the script make sure that the packages are there, with a pip that is a mock."""
    root = str(tmp_path / "root")
    return run_function(FAKE_PIP % behaviour, root, XDG_CACHE_HOME=str(tmp_path))


def test_packages_are_installed_once_and_found_after_those_of_the_user(tmp_path):
    failed = install(tmp_path, "echo 'ERROR: No matching distribution found'; return 1")
    assert (failed.returncode, failed.stdout) == (SETUP_FAILED, "")
    assert "ERROR: No matching distribution found" in failed.stderr
    assert "pip could not install numba" in failed.stderr
    assert install(tmp_path, "kill -9 $$; sleep 0.2").returncode < 0
    first, second = install(tmp_path), install(tmp_path)
    assert first.returncode == second.returncode == 0, first.stderr
    (folder,) = tmp_path.glob("dolfinx_joints/*wheels-*")
    assert (folder / "numba").is_dir()
    assert first.stdout == second.stdout == f"/mine:{folder}\n"
    assert (tmp_path / "count").read_text() == "fetched\n" * 3
    assert second.stderr == ""
