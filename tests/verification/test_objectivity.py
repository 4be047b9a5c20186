# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results do not depend on axes, numbering, the names of the sides, or the number of ranks.

        top ___________     springs all over, loads
           |     |     |
           | left|right|    joint_2 is upright and ends on joint_1, which rises by 15 degrees
           |_____|_____|
           |   lower   |    in 3-D the same, one cell or two deep
      base |___________|    clamped, shaken

Expected: the same model in its own axes, on one rank, as it stands. Turned or mirrored by an
orthogonal Q, with the loads turned alike, displacements, jumps and tractions in global axes turn by
Q and energies stay; the sides of a joint exchanged, jump and traction change their sign. Each test
runs the changed model on all ranks and compares it with the plain one on a rank of its own.

Tolerance: 1e-11 of the largest value of a quantity in the run; differences of up to 3e-12 were
measured on one rank. They come from rounding, 1e-16 of the forces in each solve, and grow with the
softness of states in which most points are open and impacts from step to step. Joints much stiffer
than the body would lose digits of the tractions (see `test_series_bar`); here k_n h/E is 1.
Newton's method stops at 1e-14 of the forces, or at what rounding leaves.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows
from whole_vectors import whole_layout

import dolfinx_joints as dj
from dolfinx_joints.laws.law import Status
from dolfinx_joints.mesh.cells import CellShape

pytestmark = [
    pytest.mark.mpi,
    pytest.mark.filterwarnings("ignore:The energy error is"),  # the blocks strike hard
]

COMM = MPI.COMM_WORLD
TOLERANCE = 1e-11
NEWTON = dj.SolverOptions(relative_tolerance=1e-14)
RISE = np.tan(np.radians(15.0))
BLOCKS = ("lower", "left", "right")
# Normals in the model's own axes, from - to + as the plain model has them.
NORMALS = {"joint_1": [-RISE, 1.0], "joint_2": [1.0, 0.0]}


def orthogonal(dim, seed, *, mirrored=False):
    """A random rotation, or one with a reflection."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(dim, dim)))
    q = q * np.sign(np.diag(r))
    if (np.linalg.det(q) < 0) != mirrored:
        q[:, 0] *= -1.0
    return q


@dataclass(frozen=True)
class View:
    """How a model is looked at.

    Attributes:
        turn: Q, or None.
        numbering: Seed of the permutation of cells and nodes, or None.
        exchanged: Whether the sides come by name, the wrong way round.
    """

    turn: np.ndarray | None = None
    numbering: int | None = None
    exchanged: bool = False


PLAIN = View()


def grid(cell):
    """Reference coordinates, cells in basix order and the block of each cell.

    x in [0, 4], (y in [0, 1]) and the height in [0, 4] in cells; the joints are height = 2, and
    x = 2 above it.
    """
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    counts = (4, 4) if dim == 2 else (4, 1, 4)
    axes = [np.arange(n + 1.0) for n in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    number = np.arange(len(points)).reshape([n + 1 for n in counts])
    corners = np.array([[(c >> k) & 1 for k in range(dim)] for c in range(2**dim)])
    origins = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, dim)
    boxes = number[tuple(np.moveaxis(origins[:, None] + corners, -1, 0))]
    simplices = {  # along the diagonals, alike in every box
        "triangle": [[0, 1, 3], [0, 2, 3]],
        "tetrahedron": [
            [0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]
        ],
    }  # fmt: skip
    parts = simplices.get(cell, [list(range(2**dim))])
    block = np.where(origins[:, -1] < 2, 0, np.where(origins[:, 0] < 2, 1, 2))
    return points, boxes[:, parts].reshape(-1, len(parts[0])), np.repeat(block, len(parts))


def facets_at(shape, points, cells, on):
    """Vertices of the facets of cells whose vertices all lie ``on`` something."""
    facets = cells[:, shape.facet_vertices].reshape(-1, shape.facet_vertices.shape[1])
    return np.unique(np.sort(facets[on(points[facets]).all(axis=1)], axis=1), axis=0)


def blocks(cell, view):
    """The three blocks, arguments of `mesh_from_arrays`."""
    shape = CellShape(name=cell, degree=1)
    points, cells, block = grid(cell)
    joints = {
        "joint_1": (lambda p: p[..., -1] == 2, [0], [1, 2]),
        "joint_2": (lambda p: (p[..., 0] == 2) & (p[..., -1] >= 2), [1], [2]),
    }
    if view.exchanged:  # nodes of their own for every block
        pairs = np.column_stack([np.repeat(block, cells.shape[1]), cells.ravel()])
        own, inverse = np.unique(pairs, axis=0, return_inverse=True)
        points, cells = points[own[:, 1]], inverse.reshape(cells.shape)
    groups = {
        "base": facets_at(shape, points, cells, lambda p: p[..., -1] == 0),
        "top": facets_at(shape, points, cells, lambda p: p[..., -1] == 4),
        "end": facets_at(shape, points, cells, lambda p: p[..., 0] == 4),
    }
    for name, (on, minus, plus) in joints.items():
        if view.exchanged:
            for side, members in (("+", minus), ("-", plus)):
                groups[name + side] = facets_at(shape, points, cells[np.isin(block, members)], on)
        else:
            groups[name] = facets_at(shape, points, cells, on)
    x = points / 2.0
    height = 1.0 + RISE * (x[:, 0] - 1.0)
    x[:, -1] = np.where(x[:, -1] <= 1, x[:, -1] * height, height + (x[:, -1] - 1) * (2 - height))
    if view.turn is not None:
        x = x @ view.turn.T
    members = {name: np.flatnonzero(block == i) for i, name in enumerate(BLOCKS)}
    if view.numbering is not None:  # cells and nodes in another order
        random = np.random.default_rng(view.numbering)
        of_cell, of_node = random.permutation(len(cells)), random.permutation(len(x))
        new_cell, new_node = np.argsort(of_cell), np.argsort(of_node)
        cells, x = new_node[cells][of_cell], x[of_node]
        members = {name: new_cell[each] for name, each in members.items()}
        groups = {name: random.permutation(new_node[each]) for name, each in groups.items()}
    return {"cell": cell, "x": x, "cells": cells, "facet_groups": groups, "cell_groups": members}


@dataclass(frozen=True)
class Case:
    """Cell, degree of the displacement, rule on the joints."""

    cell: str
    degree: int
    rule: str

    @property
    def dim(self):
        return 2 if self.cell in ("triangle", "quadrilateral") else 3


class Scene:
    """A model under a view, and what it gives in its own axes."""

    def __init__(self, case, view, comm, *, friction=30.0):
        self.view, self.dim = view, case.dim
        self.turn = np.eye(case.dim) if view.turn is None else view.turn
        jointed = dj.mesh_from_arrays(comm, **blocks(case.cell, view))
        self.model = dj.Model(
            jointed,
            material=dj.Elastic(young=2e9, poisson=0.2, density=2400.0),
            joints=dj.Joints(
                dj.FrictionNoTension(
                    normal_stiffness=4e9, shear_stiffness=2e9, friction_angle_deg=friction
                ),
                initial_gaps={"joint_2": 2e-6},
                quadrature=case.rule,
            ),
            supports=[
                dj.Fixed(group="base"),
                dj.Spring(group="top", normal_stiffness=3e8, tangential_stiffness=3e8),
            ],
            loads=self._loads(),
            body=dj.Body(degree=case.degree),
        )
        self.snapshots = []

    def vector(self, along, across, up):
        """A vector of the model's own axes in those of the view."""
        return self.turn @ np.array([along, up] if self.dim == 2 else [along, across, up])

    def _loads(self):
        """Gravity, and loads on top and end that follow the paths of the quasi-static scene."""
        paths = {
            "top": [((0, 0, -1), PRESS), ((1, 0.4, 0), SHEAR)],
            "end": [((-1, 0.1, 0.05), SIDE)],
        }
        return [
            dj.Gravity(acceleration=self.vector(0.3, 0.2, -9.81)),
            *(
                dj.Traction(group=group, value=1e5 * self.vector(*value), factor=path)
                for group, loads in paths.items()
                for value, path in loads
            ),
        ]

    def take(self, displacement, joints, energies=()):
        """Keep what a step gave, in the model's own axes, in an order of its own."""
        model, comm = self.model, self.model.jointed.mesh.comm
        operator = model.operator
        u = model.function(displacement).x.array.reshape(-1, self.dim) @ self.turn
        x = model.V.tabulate_dof_coordinates()[:, : self.dim] @ self.turn
        owned = np.arange(model.V.dofmap.index_map.size_local)
        moved = []
        for name in BLOCKS:
            cells = model.jointed.cells(name)
            here = np.intersect1d(model.V.dofmap.list[cells].ravel(), owned)
            moved.append(ordered(comm, x[here], u[here]))
        frames = operator.frames[:, :, : self.dim] @ self.turn
        plain = np.array([[*NORMALS[n][:1], *[0] * (self.dim - 2), NORMALS[n][1]] for n in NORMALS])
        sign = np.sign(np.einsum("ni,ni->n", frames[:, 0], plain[operator.joint]))[:, None]
        points = operator.points[:, : self.dim] @ self.turn
        status = joints.status.astype(float)[:, None]
        jump = np.einsum("nki,nk->ni", frames, joints.state.gap)
        traction = np.einsum("nki,nk->ni", frames, joints.traction)
        table = [sign * traction, sign * jump, joints.state.gap[:, :1], status]
        keys = np.column_stack([operator.joint, points, self._middles(len(points))])
        joined = ordered(comm, keys, np.hstack(table))
        ends = np.cumsum([self.dim, self.dim, 1, 1])[:-1]
        names = ("traction", "jump", "gap", "status")
        self.snapshots.append(
            {
                "displacement": np.vstack(moved),
                **dict(zip(names, np.split(joined, ends, axis=1), strict=True)),
                "energy": np.array(energies),
            }
        )

    def _middles(self, count):
        """Mean centre of the facets around each local point: tells twins at a crossing apart."""
        operator = self.model.operator
        pairs = self.model.jointed.pairs.gathered(operator.comm)
        number = whole_layout(operator.comm, operator.layout).number
        total = np.zeros((number.max() + 1, self.dim))
        np.add.at(total, number, pairs.nodes.mean(axis=1)[:, None] @ self.turn)
        middles = total / np.bincount(number.ravel())[:, None]
        start = operator.matrix.getOwnershipRange()[0] // 3
        return middles[start : start + count]


def ordered(comm, keys, values):
    """Values of all ranks, sorted by their keys (collective)."""
    keys, values = (np.vstack(comm.allgather(a)) for a in (keys, values))
    order = np.lexsort(np.round(keys, 6).T + 0.0)
    return values[order]


def path(*values):
    """A load factor that is linear between the times 0, 1, 2, ..."""
    return lambda time: float(np.interp(time, np.arange(len(values)), values))


# Pressed, sheared until it slides, pulled open, pressed and sheared the other way.
PRESS = path(0.0, 4.0, 4.0, -3.0, 3.0, 5.0)
SHEAR = path(0.0, 0.3, 4.5, 0.5, -1.0, -3.0)
SIDE = path(0.0, 2.0, 0.3, -1.0, 1.5, 2.5)


def pushed(case, view, comm, friction=30.0):
    """The quasi-static scene, two steps per unit of time."""
    scene = Scene(case, view, comm, friction=friction)
    run = dj.Simulation(scene.model, options=NEWTON)
    for time in np.arange(1, 11) / 2:
        state = run.quasi_statics([time])
        scene.take(state.displacement, state.joints)
    return scene.snapshots


def shaken(case, view, comm, solver="auto"):
    """Self weight, then 20 steps in which the blocks are thrown up and strike."""
    scene = Scene(case, view, comm)

    def take(record):
        e = record.energy
        energies = (e.kinetic, e.strain, e.joint, e.input, e.viscous, e.friction)
        scene.take(record.displacement, record.joints, energies)

    run = dj.Simulation(scene.model, options=NEWTON, monitors=[Rows(take)], solver=solver)
    run.statics()

    def ground(time):
        return scene.vector(
            40.0 * np.sin(90.0 * time), 25.0 * np.sin(70.0 * time), -120.0 * np.sin(120.0 * time)
        )

    run.dynamics(dt=0.003, steps=20, motion=ground)
    return scene.snapshots


CASES = [
    Case("quadrilateral", 1, "nodal"),
    Case("triangle", 2, "gauss"),
    Case("hexahedron", 1, "nodal"),
    Case("hexahedron", 2, "gauss"),
    Case("tetrahedron", 1, "nodal"),
    Case("tetrahedron", 2, "gauss"),
]
# What changes; with several ranks the number of ranks changes as well.
CHANGES = {
    "everything": lambda dim: View(turn=orthogonal(dim, 4), numbering=5, exchanged=True),
    "turned": lambda dim: View(turn=orthogonal(dim, 1)),
    "upside down": lambda dim: View(turn=-np.eye(dim)),  # exchanges the sides by the rule
    "mirrored": lambda dim: View(turn=orthogonal(dim, 2, mirrored=True)),
    "renumbered": lambda dim: View(numbering=3),
    "sides exchanged": lambda dim: View(exchanged=True),
}
if COMM.size > 1:
    CHANGES = {"nothing else": lambda dim: PLAIN, "everything": CHANGES["everything"]}
# The larger models see one change at a time in the slow set only.
PAIRS = [
    pytest.param(
        case,
        change,
        id=f"{case.cell}-{case.degree}-{case.rule}-{change}",
        marks=[pytest.mark.slow]
        if case.dim + case.degree == 5 and change not in ("everything", "nothing else")
        else [],
    )
    for case in CASES
    for change in CHANGES
]


@cache
def plain(scene, case):
    """The run to compare with, on one rank."""
    return scene(case, PLAIN, MPI.COMM_SELF)


def differences(found, expected):
    """Largest difference of each quantity relative to its largest value in the run."""
    return {
        name: max(np.abs(a[name] - b[name]).max() for a, b in zip(found, expected, strict=True))
        / max(np.abs(row[name]).max() for row in expected)
        for name in expected[0]
        if expected[0][name].size
    }


def statuses(snapshots):
    """Status of every point in every step, shape (steps, points)."""
    return np.array([row["status"][:, 0] for row in snapshots])


@pytest.mark.parametrize(("case", "change"), PAIRS)
@pytest.mark.parametrize("scene", [pushed, shaken])
def test_objective(scene, case, change):
    expected = plain(scene, case)
    found = differences(scene(case, CHANGES[change](case.dim), COMM), expected)
    assert found.pop("status") == 0.0
    assert max(found.values()) < TOLERANCE, found


@pytest.mark.parametrize("case", CASES[2:4], ids=str)
def test_both_solvers(case):
    """The condensed solver takes one tangential compliance for s1 and s2, whatever these are."""
    view = CHANGES["everything"](case.dim)
    found = differences(shaken(case, view, COMM, "monolithic"), plain(shaken, case))
    assert found.pop("status") == 0.0
    assert max(found.values()) < TOLERANCE, found


@pytest.mark.parametrize("case", CASES, ids=str)
def test_scenes_hold_what_they_should(case):
    """All states; points that close again, slide on, and are thrown up and strike."""
    for scene in (pushed, shaken):
        status = statuses(plain(scene, case))
        assert set(np.unique(status)) == {Status.OPEN, Status.STICK, Status.SLIP}
        opened = np.cumsum(status == Status.OPEN, axis=0) > 0
        assert np.any(opened & (status != Status.OPEN))
        kept = (status[1:] == Status.SLIP) & (status[:-1] != Status.OPEN)
        assert kept.any()
    struck = (status[1:] != Status.OPEN) & (status[:-1] == Status.OPEN)
    assert struck[1:].any()


def test_a_real_difference_is_seen():
    """One part in 1e8 of the friction angle is more than the tolerance."""
    case = CASES[2]
    other = pushed(case, PLAIN, COMM, friction=30.0 * (1 + 1e-8))
    found = differences(other, plain(pushed, case))
    assert found["displacement"] > 10 * TOLERANCE
    assert found["traction"] > 10 * TOLERANCE


def test_local_axes_do_change():
    """joint_1 is near the horizontal, where s1 follows x; turned, it is not."""
    frames = []
    for view in (PLAIN, CHANGES["everything"](3)):
        scene = Scene(CASES[2], view, MPI.COMM_SELF)
        first = scene.model.operator.frames[scene.model.operator.joint == 0][0]
        frames.append(first @ scene.turn)
    angle = np.arccos(np.clip(abs(frames[0][1] @ frames[1][1]), 0.0, 1.0))
    assert np.degrees(angle) > 5.0
