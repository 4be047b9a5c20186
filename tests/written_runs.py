# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Artificial results files with known motions, gaps and stresses."""

from pathlib import Path
from typing import Any

import numpy as np
from declared import (
    SHARES,
    declare_energy,
    declare_envelopes,
    declare_histories,
    declare_states,
    declare_static_stages,
)

from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES
from dolfinx_joints.results.layout import declare_body, declare_points, stage_bytes
from dolfinx_joints.results.quantities import ENERGY_TERMS
from dolfinx_joints.results.writer import ResultsWriter

STEP = 0.01
AMPLITUDE = {"linear": (1.0, 1.0, 1.0), "joints": (1.3, 0.4, 1.3)}  # as the paper's largest peaks
SURFACE_ACCELERATION = 0.5  # m/s^2

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

WEIGHT = "Gewicht, größte Höhe"


def write_run(
    path: Path,
    name: str = "joints",
    *,
    seconds: float = 1.0,
    facts: dict[str, Any] | None = None,
    summary: dict[str, Any] | None = None,
    status: str = "complete",
    waves: bool = False,
    lost: float = 0.0,
) -> Path:
    """Write a run whose point mid-crest moves in sines of 5.22, 5.0 and 5.22 Hz.

    At the end the joint is open by 3 mm at its two upper points. With ``waves`` everything also
    moves with the free surface, by ``SURFACE_ACCELERATION`` along x from rest. Waves bring 69 GJ/s,
    and all of it except the kinetic energy leaves. Friction in the joint dissipates 1 kJ/s, the
    time scheme loses ``lost`` [J/s] there.
    """
    rows = round(seconds / STEP) + 1
    metadata = {"point_names": ["mid-crest"], "run": name, "dofs": 48, "steps": rows - 1}
    metadata |= {"displacements": "absolute"} if waves else {}
    along = np.array([SURFACE_ACCELERATION if waves else 0.0, 0.0, 0.0])
    closing = {"steps": rows - 1, "energy_error": 1.25e-14, "seconds": {"time steps": 2.5}}
    with ResultsWriter(path, metadata | (facts or {})) as writer:
        declare_histories(writer, [[1.0, 0.0, 2.0]], accelerations=True, free_surface=waves)
        joints = {"joint_1": JOINT} if name == "joints" else {}
        declare_energy(writer, list(joints), ["FreeField"] if waves else [])
        if waves:
            writer.series("energy", "absorbed", (), "J", "part that viscous boundaries took")
        declare_states(writer, NODES, SURFACE, joints)
        writer.start()
        for row in range(rows):
            time = row * STEP
            wave = 1e-3 * np.sin(2 * np.pi * np.array([5.22, 5.0, 5.22]) * time)
            ground = np.array([np.sin(9.0 * time), 0.0, 0.0]) * (time < 0.6 * seconds)
            shares = dict.fromkeys(SHARES, 0.0) | {"joint_open": 0.5, "joint_stick": 0.5}
            shares["iterations"] = 2
            motion = {"free_surface_velocity": along * time} if waves else {}
            record = {
                "displacement": [wave * AMPLITUDE[name] + along * time**2 / 2],
                "acceleration": [-1e3 * wave + along],
                **(motion or {"ground_acceleration": ground}),
            }
            writer.append("histories", time, record | shares)
            energy = dict.fromkeys(ENERGY_TERMS, 1e3 * time)
            if waves:
                energy |= {"input": 69e9 * time, "loads/FreeField": 69e9 * time}
                energy["viscous"] = energy["absorbed"] = 69e9 * time - energy["kinetic"]
            rates = {"elastic": 0.0, "friction": 1e3, "numerical": lost}
            for term, rate in rates.items() if joints else ():
                energy[f"joints/joint_1/{term}"] = rate * time
            writer.append("energy", time, energy)
        for share in (0.0, 0.5, 1.0):
            moved = np.where(NODES[:, 2:] > 0.0, share * 2e-3, 0.0) * [1.0, 0.0, 0.0]
            moved = moved + along * (share * seconds) ** 2 / 2
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
    """Write a linear and a jointed run with the metadata of the paper's case."""
    folder.mkdir(exist_ok=True)
    case = {"case": "ambiesta", "record": "TMZ", "size": 8.0, "active_height": 0.75, **facts}
    return [
        write_run(folder / f"{name}.h5", name, seconds=seconds, facts=case)
        for name in ("linear", "joints")
    ]


def write_tip(path: Path, rows: int, *, plane: bool = False, **facts: Any) -> Path:
    """Write a failed run of one point, with accelerations, of a 2-D or 3-D model."""
    surface = [[0, 1], [1, 2], [2, 0]] if plane else [[0, 1, 2]]
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with ResultsWriter(path, {"point_names": ["tip"], **facts}) as writer:
        declare_histories(writer, nodes[2:], accelerations=True)
        declare_states(writer, nodes, surface, {})
        writer.start()
        for row in range(rows):
            record = {"displacement": [[0.0, 1e-3 * row, 0.0]], "iterations": 1}
            record |= {"acceleration": np.ones((1, 3)), "ground_acceleration": np.ones(3)}
            shares = dict.fromkeys(SHARES, 0.0)
            writer.append("histories", 0.1 * row, record | shares)
        writer.finish("failed", {})
    return path


def write_envelopes(path: Path, stresses: dict[str, Any], **facts: Any) -> Path:
    """Write a run of one state and envelopes of stresses, NaN if no value is given."""
    missing = np.full((len(NODES), 3), np.nan)
    with ResultsWriter(path, {"point_names": [], **facts}) as writer:
        declare_states(writer, NODES, SURFACE, {})
        declare_envelopes(writer, np.arange(len(NODES)), missing, missing)
        writer.start()
        writer.append("states", 0.0, {"displacement": np.zeros(NODES.shape)})
        writer.append("envelopes", 0.0, dict.fromkeys(ENVELOPE_NAMES, missing[:, 0]) | stresses)
        writer.finish("complete", {})
    return path


def write_stages(
    path: Path, manifest: dict[str, Any] | None = None, *, open_from: float = 1.0
) -> Path:
    """Write two static stages: the joint, 4 m^2 in the plane y = 0, is closed, then half open.

    In the first stage all four points of 1 m^2 carry a pressure of 2 MPa and a shear of 0.5 MPa
    along x. In the second only the lower two do; the upper two are open by 3 mm and have a water
    pressure of 0.1 MPa. In each stage the cube on the + side moves by 1 mm along the normal. The
    joint opens above the height ``open_from`` [m].
    """
    law = {"kind": "Friction", "friction_angle_deg": 45.0, "cohesion": 0.0}
    facts = {"point_names": ["crest"], "laws": {"joint_1": law}, "manifest": manifest or {}}
    upper = POINTS[:, 2] > open_from
    with ResultsWriter(path, facts) as writer:
        declare_points(writer, [[1.0, 0.0, 2.0]])
        declare_body(writer, NODES, SURFACE, {"joint_1": JOINT})
        declare_static_stages(writer, [[1.0, 0.0, 2.0]], NODES, {"joint_1": JOINT})
        writer.series("statics", "reaction/base", (3,), "N", "force")
        writer.series("statics", "joints/joint_1/pressure", (4,), "Pa", "water")
        writer.start()
        for number, (name, open_points) in enumerate(((WEIGHT, 0 * upper), ("winter", upper)), 1):
            is_open = open_points.astype(bool)
            traction = np.where(is_open[:, None], 0.0, [-2e6, -0.5e6, 0.0])
            row: dict[str, Any] = {
                "name": stage_bytes(name),
                "load_time": 0.0,
                "point_displacement": [[0.0, 0.0, -1e-3 * number]],
                "displacement": 1e-3 * number * (np.arange(16)[:, None] >= 8) * [0.0, 1.0, 0.0],
                "reaction/base": [0.0, 0.0, 9e6],
                "joints/joint_1/gap": np.where(is_open[:, None], [3e-3, 0, 0], [-1e-6, 4e-6, 3e-6]),
                "joints/joint_1/traction": traction,
                "joints/joint_1/status": np.where(is_open, 0, 1),
                "joints/joint_1/pressure": np.where(is_open, 1e5, 0.0),
            }
            writer.append("statics", number, row)
        writer.finish("complete", {})
    return path


def write_distinct(path: Path, seed: int = 1, **laws: dict[str, Any]) -> Path:
    """Write a run of two points and two joints in which all numbers, steps and records differ.

    Sizes are those of a dam. Half of the points with a positive gap transmit nothing. The law of a
    joint is friction, or that of ``laws``.
    """
    random = np.random.default_rng(seed)
    away = np.array([0.0, 2.0, 0.0])
    second = JOINT | {"points": POINTS + away, "areas": np.array([0.7, 0.9, 1.1, 1.3])}
    joints = {"joint_1": JOINT, "joint_2": second}
    nodes = np.concatenate([NODES, CUBE + away])
    surface = np.concatenate([SURFACE, FACES + 16])
    law = {"kind": "Friction", "friction_angle_deg": 35.0, "cohesion": 0.0}
    facts = {"point_names": ["crest", "heel"], "laws": dict.fromkeys(joints, law) | laws}
    time = np.concatenate([[0.0], np.cumsum(random.uniform(0.008, 0.012, 60))])
    with ResultsWriter(path, facts) as writer:
        declare_histories(writer, [[1.0, 0.0, 2.0], [0.0, 0.0, 0.0]], accelerations=True)
        declare_energy(writer)
        declare_states(writer, nodes, surface, joints, status=True)
        writer.series("states", "joints/joint_2/broken", (4,), "-", "bond gone", dtype=np.int8)
        missing = np.full((len(nodes), 3), np.nan)
        declare_envelopes(writer, np.arange(len(nodes)), missing, missing)
        writer.start()
        for step, t in enumerate(time):
            shares = random.dirichlet([1.0, 1.0, 1.0])
            history = dict.fromkeys(SHARES, 0.0) | dict(zip(SHARES, shares, strict=False))
            history |= {"displacement": 1e-2 * random.standard_normal((2, 3))}
            history |= {"acceleration": 3.0 * random.standard_normal((2, 3))}
            history |= {"ground_acceleration": random.standard_normal(3), "iterations": step % 7}
            writer.append("histories", t, history)
            writer.append(
                "energy", t, {term: 1e7 * random.standard_normal() for term in ENERGY_TERMS}
            )
            if step in (0, 7, 25, 40, 60):
                state: dict[str, Any] = {"displacement": 1e-2 * random.standard_normal(nodes.shape)}
                for name in joints:
                    gap = 1e-3 * random.standard_normal((4, 3))
                    traction = 1e6 * random.standard_normal((4, 3)) - [2e6, 0.0, 0.0]
                    traction[(gap[:, 0] > 0.0) & (random.random(4) < 0.5)] = 0.0
                    values = {"gap": gap, "traction": traction, "status": random.integers(0, 3, 4)}
                    state |= {f"joints/{name}/{field}": value for field, value in values.items()}
                state["joints/joint_2/broken"] = [0, 1, 0, step > 30]
                writer.append("states", t, state)
        stresses = {name: 1e6 * random.standard_normal(len(nodes)) for name in ENVELOPE_NAMES}
        writer.append("envelopes", time[-1], stresses)
        writer.finish("complete", {"steps": 60, "energy_error": 1e-14})
    return path
