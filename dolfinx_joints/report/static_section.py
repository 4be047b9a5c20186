# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report section on the static stages: pictures, displacements, joints, stresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.postprocessing import measures, views
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.joints.resultants import joint_geometry, joint_resultants
from dolfinx_joints.postprocessing.measures import StageEnergy, StageJoint, StaticStage
from dolfinx_joints.postprocessing.plots import energy_unit
from dolfinx_joints.postprocessing.rendering import round_scale
from dolfinx_joints.postprocessing.static_stages import joint_in_state, stage_jumps
from dolfinx_joints.report.page import Cell, Html, Section, figure, paragraph, table
from dolfinx_joints.report.runs import Content, Run, nothing
from dolfinx_joints.results.quantities import TABLE, rows_below

_ENERGIES_NOTE = (
    "Energies are zero in the unloaded body. Numerical energy is lost in joints (gained if "
    "negative) because the displacement path within a load increment is straight. Released energy "
    "is the work of the out-of-balance forces along the increments; friction and numerical energy "
    "include it. More load steps reduce it unless the structure jumps."
)

_JOINTS_NOTE = (
    "Safety N tan φ / V is that of the row's forces, where bonds add cohesion times intact area to "
    "N tan φ. Safety of magnitudes divides by the shear of the points summed as magnitudes, where "
    "opposite shears do not cancel. A dash means no shear, no friction angle, or a curved joint."
)
_REACTIONS_NOTE = (
    "Reactions are forces of supports on the body. If supports share a node, a component counts in "
    "the first of them that constrains it, so reactions of several supports can be summed."
)
_REACTIONS_NOTE_1 = (  # in layout 1
    "Reactions are forces of supports on the body. A node of several supports counts in each of "
    "them. The file does not name these nodes, so the reactions are not summed."
)

# Energies below this fraction of the largest one are rounding errors and shown as zero.
_ROUNDING = 1e-12

# Displacements and forces below this fraction of the largest one are shown as zero.
_NOISE = 1e-9


def statics(content: Content) -> Section:
    """Return the section with pictures of the main run and tables of all compared runs."""
    title = "Statics"
    pairs = [(run, stages(run)) for run in content.compared]
    pieces: list[Html] = []
    for run, static_stages in pairs:
        pieces += _tables(run, static_stages) if static_stages else []
    if not pieces:
        return nothing("statics", title, "static state")
    note = (
        "Displacements are relative to the unloaded body. For files without static stages, the "
        "first record is shown."
    )
    return Section("statics", title, [paragraph(note, "note"), *_pictures(content), *pieces])


def _pictures(content: Content) -> list[Html]:
    """Return the deformed body after each static stage, at a common scale."""
    run = content.main
    names = run.results.stage_names
    if not (run.drawable and names and run.has("statics", "displacement")):
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
    caption = f"{run.label} after each static stage{'' if run.plane else ', from downstream'}."
    if _any_stage_lists(run, "absent"):
        caption += " Blocks that are absent in a stage are drawn undeformed."
    return [figure(pictures, caption + gaps_note(run))]


def _any_stage_lists(run: Run, *kinds: str) -> bool:
    """Return True if a static stage lists joints as "inactive" or blocks as "absent", as named."""
    acting = (run.results.metadata.get("manifest") or {}).get("static_stages", {})
    return any(f"; {word}: " in text for text in acting.values() for word in kinds)


def gaps_note(run: Run) -> str:
    """Return a note on gaps between blocks that moved independently, or an empty text."""
    if not _any_stage_lists(run, "inactive", "absent"):
        return ""
    return (
        " Displacements are relative to the unloaded body: gaps between blocks that moved apart "
        "before their joint was active are not openings."
    )


def stages(run: Run) -> list[StaticStage]:
    """Return the static stages of a run, or without stages the first record if it is at rest."""
    static_stages = measures.static_stages(run.results)
    results = run.results
    moves = run.has("energy", "kinetic") and results.series("energy", "kinetic", 0) > 0.0
    if static_stages or moves or not run.has("histories", "displacement"):
        return static_stages
    moved = results.series("histories", "displacement", 0)
    joints = results.joints if run.has("states") else []
    return [
        StaticStage(
            name="first record",
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


def _tables(run: Run, static_stages: Sequence[StaticStage]) -> list[Html]:
    """Return tables of displacements, joints, stresses and energies of a run by stage."""
    moved = _vectors(run, {s.name: s.displacement for s in static_stages}, 1e3)
    reactions = _vectors(run, {s.name: s.reaction for s in static_stages}, 1e-6)
    joints: list[list[Cell]] = []
    for stage in static_stages:
        joints += [[stage.name]]
        joints += [[name, *_joint_cells(joint)] for name, joint in stage.joints.items()]
    pieces = []
    if static_stages[0].displacement:
        head = ["point", *(f"{component} [mm]" for component in run.components)]
        pieces.append(table(f"Static displacements ({run.label})", head, moved))
    if run.has("statics", "load_factor"):
        series = [run.results.series("statics", key) for key in ("load_factor", "controlled")]
        factors = zip(run.results.stage_names, *series, strict=True)
        if controlled := [[name, f, 1e3 * v] for name, f, v in factors if np.isfinite(f)]:
            head = ["stage", "load factor", "gap or displacement [mm]"]
            pieces.append(table(f"Controlled static stages ({run.label})", head, controlled))
    if static_stages[0].joints:
        head = ["joint", *(row.heading for row in TABLE["stage_joints"])]
        pieces.append(table(f"Joints in the static stages ({run.label})", head, joints))
        pieces.append(paragraph(_JOINTS_NOTE, "note"))
        warnings = {name: joint_geometry(run.results, name).warning for name in run.results.joints}
        pieces += [
            paragraph(f"{name} is {text}.", "note") for name, text in warnings.items() if text
        ]
    if static_stages[0].reaction:
        head = ["support", *(f"{component} [MN]" for component in run.components)]
        pieces.append(table(f"Reactions of the supports ({run.label})", head, reactions))
        note = _REACTIONS_NOTE_1 if run.results.layout == 1 else _REACTIONS_NOTE
        pieces.append(paragraph(note, "note"))
    names = [
        n
        for n in static_stages[0].stresses
        if not all(np.isnan(s.stresses[n]) for s in static_stages)
    ]
    rows = [[s.name, *(1e-6 * s.stresses[n] for n in names)] for s in static_stages]
    if names:
        head = ["stage", *(f"{name.replace('_', ', ')} [MPa]" for name in names)]
        pieces.append(table(f"Static stresses, tension > 0 ({run.label})", head, rows))
    jumps = [paragraph(f"{run.label}: {text}") for text in jump_warnings(run)]
    return [*pieces, *_energies(run, static_stages), *jumps]


def _joint_cells(joint: StageJoint) -> list[Cell]:
    """Return the columns of a joint: rounding errors are 0, infinite safeties None."""
    values = {row: float(getattr(joint, row.name)) for row in TABLE["stage_joints"]}
    largest = max(abs(value) for row, value in values.items() if row.unit == "N")
    scales = {"N": largest, "m": 1.0}  # gaps below 1 nm are zero
    shown = [row.factor * _shown(v, scales.get(row.unit, 0.0)) for row, v in values.items()]
    return [value if np.isfinite(value) else None for value in shown]


def _vectors(run: Run, stages: Mapping[str, Mapping[str, Floats]], factor: float) -> list[Any]:
    """Return rows of the named vectors of each stage, times a factor; rounding errors are 0."""
    vectors = [vector for of_stage in stages.values() for vector in of_stage.values()]
    largest, axes = np.abs(vectors).max(initial=0.0), len(run.components)
    rows: list[Any] = []
    for stage, of_stage in stages.items():
        rows.append([stage])
        for name, vector in of_stage.items():
            rows.append([name, *(factor * _shown(value, largest) for value in vector[:axes])])
    return rows


def _shown(value: float, scale: float) -> float:
    """Return a value, or 0 if it is a rounding error of values of the size ``scale``."""
    return 0.0 if abs(value) <= _NOISE * scale else float(value)


def _energies(run: Run, static_stages: Sequence[StaticStage]) -> list[Html]:
    """Return a table of a run's energies without zero columns, or [] without energies."""
    energies = [(stage.name, stage.energy) for stage in static_stages if stage.energy is not None]
    if not energies:
        return []
    rows = [_by_column(energy) for _, energy in energies]
    columns = [name for name in rows[0] if any(row[name] for row in rows)]
    joule, unit = energy_unit(max((abs(row[name]) for row in rows for name in columns), default=0))
    head = [
        "stage",
        *(f"{name} [{unit}]" for name in columns),
        "balance error / largest energy [%]",
    ]
    cells = [
        [name, *(row[column] / joule for column in columns), 100.0 * energy.relative_error]
        for (name, energy), row in zip(energies, rows, strict=True)
    ]
    title = f"Energies of the static stages ({run.label})"
    return [table(title, head, cells), paragraph(_ENERGIES_NOTE, "note")]


def _by_column(energy: StageEnergy) -> dict[str, float]:
    """Return the energies by column title, [J]; energies of joints are summed over the joints."""
    values = {f"work of {load}": work for load, work in energy.loads.items()}
    for row in TABLE["statics"]:
        if row.name.startswith("energy/joints/"):
            values[row.label] = sum(of_joint[row.key] for of_joint in energy.joints.values())
        elif row in rows_below("statics", "energy/") and row.key not in ("error", "scale"):
            values[row.label] = getattr(energy, row.key)
    least = _ROUNDING * energy.scale
    return {name: value if abs(value) > least else 0.0 for name, value in values.items()}


def jump_warnings(run: Run) -> list[str]:
    """Return a warning if the structure jumps in static stages of a run."""
    stages = stage_jumps(run.results).items()
    jumps = [f"in the static stage {name!r}: {'; '.join(texts)}" for name, texts in stages]
    return [f"the structure jumps {'; '.join(jumps)}."] if jumps else []
