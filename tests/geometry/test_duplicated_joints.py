# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files with duplicated joint faces: read as the split mesh of the conforming file is."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from networks import network
from shaken_wall import shaking, wall

import dolfinx_joints as dj
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest
from dolfinx_joints.geometry.gravity_dam import gravity_dam
from dolfinx_joints.geometry.inclined_crack import inclined_crack
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.geometry.section_table import SectionTable
from dolfinx_joints.geometry.sections_dam import sections_dam
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.geometry.voussoir_arch import voussoir_arch
from dolfinx_joints.mesh.distribution.shares import share_of
from dolfinx_joints.mesh.joint_pairs import facet_geometry

pytestmark = pytest.mark.mpi


FACES = {"extrados_radius": 50, "crown_thickness": 4, "left_angle": 40, "right_angle": 60}
TABLE = SectionTable({"elevation": np.r_[0.0, 30.0]} | {n: np.r_[v, v] for n, v in FACES.items()})
KINDS = [{"cell": cell, "order": order} for cell in ("hex", "tet") for order in (1, 2)]
CASES = [
    *((network, {"solid": solid, **kind}) for solid in (False, True) for kind in KINDS),
    *((ambiesta, {"size": 10.0, **kind}) for kind in KINDS),
    (sections_dam, {"table": TABLE, "size": 10.0, "foundation": 9.0, "perimetral": True}),
    *((gravity_dam, {"joints": {"neck": 66.5, "base": 0}, "width": w}) for w in (None, 20.0)),
    (inclined_crack, {"size": 0.5, "cell": "quad", "order": 2}),
    (jointed_wall, {"divisions": (8, 1, 4)}),
    (two_blocks, {"size": 0.5, "angle": 20.0}),
    (voussoir_arch, {"voussoirs": 5, "order": 2}),
]


def content(comm, path):
    """Return cells, nodes, groups and pairs; places, normals and areas of pairs (collective)."""
    share = share_of(dj.read_msh(path, comm))
    rows = {name: np.concatenate(comm.allgather(each)) for name, each in share.rows().items()}
    groups = {n: np.isin(rows["facet_values"], tags) for n, tags in share.facet_groups.items()}
    groups |= {n: np.isin(rows["cell_values"], tags) for n, tags in share.cell_groups.items()}
    pairs = share.pairs.gathered(comm)
    names = ("names", "axes", "joint", "minus", "plus", "match", "sign")
    middle = np.full((1, share.shape.dim - 1), 0.3)
    sizes = np.dstack(facet_geometry(pairs, share.shape, middle))
    return rows["cells"], rows["x"], groups | {n: getattr(pairs, n) for n in names}, sizes


@pytest.mark.parametrize(("script", "options"), CASES)
def test_both_files_give_the_same_split_mesh(comm, mesh_file, script, options):
    paths = [mesh_file(script, **options, duplicated=d) for d in (False, True)]
    (cells, x, exact, sizes), (others, y, exact_2, sizes_2) = (content(comm, p) for p in paths)
    np.testing.assert_allclose(x[cells], y[others], rtol=0, atol=1e-12)
    # Each node of one mesh is one node of the other: the sides of joints have their own.
    both = np.unique(np.column_stack([cells.ravel(), others.ravel()]), axis=0)
    assert len(both) == len(x) == len(y)
    np.testing.assert_equal(exact, exact_2)
    np.testing.assert_allclose(sizes, sizes_2, rtol=0, atol=1e-12)
    whole = dj.read_msh(paths[1], comm, joints=[])  # its faces are apart without splitting
    assert whole.mesh.geometry.index_map().size_global == len(x)


def test_both_files_give_the_same_run(comm, new_path, mesh_file):
    """A static state and 20 steps in which joints open: equal to 1e-9 of the largest number."""
    files = [new_path("conforming.h5"), new_path("duplicated.h5")]
    rock = [dj.Fixed(group="base"), dj.Fixed(group="abutments")]
    points = {"crest": dj.Probe(mid_crest(), group="joint_6+")}
    for file, duplicated in zip(files, (False, True), strict=True):
        path = mesh_file(ambiesta, size=10.0, order=1, active_height=1.0, duplicated=duplicated)
        model = wall(dj.read_msh(path, comm), supports=rock)
        run = dj.Simulation(model, monitors=[dj.ResultsMonitor(file, points=points)])
        run.statics()
        run.dynamics(dt=4e-3, steps=20, motion=shaking)
    comm.barrier()
    one, other = map(dj.Results, files)
    names = [f"joints/{n}/{value}" for n in one.joints for value in ("gap", "traction", "status")]
    names = [(s, n) for s in ("statics", "states") for n in names] + [("histories", "displacement")]
    for stream, name in names:
        a, b = (read.series(stream, name) for read in (one, other))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * np.abs(a).max(), err_msg=name)
