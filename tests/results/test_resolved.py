# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run resolves, read back from files, texts and pictures; warnings of what lies beyond."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from written_runs import write_run

from dolfinx_joints.common.errors import PlausibilityWarning
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.results.overview import overview
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.resolved import Resolved, beyond

# Runs of `write_run` have steps of 10 ms: ten of them to a period of 0.1 s.
STEP = 10.0


def write(path: Path, mesh: float | None, joints: float | None) -> Path:
    limits = {"step": 20.0, "mesh": mesh, "joints": joints}
    return write_run(path, facts={"manifest": {"resolved_hz": limits}})


def told(results: Results, band: float | None) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        measures.acceleration_history(results, "mid-crest", "x", band=band)
    return [str(w.message) for w in caught if w.category is PlausibilityWarning]


def test_the_longest_step_and_the_manifest_say_what_is_resolved(tmp_path: Path) -> None:
    with Results(write(tmp_path / "a.h5", 8.0, None)) as one:
        assert measures.resolved_frequencies(one) == pytest.approx((STEP, 8.0, math.inf))
        with Results(write(tmp_path / "b.h5", None, 9.0)) as other:
            both = measures.resolved_frequencies(one, other)
            assert both == pytest.approx((STEP, 8.0, 9.0))
            assert both.lowest == (8.0, "mesh")
    with Results(write_run(tmp_path / "old.h5")) as old:  # of a program that did not say
        assert measures.resolved_frequencies(old) == pytest.approx((STEP, math.inf, math.inf))


def test_a_band_beyond_is_warned_of(tmp_path: Path) -> None:
    with Results(write(tmp_path / "run.h5", 12.0, 500.0)) as results:
        (text,) = told(results, 25.0)
        assert text.startswith(f"{results.path}: accelerations are shown up to 25 Hz")
        assert "the step up to 10 Hz and the mesh up to 12 Hz;" in text
        assert text.endswith("use a shorter step and a finer mesh, or a lower band.")
        (text,) = told(results, 11.0)
        assert "step up to 10 Hz" in text
        assert "mesh" not in text
        assert told(results, STEP) == []
        assert told(results, None) == []  # raw values are not those of a band
    assert "the joints up to 3 Hz" in beyond(5.0, Resolved(10.0, 12.0, 3.0))
    assert "stiffer joints" in beyond(5.0, Resolved(10.0, 12.0, 3.0))
    assert beyond(5.0, Resolved()) == ""


def test_info_says_what_is_resolved(tmp_path: Path) -> None:
    told_of = overview(write(tmp_path / "run.h5", 12.0, None))
    (line,) = (text for text in told_of.splitlines() if text.startswith("resolved to"))
    assert line.split(maxsplit=2)[2] == "10 Hz by the step, 12 Hz by the mesh"
    assert "resolved_hz" not in told_of


def test_spectra_shade_what_is_beyond(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from dolfinx_joints import plots

    with Results(write(tmp_path / "run.h5", None, None)) as results:
        ax = plots.response_spectra(results, "mid-crest", "x", band=5.0)
        (shade,) = ax.patches
        corners = np.asarray(shade.get_path().vertices)
        corners = shade.get_patch_transform().transform(corners)
        assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((0.03, 1.0 / STEP))
        legend = ax.get_legend()
        assert legend is not None
        name = "above 10 Hz, not resolved by the step"
        assert name in [text.get_text() for text in legend.get_texts()]
        slow = plots.response_spectra(results, "mid-crest", "x", band=5.0, periods=[0.2, 1.0])
        assert not slow.patches
