# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a rank holds of results, files for ParaView, checkpoints and paths of water: its part."""

import pytest

pytest.importorskip("dolfinx")

from array_sizes import arrays, of_functions
from dolfinx.mesh import exterior_facet_indices
from shaken_wall import DT, Killed, Killer, shaking, wall

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.loads.water.open_paths import OpenPaths
from dolfinx_joints.mesh.blocks import block_of_nodes
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.simulation.checkpoint import CheckpointKeeper

pytestmark = pytest.mark.mpi


def numbers_of_all(comm, model):
    """Numbers of all joint points, their shares on facets, nodes, cells and boundary facets."""
    layout, mesh = model.operator.layout, model.jointed.mesh
    mesh.topology.create_connectivity(2, 3)
    return {
        "joint points": layout.count,
        "joint unknowns": 3 * layout.count,
        "joint points facet by facet": model.jointed.pairs.count * len(layout.rule),
        "nodes": model.V.dofmap.index_map.size_global,
        "cells": mesh.topology.index_map(3).size_global,
        "boundary facets": comm.allreduce(len(exterior_facet_indices(mesh.topology))),
    }


def watch(monkeypatch, seen, kept):
    """Look at the variables of what writes and reads, and keep the objects."""

    def watched(cls, name):
        method = getattr(cls, name)

        def call(self, *args, **options):
            kept.append(self)
            return of_functions(lambda: method(self, *args, **options), seen)

        monkeypatch.setattr(cls, name, call)

    for cls in (dj.ResultsMonitor, dj.FieldMonitor):
        for name in ("static_stage", "start", "record", "resume", "finish", "state_dict"):
            if name in vars(cls):
                watched(cls, name)
    for name in ("__init__", "save_if_due", "save_static", "load", "load_static"):
        watched(CheckpointKeeper, name)
    for name in ("__init__", "reached"):
        watched(OpenPaths, name)


def run(model, folder, kill=None, resume=False):
    """Statics, saved and read, and a dynamic stage with all that is written."""
    top = {"top": (0.0, 0.0, 20.0)}
    results = dj.ResultsMonitor(
        folder / "run.h5", points=top, every=1, envelopes=True, resultants=True
    )
    fields = dj.FieldMonitor(folder / "run.vtkhdf", every=1)
    simulation = dj.Simulation(model, monitors=[results, fields, Killer(kill)])
    if not resume:
        simulation.statics()
        simulation.save_static(folder / "run.static")
        simulation.load_static(folder / "run.static")
    kept = dj.Checkpoints(folder / "run.ckpt", every=1, resume=resume)
    simulation.dynamics(dt=DT, steps=4, motion=shaking, checkpoint=kept)


def arrays_of_all(comm, model, folder):
    """Where there are arrays as long as all, with what, in a run that is killed and goes on."""
    seen, kept = {}, []
    with pytest.MonkeyPatch.context() as monkeypatch:
        watch(monkeypatch, seen, kept)
        with pytest.raises(Killed):
            run(model, folder, kill=2)
        run(model, folder, resume=True)
    of_functions(lambda: block_of_nodes(NodeNumbering(model.V)), seen)
    for name in ("ResultsMonitor._values", "FieldMonitor._append", "save_if_due", "reached"):
        assert any(name in where for where in seen), name
    held = {path: [a.shape] for one in kept for path, a in arrays(one, set(), type(one).__name__)}
    assert len(held) > 100
    every = numbers_of_all(comm, model)
    return {
        (where, what)
        for where, shapes in (held | seen).items()
        for what, number in every.items()
        if any(number in shape for shape in shapes)
    }


def test_no_array_is_of_all(comm, read, wall_file, new_path):
    """Of two meshes, as an array of a part may be as long by chance, but hardly of both."""
    found = []
    for divisions, joints in (((12, 3, 10), 5), ((8, 3, 6), 1)):
        folder = new_path(f"joints_{joints}")
        on_root(comm, folder.mkdir)
        water = dj.JointWater(joint="joint_1", level=15.0, reached_from="base")
        jointed = read(wall_file(divisions=divisions, joints=joints))
        model = wall(jointed, loads=[dj.Gravity(), water])
        found.append(arrays_of_all(comm, model, folder))
    both = found[0] & found[1]
    assert bool(both) == (comm.size == 1), both
