#!/usr/bin/env bash
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

# What somebody who has never seen the project does first, in systems that hold no more than a
# fresh container: README's first commands, and the wheel beside a DOLFINx from elsewhere.
self=$(readlink -f -- "${BASH_SOURCE[0]}")
project=$(dirname -- "$(dirname -- "$self")")
# shellcheck source=with-dolfinx
. "$project/with-dolfinx"
set -euo pipefail

usage() {
    cat <<'TEXT'
Usage: tests/clean_root.sh [PART...]

Tries the last commit from nothing and says what it does, command by command. Parts, by default
all of them, in half an hour:

  debian12   README's first commands in a fresh minimal Debian 12 with git, make and python3
  debian13   the same in Debian 13, where the set-up installs Debian packages instead
  wheel      the wheel in a Debian 13 that has DOLFINx: in a virtual environment, then beside
             Debian's own packages; its commands and the demos from another folder
  cache      README's first commands on this system, from an empty cache

Needs root, mmdebstrap, git, 10 GB in TMPDIR (default: /var/tmp), Debian's mirror and PyPI. Takes
this system's mirror, proxies and own certificates over, and nothing else. Removes what it made.
Exit status: 0 if every command succeeded.
TEXT
}

say() { printf '== %s\n' "$*"; }
die() { printf 'clean_root.sh: %s\n' "$*" >&2; exit 1; }

# ---------------------------------------------------------------- commands, as README gives them

# Prints the README's line that begins with $1, without what it says of it; dies if it has none.
from_readme() {
    local line
    line=$(grep -m 1 -F -- "    $1" "$project/README.md") || die "README.md lacks the line '$1'."
    sed -E 's/^    //; s/ +#.*//' <<<"$line"
}

set_first_commands() {
    first=(
        "$(from_readme 'git clone')"
        "$(from_readme './with-dolfinx python3 demos/00_first_steps.py')"
        "$(from_readme 'make demo')"
        "$(from_readme './with-dolfinx mpirun')"
        "./with-dolfinx python3 -m dolfinx_joints info dam.h5"
        "test -s first_steps.png"
    )
    first[0]=${first[0]/<this repository>/\"\$REPOSITORY\"}
}

# Prints a script that runs the commands in turn, each with its seconds, and stops at a failure.
# They share a shell, so README's cd holds for what follows.
script_of() {
    local command
    echo 'exec 2>&1'
    for command in "$@"; do
        printf 'echo %q; SECONDS=0\n' "\$ $command"
        # shellcheck disable=SC2016  # expanded by the script that is printed
        printf '%s || { echo "[failed after $SECONDS s]"; exit 1; }\n' "$command"
        # shellcheck disable=SC2016
        echo 'echo "[$SECONDS s]"'
    done
}

# ---------------------------------------------------------------- a system from nothing

# new_root SUITE PACKAGE...: a minimal Debian in $root, as containers begin with.
new_root() {
    local suite=$1 mirror options packages
    shift
    root=$work/$suite
    say "new $suite with $*"
    mapfile -t mirror < <(debian_mirror)
    mapfile -t options < <(apt_options)
    packages=("$@")
    if compgen -G '/usr/local/share/ca-certificates/*.crt' >/dev/null; then
        packages+=(ca-certificates)
    fi
    mmdebstrap --quiet --variant=minbase --include="${packages[*]}" "${options[@]}" \
        "$suite" "$root" "${mirror[@]}" >"$work/build.log" 2>&1 ||
        { tail -n 20 "$work/build.log"; die "mmdebstrap could not make $suite."; }
    cp /etc/resolv.conf "$root/etc/"
    if [[ " ${packages[*]} " == *' ca-certificates '* ]]; then
        cp /usr/local/share/ca-certificates/*.crt "$root/usr/local/share/ca-certificates/"
        env -u TMPDIR chroot "$root" update-ca-certificates >>"$work/build.log" 2>&1 ||
            { tail -n 20 "$work/build.log"; die "$suite does not take the certificates."; }
    fi
    mkdir -p "$root/home/user"
    git clone -q --bare "$repository" "$root/srv/dolfinx_joints.git"
}

# Makes $1 the root of the file system and runs the script $2 with an empty home, as in a
# container: with processes and mounts of its own, which end with it.
# shellcheck disable=SC2016  # expanded inside
inside='
set -euo pipefail
mount --bind "$1" "$1"
cd "$1"
mount --rbind /dev dev
mount --rbind /sys sys
mount -t proc proc proc
pivot_root . .
umount -l .
cd /home/user
exec bash -c "$2"
'

run_inside() {
    local name proxies=()
    for name in http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY; do
        if [[ -n ${!name-} ]]; then proxies+=("$name=${!name}"); fi
    done
    env -i "${proxies[@]}" PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        HOME=/home/user LANG=C.UTF-8 REPOSITORY=/srv/dolfinx_joints.git \
        unshare --mount --propagation private --pid --fork --kill-child --ipc --uts \
        bash -c "$inside" bash "$root" "$(script_of "$@")"
}

remove_root() {
    rm -rf --one-file-system -- "$root"
}

# ---------------------------------------------------------------- parts

try_debian12() {
    new_root bookworm git make python3
    run_inside "${first[@]}"
    remove_root
}

try_debian13() {
    new_root trixie git make python3
    run_inside "${first[@]}"
    remove_root
}

# As a user of DOLFINx who never had the project's folder, but for the script that makes the mesh.
# shellcheck disable=SC2016  # expanded inside
try_wheel() {
    local folder=$work/project with_parts='"$(echo ../dist/*.whl)[views,reports]"'
    say "make dist"
    git clone -q "$repository" "$folder"
    make -s -C "$folder" dist
    new_root trixie python3-dolfinx-real python3-gmsh libegl1 python3-pip python3-venv
    cp -r -- "$folder/dist" "$root/home/user/dist"
    mkdir "$root/home/user/elsewhere"
    cp -r -- "$folder/demos/00_first_steps.py" "$folder/geometry" "$root/home/user/elsewhere"
    run_inside \
        'python3 -m venv --system-site-packages venv && . venv/bin/activate' \
        "$(from_readme 'python3 -m pip install dist/dolfinx_joints-*.whl')" \
        'cd elsewhere' \
        'python3 -m dolfinx_joints --help' \
        'dolfinx-joints --version' \
        "python3 -m pip install $with_parts" \
        'python3 00_first_steps.py' \
        'dolfinx-joints info dam.h5' \
        'dolfinx-joints csv dam.h5 --out tables' \
        'dolfinx-joints report dam.h5 --out report.html' \
        'deactivate && rm -r ../venv dam.h5 first_steps.png' \
        "python3 -m pip install --break-system-packages $with_parts" \
        'python3 00_first_steps.py' \
        'dolfinx-joints info dam.h5' \
        'python3 -m dolfinx_joints --version'
    remove_root
}

try_cache() {
    local home=$work/cache
    mkdir "$home"
    (cd "$home" && XDG_CACHE_HOME=$home/cache REPOSITORY=$repository \
        bash -c "$(script_of "${first[@]}")")
    rm -rf --one-file-system -- "$home"
}

# ---------------------------------------------------------------- main

all=(debian12 debian13 wheel cache)

main() {
    local part parts=("$@") first repository root=''
    if [[ ${1-} == -h || ${1-} == --help ]]; then usage && exit 0; fi
    if (($# == 0)); then parts=("${all[@]}"); fi
    for part in "${parts[@]}"; do
        [[ " ${all[*]} " == *" $part "* ]] || die "there is no part '$part'; parts: ${all[*]}"
    done
    ((EUID == 0)) || die "needs root, for systems of their own."
    have mmdebstrap || die "needs mmdebstrap."
    set_first_commands
    work=$(mktemp -d "${TMPDIR:-/var/tmp}/clean-XXXXXX")
    trap 'rm -rf --one-file-system -- "$work"' EXIT
    repository=$work/dolfinx_joints.git
    git clone -q --bare "$project" "$repository"
    for part in "${parts[@]}"; do
        say "$part"
        "try_$part"
        say "$part: passed"
    done
}

main "$@"
