# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Title, numbers of figures and tables, assumptions, grouped warnings and PDF of reports."""

import base64
import io
import re
import sys
from html import unescape
from pathlib import Path

import pytest
from reading_back import captions
from written_runs import write_run

from dolfinx_joints import cli, report
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.report import page, writing
from dolfinx_joints.report.runs import grouped

pytest.importorskip("matplotlib")

MANIFEST = {
    "body": {"degree": 1},
    "material": {"all": "Elastic(young=2.4e10, poisson=0.2, density=2400.0)"},
    "joint_laws": {"joint_1": "FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10)"},
    "loads": ["Gravity(acceleration=None, cells=None)"],
    "supports": ["Fixed(group='base', components=None, point=None)"],
    "damping": "Rayleigh(mass_factor=0.0, stiffness_factor=0.002)",
    "settings": {"time step": 0.01, "time scheme": "EnergyConsistent()"},
}
TITLE = {"dam": "Dam <1>", "client": "Client & Co", "author": "A. Author", "date": "1 May 2026"}


def bullets(html: str, section: str = "assumptions") -> list[str]:
    """Return the bullets of a section without mark-up."""
    text = html[html.index(f'<section id="{section}">') :]
    return [unescape(re.sub("<.*?>", "", item)) for item in re.findall("<li>(.*?)</li>", text)]


def html_of(paths: list[Path], folder: Path, **options: str) -> str:
    pytest.importorskip("plotly")
    return report.write(paths, folder / "out.html", with_3d=False, **options).read_text("utf-8")


def test_the_title_has_what_is_given(tmp_path):
    path = write_run(tmp_path / "run.h5", seconds=0.05)
    html = html_of([path], tmp_path)
    assert "<header><h1>Report: run</h1></header>" in html
    html = html_of([path], tmp_path, **TITLE)
    assert "<title>Report: Dam &lt;1&gt;</title>" in html
    given = "<dt>Client</dt><dd>Client &amp; Co</dd><dt>Author</dt><dd>A. Author</dd>"
    assert f"{given}<dt>Date</dt><dd>1 May 2026</dd></dl></header>" in html
    words = [word for name, text in TITLE.items() for word in (f"--{name}", text)]
    out = str(tmp_path / "cli.html")
    assert cli.main(["report", str(path), "--no-3d", "--out", out, *words]) == 0
    assert f"{given}<dt>Date</dt>" in Path(out).read_text("utf-8")


def test_numbers_follow_the_page_and_references_use_them():
    figure, table = page.figure([], "A figure."), page.table("A & B", ["x [m]"], [[1]])
    text = page.paragraph(f"See {page.reference('A & B')}, {page.reference('no caption')}.")
    html = page.numbered("".join([text, figure, figure, table]))
    assert captions(html) == ["A figure.", "A figure."]
    assert '<caption id="table-1"><b>Table 1.</b> A &amp; B</caption>' in html
    assert 'See <a href="#table-1">Table 1</a>, ⟦no caption⟧.' in html


def test_all_figures_and_tables_of_a_report_are_numbered(tmp_path):
    html = html_of([write_run(tmp_path / "run.h5", facts={"manifest": MANIFEST})], tmp_path)
    assert captions(html)
    numbers = re.findall(r'<caption id="table-(\d+)"><b>Table (\d+)\.</b>', html)
    assert [n for n, _ in numbers] == [m for _, m in numbers]
    assert [int(n) for n, _ in numbers] == list(range(1, html.count("<caption") + 1))
    assert "⟦" not in html
    (laws,) = re.findall(r"<b>(Table \d+)\.</b> Laws of the joints<", html)
    assert any(f"no tension ({laws})." in text for text in bullets(html))


def test_assumptions_are_those_of_the_file(tmp_path):
    other = MANIFEST | {
        "material": {"rock": "Mine()", "dam": "DruckerPrager(cohesion=1e6)"},
        "supports": [*MANIFEST["supports"], "ViscousBoundary(group='sides')"],
        "loads": ["HydrostaticPressure(group='upstream', level=2.0)"],
        "added_mass": ["WestergaardMass(group='upstream', level=2.0)"],
        "settings": {"time step": 0.02, "time scheme": "EnergyConsistent()"},
    }
    paths = [
        write_run(tmp_path / f"{name}.h5", facts={"manifest": facts})
        for name, facts in (("a", MANIFEST), ("b", other))
    ]
    one = bullets(html_of(paths[:1], tmp_path))
    for text in (
        "The model is three-dimensional.",
        "The material is linear elastic and isotropic: it does not crack or yield.",
        "Rayleigh damping of the body is 0.002 s times the stiffness.",
        "The displacement relative to the ground is zero at base.",
        "Time steps are 0.01 s, with the scheme EnergyConsistent.",
        "There is no load of water, no added mass and no reservoir.",
        "No viscous boundary and no free field absorbs waves.",
        "Checks: the files have no strengths and no limits.",
    ):
        assert text in one
    both = bullets(html_of(paths, tmp_path))
    for text in (
        "The model is three-dimensional.",
        "a: There is no load of water, no added mass and no reservoir.",
        "a: No viscous boundary and no free field absorbs waves.",
        "b: The material of rock follows Mine.",
        "b: The material of dam is elastic and perfectly plastic with the limit of Drucker and "
        "Prager.",
        "b: Water at upstream acts as added mass (WestergaardMass).",
        "b: The water is incompressible: it has no waves.",
        "b: Water pressure does not act in the joints.",
        "Time steps are …, with the scheme EnergyConsistent. (a: 0.01 s; b: 0.02 s)",
    ):
        assert text in both


def test_similar_sentences_are_one():
    slip = "Joint 'joint_{}': slip reached {} % of the cell by t = {} s, at most 5 %."
    texts = [("a", slip.format(1, 12.5, 1)), ("a", slip.format(2, 7, 0.5)), ("b", "The slip of 2")]
    texts += [("b", slip.format(1, 9, 1)), ("c", "The slip of 2"), ("a", slip.format(1, 12.5, 1))]
    assert grouped(texts) == [
        "Joint …: slip reached … of the cell by t = …, at most 5 %. (a: 'joint_1', 12.5 %, 1 s; "
        "a: 'joint_2', 7 %, 0.5 s; b: 'joint_1', 9 %, 1 s)",
        "b, c: The slip of 2",
    ]
    assert grouped([("a", "x"), ("b", "x")], ["a", "b"]) == ["x"]
    # Numbers with their signs and exponents, and no digits of names.
    assert grouped([("a", "v1 is −1.5e−3 m"), ("b", "v1 is 2e5 m")]) == [
        "v1 is … (a: −1.5e−3 m; b: 2e5 m)"
    ]


def test_warnings_of_several_runs_are_one_bullet(tmp_path):
    paths = [
        write_run(tmp_path / f"{n}.h5", summary={"energy_error": error}, seconds=0.05)
        for n, error in (("a", 0.07), ("b", 0.09))
    ]
    html = html_of(paths, tmp_path)
    assert "<li>the energy error is … of the largest energy. (a: 7.00%; b: 9.00%)</li>" in html


def test_pdf_has_pictures_instead_of_scripts(tmp_path, monkeypatch):
    """The page that is printed: no script, no interactive plot, all else as in HTML."""
    path = write_run(tmp_path / "run.h5", facts={"manifest": MANIFEST})
    monkeypatch.setattr(writing, "_check_packages", lambda *_: None)
    monkeypatch.setattr(writing, "_print", lambda html, part: part.write_text(html, "utf-8"))
    pytest.importorskip("pyvista")
    html = report.write([path], tmp_path / "out.pdf", **TITLE).read_text("utf-8")
    for absent in ("<script", 'class="plot"', 'id="scene"', "Picture: <a"):
        assert absent not in html
    assert html.index("<nav") < html.index("Main results")
    found = captions(html)
    assert html.count("<img") >= len(found)
    assert any(
        re.fullmatch(r"run at t = .* s, displacements enlarged .* times\.", t) for t in found
    )


@pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf")
def test_pdf_is_written(tmp_path):
    pytest.importorskip("weasyprint")
    path = write_run(tmp_path / "run.h5", seconds=0.1)
    written = report.write([path], tmp_path / "out.pdf", with_3d=False, **TITLE).read_bytes()
    assert written.startswith(b"%PDF-")
    assert b"%%EOF" in written[-10:]


@pytest.mark.parametrize("wide", [False, True])
def test_printed_pictures_keep_their_shape(wide):
    """Print a tall and a broad picture, each larger than the page."""
    weasyprint = pytest.importorskip("weasyprint")
    from dolfinx_joints.postprocessing.axes import new_figure

    for width, height in ((8.0, 20.0), (20.0, 8.0)):
        drawn = io.BytesIO()
        new_figure(figsize=(width, height)).savefig(drawn, dpi=100)
        data = base64.b64encode(drawn.getvalue()).decode()
        image = page.Html(f'<img src="data:image/png;base64,{data}" alt=""/>')
        section = page.Section("one", "One", [page.figure([image], "A figure.", wide=wide)])
        html = page.page("Report", {}, [], [section], page.Drawings(Path(), printed=True))
        sheets = weasyprint.HTML(string=html).render().pages
        boxes = [box for sheet in sheets for box in sheet._page_box.descendants()]
        (size,) = {(box.width, box.height) for box in boxes if box.element_tag == "img"}
        assert size[0] / size[1] == pytest.approx(width / height, rel=1e-3)
        assert size[0] <= 170 * 96 / 25.4 + 1e-6  # the width of the page [px]


def test_loads_are_in_words_with_units(tmp_path):
    line = "SeepageLine(start=(0.0, 20.0), end=(16.5, 20.0), upstream=38.0, drain=None)"
    uplift = f"Uplift(joint='joint_1', pressure={line}, factor=constant)"
    loads = [*MANIFEST["loads"], uplift, "Uplift(joint='joint_2', pressure=2e6)"]
    facts = {"manifest": MANIFEST | {"loads": loads}, "study": {"kind": "arch", "share": 0.5}}
    html = html_of([write_run(tmp_path / "run.h5", facts=facts)], tmp_path)
    rows = re.findall(r'<tr><th scope="row">(.*?)</th><td[^>]*>(.*?)</td></tr>', html)
    assert {
        ("acceleration [m/s²]", "9.807 downwards"),
        ("pressure", "SeepageLine"),
        ("start of the line [m]", "0, 20"),
        ("end of the line [m]", "16.5, 20"),
        ("level upstream [m]", "38"),
        ("study", "kind: arch, share: 0.5"),
    } <= set(rows)
    assert any(title == "pressure [MPa]" and value == "2" for title, value in rows)


def test_main_results_name_the_checks_that_are_not_met(tmp_path):
    # The residual slip of the run is 0: a limit of 1 mm is met. The drift is above 0.
    for drift, words in ((0.1, "none of 2 with limits"), (0.0, "crest displacement / height")):
        limits = {"kind": "arch", "crest": "mid-crest", "drift": drift, "residual_slip": 1e-3}
        path = write_run(tmp_path / f"{drift:g}.h5", facts={"checks": limits}, seconds=0.5)
        html = html_of([path], tmp_path)
        (cell,) = re.findall(r">checks that are not met</th><td[^>]*>(.*?)</td>", html)
        assert cell == words
    path = write_run(tmp_path / "bad.h5", facts={"checks": {"sped": 1}}, seconds=0.05)
    assert "the run cannot be checked</td>" in html_of([path], tmp_path)
    path = write_run(tmp_path / "none.h5", seconds=0.05)
    assert "checks that are not met" not in html_of([path], tmp_path)


def test_pdf_needs_its_package(tmp_path, monkeypatch):
    path = write_run(tmp_path / "run.h5", seconds=0.05)
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    with pytest.raises(ResultsError, match="Reports need weasyprint, which is not installed"):
        report.write([path], tmp_path / "out.pdf", with_3d=False)
    assert not (tmp_path / "out.pdf").exists()
