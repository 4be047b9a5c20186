# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Build the documentation site: ``make docs``.

Any warning is a failure: a link that leads nowhere, a name that does not exist, a docstring that
is not well formed. So is a page that would ask the net for a script, a style or a picture.
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
# What a page needs of MathJax, a tenth of what comes with it.
MATHJAX = ("tex-chtml-full.js", "output/chtml/fonts/woff-v2")


def main() -> int:
    """Build the site; 0, or 1 where something is wrong."""
    parser = argparse.ArgumentParser(description="Build the documentation site.")
    parser.add_argument("--runs", type=Path, required=True, help="what the demos printed and drew")
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
    """Name what pages would ask the net for; 1 if there is any."""
    found = [
        (page, tag) for page in site.rglob("*.html") for tag in REMOTE.findall(page.read_text())
    ]
    for page, tag in found:
        print(f"{page} asks the net: {tag}", file=sys.stderr)
    if not found:
        print(f"{site / 'index.html'}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
