# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Texts of the package and the pages are plain: no riddling phrases, no sentences above 35 words.

ruff (D401) sees that docstrings of functions begin with a verb.
"""

from pathlib import Path

import pytest
from plain_english import faults, files, openings, phrases, sentences, vague_names, words

PROJECT = Path(__file__).resolve().parents[1]
PLACES = ["dolfinx_joints", "geometry", "docs", "demos", "paper"]
PAGES = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"]


@pytest.mark.parametrize("place", [*PLACES, *PAGES])
def test_texts_are_plain(place):
    paths = files([PROJECT / place])
    assert paths
    found = [f"{path}:{line}: {fault}" for path in paths for line, fault in faults(path)]
    assert not found, "\n".join(found)


def test_the_check_finds_faults():
    import ast

    tree = ast.parse('def f(found):\n    """Whether it is open."""\n    here = found')
    assert len(list(openings(tree))) == 1
    assert len(list(vague_names(tree))) == 2
    assert list(phrases("The solver gives up.\nNone such; no such joint.", 4))[1][0] == 5
    assert words("At 0.5 m the `law` opens") == 5
    assert len(sentences("See eq. (5). It opens at $x = 1$. Then it closes!")) == 3
