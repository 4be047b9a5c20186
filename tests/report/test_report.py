# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reports: what the page says, how it judges, and what a real browser makes of it."""

from __future__ import annotations

import re
import sys
import warnings
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, chromium

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES as NAMES
from dolfinx_joints.postprocessing.envelopes import declare_envelopes
from dolfinx_joints.report import page as report_page
from dolfinx_joints.report import paper_statements, report
from dolfinx_joints.report import response_sections as report_response
from dolfinx_joints.report import run_sections as report_sections
from dolfinx_joints.report import runs as report_runs
from dolfinx_joints.results.layout import declare_energy, declare_histories, declare_states
from dolfinx_joints.results.reader import ENERGY_TERMS, Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")
pytest.importorskip("plotly")

VOID = {"meta", "link", "img", "input", "br", "hr"}
STEP = 0.01
AMPLITUDE = {"linear": (1.0, 1.0, 1.0), "joints": (1.3, 0.4, 1.3)}  # as the paper's largest peaks

# Two cubes of 2 m with a joint between them in the plane y = 0.
CUBE = np.array([[x, y, z] for z in (0.0, 2.0) for y in (0.0, 2.0) for x in (0.0, 2.0)])
FACES = np.array(
    [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
)
NODES = np.concatenate([CUBE - [0.0, 2.0, 0.0], CUBE])
SURFACE = np.concatenate([FACES, FACES + 8])
POINTS = np.array([[0.5, 0.0, 0.5], [1.5, 0.0, 0.5], [0.5, 0.0, 1.5], [1.5, 0.0, 1.5]])
FRAME = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
JOINT = {
    "points": POINTS,
    "frames": np.tile(FRAME, (4, 1, 1)),
    "areas": np.ones(4),
    "facet": np.zeros(4, dtype=int),
}


def write_run(
    path: Path,
    name: str = "joints",
    *,
    seconds: float = 1.0,
    facts: dict[str, Any] | None = None,
    summary: dict[str, Any] | None = None,
    status: str = "complete",
) -> Path:
    """Write a run whose point mid-crest moves in sines of 5.22, 5.0 and 5.22 Hz.

    The joint opens by 3 mm at its two upper points at the end.
    """
    rows = round(seconds / STEP) + 1
    metadata = {"point_names": ["mid-crest"], "run": name, "dofs": 48, "steps": rows - 1}
    closing = {"steps": rows - 1, "energy_error": 1.25e-14, "seconds": {"time steps": 2.5}}
    with ResultsWriter(path, metadata | (facts or {})) as writer:
        declare_histories(writer, [[1.0, 0.0, 2.0]], accelerations=True)
        declare_energy(writer)
        declare_states(writer, NODES, SURFACE, {"joint_1": JOINT} if name == "joints" else {})
        writer.start()
        for row in range(rows):
            time = row * STEP
            wave = 1e-3 * np.sin(2 * np.pi * np.array([5.22, 5.0, 5.22]) * time)
            ground = np.array([np.sin(9.0 * time), 0.0, 0.0]) * (time < 0.6 * seconds)
            shares = {"joint_open": 0.5, "joint_stick": 0.5, "joint_slip": 0.0, "iterations": 2}
            record = {
                "displacement": [wave * AMPLITUDE[name]],
                "acceleration": [-1e3 * wave],
                "ground_acceleration": ground,
            }
            writer.append("histories", time, record | shares)
            writer.append("energy", time, dict.fromkeys(ENERGY_TERMS, 1e3 * time))
        for share in (0.0, 0.5, 1.0):
            moved = np.where(NODES[:, 2:] > 0.0, share * 2e-3, 0.0) * [1.0, 0.0, 0.0]
            state: dict[str, Any] = {"displacement": moved}
            if name == "joints":
                gap = np.where(POINTS[:, 2:] > 1.0, 3e-3 * share, -1e-6) * [1.0, 0.0, 0.0]
                state["joints/joint_1/gap"] = gap
                state["joints/joint_1/traction"] = np.where(gap > 0.0, 0.0, 1e11 * gap)
            writer.append("states", share * seconds, state)
        if status != "running":
            writer.finish(status, closing | (summary or {}))
    return path


def paper_pair(folder: Path, *, seconds: float = 11.0, **facts: Any) -> list[Path]:
    """A linear and a jointed run that say they are the paper's case."""
    folder.mkdir(exist_ok=True)
    case = {"case": "ambiesta", "record": "TMZ", "size": 8.0, "active_height": 0.75, **facts}
    return [
        write_run(folder / f"{name}.h5", name, seconds=seconds, facts=case)
        for name in ("linear", "joints")
    ]


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


def verdicts(paths: list[Path]) -> dict[str, str]:
    """Verdicts on the first pair by what was measured."""
    with report_runs.opened(paths) as runs:
        pair = report_runs.pairs(runs, paper_statements.CASE)[0]
        return {j.check.quantity: j.verdict for j in paper_statements.judged(pair)}


def test_page_is_whole_and_its_links_lead_somewhere(tmp_path):
    page, _ = page_of([write_run(tmp_path / "run.h5")], tmp_path)
    assert len(set(page.names)) == len(page.names)
    assert {anchor[1:] for anchor in page.anchors} <= set(page.names)
    pictures = {link for link in page.addresses if link and not link.startswith("data:")}
    assert pictures
    assert all((tmp_path / link).is_file() for link in pictures)


@pytest.mark.parametrize(
    ("facts", "summary", "cell"),
    [
        ({"dofs": 12345}, {}, "12\u202f345"),
        ({"colour": "green"}, {}, "green"),
        ({}, {"energy_error": 3.125e-3}, "0.003125"),
        ({}, {"peak_mb": 777.0}, "777"),
        ({}, {"seconds": {"time steps": 61.75}}, "61.75"),
    ],
)
def test_table_values_come_from_the_file(tmp_path, facts, summary, cell):
    before, _ = page_of([write_run(tmp_path / "a.h5")], tmp_path)
    after, _ = page_of([write_run(tmp_path / "b.h5", facts=facts, summary=summary)], tmp_path)
    assert cell not in before.cells
    assert cell in after.cells


def test_joint_table_shows_what_the_gaps_are(tmp_path):
    # 3 mm at the end; half of the area is open in two of three states.
    page, _ = page_of([write_run(tmp_path / "run.h5")], tmp_path)
    row = page.cells.index("joint_1")
    assert page.cells[row + 1 : row + 3] == ["0", "3"]
    assert page.cells[row + 4] == "1"
    assert page.cells[row + 8] == "33.33"


def test_same_input_same_page(tmp_path):
    path = write_run(tmp_path / "run.h5")
    assert page_of([path], tmp_path)[1] == page_of([path], tmp_path)[1]


def test_text_of_a_file_stays_text(tmp_path):
    evil = "</script><script>window.harmed = 1</script>"
    facts = {"run": evil, "case": evil, evil: evil}
    summary = {"error": evil, "solver": evil}
    path = write_run(tmp_path / "run.h5", facts=facts, summary=summary, status="failed")
    page, html = page_of([path], tmp_path)
    assert evil in page.cells
    assert evil not in html
    assert html.count("<script") == 3


@pytest.mark.parametrize(
    ("status", "words"), [("stopped", "was stopped at t = 1 s"), ("failed", "failed at t = 1 s")]
)
def test_unfinished_run_is_told_at_the_top(tmp_path, status, words):
    path = write_run(tmp_path / "run.h5", status=status, summary={"error": "out of patience"})
    _, html = page_of([path], tmp_path)
    alert = html.index('class="alert"')
    assert alert < html.index('class="summary"')
    assert words in html[alert : alert + 300]
    assert "out of patience" in html[alert : alert + 300]


def test_file_without_anything_known_is_reported_as_it_is(tmp_path):
    with ResultsWriter(tmp_path / "other.h5", {"title": "else"}) as writer:
        writer.series("run", "u", (2,), "m", "displacement")
        writer.start()
        writer.finish("complete", {})
    page, html = page_of([tmp_path / "other.h5"], tmp_path)
    assert "else" in page.cells
    assert "The files hold no histories." in html


def test_plane_model_has_no_view_in_space(tmp_path):
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with ResultsWriter(tmp_path / "plane.h5", {"point_names": ["tip"]}) as writer:
        declare_histories(writer, nodes[2:])
        declare_states(writer, nodes, [[0, 1], [1, 2], [2, 0]], {})
        writer.start()
        for row in range(4):
            record = {"displacement": [[0.0, 1e-3 * row, 0.0]], "iterations": 1}
            shares = dict.fromkeys(("joint_open", "joint_stick", "joint_slip"), 0.0)
            writer.append("histories", 0.1 * row, record | shares)
            writer.append("states", 0.1 * row, {"displacement": np.zeros((3, 3))})
        writer.finish("complete", {})
    page, html = page_of([tmp_path / "plane.h5"], tmp_path, with_3d=True)
    assert "The models are plane: no view in space." in html
    assert "tip, y, plane" in page.cells
    assert "tip, z, plane" not in page.cells


def write_tip(path: Path, rows: int, *, plane: bool, **facts: Any) -> Path:
    """A run of one point, with accelerations, of a plane model or one in space."""
    surface = [[0, 1], [1, 2], [2, 0]] if plane else [[0, 1, 2]]
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with ResultsWriter(path, {"point_names": ["tip"], **facts}) as writer:
        declare_histories(writer, nodes[2:], accelerations=True)
        declare_states(writer, nodes, surface, {})
        writer.start()
        for row in range(rows):
            record = {"displacement": [[0.0, 1e-3 * row, 0.0]], "iterations": 1}
            record |= {"acceleration": np.ones((1, 3)), "ground_acceleration": np.ones(3)}
            shares = dict.fromkeys(("joint_open", "joint_stick", "joint_slip"), 0.0)
            writer.append("histories", 0.1 * row, record | shares)
        writer.finish("failed", {})
    return path


@pytest.mark.parametrize("first", [True, False])
def test_plane_models_and_others_in_one_report(tmp_path, first):
    names = ["plane", "space"] if first else ["space", "plane"]
    files = [write_tip(tmp_path / f"{n}.h5", 6, plane=n == "plane") for n in names]
    page, _ = page_of(files, tmp_path)
    assert {"tip, z, space", "tip, y, plane", "tip, space", "tip, plane"} <= set(page.cells)
    assert "tip, z, plane" not in page.cells


def test_pictures_are_of_a_body_in_space(tmp_path):
    pytest.importorskip("pyvista")
    files = [write_tip(tmp_path / "plane.h5", 6, plane=True), write_run(tmp_path / "space.h5")]
    _, html = page_of(files, tmp_path, with_3d=True)
    assert "Finite-element mesh of space." in html


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_run_that_ended_as_it_began(tmp_path, rows):
    # Also where it says that it is the paper's case, without its point.
    files = [
        write_tip(tmp_path / f"{run}.h5", rows, plane=False, case="ambiesta", run=run)
        for run in ("linear", "joints")
    ]
    _, html = page_of([*files, write_run(tmp_path / "whole.h5")], tmp_path)
    assert "linear failed at t = " in html
    assert "the files do not hold what it takes" in html


def test_body_without_arch_directions(tmp_path):
    # A cube: all its vertices are edges. The principal stresses are drawn, the others are not.
    pytest.importorskip("pyvista")
    missing = np.full((8, 3), np.nan)
    with ResultsWriter(tmp_path / "cube.h5", {"point_names": []}) as writer:
        declare_states(writer, CUBE, FACES, {})
        declare_envelopes(writer, np.arange(8), missing, missing)
        writer.start()
        writer.append("states", 0.0, {"displacement": np.zeros((8, 3))})
        known = {name: np.arange(8.0) if "principal" in name else missing[:, 0] for name in NAMES}
        writer.append("envelopes", 0.0, known)
        writer.finish("complete", {})
    with Results(tmp_path / "cube.h5") as results, warnings.catch_warnings():
        warnings.simplefilter("error")
        found = measures.stress_extremes(results)
    assert (found["principal_max"], found["principal_min"]) == (7.0, 0.0)
    assert np.isnan(found["arch_max"])
    _, html = page_of([tmp_path / "cube.h5"], tmp_path, with_3d=True)
    assert "Deformed shape of cube at t = 0.000 s, the last record." in html
    assert "Envelope principal, max of cube" in html
    assert "Envelope arch, max" not in html


def test_doubts_about_a_run_are_said(tmp_path):
    # Both errors are above the 5 % that `results` calls large; a fifth of that is not doubtful.
    many = {"energy_error": 0.07, "local_error": 0.3, "warnings": ["the slip is large"]}
    path = write_run(tmp_path / "run.h5", summary=many, seconds=0.05)
    few = write_run(tmp_path / "few.h5", summary={"energy_error": 0.01}, seconds=0.05)
    with report_runs.opened([path, few]) as runs:
        assert [report_sections.doubts(run) for run in runs] == [
            [
                "run: the energy error is 7.00% of the largest energy.",
                "run: a step errs by 30.00% of the largest displacement.",
                "run: the slip is large",
            ],
            [],
        ]


def test_what_is_not_in_the_file_is_said(tmp_path, monkeypatch):
    # Histories alone: joints, states and a body are missing; the ground did not move.
    with ResultsWriter(tmp_path / "bare.h5", {"point_names": ["tip"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 1.0]], accelerations=True)
        writer.start()
        for row in range(6):
            record = {"displacement": [[1e-3 * row, 0.0, 0.0]], "iterations": 1}
            record |= {"acceleration": np.zeros((1, 3)), "ground_acceleration": np.zeros(3)}
            shares = dict.fromkeys(("joint_open", "joint_stick", "joint_slip"), 0.0)
            writer.append("histories", 0.1 * row, record | shares)
        writer.finish("complete", {})

    def unknown(package):
        raise report_sections.PackageNotFoundError(package)

    monkeypatch.setattr(report_sections, "version", unknown)
    page, html = page_of([tmp_path / "bare.h5"], tmp_path, with_3d=True)
    assert "The files hold no states of a body." in html
    assert "not installed as a package" in page.cells
    with report_runs.opened([tmp_path / "bare.h5"]) as (run,):
        assert report_response.strong_until(run) == pytest.approx(0.5)  # the end of the run


def test_joints_without_states_tell_no_opening(tmp_path):
    with ResultsWriter(tmp_path / "r.h5", {}) as writer:
        declare_states(writer, NODES, SURFACE, {"joint_1": JOINT})
        writer.start()
        writer.finish("complete", {})
    with report_runs.opened([tmp_path / "r.h5"]) as (run,):
        assert report_response.widest_opening(run) is None
    path = write_run(tmp_path / "linear.h5", "linear", seconds=0.1)
    with report_runs.opened([path]) as (run,):
        assert report_response.widest_opening(run) == "has no joints"


def test_crest_arch_is_judged_by_its_stresses(tmp_path):
    # Arch stresses of z MPa everywhere: in the crest, the upper tenth of 2 m, 2 MPa.
    paths = []
    for name, factor in (("linear", 1.0), ("joints", -1.1)):
        path = tmp_path / f"{name}.h5"
        with ResultsWriter(path, {"point_names": [], "run": name}) as writer:
            declare_states(writer, NODES, SURFACE, {})
            missing = np.full((len(NODES), 3), np.nan)
            declare_envelopes(writer, np.arange(len(NODES)), missing, missing)
            writer.start()
            stress = 1e6 * factor * NODES[:, 2]
            known = {n: stress if n == "arch_max" else np.nan * stress for n in NAMES}
            writer.append("envelopes", 0.0, known)
            writer.finish("complete", {})
        paths.append(path)
    with report_runs.opened(paths) as (linear, joints):
        assert paper_statements._crest_stress(linear) == pytest.approx(2e6)
        assert paper_statements._crest_stress(joints) == pytest.approx(2.2e6)
    with report_runs.opened([write_run(tmp_path / "bare.h5", seconds=0.05)]) as (bare,):
        assert np.isnan(paper_statements._crest_stress(bare))


@pytest.mark.parametrize(("spread", "said"), [(None, False), (0.05, False), (0.2, True)])
def test_an_error_that_reaches_a_bound_is_said(spread, said):
    check = paper_statements.Check("statement", "ratio", "0.9 to 1.1", 0.9, 1.1, lambda pair: 1.0)
    judgement = paper_statements.Judgement(check, 1.0, "agrees")
    words = paper_statements._verdict(judgement, spread)
    assert "agrees" in words
    assert ("the error estimate reaches the bound" in words) == said


def test_plane_joints_have_no_maps(tmp_path):
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    joint = {
        "points": np.array([[0.5, 1.0, 0.0]]),
        "frames": np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]),
        "areas": np.ones(1),
        "facet": np.zeros(1, dtype=int),
    }
    with ResultsWriter(tmp_path / "plane.h5", {"point_names": ["tip"]}) as writer:
        declare_states(writer, nodes, [[2, 3], [0, 1]], {"seam": joint})
        writer.start()
        for time, opening in ((0.0, 0.0), (1.0, 2e-3)):
            record = {"displacement": np.zeros((4, 3)), "joints/seam/gap": [[opening, 0.0, 0.0]]}
            writer.append("states", time, record | {"joints/seam/traction": np.zeros((1, 3))})
        writer.finish("complete", {})
    page, html = page_of([tmp_path / "plane.h5"], tmp_path)
    assert "The model is plane: its joints are lines, of which no maps are drawn." in html
    assert "seam" in page.cells


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (True, "yes"), (np.bool_(False), "no"), ([1, "a", None], "1, a, –")],
)
def test_values_in_words(value, text):
    assert report_page.plain(value) == text


@pytest.mark.parametrize("package", ["matplotlib", "plotly"])
def test_a_report_needs_its_packages(tmp_path, monkeypatch, package):
    path = write_run(tmp_path / "run.h5", seconds=0.05)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ResultsError, match=f"Reports need {package}, which is not installed"):
        report.write([path], tmp_path / "out.html", with_3d=False)


def test_bad_input_is_refused_in_a_sentence(tmp_path):
    path = write_run(tmp_path / "run.h5")
    (tmp_path / "text.h5").write_text("no results")
    for paths, out, words in (
        ([], "out.html", "needs at least one results file"),
        ([path, path], "out.html", "given twice"),
        ([tmp_path / "none.h5"], "out.html", "There is no results file"),
        ([tmp_path / "text.h5"], "out.html", "is not an HDF5 file"),
        ([path], "out.pdf", "ends in .html"),
        ([path], "run.h5/out.html", "cannot be written"),
    ):
        with pytest.raises(ResultsError, match=words):
            report.write(paths, tmp_path / out, with_3d=False)
    assert not (tmp_path / "out.html").exists()


def test_names_are_as_short_as_they_can_be(tmp_path):
    first, second = paper_pair(tmp_path / "a", seconds=0.1), paper_pair(tmp_path / "b", seconds=0.1)
    with report_runs.opened([first[0], second[0], second[1]]) as runs:
        assert [run.label for run in runs] == ["a/linear", "b/linear", "joints"]


def test_names_tell_runs_apart(tmp_path):
    files = [write_run(tmp_path / name, seconds=0.02) for name in ("dt0.001", "dt0.005")]
    files += [write_run(tmp_path / name, seconds=0.02) for name in ("run.h5", "run.hdf5")]
    with report_runs.opened(files[:2]) as runs:
        assert [run.label for run in runs] == ["dt0.001", "dt0.005"]
    with report_runs.opened(files) as runs:
        assert [run.label for run in runs] == [file.name for file in files]


def test_paper_is_judged_by_its_own_numbers(tmp_path):
    # The sines have the paper's frequencies and ratios; the maxima in the strong phase then do not
    # agree, as one sine cannot have both.
    found = verdicts(paper_pair(tmp_path / "a"))
    frequencies = [v for name, v in found.items() if "frequency of the largest" in name]
    assert frequencies == 6 * ["agrees"]
    for component in "xyz":
        assert found[f"{component}: largest Fourier amplitude, joints / linear"] == "agrees"
        strong = f"{component}: largest displacement in the strong phase, joints / linear"
        assert found[strong] == "does not agree"
    assert (
        found["energy error / largest energy [%]; small by construction with scheme ec"] == "agrees"
    )
    stress = next(v for name, v in found.items() if "arch stress" in name)
    assert stress == "not comparable"  # the files hold no envelopes


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"seconds": 5.0}, "the runs last 5 s"),
        ({"record": "El Centro"}, "El Centro, is not the record of Tolmezzo"),
        ({"friction_angle_deg": 40.0}, "friction_angle_deg is 40"),
        ({"active_height": 1.0}, "up to the crest"),
        ({"height": 100.0}, "height is 100"),
    ],
)
def test_other_cases_are_not_comparable(tmp_path, options, reason):
    with report_runs.opened(paper_pair(tmp_path / "a", **options)) as runs:
        pair = report_runs.pairs(runs, paper_statements.CASE)[0]
        judged = paper_statements.judged(pair)
    assert {j.verdict for j in judged if j.check.response} == {"not comparable"}
    assert any(reason in j.reason for j in judged)
    assert all(j.verdict != "not comparable" for j in judged if not j.check.response)


def test_error_is_estimated_from_other_meshes_only(tmp_path):
    main = paper_pair(tmp_path / "a")
    other = paper_pair(tmp_path / "b", size=4.0)
    foreign = paper_pair(tmp_path / "c", size=4.0, friction_angle_deg=40.0)
    _, alone = page_of(main, tmp_path)
    assert "One mesh, one step: the error is not estimated." in alone
    with report_runs.opened([*main, *other, *foreign]) as runs:
        found = report_runs.pairs(runs, paper_statements.CASE)
        assert [pair.joints.label for pair in found] == ["a/joints", "b/joints"]
    _, html = page_of([*main, *other, *foreign], tmp_path)
    assert "b/joints (size 4.0)" in html


def test_packed_arrays_are_those_of_the_file(tmp_path):
    import base64
    import json

    path = write_run(tmp_path / "run.h5")
    _, html = page_of([path], tmp_path)
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', html)[1]
    trace = json.loads(text)["plots"]["history-1"]["data"][0]
    drawn = np.frombuffer(base64.b64decode(trace["y"]["f4"]), dtype="<f4")
    with Results(path) as results:
        u = 1e3 * results.series("histories", "displacement")[:, 0, 0]
    np.testing.assert_allclose(drawn, u - u[0], rtol=1e-6, atol=1e-6)


@pytest.mark.skipif(chromium() is None, reason="needs chromium")
def test_browser_draws_the_report(tmp_path):
    pytest.importorskip("pyvista")
    from matplotlib.image import imread

    evil = "<img src=x onerror='window.harmed = 1'>"
    paths = paper_pair(tmp_path / "a", seconds=1.0, remark=evil)
    out = report.write(paths, tmp_path / "out.html")
    with Browser() as browser:
        for width in (1200, 390):
            browser.size(width, 900)
            browser.open(out)
            # Nothing is wider than the page: wide tables scroll within themselves.
            assert browser.run("document.documentElement.scrollWidth") <= width
            shown = browser.run("[...document.querySelectorAll('.main-svg')].length")
            assert shown > 0
            assert browser.run("Boolean(document.querySelector('#scene canvas'))")
            picture = imread(browser.screenshot(tmp_path / "scene.png", "#scene .plot"))
            # The body, white to blue, and its edges: not the white of an empty canvas.
            coloured = np.ptp(picture[..., :3], axis=2) > 0.2
            assert coloured.mean() > 0.01
            assert browser.run("window.harmed") is None
            moved = browser.run(
                """(() => { const time = document.querySelector('#scene [name=time]');
                const before = document.querySelector('#scene output').textContent;
                time.value = 0; time.dispatchEvent(new Event('input'));
                return [before, document.querySelector('#scene output').textContent]; })()"""
            )
            assert moved == ["1.000 s", "0.000 s"]
        assert browser.errors == []
        own = out.resolve().as_uri()
        assert all(url == own or url.startswith(("data:", "blob:")) for url in browser.requests)


@pytest.mark.skipif(chromium() is None, reason="needs chromium")
def test_browser_sees_errors_and_requests(tmp_path):
    # The test above can fail: this page asks the net for a picture and throws.
    page = tmp_path / "bad.html"
    page.write_text(
        "<!DOCTYPE html><html data-drawn='0'><body><img src='http://127.0.0.1:9/x.png'>"
        "<script>throw new Error('thrown')</script></body></html>"
    )
    with Browser() as browser:
        browser.open(page)
        browser.run("new Promise((done) => setTimeout(done, 300))")
        assert any("thrown" in message for message in browser.errors)
        assert "http://127.0.0.1:9/x.png" in browser.requests
