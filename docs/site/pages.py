# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of the documentation site: texts of the project, demos, and lists of public names."""

from __future__ import annotations

import ast
import os
import re
import shutil
from collections import defaultdict
from importlib.util import find_spec
from pathlib import Path

from dolfinx_joints import _HOME

PROJECT = Path(__file__).resolve().parents[2]
# In the order of the menu.
MENU = {
    "Use": [
        "docs/guide.md",
        "demos",
        "docs/api.md",
        "docs/modules.md",
    ],
    "Background": ["docs/theory.md", "docs/time_integration.md", "docs/conventions.md"],
    "Evidence": [
        "docs/benchmarks.md",
        "docs/studies.md",
        "docs/mutants.md",
    ],
    "Development": ["docs/design.md", "CONTRIBUTING.md", "CHANGELOG.md"],
}
# Files beside the pages that pages link to.
FILES = ("CITATION.cff", "COPYING", "COPYING.LESSER")
# Modules that users import by name, as the guide does.
MODULES = (
    "results",
    "measures",
    "envelopes",
    "spectra",
    "motion_processing",
    "stresses",
    "plots",
    "motion_plots",
    "response_plots",
    "views",
    "report",
    "study",
)
LINK = re.compile(r"\]\(([^)\s:#]+)(#[^)\s]*)?\)")


def demos() -> list[Path]:
    """The demos in their order."""
    return sorted((PROJECT / "demos").glob("[0-9]*.py"))


def gather(target: Path, runs: Path) -> None:
    """Write the sources of all pages.

    The folders are those of the project, so that links between its texts need no change, but
    for the demos, which are pages here, and the README, which is the first page.

    Args:
        target: Folder of the sources, made anew.
        runs: Folder with a folder for each demo, in which it ran: ``printed.txt`` and figures.
    """
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(PROJECT / "docs" / "images", target / "docs" / "images")
    names = [name for group in MENU.values() for name in group]
    for name in ["README.md", *names]:
        source = PROJECT / name
        if source.is_file():
            text = with_page_links(source.read_text("utf-8"), source)
            _write(target / name.replace("README", "index"), text)
    for name in FILES:
        shutil.copy(PROJECT / name, target / name)
    for script in demos():
        text = demo_page(script, runs / script.stem, target / "demos" / script.stem)
        _write(target / "demos" / f"{script.stem}.md", text)
    _write(target / "docs" / "api.md", api_page())
    _write(target / "docs" / "modules.md", modules_page())
    with (target / "index.md").open("a", encoding="utf-8") as index:
        index.write(_menu())


def with_page_links(text: str, source: Path) -> str:
    """A text whose links lead to pages where these have other names than their sources."""

    def page(match: re.Match[str]) -> str:
        link, anchor = match[1], match[2] or ""
        file = (source.parent / link).resolve()
        if file in demos():
            link = link.removesuffix(".py") + ".md"
        elif file == PROJECT / "README.md":
            link = link.replace("README", "index")
        return f"]({link}{anchor})"

    return LINK.sub(page, text)


def demo_page(script: Path, run: Path, pictures: Path) -> str:
    """A demo as a page: its text and code, what it printed, its figures.

    Args:
        script: The demo, cells of text and code between ``# %%`` lines.
        run: Folder in which it ran.
        pictures: Folder beside the page, where figures are copied to.
    """
    cells = re.split(r"^# %%", script.read_text("utf-8"), flags=re.M)[1:]
    title, *parts = filter(None, map(_cell, cells))
    # One title; what follows at its level is a section.
    parts = [re.sub(r"\A# ", "## ", part) for part in parts]
    printed = (run / "printed.txt").read_text("utf-8").strip("\n")
    page = "\n\n".join([title, *parts, "## What it prints", f"```text\n{printed}\n```\n"])
    figures = sorted(run.rglob("*.png"))
    if figures:
        pictures.mkdir(parents=True)
        page += "\n## Figures\n"
    for figure in figures:
        shutil.copy(figure, pictures)
        words = figure.stem.replace("_", " ")
        page += f"\n![{words}]({pictures.name}/{figure.name})\n"
    return with_page_links(page, script)


def _cell(cell: str) -> str:
    """Markdown of a cell."""
    kind, _, body = cell.partition("\n")
    if "[markdown]" in kind:
        return "\n".join(re.sub(r"^# ?", "", line) for line in body.strip().split("\n"))
    code = body.strip("\n")
    return f"```python\n{code}\n```" if code else ""


def api_page() -> str:
    """The public names of the package by the module that they come from."""
    homes = defaultdict(list)
    for name, module in _HOME.items():
        homes[module].append(name)
    page = (
        "# Public names\n\nWhat `import dolfinx_joints as dj` offers, by the module that it comes "
        "from. All units are SI units; angles are in degrees where the name says so.\n"
    )
    for module in sorted(homes):
        directives = "\n\n".join(_directive(module, name) for name in sorted(homes[module]))
        page += f"\n## {module}\n\n*{_summary(module)}.*\n\n```{{eval-rst}}\n{directives}\n```\n"
    return page


def _directive(module: str, name: str) -> str:
    tree = ast.parse(_source(module))
    kinds = {n.name: n for n in tree.body if isinstance(n, ast.ClassDef | ast.FunctionDef)}
    kind = kinds.get(name)
    if isinstance(kind, ast.FunctionDef):
        return f".. autofunction:: dolfinx_joints.{name}"
    return f".. autoclass:: dolfinx_joints.{name}\n   :members:"


def modules_page() -> str:
    """Modules for results, records, pictures and studies."""
    page = (
        "# Modules\n\nWhat is made for results, records, pictures and studies is imported from its "
        "module, as in `from dolfinx_joints import plots`.\n"
    )
    for module in MODULES:
        known = ", ".join(name for name, home in _HOME.items() if home == module)
        page += (
            f"\n## {module}\n\n```{{eval-rst}}\n.. automodule:: dolfinx_joints.{module}\n"
            f"   :members:\n   :exclude-members: {known}\n```\n"
        )
    return page


def _source(module: str) -> str:
    spec = find_spec(f"dolfinx_joints.{module}")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).read_text("utf-8")


def _summary(module: str) -> str:
    """The first sentence of a module, without its full stop."""
    text = ast.get_docstring(ast.parse(_source(module))) or module
    return text.split("\n")[0].rstrip(".")


def _menu() -> str:
    text = ""
    for caption, names in MENU.items():
        pages = []
        for name in names:
            found = demos() if name == "demos" else [PROJECT / name]
            pages += [os.path.relpath(file.with_suffix(""), PROJECT) for file in found]
        text += "\n```{toctree}\n:hidden:\n:caption: " + caption + "\n\n"
        text += "\n".join(pages) + "\n```\n"
    return text


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")
