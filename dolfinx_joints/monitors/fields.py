# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacements and joints of a state, and static stages, as records of a results file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.mpi import rows_at
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.load import load_names
from dolfinx_joints.loads.water.pressures_in_joints import water_in_joints
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.probes import PointProbe
from dolfinx_joints.monitors.resultants import broken, broken_joints
from dolfinx_joints.monitors.surface_stress import StressEnvelopes
from dolfinx_joints.postprocessing.envelopes import STAGE_STRESSES
from dolfinx_joints.results.layout import stage_bytes
from dolfinx_joints.results.quantities import ENERGY_TERMS, rows_below
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import Record, StageRecord
from dolfinx_joints.simulation.statics.stage_start import CONSTRUCTION
from dolfinx_joints.simulation.statics.unfinished import unfinished


def energy_terms(model: Model) -> list[str]:
    """Energies of the whole model that its runs have, in the order of the table."""
    contact, has = model.contact, dict.fromkeys(ENERGY_TERMS, True)
    has |= {"plastic": model.bulk is not None, "impact": contact is not None and contact.stops}
    has |= {"water": model.coupled is not None}
    has |= {"absorbed": bool(model.absorbing) or model.coupled is not None}
    return [row.name for row in rows_below("energy") if has.get(row.name)]


def energies(model: Model, record: Record) -> dict[str, float]:
    """Values of the stream ``energy``, always in the same order."""
    row = record.energy
    found = {term: getattr(row, term) for term in energy_terms(model)}
    joints = () if model.operator is None else model.operator.names
    for each in rows_below("energy", "joints/*/"):
        names = [each.name.replace("*", joint) for joint in joints]
        found |= zip(names, getattr(row, f"joint_{each.key}").tolist(), strict=True)
    return found | {f"loads/{load}": work for load, work in row.input_by_load.items()}


class Fields:
    """Displacements of all nodes and values of all joint points."""

    def __init__(
        self, model: Model, nodes: NodeNumbering, rows: JointRows | None, wet: Sequence[str]
    ) -> None:
        self._nodes, self._rows, self._contact = nodes, rows, model.contact
        bonded = () if model.contact is None else broken_joints(model.contact)
        self._only: dict[str, Sequence[str]] = {"pressure": wet, "broken": bonded}

    def of_joints(
        self, joints: Response | None, pressure: Callable[[], Floats] | None
    ) -> dict[str, NDArray[Any]]:
        """Values of this rank's rows; the water's pressure is of local points (collective)."""
        if self._rows is None or self._contact is None or joints is None:
            return {}
        found: dict[str, NDArray[Any]] = {"gap": joints.state.gap, "traction": joints.traction}
        found["status"] = self._contact.shown_status(joints.status)
        if self._only["pressure"]:
            dry = np.zeros(len(joints.traction))
            found["pressure"] = dry if pressure is None else pressure()
        if self._only["broken"]:
            found["broken"] = broken(self._contact, joints)
        return {what: self._rows(values) for what, values in found.items()}

    def concerned(self, what: str, joint: str) -> bool:
        """Whether a joint has values of this kind."""
        return joint in self._only.get(what, (joint,))

    def values(
        self, u: PETSc.Vec, joints: Response | None, pressure: Callable[[], Floats] | None
    ) -> dict[str, Any]:
        """Displacement and values `of_joints` of all ranks by name (collective)."""
        found: dict[str, Any] = {"displacement": self._nodes.across(self._nodes.dealt(u))}
        for what, rows in self.of_joints(joints, pressure).items():
            assert self._rows is not None
            for name, each in self._rows.across(rows).items():
                if self.concerned(what, name):
                    found[f"joints/{name}/{what}"] = each
        return found


class StageFields:
    """Static stages as the stream ``statics`` of a results file."""

    def __init__(
        self,
        model: Model,
        nodes: NodeNumbering,
        rows: JointRows | None,
        probe: PointProbe,
        envelopes: StressEnvelopes | None,
    ) -> None:
        self._model, self._nodes, self._probe, self._envelopes = model, nodes, probe, envelopes
        wet = tuple(dict.fromkeys(load.joint for load in water_in_joints(model.loads)))
        self._fields = Fields(model, nodes, rows, wet)
        self._joints = () if model.operator is None else tuple(model.operator.names)
        self._loads = (*load_names(model.loads), "grout", CONSTRUCTION)

    def values(self, stage: StageRecord) -> dict[str, Any]:
        """Record of a stage (collective)."""
        state, pressure = stage.state, stage.pressure
        found = self._fields.values(
            state.displacement, state.joints, None if pressure is None else lambda: pressure
        )
        found |= {"name": stage_bytes(stage.name), "load_time": stage.time}
        found["point_displacement"] = self._probe.read(state.displacement)
        # Viscous boundaries hold the body in static stages.
        for group in dict.fromkeys((*self._model.constraints.groups, *self._model.absorbing)):
            found[f"reaction/{group}"] = self._model.resultant(state.reaction, group)
        if self._envelopes is not None:
            there = self._there(self._envelopes, state.absent)
            columns = self._envelopes.at(state.displacement, stage.time, stage.loads, there)
            found |= dict(zip(dict.fromkeys(STAGE_STRESSES.values()), columns, strict=True))
        return found | self._energies(state)

    def _energies(self, state: StaticState) -> dict[str, float]:
        """Energies [J] and jumps of a stage; loads that never acted have no work."""
        energy = state.energy
        found = {row.key: getattr(energy, row.key) for row in rows_below("statics", "energy/")}
        for row in rows_below("statics", "energy/joints/*/"):
            values = zip(self._joints, getattr(energy, f"joint_{row.key}"), strict=True)
            found |= {f"joints/{joint}/{row.key}": float(value) for joint, value in values}
        works = dict.fromkeys(self._loads, 0.0) | dict(energy.input_by_load)
        found |= {f"loads/{load}": work for load, work in works.items()}
        jumps = {"jumps": len(state.jumps), "jump_energy": sum(j.energy for j in state.jumps)}
        return {f"energy/{name}": value for name, value in found.items()} | jumps

    def _there(self, envelopes: StressEnvelopes, absent: Sequence[str]) -> Floats:
        """1 at the vertices of the envelopes, 0 at those of absent blocks (collective)."""
        there = self._model.stiffness.createVecRight()
        there.set(1.0)
        there.getArray()[unfinished(self._model, (), absent).dofs] = 0.0
        return rows_at(
            self._model.jointed.mesh.comm, self._nodes.dealt(there)[:, 0], envelopes.nodes
        )
