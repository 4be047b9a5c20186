# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Section of a report on the static stages: pictures, displacements, joints, stresses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_joints.postprocessing import measures, views
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.joints.resultants import joint_geometry, joint_resultants
from dolfinx_joints.postprocessing.measures import StageEnergy, StaticStage
from dolfinx_joints.postprocessing.plots import energy_unit
from dolfinx_joints.postprocessing.rendering import round_scale
from dolfinx_joints.postprocessing.static_stages import joint_in_state, stage_jumps
from dolfinx_joints.report.page import Cell, Html, Section, figure, paragraph, table
from dolfinx_joints.report.runs import Content, Run, nothing
from dolfinx_joints.results.quantities import TABLE, rows_below

_ENERGIES_NOTE = (
    "Energies count from the unloaded body. Numerical is the energy that joints lose, or gain if "
    "it is negative, because the path within an increment of the loads is straight. Released is "
    "the work of forces out of balance along the increments, a part of friction and numerical; "
    "more load steps make it smaller unless the structure jumps."
)

# Share of the largest energy below which a value is rounding.
_ROUNDING = 1e-12


def statics(content: Content) -> Section:
    """Pictures of the main run's static stages, and tables of all compared runs."""
    title = "Statics"
    each = [(run, stages(run)) for run in content.compared]
    pieces: list[Html] = []
    for run, found in each:
        pieces += _tables(run, found) if found else []
    if not pieces:
        return nothing("statics", title, "static state")
    note = (
        "Displacements are counted from the unloaded body. Files without named stages show the "
        "state that the earthquake starts from."
    )
    return Section("statics", title, [paragraph(note, "note"), *_pictures(content), *pieces])


def _pictures(content: Content) -> list[Html]:
    """The deformed body after each static stage, from downstream, all to one scale."""
    run = content.main
    names = run.results.stage_names
    surface = {"mesh/nodes", "mesh/surface"} <= set(run.results.statics)
    if run.plane or not (surface and names and run.has("statics", "displacement")):
        return []
    body = Body(run.results, run.groups)
    moved = [run.results.series("statics", "displacement", i)[body.seen] for i in range(len(names))]
    largest = max(float(np.linalg.norm(u, axis=1).max()) for u in moved)
    scale = round_scale(body.nodes[body.seen], largest)
    pictures = []
    for number, name in enumerate(names):
        drawn = views.deformed(run.results, stage=number, scale=scale, groups=run.groups)
        path = content.save(f"static_{number + 1}", drawn, dpi=90)
        pictures.append(content.drawings.picture(path, f"{run.label} after {name}"))
    caption = f"{run.label} after each static stage, from downstream."
    if _any_lacks(run, "absent"):
        caption += " Blocks that are absent in a stage are drawn unmoved."
    return [figure(pictures, caption + gaps_note(run))]


def _any_lacks(run: Run, *what: str) -> bool:
    """Whether joints were inactive, or blocks absent, in any static stage."""
    acting = (run.results.metadata.get("manifest") or {}).get("static_stages", {})
    return any(f"; {each}: " in text for text in acting.values() for each in what)


def gaps_note(run: Run) -> str:
    """What to keep in mind of pictures of blocks that stood alone for a time; empty of others."""
    if not _any_lacks(run, "inactive", "absent"):
        return ""
    return (
        " Displacements are from the unloaded body: where blocks moved apart before the joints "
        "between them acted there are gaps that are no openings."
    )


def stages(run: Run) -> list[StaticStage]:
    """The static stages of a run or, of files without any, the first record."""
    found = measures.static_stages(run.results)
    if found or not run.has("histories", "displacement"):
        return found
    results = run.results
    moved = results.series("histories", "displacement", 0)
    joints = results.joints if run.has("states") else []
    return [
        StaticStage(
            name="static state",
            load_time=float(results.time("histories")[0]),
            displacement=dict(zip(results.point_names, moved, strict=True)),
            reaction={},
            joints={
                joint: joint_in_state(results, "states", joint_resultants(results, joint), 0)
                for joint in joints
            },
            stresses={},
        )
    ]


def _tables(run: Run, found: Sequence[StaticStage]) -> list[Html]:
    """Displacements, joints and stresses of a run, one stage after the other."""
    moved: list[list[Cell]] = []
    joints: list[list[Cell]] = []
    for stage in found:
        moved += [[stage.name]] + [
            [point, *(1e3 * float(u) for u in values[: len(run.components)])]
            for point, values in stage.displacement.items()
        ]
        joints += [[stage.name]] + [
            [name, *(row.factor * float(getattr(joint, row.name)) for row in TABLE["stage_joints"])]
            for name, joint in stage.joints.items()
        ]
    pieces = []
    if found[0].displacement:
        head = ["point", *(f"{component} [mm]" for component in run.components)]
        pieces.append(table(f"Static displacements ({run.label})", head, moved))
    if found[0].joints:
        head = ["joint", *(row.heading for row in TABLE["stage_joints"])]
        pieces.append(table(f"Joints in the static stages ({run.label})", head, joints))
        warnings = {name: joint_geometry(run.results, name).warning for name in run.results.joints}
        pieces += [
            paragraph(f"{name} is {text}.", "note") for name, text in warnings.items() if text
        ]
    names = list(found[0].stresses)
    rows = [[s.name, *(1e-6 * s.stresses[n] for n in names)] for s in found]
    if any(not np.isnan(value) for stage in found for value in stage.stresses.values()):
        head = ["stage", *(f"{name.replace('_', ', ')} [MPa]" for name in names)]
        pieces.append(table(f"Static stresses, tension > 0 ({run.label})", head, rows))
    return pieces + _energies(run, found) + [paragraph(text) for text in jump_warnings(run)]


def _energies(run: Run, found: Sequence[StaticStage]) -> list[Html]:
    """Table of the energies of a run without columns of zeros; nothing of files without them."""
    known = [(stage.name, stage.energy) for stage in found if stage.energy is not None]
    if not known:
        return []
    rows = [_by_column(energy) for _, energy in known]
    columns = [name for name in rows[0] if any(row[name] for row in rows)]
    joule, unit = energy_unit(max((abs(row[name]) for row in rows for name in columns), default=0))
    head = ["stage", *(f"{name} [{unit}]" for name in columns), "balance error / largest [%]"]
    cells = [
        [name, *(row[column] / joule for column in columns), 100.0 * energy.relative_error]
        for (name, energy), row in zip(known, rows, strict=True)
    ]
    title = f"Energies of the static stages ({run.label})"
    return [table(title, head, cells), paragraph(_ENERGIES_NOTE, "note")]


def _by_column(energy: StageEnergy) -> dict[str, float]:
    """Energies by the heads of their columns, those of all joints added up, [J]."""
    values = {f"work of {load}": work for load, work in energy.loads.items()}
    for row in TABLE["statics"]:
        if row.name.startswith("energy/joints/"):
            values[row.label] = sum(of_joint[row.key] for of_joint in energy.joints.values())
        elif row in rows_below("statics", "energy/") and row.key not in ("error", "scale"):
            values[row.label] = getattr(energy, row.key)
    least = _ROUNDING * energy.scale
    return {name: value if abs(value) > least else 0.0 for name, value in values.items()}


def jump_warnings(run: Run) -> list[str]:
    """Sentences on the jumps of the static stages of a run."""
    return [
        f"{run.label}: the structure jumps in the static stage {name!r}: {'; '.join(jumps)}."
        for name, jumps in stage_jumps(run.results).items()
    ]
