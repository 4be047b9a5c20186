# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reports: their contents, and what a real browser makes of them."""

import base64
import io
import json
import re
import sys
import warnings
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import chromium, value_in
from declared import declare_histories, write_states
from reading_back import captions
from written_runs import NODES, SHARES, write_envelopes, write_run, write_stages, write_tip

from dolfinx_joints import report
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report import opening, run_sections, runs, writing
from dolfinx_joints.report import page as report_page
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")
pytest.importorskip("plotly")

VOID = {"meta", "link", "img", "input", "br", "hr"}
EVIL = "</script><script>window.harmed = 1</script>"


class Page(HTMLParser):
    """Elements of a page; refuses what is not closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: list[str] = []
        self.anchors: list[str] = []
        self.addresses: list[str] = []
        self.cells: list[str] = []
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if "id" in values:
            self.names.append(str(values["id"]))
        link = str(values.get("href") or values.get("src") or "")
        (self.anchors if link.startswith("#") else self.addresses).append(link)
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in VOID
        self.handle_starttag(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "td" in self.open or "th" in self.open:
            self.cells[-1] += data


def page_of(paths: list[Path], folder: Path, **options: Any) -> tuple[Page, str]:
    """Write a report and read it."""
    out = report.write(paths, folder / "out.html", **{"with_3d": False, **options})
    html = out.read_text(encoding="utf-8")
    return Page(html), html


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a run in ``run.h5`` and the report on it, ``out.html``."""
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def plain(folder):
    """Report on a run of 1 s."""
    return page_of([write_run(folder / "run.h5")], folder)


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """Report on a run that failed, with facts of its own and mark-up among them."""
    folder = tmp_path_factory.mktemp("failed")
    facts = {"dofs": 12345, "colour": "green", "run": EVIL, "case": EVIL, EVIL: EVIL}
    summary = {"energy_error": 3.125e-3, "peak_mb": 777.0, "seconds": {"time steps": 61.75}}
    summary |= {"error": f"out of patience {EVIL}", "solver": EVIL, "steps": 240}
    path = write_run(folder / "run.h5", facts=facts, summary=summary, status="failed")
    return page_of([path], folder)


def test_page_is_whole_and_its_links_lead_somewhere(plain, folder):
    page, _ = plain
    assert len(set(page.names)) == len(page.names)
    assert {anchor[1:] for anchor in page.anchors} <= set(page.names)
    pictures = {link for link in page.addresses if link and not link.startswith("data:")}
    assert pictures
    assert all((folder / link).is_file() for link in pictures)


def test_table_values_come_from_the_file(plain, failed):
    for cell in ("12\u202f345", "green", "0.3125", "777", "61.75"):
        assert cell not in plain[0].cells
        assert cell in failed[0].cells


def test_steps_are_those_that_were_taken(failed):
    # 100 of the 240 that were asked for.
    cells = failed[0].cells
    assert cells[cells.index("time steps") + 1] == "100"


def data_of(html: str) -> dict[str, Any]:
    """What the scripts of a page draw."""
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', html)
    assert text
    found: dict[str, Any] = json.loads(text[1])
    return found


def unpacked(packed: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["f4"]), dtype="<f4")


def test_a_free_field_is_shown_relative_to_its_surface(tmp_path):
    """The file's displacements reach 250 mm; without the ground's they are those of ``plain``."""
    page, html = page_of([write_run(tmp_path / "waves.h5", waves=True)], tmp_path)
    assert "Displacements are relative to the free surface, from the first record." in html
    shown = next(cell for cell in page.cells if cell.endswith("s, relative to the free surface"))
    assert abs(float(shown.split(" ")[0].replace("\N{MINUS SIGN}", "-"))) == pytest.approx(
        1.3, 5e-3
    )
    plots = data_of(html)["plots"]
    wave = 1.3 * np.sin(2 * np.pi * 5.22 * 0.01 * np.arange(101))
    np.testing.assert_allclose(unpacked(plots["history-1"]["data"][0]["y"]), wave, atol=1e-4)
    named = {trace["name"]: unpacked(trace["y"]) for trace in plots["response-1"]["data"][:2]}
    assert list(named) == ["waves", "free surface"]
    # 0.5 m/s^2 at once throws an oscillator with 5 % damping to 1.85 times its static deflection.
    assert named["free surface"].max() == pytest.approx(0.5 * (1 + np.exp(-0.05 * np.pi)), rel=0.01)
    row = page.cells.index("mid-crest, x, waves")
    assert page.cells[row + 2] == "1.3"
    assert "69 minus 69 GJ at the end" in html
    stored = {trace["name"]: unpacked(trace["y"]) for trace in plots["energies-1"]["data"]}
    assert stored["waves"][-1] == stored["kinetic"][-1] == 1.0  # kJ
    assert stored["viscous"][-1] == stored["input"][-1] == 0.0


def test_runs_say_what_each_is_relative_to(tmp_path):
    paths = [write_run(tmp_path / f"{n}.h5", waves=n == "waves") for n in ("waves", "motion")]
    _, html = page_of(paths, tmp_path)
    frames = (
        "relative to the free surface in waves, relative to the ground in motion, from the first "
        "record."
    )
    assert f"Displacements are {frames}" in html


def test_the_body_in_space_is_without_the_motion_of_its_base(tmp_path):
    pytest.importorskip("pyvista")
    path = write_run(tmp_path / "waves.h5", waves=True)
    _, html = page_of([path], tmp_path, with_3d=True)
    assert "from the unloaded body, relative to the mean of the base" in html
    scene = data_of(html)["scene"][0]
    assert scene["largest"] == pytest.approx(2.0)  # mm, of 252
    last = unpacked(scene["frames"][-1]["displacement"]).reshape(-1, 3)
    np.testing.assert_allclose(last, np.where(NODES[:, 2:] > 0, [2e-3, 0, 0], 0.0), atol=1e-6)


def test_same_input_same_page(plain, folder):
    assert page_of([folder / "run.h5"], folder)[1] == plain[1]


def test_text_of_a_file_stays_text(failed):
    page, html = failed
    assert EVIL in page.cells
    assert EVIL not in html
    assert html.count("<script") == 3


def test_unfinished_run_is_reported_at_the_top(failed, tmp_path):
    _, html = failed
    alert = html.index('class="alert"')
    assert alert < html.index("Main results")
    assert "failed at t = 1 s" in html[alert : alert + 300]
    assert "out of patience" in html[alert : alert + 300]
    with runs.opened([write_run(tmp_path / "run.h5", seconds=0.1, status="stopped")]) as (run,):
        assert opening.ending(run) == "run was stopped at t = 0.1 s, after 10 of 10 steps."


def test_file_without_anything_known_is_reported_as_it_is(tmp_path):
    with ResultsWriter(tmp_path / "other.h5", {"title": "else"}) as writer:
        writer.series("run", "u", (2,), "m", "displacement")
        writer.start()
        writer.finish("complete", {})
    page, html = page_of([tmp_path / "other.h5"], tmp_path)
    assert "else" in page.cells
    assert "Iterations and joint states: the files have no histories." in html
    assert '<section id="iterations">' not in html


def test_the_state_drawn_is_the_one_with_the_largest_displacement(tmp_path):
    # States at 0, 0.5 and 1 s: x and z move by sin(2 pi 5.22 t), -0.64 and 0.98 at the last two,
    # and the histories peak where the state at rest is nearer.
    with runs.opened([write_run(tmp_path / "run.h5")]) as (run,):
        assert runs.largest_moment(run)[0] == 1.0


def test_pictures_beside_a_file_of_static_stages_are_of_the_run_that_is_named(tmp_path):
    pytest.importorskip("pyvista")
    files = [write_stages(tmp_path / "first.h5"), write_run(tmp_path / "second.h5", seconds=0.1)]
    _, html = page_of(files, tmp_path, with_3d=True)
    assert "Runs: first (2 static stages), second (0.1 s). Pictures show second." in html
    found = captions(html)
    assert "second at t = " in found[0]  # the dam, deformed
    assert not any("first at" in caption or "first after" in caption for caption in found)


def test_static_stages_alone_have_maps_of_the_last(tmp_path):
    pytest.importorskip("pyvista")
    page, html = page_of([write_stages(tmp_path / "dam.h5")], tmp_path, with_3d=True)
    found = captions(html)
    assert found[0].startswith("dam after each static stage, from downstream.")
    assert found[1:3] == ["Normal traction, dam after winter.", "Opening, dam after winter."]
    assert "the section Statics shows the body after each" in html
    assert not re.search("the files have no (joints|states)", html)
    assert "smallest safety" not in page.cells  # nor what is said of that table
    assert "Slip is the tangential" not in html


def test_runs_that_ended_as_they_began(tmp_path):
    files = [write_tip(tmp_path / f"rows_{rows}.h5", rows) for rows in (0, 1, 2, 6)]
    page, html = page_of(files, tmp_path)
    assert "rows_2 failed at t = " in html
    assert "tip, z, rows_6" in page.cells


def test_plane_model_and_a_body_without_arch_directions(tmp_path):
    # Cubes: all their vertices are edges. The principal stresses are drawn, the others are not.
    pytest.importorskip("pyvista")
    principal = {f"principal_{end}": np.arange(float(len(NODES))) for end in ("max", "min")}
    cubes = write_envelopes(tmp_path / "cubes.h5", principal)
    with Results(cubes) as results, warnings.catch_warnings():
        warnings.simplefilter("error")
        found = measures.stress_extremes(results)
    assert (found["principal_max"], found["principal_min"]) == (15.0, 0.0)
    assert np.isnan(found["arch_max"])
    files = [write_tip(tmp_path / "plane.h5", 6, plane=True), cubes]
    files.append(write_tip(tmp_path / "space.h5", 6))
    page, html = page_of(files, tmp_path, with_3d=True)
    assert {"tip, z, space", "tip, y, plane", "tip, space", "tip, plane"} <= set(page.cells)
    assert "tip, z, plane" not in page.cells
    assert "Largest principal stress over the run at each point of the boundary, cubes." in html
    assert "Largest arch stress" not in html


def test_doubts_about_a_run_are_reported(tmp_path):
    # Both errors are above the 5 % that `results` calls large; a fifth of that is not doubtful.
    # The file has a warning of one of them.
    recorded = "The estimated error of a single step is 30 % of the largest displacement"
    many = {"energy_error": 0.07, "local_error": 0.3, "warnings": [recorded]}
    path = write_run(tmp_path / "run.h5", summary=many, seconds=0.05)
    few = write_run(tmp_path / "few.h5", summary={"energy_error": 0.01}, seconds=0.05, lost=49.0)
    lossy = write_run(tmp_path / "lossy.h5", seconds=0.05, lost=-400.0)  # 40 % of friction
    with runs.opened([path, few, lossy]) as all_runs:
        assert [opening.doubts(run) for run in all_runs] == [
            [
                "the energy error is 7 % of the largest energy.",
                recorded,
            ],
            [],
            [
                "the time scheme changes the energy: 0.02 kJ gained in 'joint_1', where friction "
                "dissipated 0.05 kJ. Use a smaller time step."
            ],
        ]


def test_what_is_not_in_the_file_is_reported(tmp_path, monkeypatch):
    # Histories alone: joints, states and a body are missing; the ground did not move.
    with ResultsWriter(tmp_path / "bare.h5", {"point_names": ["tip"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 1.0]], accelerations=True)
        writer.start()
        for row in range(6):
            record = {"displacement": [[1e-3 * row, 0.0, 0.0]], "iterations": 1}
            record |= {"acceleration": np.zeros((1, 3)), "ground_acceleration": np.zeros(3)}
            shares = dict.fromkeys(SHARES, 0.0)
            writer.append("histories", 0.1 * row, record | shares)
        writer.finish("complete", {})

    def unknown(package):
        raise run_sections.PackageNotFoundError(package)

    monkeypatch.setattr(run_sections, "version", unknown)
    page, html = page_of([tmp_path / "bare.h5"], tmp_path, with_3d=True)
    assert "3-D view of the body: the files have no states of a body." in html
    assert "not installed as a package" in page.cells
    with runs.opened([tmp_path / "bare.h5"]) as (run,):
        assert measures.strong_phase_end(run.results) == pytest.approx(0.5)  # the end of the run


def test_checks_are_a_table_with_the_limits_of_the_file(plain, tmp_path):
    # Without stresses the limits of an arch dam judge nothing. The point is 2 m above the lowest
    # node, and moves by 1 mm x AMPLITUDE or less.
    assert "Checks: the files have no strengths and no limits." in plain[1]
    arguments = {"kind": "arch", "crest": "mid-crest", "drift": 0.1, "residual_slip": 1e-3}
    page, html = page_of([write_run(tmp_path / "run.h5", facts={"checks": arguments})], tmp_path)
    assert "Checks, limits of arch dams (run)" in html
    start = page.cells.index("overstressed share of the area")
    assert page.cells[start : start + 6] == [
        *page.cells[start : start + 1],
        "",
        "–",
        "0.2",
        "-",
        "not recorded",
    ]
    start = page.cells.index("crest displacement / height")
    assert page.cells[start + 3 : start + 6] == ["0.1", "-", "yes"]
    start = page.cells.index("residual slip, mean of the last second")
    where = "joint_1 from the first record"
    assert page.cells[start + 1 : start + 6] == [where, "0", "0.001", "m", "yes"]


def test_plane_joints_have_profiles(tmp_path):
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    joint = {
        "points": np.array([[0.5, 1.0, 0.0]]),
        "frames": np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]),
        "areas": np.ones(1),
        "facet": np.zeros(1, dtype=int),
    }
    states = ((0.0, {}), (1.0, {"joints/seam/gap": [[2e-3, 0.0, 0.0]]}))
    given = (nodes, [[2, 3], [0, 1]], {"seam": joint}, *states)
    write_states(tmp_path / "plane.h5", *given, point_names=["tip"])
    page, html = page_of([tmp_path / "plane.h5"], tmp_path, with_3d=True)
    assert "3-D view" not in html
    assert "Values along the joints at the record closest to the largest opening, plane." in html
    assert "seam" in page.cells
    assert "2.000 1 s at (0.5, 1) m" in page.cells
    assert "Coordinates are x (downstream) and y (up).</p>" in html


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (True, "yes"), (np.bool_(False), "no"), ([1, "a", None], "1, a, –")],
)
def test_values_as_text(value, text):
    assert report_page.plain(value) == text


@pytest.mark.parametrize("package", ["matplotlib", "plotly"])
def test_a_report_needs_its_packages(tmp_path, monkeypatch, package):
    path = write_run(tmp_path / "run.h5", seconds=0.05)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ResultsError, match=f"Reports need {package}, which is not installed"):
        report.write([path], tmp_path / "out.html", with_3d=False)


def test_bad_input_has_one_message(tmp_path):
    path = write_run(tmp_path / "run.h5")
    (tmp_path / "text.h5").write_text("no results")
    for paths, out, words in (
        ([path, path], "out.html", "given twice"),
        ([tmp_path / "none.h5"], "out.html", "There is no results file"),
        ([tmp_path / "text.h5"], "out.html", "is not an HDF5 file"),
        ([path], "out.docx", "ends in .html or .pdf"),
        ([path], "run.h5/out.html", "cannot be written"),
    ):
        with pytest.raises(ResultsError, match=words):
            report.write(paths, tmp_path / out, with_3d=False)
    with pytest.raises(ValueError, match=r"results is \[\]; it must be 1 or more values"):
        report.write([], tmp_path / "out.html")
    assert not (tmp_path / "out.html").exists()


def test_a_report_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    path, out = write_run(tmp_path / "run.h5", seconds=0.05), tmp_path / "out.html"
    out.write_text("old")
    monkeypatch.setattr(writing, "page", lambda *_: "\ud800")  # that no encoding has
    with pytest.raises(UnicodeEncodeError):
        report.write([path], out, with_3d=False)
    assert [(file.name, file.read_text()) for file in tmp_path.glob("out.html*")] == [
        ("out.html", "old")
    ]


def test_the_jointed_run_is_drawn(tmp_path):
    files = [write_run(tmp_path / f"{n}.h5", n, seconds=0.02) for n in ("joints", "linear")]
    with runs.opened(files) as (joints, linear):
        assert runs.linear_and_jointed([joints, linear]) == (linear, joints)
        assert runs.linear_and_jointed([linear, joints, joints]) == (None, joints)


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["a/linear.h5", "b/linear.h5", "b/joints.h5"], ["a/linear", "b/linear", "joints"]),
        (["dt0.001", "dt0.005"], ["dt0.001", "dt0.005"]),
        (["dt0.001", "run.h5", "run.hdf5"], ["dt0.001", "run.h5", "run.hdf5"]),
    ],
)
def test_names_of_runs_are_as_short_as_tells_them_apart(tmp_path, files, names):
    for file in files:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        write_run(tmp_path / file, seconds=0.02)
    with runs.opened([tmp_path / file for file in files]) as found:
        assert [run.label for run in found] == names


# When a page is drawn: its width, its pictures, and what the slider of time makes of the scene.
DRAWN = """new Promise((done) => { const look = async () => {
if (!("drawn" in page.dataset)) return setTimeout(look, 50);
const one = (what) => document.querySelector(what);
const slider = one("#scene [name=time]"), shown = one("#scene output"), before = shown.textContent;
const picture = await Plotly.toImage(one("#scene .plot"));
slider.value = 0; slider.dispatchEvent(new Event("input"));
done({ width: page.scrollWidth, plots: document.querySelectorAll(".main-svg").length, picture,
    moved: [before, shown.textContent], harmed: window.harmed }); }; look(); })"""


@pytest.mark.skipif(chromium() is None, reason="needs chromium")
def test_browser_draws_the_report(tmp_path):
    pytest.importorskip("pyvista")
    from matplotlib.image import imread

    facts = {"remark": "<img src=x onerror='window.harmed = 1'>"}
    paths = [write_run(tmp_path / f"{n}.h5", n, facts=facts) for n in ("joints", "linear")]

    def add(found):
        section = report.Section("own", "Own section", [report_page.paragraph("of a study")])
        joints, linear = found
        return report.Addition(first=[section], note="A note.", reference=linear, main=joints)

    out = report.write(paths, tmp_path / "out.html", add=add)
    html = out.read_text(encoding="utf-8")
    assert html.index("of a study") < html.index('<section id="statics">')
    assert html.index("A note.") < html.index("Main results")
    assert html.index('scope="col">linear') < html.index('scope="col">joints')
    found = value_in(out, DRAWN, width=390)
    assert found["width"] <= 390  # wide tables scroll within themselves
    assert found["plots"] > 0
    assert found["moved"] == ["1.000 s", "0.000 s"]
    assert "from downstream, with displacements × 100 unless changed above" in html
    assert "harmed" not in found
    # The body, white to blue, and its edges: not the white of an empty canvas.
    picture = imread(io.BytesIO(base64.b64decode(found["picture"].partition(",")[2])))
    assert (np.ptp(picture[..., :3], axis=2) > 0.2).mean() > 0.01
