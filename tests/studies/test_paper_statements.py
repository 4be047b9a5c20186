# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The paper's statements, judged on runs of known motion."""

import numpy as np
import pytest
from written_runs import NODES, paper_pair, write_envelopes, write_run, write_tip

from dolfinx_joints.report import runs as report_runs
from studies import paper_statements


def verdicts(paths):
    """Verdicts on the first pair by what was measured."""
    with report_runs.opened(paths) as runs:
        pair = paper_statements.pairs(runs)[0]
        return {j.check.quantity: j.verdict for j in paper_statements.judged(pair)}


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
    assert found["energy error / largest energy [%]"] == "agrees"
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
        pair = paper_statements.pairs(runs)[0]
        judged = paper_statements.judged(pair)
    assert {j.verdict for j in judged if j.check.response} == {"not comparable"}
    assert any(reason in j.reason for j in judged)
    assert all(j.verdict != "not comparable" for j in judged if not j.check.response)


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_runs_that_ended_as_they_began(tmp_path, rows):
    facts = {"case": "ambiesta"}
    files = [
        write_tip(tmp_path / f"{run}.h5", rows, run=run, **facts) for run in ("linear", "joints")
    ]
    with report_runs.opened(files) as runs:
        added = paper_statements.add_statements(runs)
    assert "the files lack the data" in "".join(added.first[0].pieces)


def test_error_is_estimated_from_other_meshes_only(tmp_path):
    main = paper_pair(tmp_path / "a")
    other = paper_pair(tmp_path / "b", size=4.0)
    foreign = paper_pair(tmp_path / "c", size=4.0, friction_angle_deg=40.0)
    with report_runs.opened(main) as runs:
        added = paper_statements.add_statements(runs)
        assert [added.reference, added.main] == runs
        text = "There is only one mesh and one step, so the error is not estimated."
        assert text in "".join(added.first[0].pieces)
        assert added.last[0].name == "departures"
        assert added.note.startswith("Of ")
    with report_runs.opened([*main, *other, *foreign]) as runs:
        found = paper_statements.pairs(runs)
        assert [pair.joints.label for pair in found] == ["a/joints", "b/joints"]
        added = paper_statements.add_statements(runs)
        assert "b/joints (size 4.0)" in "".join(added.first[0].pieces)
    with report_runs.opened([write_run(tmp_path / "else.h5", seconds=0.05)]) as runs:
        assert not paper_statements.add_statements(runs).first


def test_crest_arch_is_judged_by_its_stresses(tmp_path):
    # Arch stresses of z MPa everywhere: in the crest, the upper tenth of 2 m, 2 MPa.
    stress = 1e6 * NODES[:, 2]
    paths = [
        write_envelopes(tmp_path / f"{name}.h5", {"arch_max": factor * stress}, run=name)
        for name, factor in (("linear", 1.0), ("joints", -1.1))
    ]
    with report_runs.opened(paths) as (linear, joints):
        assert paper_statements._crest_stress(linear) == pytest.approx(2e6)
        assert paper_statements._crest_stress(joints) == pytest.approx(2.2e6)
    with report_runs.opened([write_run(tmp_path / "bare.h5", seconds=0.05)]) as (bare,):
        assert np.isnan(paper_statements._crest_stress(bare))


@pytest.mark.parametrize(("spread", "reported"), [(None, False), (0.05, False), (0.2, True)])
def test_an_error_that_reaches_a_bound_is_reported(spread, reported):
    check = paper_statements.Check("statement", "ratio", "0.9 to 1.1", 0.9, 1.1, lambda pair: 1.0)
    judgement = paper_statements.Judgement(check, 1.0, "agrees")
    words = paper_statements._verdict(judgement, spread)
    assert "agrees" in words
    assert ("the error estimate includes the bound" in words) == reported
