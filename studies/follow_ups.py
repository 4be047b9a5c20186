# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Open questions of the 1992 paper: cases that differ from the paper's in one parameter each.

    ./with-dolfinx python3 -m studies.follow_ups --records DIRECTORY --workers 2
    ./with-dolfinx python3 -m studies.follow_ups --list
    ./with-dolfinx python3 -m studies.follow_ups --only gap friction

The paper asks three questions. *Joints up to the crest*: all joints are cut through the full
height. *No crest arch*: the uncut band above the joints is removed, so that the body ends at 0.75
of the height, at the top of its joints. Its response is compared with the linear body of the same
shape, and at the crown at 0.75 of the height also with the full dam. *Initial gaps*: every joint
has a gap before self weight acts; openings in the table include this gap.

Other cases vary what the paper leaves open: the active height of the joints, and whether the blocks
carried self weight before the joints were closed (*grouted*) or with active joints. Further cases
vary friction, stiffness and number of the joints, the amplitude of the motion, and the record.

All sweeps use the paper's record if it is in the folder or its subfolders (its name contains TMZ).
Each other record is rotated so that its largest horizontal peak is on the stream axis, and is cut
at 95 % of its Arias intensity. It is run as recorded, and scaled to the largest horizontal peak of
the paper's record.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints import JointsError, Motion, RecordError
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.motions.reading import record_names
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.study import Study, write_csv
from studies.ambiesta import Case, Which, make_motion, parameters, study_row
from studies.follow_up_plots import draw_all

PAPER_RECORD = "TMZ"
CREST = {"active_height": 1.0}

# Values of one parameter each; the paper's value is the case "paper".
SWEEPS: dict[str, tuple[float, ...]] = {
    "active_height": (0.3, 0.4, 0.45, 0.5, 0.55, 0.6, 0.9),
    "gap": (0.0005, 0.001, 0.002, 0.003, 0.004, 0.005),
    "friction_angle_deg": (20.0, 25.0, 35.0, 40.0, 45.0, 50.0),
    "normal_stiffness": (1e10, 3e10, 3e11, 1e12, 1e13),
    "shear_ratio": (0.1, 0.2, 0.7, 1.0),
    "joints": (3, 5, 7, 9, 15, 21),
    "scale": (0.25, 0.5, 0.75, 1.25, 1.5, 2.0),
}
# Sweeps with joints up to the crest.
CREST_SWEEPS: dict[str, tuple[float, ...]] = {"gap": (0.001, 0.002, 0.005), "scale": (0.5, 2.0)}
# Sweeps with joints grouted after self weight.
GROUTED_SWEEPS: dict[str, tuple[float, ...]] = {"active_height": (0.4, 0.5, 0.6)}


@dataclass(frozen=True, kw_only=True)
class Entry:
    """Case of the grid.

    Attributes:
        case: The case.
        run_as: ``linear`` or ``joints``.
        keep: Whether to keep the results file.
    """

    case: Case
    run_as: Which = "joints"
    keep: bool = False


def records_below(folder: str | Path) -> dict[str, Path]:
    """Return the folders of all records in a folder and its subfolders, by record name.

    Raises:
        RecordError: There is no record.
    """
    folders = [Path(folder), *sorted(p for p in Path(folder).rglob("*") if p.is_dir())]
    places = {name: place for place in folders for name in record_names(place)}
    if not places:
        raise RecordError(f"There are no records, three AT2 files each, in {folder}.")
    return places


def strongest_direction(motion: Motion) -> float:
    """Return the rotation, 0 to 179 degrees, that turns the largest horizontal peak to x."""
    angles = np.deg2rad(np.arange(180.0))
    x, y, _ = motion.acceleration.T
    peaks = [np.abs(np.cos(a) * x + np.sin(a) * y).max() for a in angles]
    return float(np.argmax(peaks))


def grid(base: Case, others: dict[str, Path] | None = None) -> dict[str, Entry]:
    """Return all cases by name.

    Args:
        base: The paper's case.
        others: Folders of further records by name.
    """
    cut = replace(base, crest_arch=False)
    crest = replace(base, **CREST)
    grouted = replace(base, self_weight="grouted")
    entries = {
        "paper_linear": Entry(case=base, run_as="linear", keep=True),
        "paper": Entry(case=base, keep=True),
        "crest_joints": Entry(case=crest, keep=True),
        "no_crest_arch_linear": Entry(case=cut, run_as="linear", keep=True),
        "no_crest_arch": Entry(case=cut, keep=True),
        "grouted": Entry(case=grouted),
        "grouted_crest_joints": Entry(case=replace(crest, self_weight="grouted")),
        "newmark": Entry(case=replace(base, scheme="newmark")),
    }
    swept = (
        ("", base, SWEEPS),
        ("crest_joints_", crest, CREST_SWEEPS),
        ("grouted_", grouted, GROUTED_SWEEPS),
    )
    for prefix, start, sweeps in swept:
        for name, values in sweeps.items():
            for value in values:
                entries[f"{prefix}{name}={value:g}"] = Entry(case=replace(start, **{name: value}))
    synthetic = replace(base, record_folder=None, record_name=None, rotate=None)
    motions = {"synthetic": synthetic} if base.record_folder is not None else {}
    for name, folder in (others or {}).items():
        motions |= dict(_of_record(base, name, folder))
    for name, case in motions.items():
        entries[f"record={name}_linear"] = Entry(case=case, run_as="linear")
        entries[f"record={name}"] = Entry(case=case)
        entries[f"crest_joints_record={name}"] = Entry(case=replace(case, **CREST))
    return entries


def _of_record(base: Case, name: str, folder: Path) -> Iterator[tuple[str, Case]]:
    """Yield a record unscaled, and scaled to the largest horizontal peak of the base's motion."""
    case = replace(
        base, record_folder=str(folder), record_name=name, rotate=0.0, scale=1.0, steps=1
    )
    case = replace(case, rotate=strongest_direction(make_motion(case)))
    motion = make_motion(case)
    steps = int(np.ceil(measures.strong_motion_end(motion) / case.time_step))
    full = base.steps >= Case().steps
    case = replace(case, steps=steps if full else min(steps, base.steps))
    short = re.sub(r"[^\w.+-]", "_", name).split("_")[-1]
    yield short, case
    factor = float(make_motion(base).peak[:2].max() / motion.peak[:2].max())
    yield f"{short}_scaled", replace(case, scale=round(factor, 4))


def make_study(entries: dict[str, Entry], out: Path) -> Study:
    """Return the grid as a study in a folder."""
    cases: dict[str, dict[str, Any]] = {
        name: parameters(e.case, e.run_as, keep=e.keep, envelopes=True)
        for name, e in entries.items()
    }
    return Study(out, study_row, cases)


def base_case(records: str | None, **numbers: Any) -> tuple[Case, dict[str, Path]]:
    """Return the paper's case, with the paper's record if it exists, and the other records."""
    if records is None:
        return Case(**numbers), {}
    others = records_below(records)
    own = next((name for name in others if PAPER_RECORD in name), None)
    if own is None:
        return Case(**numbers), others
    folder = others.pop(own)
    return Case(record_folder=str(folder), record_name=own, **numbers), others


def differences(entry: Entry, base: Case) -> str:
    """Return the parameters in which a case differs from the paper's, as text."""
    own, paper = asdict(entry.case), asdict(base)
    parts = [f"{name} {value}" for name, value in own.items() if value != paper[name]]
    return ", ".join([entry.run_as, *parts])


def main(arguments: list[str] | None = None) -> None:
    """List or run the cases, and draw the plots."""
    parser = Parser(description="Open questions of the 1992 paper.")
    parser.add_argument("--records", help="folder with AT2 files, searched with its subfolders")
    parser.add_argument("--out", type=Path, default=Path("output/follow_ups"), help="output folder")
    parser.add_argument("--workers", type=at_least(1), default=2, help="parallel cases (default 2)")
    parser.add_argument("--list", action="store_true", help="list the cases without running them")
    parser.add_argument("--only", nargs="+", help="cases whose names start with one of these")
    parser.add_argument("--retry-failed", action="store_true", help="run failed cases again")
    parser.add_argument(
        "--again", action="store_true", help="repeat cases whose parameters have changed"
    )
    parser.add_argument(
        "--steps", type=at_least(1), default=Case().steps, help="time steps of 0.00488 s"
    )
    parser.add_argument("--size", type=float, default=Case().size, help="cell size [m]")
    options = parser.parse_args(arguments)
    base, others = base_case(options.records, steps=options.steps, size=options.size)
    entries = grid(base, others)
    starts = tuple(options.only or ("",))
    chosen = [name for name in entries if name.startswith(starts)]
    if not chosen:
        raise ValueError(f"No case starts with {' or '.join(starts)}; --list prints all names.")
    if options.list:
        for name in chosen:
            print(f"{name:<34} {differences(entries[name], base)}")
        print(f"{len(chosen)} cases")
        return
    study = make_study(entries, options.out)
    tally = study.run(
        workers=options.workers,
        only=chosen,
        retry_failed=options.retry_failed,
        rerun_changed=options.again,
    )
    print(tally)
    table = study.table()
    print(f"table: {write_csv(table, options.out / 'table.csv')}")
    for path in draw_all(table, options.out):
        print(f"figure: {path}")


if __name__ == "__main__":
    try:
        main()
    except (JointsError, ValueError) as error:
        print(f"studies.follow_ups: {error}", file=sys.stderr)
        raise SystemExit(2) from None
