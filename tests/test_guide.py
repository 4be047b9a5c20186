# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The snippets of the guide run, in the order of its index and in one namespace."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")
pytest.importorskip("h5py")
pytest.importorskip("pyvista")

import dolfinx_joints as dj

GUIDE = Path(__file__).resolve().parents[1] / "docs" / "guide"
# Snippets with names of the user's own study, and the row that test_extend.py runs.
LEFT_OUT = {("studies", 2), ("studies", 3), ("extend", 7)}


def snippets(page: str) -> list[str]:
    text = (GUIDE / f"{page}.md").read_text("utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.M | re.S)


def write_records(folder: Path) -> None:
    """Write the files that the page on motions reads."""
    motion = dj.synthetic_motion(duration=10.0)
    time = np.arange(len(motion.acceleration)) * motion.dt
    (folder / "records").mkdir()
    samples = np.column_stack([time, motion.acceleration])
    header = "unit: m/s^2\ncolumns: time N E UP"
    np.savetxt(folder / "records" / "station.txt", samples, fmt="%.6f", header=header)
    for axis, name in enumerate(("h1", "h2", "v")):
        pair = np.column_stack([time, 100.0 * motion.acceleration[:, axis]])
        np.savetxt(folder / f"{name}.txt", pair, fmt="%.6f")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_snippets_of_the_guide_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_records(tmp_path)
    module = ModuleType("guide_snippets")
    monkeypatch.setitem(sys.modules, module.__name__, module)  # for dataclasses
    pages = re.findall(r"^\d+\. \[[^\]]*\]\((\w+)\.md\)", (GUIDE / "index.md").read_text(), re.M)
    assert len(pages) > 20
    for page in ["index", *pages]:
        for number, snippet in enumerate(snippets(page), 1):
            if (page, number) == ("ranks", 2):
                dj.write_split("dam.h5", module.wall)
            if (page, number) not in LEFT_OUT:
                exec(compile(snippet, f"{page}.md, snippet {number}", "exec"), module.__dict__)
