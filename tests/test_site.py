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
from urllib.parse import unquote

import pytest
from browser import Browser, chromium

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
    table = (PROJECT / "docs" / "guide" / "errors.md").read_text("utf-8")
    rows = re.findall(r"^\|.*\| `(\w+/test_\w+\.py)::(\w+)` \|$", table, flags=re.M)
    assert len(rows) == table.count(".py::") > 20
    for file, name in rows:
        assert f"def {name}(" in (PROJECT / "tests" / file).read_text("utf-8"), name


def test_every_text_is_in_the_menu(pages):
    assert set(TEXTS) - set(pages.texts()) == {PROJECT / "README.md"}


def test_every_public_name_has_an_entry(pages):
    page = "".join(pages.reference_pages().values())
    names = re.findall(r"^\.\. auto(?:class|function):: dolfinx_joints\.(\w+)$", page, re.M)
    modules = re.findall(r"^\.\. automodule:: dolfinx_joints\.(?:\w+\.)*(\w+)$", page, re.M)
    assert len(names) == len(set(names))
    assert {*names, *modules} >= set(dolfinx_joints.__all__) >= set(names)


def test_every_task_of_the_guide_is_linked_from_the_reference(pages):
    reference = "".join(pages.reference_pages().values())
    guide = {path.stem for path in (PROJECT / "docs" / "guide").glob("*.md")}
    linked = set(re.findall(r"\(\.\./guide/(\w+)\.md\)", reference))
    assert linked == guide - {"index", "other_codes"}


def test_links_of_the_site_lead_to_anchors():
    site = os.environ.get("DOLFINX_JOINTS_SITE")
    if site is None:
        pytest.skip("looks at a built site: make docs")
    texts = {page.resolve(): page.read_text("utf-8") for page in Path(site).rglob("*.html")}
    known = {page: set(re.findall(r' id="([^"]+)"', text)) for page, text in texts.items()}
    links = 0
    for page, text in texts.items():
        for link, anchor in re.findall(r' href="([^":#]*)#([^"]+)"', text):
            target = (page.parent / link).resolve() if link else page
            assert unquote(anchor) in known[target], f"{page}: {link}#{anchor}"
            links += 1
    assert links > 1000


READY = """new Promise(done => {
    const look = () => {
        if (document.readyState !== 'complete') setTimeout(look, 50);
        else Promise.resolve(window.MathJax?.startup?.promise).then(() => done(true));
    };
    look();
})"""


@pytest.mark.slow
def test_the_site_shows_every_equation_and_asks_for_nothing():
    site = os.environ.get("DOLFINX_JOINTS_SITE")
    if site is None or chromium() is None:
        pytest.skip("looks at a built site in a browser: make docs")
    shown = "document.querySelectorAll('mjx-container').length"
    wrong = "document.querySelectorAll('mjx-merror').length"
    tags = "[...document.querySelectorAll('mjx-labels')].map(e => e.children.length)"
    tags += ".reduce((a, b) => a + b, 0)"
    tagged = 0
    with Browser() as browser:
        pages = [*Path(site).glob("*.html"), *Path(site).glob("d*/**/*.html")]
        for page in sorted(pages):
            browser._call("Page.navigate", url=page.resolve().as_uri())
            browser.run(READY)
            equations = page.read_text("utf-8").count('class="math notranslate')
            assert browser.run(shown) == equations, page
            assert browser.run(wrong) == 0, page
            if page.parent.name == "theory":
                text = (PROJECT / "docs" / "theory" / f"{page.stem}.md").read_text("utf-8")
                tagged += browser.run(tags)
                assert browser.run(tags) == len(re.findall(r"\\tag\{", text)), page
            assert browser.errors == [], page
        outside = [r for r in browser.requests if not r.startswith(("file:", "data:", "about:"))]
    assert outside == []
    assert tagged > 50
