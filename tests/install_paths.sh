#!/usr/bin/env bash
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

# Ways to install without the launcher, each from nothing: an empty environment, empty caches.
set -euo pipefail

usage='Usage: tests/install_paths.sh [PART...]
Installs this folder from nothing, runs demo 00, and demo 05 on 2 ranks. Parts, by default all:
  pip        an empty virtual environment of Python 3.12 or later, all packages from PyPI
  conda      environment.yml, by mamba, micromamba or conda
  container  Dockerfile, by docker or podman
What cannot run here is an error. PYTHON names the Python to take for pip.'
if [[ ${1-} == -h || ${1-} == --help ]]; then echo "$usage"; exit; fi

project=$(dirname -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")")
work=$(mktemp -d "${TMPDIR:-/var/tmp}/install-XXXXXX")
trap 'rm -rf -- "$work"' EXIT

# first_available COMMAND...: prints the first that there is.
first_available() {
    local command
    for command in "$@"; do
        if command -v "$command" >/dev/null; then echo "$command" && return; fi
    done
    echo "none of these commands is there: $*" >&2
    return 1
}

timed() {
    local start=$SECONDS
    "$@"
    echo "[$((SECONDS - start)) s] $*"
}

# try_examples RUN...: demos, one of them on 2 ranks, and what looks at results; RUN runs a command
# in the environment, in the folder $work/example.
try_examples() {
    mkdir -p "$work/example"
    cp -- "$project"/demos/0[05]_*.py "$work/example"
    cd -- "$work/example"
    timed "$@" python3 00_first_steps.py
    timed "$@" mpirun -n 2 python3 05_joint_law_in_ufl.py
    timed "$@" dolfinx-joints csv dam.h5 --out tables
    timed "$@" dolfinx-joints report dam.h5 --out report.html
    ls -l first_steps.png report.html tables
}

try_pip() {
    local python
    python=${PYTHON:-$(first_available python3.14 python3.13 python3.12 python3)}
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 12))' ||
        { echo "$python does not run, or is older than 3.12; PYTHON names another" >&2 && return 1; }
    "$python" -m venv "$work/venv"
    export PATH="$work/venv/bin:$PATH" XDG_CACHE_HOME="$work/cache"
    git clone -q -- "$project" "$work/project"
    timed pip install -q --no-cache-dir "$work/project[dolfinx,views,reports,geometry]"
    du -sm "$work/venv"
    try_examples env
    # The one order of imports that cannot work is named, not left to fail somewhere else.
    ! python3 -c 'import dolfinx_solver, dolfinx.fem.petsc, dolfinx_joints' 2> order.txt
    grep -F 'above the imports from dolfinx' order.txt
}

try_conda() {
    local conda
    conda=$(first_available mamba micromamba conda)
    cd -- "$project"
    timed "$conda" env create -y -q -p "$work/conda" -f environment.yml
    try_examples "$conda" run -p "$work/conda"
}

try_container() {
    local engine
    engine=$(first_available docker podman)
    timed "$engine" build -q -t dolfinx-joints "$project"
    try_examples "$engine" run --rm -v "$work/example:/work" -w /work dolfinx-joints
}

if (($# == 0)); then set -- pip conda container; fi
for part in "$@"; do
    echo "== $part"
    ("try_$part")
    echo "== $part: passed"
done
