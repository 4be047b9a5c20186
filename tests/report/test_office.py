# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Title, numbers of figures and tables, assumptions, warnings and PDF of reports."""

import base64
import datetime
import io
import re
import sys
from html import unescape
from pathlib import Path
from typing import Any

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


def html_of(paths: list[Path], folder: Path, **options: Any) -> str:
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
    html = html_of([path], tmp_path, **dict.fromkeys(TITLE, ""))
    assert "<header><h1>Report: run</h1></header>" in html
    with pytest.raises(ValueError, match="it must be a text such as 2026-11-29 or None"):
        html_of([path], tmp_path, date=datetime.date(2026, 11, 29))


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
        "a: Time steps are 0.01 s, with the scheme EnergyConsistent.",
        "b: Time steps are 0.02 s, with the scheme EnergyConsistent.",
    ):
        assert text in both


def test_assumptions_name_components_dashpots_and_joints_without_friction(tmp_path):
    friction = (
        "FrictionNoTension(normal_stiffness=1e11, shear_stiffness={}, friction_angle_deg=5.0)"
    )
    made = MANIFEST | {
        "joint_laws": {
            "a": friction.format("0.5"),
            "b": friction.format("0.0"),
            "c": f"ViscousJoint(law={friction.format('0.0')}, normal_viscosity=1e8)",
            "d": f"ViscousJoint(law={friction.format('0.5')}, normal_viscosity=1e8)",
            "e": "AdhesiveJoint(friction_angle_deg=40.0, adhesion=1e5)",
            "f": "CohesiveJoint(friction_angle_deg=40.0, cohesion=1e6)",
        },
        "supports": [
            "Fixed(group='base', components='xy', point=None)",
            "Fixed(group='sides', components='xy', point=None)",
            "Fixed(group='base', components='z', point=(0.0, 1.5, 0.0))",
        ],
        "settings": {"ground motion": "<function shake.<locals>.<lambda>>"},
    }
    found = bullets(html_of([write_run(tmp_path / "a.h5", facts={"manifest": made})], tmp_path))
    laws = [text.partition(" (")[0] for text in found if text.startswith("The joints")]
    shear, dashpots = "shear up to Coulomb's limit", ", and have dashpots that act while closed"
    words = "The joints {} transmit pressure elastically, {}, no tension{}"
    assert laws == [
        words.format("a", shear, ""),
        words.format("b", "no shear", ""),
        words.format("c", "no shear", dashpots),
        words.format("d", shear, dashpots),
        "The joints e transmit pressure, tension, and shear with an adhesion that stays",
        "The joints f are bonded; the bond softens as it breaks, and the broken part rubs",
    ]
    for text in (
        "The displacement along x, y relative to the ground is zero at base, sides.",
        "The displacement along z relative to the ground is zero at the point (0, 1.5, 0) m.",
        "The ground moves by a function of time, the same at all supports.",
    ):
        assert text in found


def test_errors_are_estimated_only_for_the_run_of_the_bars(tmp_path):
    # joint_1 opens by 3 mm in the jointed run; the linear run has no joint.
    paths = [write_run(tmp_path / f"{name}.h5", name) for name in ("linear", "joints")]
    found = bullets(html_of(paths, tmp_path, bars={"joint_1: opening [m]": (3e-3, 1e-4)}))
    assert "linear: The errors of time step and mesh are not estimated (dj.accuracy)." in found
    assert "linear: The body has no joints." in found
    alone = bullets(html_of(paths[:1], tmp_path))
    assert "The body has no joints." in alone
    assert not any(text.startswith("Joints: ") for text in alone)


def test_equal_sentences_are_one():
    texts = [("a", "The slip of 1"), ("b", "The slip of 2"), ("c", "The slip of 2")]
    assert grouped([*texts, texts[0]]) == ["a: The slip of 1", "b, c: The slip of 2"]
    assert grouped([("a", "x"), ("b", "x")], ["a", "b"]) == ["x"]


def test_warnings_of_several_runs_are_one_bullet(tmp_path):
    paths = [
        write_run(
            tmp_path / f"{n}.h5", summary={"energy_error": 0.0712}, seconds=0.05, status=status
        )
        for n, status in (("a", "complete"), ("b", "failed"), ("c", "failed"))
    ]
    html = html_of(paths, tmp_path)
    failed, error, *_ = re.findall("<li>(.*?)</li>", html[html.index("Warnings</h3>") :])
    assert failed.startswith("b, c: failed at t = 0.05 s")
    assert error == "a, b, c: the energy error is 7.12 % of the largest energy."


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
