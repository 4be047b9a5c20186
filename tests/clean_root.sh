#!/usr/bin/env bash
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

# README's first commands, as somebody gives them who has never seen the project, in systems that
# hold no more than a fresh container; and the wheel beside a DOLFINx from elsewhere.
self=$(readlink -f -- "${BASH_SOURCE[0]}")
project=$(dirname -- "$(dirname -- "$self")")
# shellcheck source=with-dolfinx
. "$project/with-dolfinx"
set -euo pipefail

usage='Usage: tests/clean_root.sh [PART...]
Tries the last commit from nothing. Parts, by default all of them, in half an hour:
  debian12   README in a fresh minimal Debian 12 with git, make and python3
  debian13   the same in Debian 13, where the set-up installs Debian packages instead
  wheel      the wheel in a Debian 13 that has DOLFINx
Needs root, mmdebstrap, git, 10 GB in TMPDIR (default: /var/tmp), Debian'\''s mirror and PyPI.'

# Prints the README's line that begins with $1, without its comment.
from_readme() {
    grep -m 1 -F -- "    $1" "$project/README.md" | sed -E 's/^    //; s/ +#.*//'
}

first=(
    "$(from_readme 'git clone' | sed 's#<this repository>#/srv/dolfinx_joints.git#')"
    "$(from_readme './with-dolfinx python3 demos/00_first_steps.py')"
    "$(from_readme 'make demo')"
    "$(from_readme './with-dolfinx mpirun')"
    './with-dolfinx dolfinx-joints info dam.h5'
)

# new_root SUITE PACKAGE...: a minimal Debian in $root, as containers begin with.
new_root() {
    local suite=$1 mirror options certificates=/usr/local/share/ca-certificates
    shift
    root=$work/$suite
    mapfile -t mirror < <(debian_mirror)
    mapfile -t options < <(apt_options)
    mmdebstrap --quiet --variant=minbase --include="ca-certificates $*" "${options[@]}" "$suite" \
        "$root" "${mirror[@]}"
    cp /etc/resolv.conf "$root/etc/"
    if [[ -d $certificates ]]; then cp -rT "$certificates" "$root$certificates"; fi
    env -u TMPDIR chroot "$root" update-ca-certificates >/dev/null
    mkdir -p "$root/home/user"
    git clone -q --bare "$project" "$root/srv/dolfinx_joints.git"
}

# Runs commands in turn in $root with an empty home, processes and mounts of its own, as a
# container does; README's cd holds for what follows. Removes $root.
# shellcheck disable=SC2016  # expanded inside
run_inside() {
    local proxies
    mapfile -t proxies < <(env | grep -i '^[a-z]*_proxy=')
    env -i "${proxies[@]}" PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/home/user LANG=C.UTF-8 \
        unshare --mount --pid --fork --kill-child --ipc --uts bash -c '
            set -e
            mount --bind "$1" "$1"; cd "$1"
            mount --rbind /dev dev; mount --rbind /sys sys; mount -t proc proc proc
            pivot_root . .; umount -l .
            cd /home/user
            for command in "${@:2}"; do
                echo "$ $command"; SECONDS=0
                eval "$command"
                echo "[$SECONDS s]"
            done' bash "$root" "$@"
    rm -rf --one-file-system -- "$root"
}

try_debian12() { new_root bookworm git make python3; run_inside "${first[@]}"; }

try_debian13() { new_root trixie git make python3; run_inside "${first[@]}"; }

# As a user of DOLFINx who never had the project's folder.
try_wheel() {
    git clone -q "$project" "$work/project"
    make -s -C "$work/project" dist
    new_root trixie python3-dolfinx-real python3-gmsh libegl1 python3-pip python3-venv
    cp -r -- "$work/project/dist" "$project/demos/00_first_steps.py" "$root/home/user"
    # shellcheck disable=SC2016  # expanded inside
    run_inside 'python3 -m venv --system-site-packages venv' '. venv/bin/activate' \
        'python3 -m pip install "$(echo dist/*.whl)[views,reports]"' \
        'mkdir elsewhere; cd elsewhere' 'python3 ../00_first_steps.py' \
        'dolfinx-joints csv dam.h5 --out tables' \
        'dolfinx-joints report dam.h5 --out report.html' 'python3 -m dolfinx_joints --version'
}

if [[ ${1-} == -h || ${1-} == --help ]]; then echo "$usage"; exit; fi
work=$(mktemp -d "${TMPDIR:-/var/tmp}/clean-XXXXXX")
trap 'rm -rf --one-file-system -- "$work"' EXIT
if (($# == 0)); then set -- debian12 debian13 wheel; fi
for part in "$@"; do
    echo "== $part"
    "try_$part"
    echo "== $part: passed"
done
