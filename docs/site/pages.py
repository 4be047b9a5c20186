# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of the documentation site: texts of the project, demos and the reference."""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path

import parameters
from gallery import gallery

PROJECT = Path(__file__).resolve().parents[2]
# Pages in the order of the menu. Those of a folder are in the order of the links in its index.
MENU = {
    "Use": [
        "docs/guide/index.md",
        "demos/index.md",
        "docs/reference/index.md",
        "docs/conventions.md",
        "docs/results_file.md",
    ],
    "Background": ["docs/theory/index.md"],
    "Evidence": [
        "docs/accuracy.md",
        "docs/stability.md",
        "docs/validation.md",
        "docs/comparison.md",
        "docs/studies.md",
        "docs/decisions/index.md",
    ],
    "Development": [
        "docs/design.md",
        "CONTRIBUTING.md",
        "CODE_OF_CONDUCT.md",
        "SECURITY.md",
        "CHANGELOG.md",
    ],
}
NOTEBOOKS = ("00_first_steps", "08_results")  # demos whose page shows the output of each cell
# Modules that users import by name. Each is on the page of its wing in the reference.
MODULES = (
    "exact",
    "export",
    "laws.law",
    "laws.path_mean",
    "monitors.surface_stress",
    "motions.processing",
    "motions.reading",
    "motions.spectra",
    "motions.spectrum_matching",
    "postprocessing.envelopes",
    "postprocessing.measures",
    "postprocessing.motion_plots",
    "postprocessing.plots",
    "postprocessing.joints.resultants",
    "postprocessing.views",
    "report",
    "results.reader",
    "study",
)
# Pages of the guide that use a wing.
GUIDES = {
    "body": ("loads", "foundation", "modes"),
    "common": ("errors", "install"),
    "export": ("export",),
    "gradient": ("gradients",),
    "joints": ("joints", "own_solver"),
    "laws": ("joints", "extend"),
    "loads": ("loads", "water", "temperature", "foundation", "extend"),
    "materials": ("materials",),
    "mesh": ("mesh", "dolfinx", "extend"),
    "model": ("statics", "modes", "dolfinx"),
    "monitors": ("results",),
    "motions": ("motions",),
    "postprocessing": ("reading", "accelerations"),
    "report": ("report",),
    "results": ("reading", "extend"),
    "simulation": ("statics", "dynamics", "restart", "ranks"),
    "solvers": ("solvers",),
    "study": ("studies",),
    "time_integration": ("dynamics",),
}
LINK = re.compile(r"\]\(([^)\s:#]+)(#[^)\s]*)?\)")
REFERENCE = """# Reference

The public names of `import dolfinx_joints as dj`, by wing of the package, and modules that are
imported by name. Units are SI units; angles whose name ends in `_deg` are in degrees. The page
[Parameters](parameters.md) gives kind, range, unit and default of each parameter.

"""


def demos() -> list[Path]:
    """Return the demos in their order."""
    return sorted((PROJECT / "demos").glob("[0-9]*.py"))


def gather(target: Path, runs: Path) -> None:
    """Write the sources of all pages.

    Folders are those of the project, so that links between its texts need no change. Exceptions
    are links to the demos, which become pages, and to the README, which is the first page.

    Args:
        target: New folder for the sources.
        runs: Folder with one folder per demo, which has ``printed.txt`` and the figures.
    """
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(PROJECT / "docs" / "images", target / "docs" / "images")
    for source in [PROJECT / "README.md", *texts()]:
        name = str(source.relative_to(PROJECT)).replace("README", "index")
        text = source.read_text("utf-8")
        _write(target / name, with_page_links(text, source))
        for file in linked_files(text, source):
            _write(target / file.relative_to(PROJECT), file.read_text("utf-8"))
    from notebooks import notebook_page  # its packages are only installed to build the site

    pages = {}
    for script in demos():
        folder = target / "demos" / script.stem
        if script.stem in NOTEBOOKS:
            pages[script.stem] = with_page_links(notebook_page(script, folder), script)
        else:
            pages[script.stem] = demo_page(script, runs / script.stem, folder)
    pages["index"] = gallery(pages, runs) + _toctree("", list(pages))
    for name, text in pages.items():
        _write(target / "demos" / f"{name}.md", text)
    for name, text in reference_pages().items():
        _write(target / "docs" / "reference" / f"{name}.md", text)
    with (target / "index.md").open("a", encoding="utf-8") as index:
        index.write(_menu())
    for index in (target / "docs").glob("*/index.md"):
        pages = listed(index)
        with index.open("a", encoding="utf-8") as file:
            file.write(_toctree("", [str(page.with_suffix("").name) for page in pages]))


def texts() -> list[Path]:
    """Return the texts of the menu, including those of its folders."""
    files = [PROJECT / name for group in MENU.values() for name in group]
    files = [file for file in files if file.is_file()]
    return files + [page for file in files if file.name == "index.md" for page in listed(file)]


def linked_files(text: str, source: Path) -> list[Path]:
    """Return the files that a text links to, such as modules, without pages and images."""
    files = {(source.parent / match[1]).resolve() for match in LINK.finditer(text) if match[1]}
    others = {file for file in files if file.is_file() and file.suffix not in (".md", ".png")}
    return sorted(others - set(demos()))


def listed(index: Path) -> list[Path]:
    """Return the pages of a folder in the order of the links in its index."""
    links = [index.parent / match[1] for match in LINK.finditer(index.read_text("utf-8"))]
    inside = [link for link in links if link.parent == index.parent and link.suffix == ".md"]
    return list(dict.fromkeys(inside))


def with_page_links(text: str, source: Path) -> str:
    """Replace links to sources by links to their pages if these have other names."""

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
    """Return a demo as a page: text and code, printed lines, figures.

    Args:
        script: The demo, whose cells of text and code are separated by ``# %%`` lines.
        run: Folder in which the demo ran.
        pictures: Folder next to the page, to which figures are copied.
    """
    cells = re.split(r"^# %%", script.read_text("utf-8"), flags=re.M)[1:]
    title, *parts = filter(None, map(_cell, cells))
    # A page has one title; later headings of the same level become sections.
    parts = [re.sub(r"\A# ", "## ", part) for part in parts]
    printed = (run / "printed.txt").read_text("utf-8").strip("\n")
    page = "\n\n".join([title, *parts, "## Output", f"```text\n{printed}\n```\n"])
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
    """Return the Markdown of a cell."""
    kind, _, body = cell.partition("\n")
    if "[markdown]" in kind:
        return "\n".join(re.sub(r"^# ?", "", line) for line in body.strip().split("\n"))
    code = body.strip("\n")
    return f"```python\n{code}\n```" if code else ""


def reference_pages() -> dict[str, str]:
    """Return the pages of the reference: index, one page per wing, table of parameters."""
    homes = public_names()
    wings = {module.split(".")[0] for module in homes.values()}
    pages = {}
    for wing in sorted(wings | {module.split(".")[0] for module in MODULES}):
        pages[wing] = f"# {wing}\n\n{_summary(wing)}\n\n{_guides(wing)}\n"
        for module in sorted(m for m in set(homes.values()) if m.split(".")[0] == wing):
            names = sorted(name for name, home in homes.items() if home == module)
            pages[wing] += _section(module, [_directive(module, name) for name in names])
        for module in [m for m in MODULES if m.split(".")[0] == wing]:
            listed_names = ", ".join(name for name, home in homes.items() if home == module)
            lines = f".. automodule:: dolfinx_joints.{module}\n   :members:"
            pages[wing] += _section(module, [lines + f"\n   :exclude-members: {listed_names}"])
    rows = "".join(f"- [{name}]({name}.md): {_brief(name)}\n" for name in pages)
    pages["parameters"] = f"# Parameters\n\n{parameters.table()}"
    return {"index": REFERENCE + rows, **pages}


def _guides(wing: str) -> str:
    """Return links to the pages of the guide that use a wing."""
    links = []
    for name in GUIDES.get(wing, ()):
        title = (PROJECT / "docs" / "guide" / f"{name}.md").read_text("utf-8").partition("\n")[0]
        links.append(f"[{title.removeprefix('# ')}](../guide/{name}.md)")
    return f"In the guide: {', '.join(links)}." if links else ""


def public_names() -> dict[str, str]:
    """Return the module of each public class and function, from the stub of the package."""
    homes = {}
    for node in ast.parse(_source("", "__init__.pyi")).body:
        for alias in node.names if isinstance(node, ast.ImportFrom) else ():
            home = node.module or ""
            path = PROJECT / "dolfinx_joints" / home.replace(".", "/") / alias.name
            if not (path.is_dir() or path.with_suffix(".py").exists()):
                homes[alias.name] = home
    return homes


def _section(module: str, directives: list[str]) -> str:
    whole = directives[0].startswith(".. automodule")
    words = "" if whole else f"*{_brief(module)}.*\n\n"
    return f"\n## {module}\n\n{words}```{{eval-rst}}\n" + "\n\n".join(directives) + "\n```\n"


def _directive(module: str, name: str) -> str:
    kinds = {n.name: n for n in ast.parse(_source(module)).body if hasattr(n, "name")}
    if isinstance(kinds.get(name), ast.FunctionDef):
        return f".. autofunction:: dolfinx_joints.{name}"
    return f".. autoclass:: dolfinx_joints.{name}\n   :members:"


def _source(module: str, file: str = "__init__.py") -> str:
    package = PROJECT / "dolfinx_joints" / module.replace(".", "/")
    return (package / file if package.is_dir() else package.with_suffix(".py")).read_text("utf-8")


def _summary(module: str) -> str:
    """Return the docstring of a module."""
    return (ast.get_docstring(ast.parse(_source(module))) or module).replace("``", "`")


def _brief(module: str) -> str:
    """Return the first line of a module's docstring, without the full stop."""
    return _summary(module).split("\n")[0].rstrip(".")


def _menu() -> str:
    text = ""
    for caption, names in MENU.items():
        text += _toctree(caption, [name.removesuffix(".md") for name in names])
    return text


def _toctree(caption: str, pages: list[str]) -> str:
    words = f":caption: {caption}\n" if caption else ""
    return "\n```{toctree}\n:hidden:\n" + words + "\n" + "\n".join(pages) + "\n```\n"


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")
