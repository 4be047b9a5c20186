# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Build the documentation site: ``make docs``.

Any warning of Sphinx fails the build: a link without a target, an unknown name, a malformed
docstring. A page that would load a script, a style or a picture from the network fails it, too.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from pages import gather
from sphinx.cmd.build import main as sphinx

HERE = Path(__file__).resolve().parent
REMOTE = re.compile(r"<(?:script|img|link|iframe)\b[^>]*\b(?:src|href)=\"(?:https?:)?//[^>]*>")
# The files of MathJax that pages need, a tenth of the package.
MATHJAX = ("tex-chtml-full.js", "output/chtml/fonts/woff-v2")


def main() -> int:
    """Build the site and return 0, or 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description="Build the documentation site.")
    parser.add_argument(
        "--runs", type=Path, required=True, help="folder of the output and figures of the demos"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the site")
    options = parser.parse_args()
    sources = options.out.with_name(options.out.name + "-sources")
    gather(sources, options.runs)
    shutil.rmtree(options.out, ignore_errors=True)
    flags = ["--fail-on-warning", "--keep-going", "--fresh-env", "--quiet", "--builder", "html"]
    status = sphinx([*flags, "--conf-dir", str(HERE), str(sources), str(options.out)])
    if status:
        return 1
    copy_mathjax(options.out / "_static" / "mathjax")
    return report_remote(options.out)


def copy_mathjax(target: Path) -> None:
    """Copy MathJax and its fonts."""
    spec = find_spec("sphinx-mathjax-offline")
    assert spec is not None
    assert spec.origin is not None
    source = Path(spec.origin).parent / "static" / "mathjax"
    for name in MATHJAX:
        copy = shutil.copytree if (source / name).is_dir() else shutil.copy
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        copy(source / name, target / name)


def report_remote(site: Path) -> int:
    """Print what pages would load from the network; return 1 if there is anything, otherwise 0."""
    remote = [
        (page, tag) for page in site.rglob("*.html") for tag in REMOTE.findall(page.read_text())
    ]
    for page, tag in remote:
        print(f"{page} loads from the network: {tag}", file=sys.stderr)
    if not remote:
        print(f"{site / 'index.html'}")
    return int(bool(remote))


if __name__ == "__main__":
    sys.exit(main())
