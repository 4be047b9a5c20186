# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Settings of Sphinx for the documentation site; ``build.py`` collects the pages."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

import dolfinx_joints

project = "dolfinx_joints"
author = "The dolfinx_joints developers"
copyright = "2026, The dolfinx_joints developers"
release = dolfinx_joints.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
source_suffix = {".md": "markdown"}
highlight_language = "none"
default_role = "py:obj"

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
mathjax_path = "mathjax/tex-chtml-full.js"  # copied into the site: pages need no network

autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 80
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = f"dolfinx_joints {release}"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["site.css"]
html_css_files = ["site.css"]


def leave_equations_alone(_: Sphinx, document: nodes.document) -> None:
    r"""Keep Sphinx from wrapping equations of several lines in environments without \tag."""
    for block in document.findall(nodes.math_block):
        text = f"\\[{block.astext()}\\]"
        block.children.clear()
        block += nodes.Text(text)
        block["no-wrap"] = True


def keep_bars(*arguments: Any) -> None:
    """Escape bars in docstrings: they are magnitudes, and not docutils' substitutions."""
    lines = arguments[-1]
    for i, line in enumerate(lines):
        parts = re.split(r"(``.*?``)", line)
        lines[i] = "".join(p if p.startswith("``") else p.replace("|", "\\|") for p in parts)


def correct_back_links(_: Sphinx, page: str, __: str, context: dict[str, Any], *___: Any) -> None:
    """Correct the links from source pages back to names that are documented in their modules.

    If one name of a module is public, Sphinx treats all names of the module as public.
    """
    if page.startswith("_modules/"):
        module = page.removeprefix("_modules/").replace("/", ".")
        context["body"] = re.sub(
            r'(viewcode-back" href="[^"#]*#)dolfinx_joints\.(\w+)"',
            lambda m: m[0] if hasattr(dolfinx_joints, m[2]) else f'{m[1]}{module}.{m[2]}"',
            context["body"],
        )


def setup(app: Sphinx) -> None:
    """Connect the functions of this file to Sphinx's events."""
    app.connect("doctree-read", leave_equations_alone)
    app.connect("autodoc-process-docstring", keep_bars)
    app.connect("html-page-context", correct_back_links)
