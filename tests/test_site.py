# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of the documentation site, and links between the project's texts.

The site itself is looked at where it has been built: in the folder that ``DOLFINX_JOINTS_SITE``
names (``make docs``).
"""

import importlib
import os
import re
from pathlib import Path

import pytest
from browser import chromium, value_in
from checked_inputs import CHECKS

import dolfinx_joints

PROJECT = Path(__file__).resolve().parents[1]
TEXTS = [PROJECT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
TEXTS += sorted((PROJECT / "docs").rglob("*.md"))


@pytest.fixture(scope="module")
def pages():
    """The module that gathers the pages, beside the texts and in no package."""
    with pytest.MonkeyPatch.context() as context:
        context.syspath_prepend(PROJECT / "docs" / "site")
        yield importlib.import_module("pages")


def anchors(text: str) -> set[str]:
    """What links to headings may name: GitHub's rule, which the site follows."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", prose, flags=re.M)
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    return {"#" + heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: str(path.relative_to(PROJECT)))
def test_links_lead_somewhere(text):
    content = text.read_text("utf-8")
    for link, anchor in re.findall(r"\]\(([^)\s:#]*)(#[^)\s]*)?\)", content):
        file = (text.parent / link).resolve() if link else text
        assert file.is_file(), link
        if anchor:
            assert anchor in anchors(file.read_text("utf-8")), f"{link}{anchor}"


def test_every_check_of_the_table_has_its_test():
    assert len(CHECKS) > 20
    for check in CHECKS:
        source = (PROJECT / "tests" / check.file).read_text("utf-8")
        assert f"def {check.test}(" in source, check.test


def test_every_text_is_in_the_menu(pages):
    assert set(TEXTS) - set(pages.texts()) == {PROJECT / "README.md"}


def test_every_public_name_has_an_entry(pages):
    page = "".join(pages.reference_pages().values())
    names = re.findall(r"^\.\. auto(?:class|function):: dolfinx_joints\.(\w+)$", page, re.M)
    modules = re.findall(r"^\.\. automodule:: dolfinx_joints\.(?:\w+\.)*(\w+)$", page, re.M)
    assert len(names) == len(set(names))
    assert {*names, *modules} >= set(dolfinx_joints.__all__) >= set(names)


SITE = os.environ.get("DOLFINX_JOINTS_SITE")
EQUATIONS = """new Promise((done) => { const look = () => {
const typeset = window.MathJax?.startup?.promise;
if (document.readyState !== "complete" || !typeset) return setTimeout(look, 50);
typeset.then(() => done(["mjx-container", "mjx-merror"].map(
    (name) => document.querySelectorAll(name).length))); }; look(); })"""


@pytest.mark.slow
@pytest.mark.skipif(SITE is None or chromium() is None, reason="needs a built site and chromium")
def test_the_site_shows_every_equation_and_asks_for_nothing():
    pages = sorted(Path(SITE).glob("docs/theory/*.html")) if SITE else []
    assert len(pages) > 10
    for page in pages:
        equations = page.read_text("utf-8").count('class="math notranslate')
        assert equations == 0 or value_in(page, EQUATIONS) == [equations, 0], page
