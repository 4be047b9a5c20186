# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of a results file: displacements and joint values of states and static stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
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
from dolfinx_joints.monitors.resultants import breakable_joints, broken_shares
from dolfinx_joints.monitors.surface_stress import StressEnvelopes
from dolfinx_joints.results.layout import stage_bytes
from dolfinx_joints.results.quantities import ENERGY_TERMS, rows_below
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import StageRecord
from dolfinx_joints.simulation.statics.stage_start import CONSTRUCTION
from dolfinx_joints.simulation.statics.unfinished import find_unfinished
from dolfinx_joints.time_integration.energy import EnergyRow


def energy_terms(model: Model) -> list[str]:
    """Return the names of the energies that occur in runs of the model, in the table's order."""
    contact, has = model.contact, dict.fromkeys(ENERGY_TERMS, True)
    has |= {"plastic": model.bulk is not None, "impact": contact is not None and contact.stops}
    has |= {"fracture": contact is not None and contact.softens}
    has |= {"water": model.coupled is not None}
    has |= {"absorbed": bool(model.absorbing) or model.coupled is not None}
    return [row.name for row in rows_below("energy") if has.get(row.name)]


def energies(model: Model, rows: Sequence[EnergyRow]) -> dict[str, Floats]:
    """Return the values of consecutive steps of the stream ``energy`` by name."""
    terms = energy_terms(model)
    columns = np.array([*map(attrgetter(*terms), rows)]).T
    values: dict[str, Floats] = dict(zip(terms, columns, strict=True))
    joints = () if model.operator is None else model.operator.names
    for entry in rows_below("energy", "joints/*/"):
        of_joints = np.array([getattr(row, f"joint_{entry.key}") for row in rows]).T
        names = [entry.name.replace("*", joint) for joint in joints]
        values |= zip(names, of_joints, strict=True)
    for load in rows[0].input_by_load:
        values[f"loads/{load}"] = np.array([row.input_by_load[load] for row in rows])
    return values


class Fields:
    """Displacements of all nodes and values of all joint points."""

    def __init__(
        self, model: Model, nodes: NodeNumbering, rows: JointRows | None, wet: Sequence[str]
    ) -> None:
        self._nodes, self._rows, self._contact = nodes, rows, model.contact
        bonded = () if model.contact is None else breakable_joints(model.contact)
        self._limited: dict[str, Sequence[str]] = {"pressure": wet, "broken": bonded}

    def joint_rows(
        self, joints: Response | None, pressure: Callable[[], Floats] | None
    ) -> dict[str, NDArray[Any]]:
        """Return joint values by quantity, in the order of `JointRows` (collective).

        ``pressure`` returns the water pressures at the local joint points.
        """
        if self._rows is None or self._contact is None or joints is None:
            return {}
        parts: dict[str, NDArray[Any]] = {"gap": joints.state.gap, "traction": joints.traction}
        parts["status"] = self._contact.shown_status(joints.status)
        if self._limited["pressure"]:
            dry = np.zeros(len(joints.traction))
            parts["pressure"] = dry if pressure is None else pressure()
        if self._limited["broken"]:
            parts["broken"] = broken_shares(self._contact, joints)
        return {quantity: self._rows(values) for quantity, values in parts.items()}

    def has_values(self, quantity: str, joint: str) -> bool:
        """Return True if the joint has values of this quantity."""
        return joint in self._limited.get(quantity, (joint,))

    def values(
        self, u: PETSc.Vec, joints: Response | None, pressure: Callable[[], Floats] | None
    ) -> dict[str, Any]:
        """Return displacement and joint values of all ranks by name (collective)."""
        values: dict[str, Any] = {"displacement": self._nodes.across(self._nodes.dealt(u))}
        for quantity, rows in self.joint_rows(joints, pressure).items():
            assert self._rows is not None
            for name, of_joint in self._rows.across(rows).items():
                if self.has_values(quantity, name):
                    values[f"joints/{name}/{quantity}"] = of_joint
        return values


class StageFields:
    """Records of static stages, the stream ``statics`` of a results file."""

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
        """Return the record of a stage (collective)."""
        state, pressure = stage.state, stage.pressure
        values = self._fields.values(
            state.displacement, state.joints, None if pressure is None else lambda: pressure
        )
        values |= {"name": stage_bytes(stage.name), "load_time": stage.time}
        for key in ("load_factor", "controlled"):
            values[key] = np.nan if (value := getattr(state, key)) is None else value
        values["point_displacement"] = self._probe.read(state.displacement)
        # In static stages viscous boundaries act as supports.
        clamped, absorbing = self._model.constraints, self._model.absorbing
        for group in dict.fromkeys((*clamped.groups, *clamped.points, *absorbing)):
            values[f"reaction/{group}"] = self._model.resultant(state.reaction, group)
        if self._envelopes is not None:
            present = self._present(self._envelopes, state.absent)
            values |= self._envelopes.at(state.displacement, stage.time, stage.loads, present)
        return values | self._energies(state)

    def _energies(self, state: StaticState) -> dict[str, float]:
        """Return energies [J] and jumps of a stage; works of loads that never acted are zero."""
        energy = state.energy
        terms = {row.key: getattr(energy, row.key) for row in rows_below("statics", "energy/")}
        for row in rows_below("statics", "energy/joints/*/"):
            values = zip(self._joints, getattr(energy, f"joint_{row.key}"), strict=True)
            terms |= {f"joints/{joint}/{row.key}": float(value) for joint, value in values}
        works = dict.fromkeys(self._loads, 0.0) | dict(energy.input_by_load)
        terms |= {f"loads/{load}": work for load, work in works.items()}
        jumps = {"jumps": len(state.jumps), "jump_energy": sum(j.energy for j in state.jumps)}
        return {f"energy/{name}": value for name, value in terms.items()} | jumps

    def _present(self, envelopes: StressEnvelopes, absent: Sequence[str]) -> Floats:
        """Return 1 at vertices of the envelopes, 0 at vertices of absent blocks (collective)."""
        present = self._model.stiffness.createVecRight()
        present.set(1.0)
        present.getArray()[find_unfinished(self._model, (), absent).dofs] = 0.0
        return rows_at(
            self._model.jointed.mesh.comm, self._nodes.dealt(present)[:, 0], envelopes.nodes
        )
