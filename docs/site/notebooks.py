# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Demos that run as notebooks, without a screen: cells and their output become a page."""

from __future__ import annotations

import base64
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient

PROJECT = Path(__file__).resolve().parents[2]
_SECONDS = 600  # limit for a cell


def notebook_page(script: Path, target: Path) -> str:
    """Return a demo as a page with the output of its cells, and write the notebook.

    Args:
        script: The demo.
        target: New folder for the page's pictures and the notebook.

    Raises:
        CellExecutionError: A cell fails.
    """
    target.mkdir(parents=True)
    notebook = executed(script)
    nbformat.write(notebook, target / f"{script.stem}.ipynb")
    parts = [_cell(cell, f"{script.stem}_{i}", target) for i, cell in enumerate(notebook.cells)]
    title, *sections = filter(None, parts)
    link = f"*[This page as a notebook]({target.name}/{script.stem}.ipynb)*"
    return "\n\n".join([title, link, *sections]) + "\n"


def executed(script: Path) -> Any:
    """Run all cells of a script in an empty folder and return the notebook."""
    notebook = jupytext.read(script, fmt="py:percent")
    notebook.cells = [c for c in notebook.cells if not c.source.startswith("# Copyright")]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kernel = folder / "jupyter" / "kernels" / "python3"
        kernel.mkdir(parents=True)
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        spec = {"argv": command, "display_name": "Python 3", "language": "python"}
        (kernel / "kernel.json").write_text(json.dumps(spec))
        os.environ["JUPYTER_PATH"] = str(folder / "jupyter")
        (folder / "run").mkdir()
        resources = {"metadata": {"path": str(folder / "run")}}
        NotebookClient(notebook, timeout=_SECONDS, resources=resources).execute()
    return notebook


def _cell(cell: Any, name: str, target: Path) -> str:
    """Return the Markdown of a cell and of its output."""
    if cell.cell_type == "markdown":
        return str(cell.source)
    parts = [f"```python\n{cell.source}\n```"] if cell.source else []
    for i, output in enumerate(cell.get("outputs", [])):
        if output.output_type == "stream":
            shown = output.text.rstrip().replace(f"{PROJECT}/", "")
            parts.append(f"```text\n{shown}\n```")
        elif "image/png" in output.get("data", {}):
            picture = target / f"{name}_{i}.png"
            picture.write_bytes(base64.b64decode(output.data["image/png"]))
            parts.append(f"![output of the cell]({target.name}/{picture.name})")
        elif "text/html" in output.get("data", {}):
            parts.append(f'<div class="shown">{output.data["text/html"]}</div>')
    return "\n\n".join(parts)
