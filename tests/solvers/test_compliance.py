# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliances of joint points: each kind against the definition, G = B A^-1 B^T."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from whole_vectors import Whole, all_of

import dolfinx_joints as dj
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.compliance import Compliance
from dolfinx_joints.solvers.compliance.row_matrix import RowMatrix
from dolfinx_joints.solvers.compliance.unit_forces import CONTROLS, UnitForces, schur_complement
from dolfinx_joints.solvers.effective_matrix import (
    STATIC,
    EffectiveMatrix,
    MatrixCoefficients,
    unconstrained_dofs,
)

pytestmark = pytest.mark.mpi

STEP = MatrixCoefficients(
    mass=8e4, damping=200.0, stiffness=0.5
)  # of 0.01 s by average acceleration
KINDS = ("dense", "compressed", "matrix-free")


class Scene:
    """A model, its constrained B and its bulk."""

    def __init__(self, model: Any, effective: MatrixCoefficients, linear: str = "direct") -> None:
        self.system = model.system()
        self.joints = self.system.contact.operator
        self.operator = self.joints.constrained(unconstrained_dofs(self.system))
        self.bulk = EffectiveMatrix(self.system, effective, linear=linear)
        self.size = self.operator.getSize()[0]
        self.comm = self.operator.comm.tompi4py()

    def compliance(self, kind: str, **options: Any) -> Compliance:
        return Compliance(self.bulk, self.operator, self.joints, kind=kind, **options)

    def gaps(self, force: np.ndarray) -> np.ndarray:
        """G F of all points by the definition."""
        points, nodal = self.operator.createVecs()[::-1]
        moved = nodal.duplicate()
        points.setArray(force[slice(*self.operator.getOwnershipRange())])
        self.operator.multTranspose(points, nodal)
        self.bulk.solver.solve(nodal, moved)
        self.operator.mult(moved, points)
        return self.all_of(points.getArray().copy())

    def by_split(self, found: Compliance, force: np.ndarray) -> np.ndarray:
        """G F from S: in f = s F and g / s, G is I + S."""
        dead, scale = self.all_of(found.dead.ravel()), self.all_of(found.scale)
        f = scale * force
        return np.where(dead, 0.0, scale * (f + self.product(found.split, f)))

    def check(self, found: Compliance, loads: Sequence[np.ndarray] = ()) -> None:
        """Compare G F from S with the definition, for all points loaded unless given."""
        for force in loads or forces(self.size)[:1]:
            expected = self.gaps(force)
            atol = 1e-10 * np.abs(expected).max()
            np.testing.assert_allclose(self.by_split(found, force), expected, rtol=0, atol=atol)

    def product(self, split: Any, values: np.ndarray) -> np.ndarray:
        return Whole(split, self.comm).product(values)

    def all_of(self, part: np.ndarray) -> np.ndarray:
        return all_of(self.comm, part)


def forces(size: int, number: int = 3) -> list[np.ndarray]:
    """All points loaded, one of them, and a few."""
    rng = np.random.default_rng(1)
    every, one, few = rng.normal(size=size), np.zeros(size), np.zeros(size)
    one[size // 2], few[rng.permutation(size)[:9]] = 1.0, 1.0
    return [1e6 * every, one, few][:number]


def model(
    jointed: Any, *, held: Sequence[str] = ("base",), quadrature: str = "auto", **changes: Any
) -> Any:
    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
    return dj.Model(
        jointed,
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        joints=dj.Joints(law, quadrature=quadrature),
        supports=[dj.Fixed(group=group) for group in held],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
        **changes,
    )


@pytest.fixture
def scene(read, wall_file, blocks_file, two_rectangles_file) -> Callable[..., Scene]:
    """A wall whose lowest joint points are clamped, inclined blocks, or a plane; by name."""
    files = {
        "wall": lambda: wall_file(divisions=(8, 3, 6)),
        "blocks": lambda: blocks_file(size=0.125),
        "plane": lambda: two_rectangles_file(divisions=12),
        "tetrahedra": lambda: blocks_file(cell="tet"),
    }

    def make(
        name: str, effective: MatrixCoefficients = STEP, *, on: Any = None, **options: Any
    ) -> Scene:
        linear = options.pop("linear", "direct")
        jointed = read(files[name](), on)
        return Scene(model(jointed, **options), effective, linear)

    return make


SCENES: dict[str, Any] = {
    "wall": ("wall", {}),
    "blocks": ("blocks", {}),
    "plane": ("plane", {}),
    "statics": ("wall", STATIC, {}),
    "higher degree": ("tetrahedra", {"quadrature": "gauss", "body": dj.Body(degree=2)}),
}


@pytest.mark.parametrize(("name", "kind"), [*product(SCENES, KINDS)])
def test_every_kind_is_the_definition(scene, name, kind):
    # What the compressed one leaves out is 1e-12 of the diagonal in each block.
    case = scene(*SCENES[name][:-1], **SCENES[name][-1])
    found = case.compliance(kind)
    assert found.kind == kind
    case.check(found, forces(case.size))


@pytest.mark.parametrize("kind", KINDS)
def test_symmetric_and_positive(scene, kind):
    # x . S y = y . S x; x . (x + S x) is twice an elastic energy.
    case = scene("blocks")
    found = case.compliance(kind)
    rng = np.random.default_rng(3)
    dead = case.all_of(found.dead.ravel())
    x, y = (np.where(dead, 0.0, rng.normal(size=case.size)) for _ in range(2))
    s_x, s_y = (case.product(found.split, v) for v in (x, y))
    size = np.linalg.norm(x) * np.linalg.norm(s_y)
    assert abs(x @ s_y - y @ s_x) <= 1e-12 * size
    assert x @ (x + s_x) > 0.0


@pytest.mark.parametrize("name", ["wall", "blocks", "plane"])
def test_own_compliances(scene, name):
    """Area times the diagonal of G, tangential the mean over the directions that move."""
    case = scene(name)
    found = case.compliance("dense")
    own, areas = case.all_of(found.own), case.all_of(case.joints.areas)
    diagonal = np.zeros((case.size // 3, 3))
    points = np.unique(np.linspace(0, len(diagonal) - 1, 7).astype(int))
    for i, k in product(points, range(3)):
        unit = np.zeros(case.size)
        unit[3 * i + k] = 1.0
        diagonal[i, k] = case.gaps(unit)[3 * i + k]
    moving = 1 if name == "plane" else 2
    expected = areas[:, None] * np.column_stack(
        [diagonal[:, 0], diagonal[:, 1:].sum(axis=1) / moving]
    )
    np.testing.assert_allclose(own[points], expected[points], rtol=1e-10, atol=0)
    assert np.any(expected[points] > 0.0)
    scaled = found.own / case.joints.areas[:, None]
    shown = np.where(found.dead, 1.0, np.repeat(np.sqrt(scaled), (1, 2), axis=1))
    np.testing.assert_allclose(found.scale.reshape(-1, 3), shown, rtol=1e-14)


@pytest.mark.parametrize("kind", ["compressed", "matrix-free"])
@pytest.mark.parametrize("name", ["wall", "blocks", "plane"])
def test_estimated_own_compliances(scene, name, kind):
    # Any will do, but what is far off makes the iteration slow: within a factor of three, where
    # corners are 2.3 times as compliant as their diagonal of A says.
    case = scene(name)
    exact, found = (case.all_of(case.compliance(each).own) for each in ("dense", kind))
    np.testing.assert_array_equal(found > 0.0, exact > 0.0)
    ratio = found[exact > 0.0] / exact[exact > 0.0]
    assert ratio.min() > 1.0 / 3.0
    assert ratio.max() < 3.0


@pytest.mark.parametrize("kind", KINDS)
def test_dead_directions(scene, kind):
    """The third in a plane; all of the points on a clamped base; nothing couples to them."""
    case = scene("plane")
    found = case.compliance(kind)
    np.testing.assert_array_equal(found.dead, np.tile([False, False, True], (len(found.dead), 1)))
    wall = scene("wall")
    clamped = wall.compliance(kind)
    heights = wall.all_of(wall.joints.points)[:, 2]
    lowest = heights < heights.min() + 1e-9
    np.testing.assert_array_equal(wall.all_of(clamped.dead), np.tile(lowest[:, None], (1, 3)))
    assert 0 < np.count_nonzero(lowest) < len(lowest)
    for made, of in ((found, case), (clamped, wall)):
        np.testing.assert_array_equal(made.scale[made.dead.ravel()], 1.0)
        dead = of.all_of(made.dead.ravel())
        every = np.random.default_rng(4).normal(size=of.size)
        assert not of.product(made.split, np.where(dead, every, 0.0)).any()
        assert not of.product(made.split, every)[dead].any()


@pytest.mark.parametrize("kind", KINDS)
def test_all_joint_points_clamped(scene, kind):
    # Both sides of the joint are supports: nothing moves at all.
    case = scene("blocks", held=["joint_1+", "joint_1-"])
    found = case.compliance(kind)
    assert found.dead.all()
    assert not case.product(found.split, np.ones(case.size)).any()


@pytest.mark.parametrize("kind", ["dense", "compressed"])
def test_parts_of_what_is_kept(scene, kind):
    """Products with few values, and the matrix as a whole, are those of S."""
    case = scene("blocks")
    found = case.compliance(kind)
    split = Whole(found.split, case.comm)
    whole = split.matrix()
    np.testing.assert_allclose(found.split.whole(), whole, rtol=0, atol=1e-11)
    np.testing.assert_allclose(whole, whole.T, rtol=0, atol=1e-11)
    rng = np.random.default_rng(5)
    for count in (0, 1, 30, case.size // 3):
        points = np.sort(rng.permutation(case.size // 3)[:count])
        rows = (3 * points[:, None] + np.arange(3)).ravel()
        every = np.zeros(case.size)
        every[rows] = rng.normal(size=len(rows))
        all_rows = split.product(every)
        np.testing.assert_allclose(all_rows, whole @ every, rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", ["dense", "compressed"])
@pytest.mark.parametrize("name", ["wall", "blocks", "plane"])
def test_the_rough_one_is_near(scene, name, kind, monkeypatch):
    # Each block to 1e-4 of the diagonal, and there are some ten of them in a row.
    monkeypatch.setattr(limits, "LARGEST_DENSE", 0)  # with a dense S none is made for so few points
    case = scene(name)
    found = case.compliance(kind)
    x = np.random.default_rng(6).normal(size=case.size)
    fine, rough = (case.product(s, x) for s in (found.split, found.rough))
    difference = np.linalg.norm(rough - fine)
    assert difference <= 1e-3 * np.linalg.norm(x)
    assert difference > 0.0
    assert not rough[case.all_of(found.dead.ravel())].any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["wall", "plane"])
def test_ranks_do_not_matter(scene, name, kind):
    case, alone = scene(name), scene(name, on=MPI.COMM_SELF)
    found, expected = case.compliance(kind), alone.compliance(kind)
    np.testing.assert_array_equal(case.all_of(found.dead), expected.dead)
    np.testing.assert_allclose(case.all_of(found.scale), expected.scale, rtol=1e-9)
    force = forces(case.size)[0]
    gap, reference = case.by_split(found, force), alone.by_split(expected, force)
    np.testing.assert_allclose(gap, reference, rtol=0, atol=1e-10 * np.abs(reference).max())


@pytest.mark.parametrize("kind", KINDS)
def test_the_largest_own_compliance(scene, kind):
    # Half of the mean: points above it are cut, the others stay, and G is what it was.
    case = scene("wall")
    free = case.compliance(kind)
    bound = 0.5 * case.all_of(free.own).mean(axis=0)
    largest = np.tile(bound, (len(case.joints.areas), 1))
    found = case.compliance(kind, largest=largest)
    np.testing.assert_allclose(found.own, np.minimum(free.own, largest), rtol=1e-12)
    case.check(found)


def test_which_kind_auto_takes(scene, monkeypatch):
    case = scene("plane")
    assert case.compliance("auto").kind == "dense"
    assert isinstance(case.compliance("auto").split, RowMatrix)
    assert scene("plane", linear="iterative").compliance("auto").kind == "matrix-free"
    monkeypatch.setattr(limits, "LARGEST_DENSE", case.size - 1)
    assert case.compliance("auto").kind == "compressed"
    monkeypatch.setattr(case.joints, "points", None)
    assert case.compliance("auto").kind == "dense"


def test_free_with_an_iterative_bulk(scene):
    case = scene("wall", linear="iterative")
    found, reference = case.compliance("matrix-free"), scene("wall")
    force = forces(case.size)[0]
    expected = reference.gaps(force)
    size = np.abs(expected).max()
    np.testing.assert_allclose(case.by_split(found, force), expected, rtol=0, atol=1e-9 * size)


MODES = replace(STEP, exact_modes=6)
SHORT = replace(STEP, mass=100.0 * STEP.mass)  # a stiff body: two ways agree to 2e-15


@pytest.mark.parametrize("linear", ["direct", "mumps"])
@pytest.mark.parametrize(
    ("name", "effective"),
    [("wall", STEP), ("wall", MODES), ("wall", STATIC), ("plane", SHORT), ("blocks", STEP)],
)
def test_all_columns_at_once(scene, name, effective, linear):
    """The Schur complement against back-substitutions; 0 where points cannot move."""
    case = scene(name, effective, linear=linear)
    found = UnitForces(case.bulk, case.operator).at_once()
    expected = UnitForces(case.bulk, case.operator).gaps(np.arange(case.size)).T
    assert found is not None
    size = case.comm.allreduce(np.abs(expected).max(initial=0.0), op=MPI.MAX)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)
    dead = case.all_of(case.compliance("dense").dead.ravel())
    assert dead.any() or name == "blocks"
    assert not found[dead].any()
    force = forces(case.size)[0]
    points, nodal = case.operator.createVecs()[::-1]
    points.setArray(force[slice(*case.operator.getOwnershipRange())])
    case.operator.multTranspose(points, nodal)
    moved = nodal.duplicate()
    case.bulk.solve(nodal, moved)
    case.operator.mult(moved, points)
    gap = points.getArray(readonly=True)
    np.testing.assert_allclose(force @ found, gap, rtol=0, atol=1e-10 * np.linalg.norm(gap))


def test_all_columns_in_other_units(scene):
    # Forces in EN make A 1e-18 and G 1e18 times as large: entries of B choose no pivots.
    case = scene("blocks")
    expected = schur_complement(case.bulk.constrained, case.operator)
    case.bulk.constrained.scale(1e-18)
    found = schur_complement(case.bulk.constrained, case.operator)
    size = case.comm.allreduce(np.abs(expected).max(initial=0.0), op=MPI.MAX)
    np.testing.assert_allclose(1e-18 * found, expected, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("kind", ["dense", "compressed"])
def test_columns_one_by_one_after_a_failure(scene, kind, monkeypatch, caplog):
    # MUMPS is given 5 % of the workspace that it estimates.
    case = scene("blocks")
    monkeypatch.setattr(limits, "SMALLEST_AT_ONCE", 1)
    monkeypatch.setitem(CONTROLS, 14, -95)
    caplog.set_level("WARNING", "dolfinx_joints")
    case.check(case.compliance(kind))
    if case.comm.size == 1 or kind == "dense":
        text = "column by column: the bordered matrix could not be factored (MUMPS: "
        assert [text in each for each in caplog.messages] == [True] * (case.comm.rank == 0)


def test_what_is_made_at_once(scene, monkeypatch):
    """Of positive matrices and neither few unknowns nor many; not what is asked to be small."""
    made = []
    monkeypatch.setattr(UnitForces, "at_once", lambda self: made.append(1))
    case = scene("plane")

    def at_once(kind: str, least: int, most: int) -> bool:
        made.clear()
        monkeypatch.setattr(limits, "SMALLEST_AT_ONCE", least)
        monkeypatch.setattr(limits, "LARGEST_WHOLE", most)
        case.compliance(kind)
        return bool(made)

    size = case.size
    assert at_once("dense", size, size)
    assert not at_once("dense", size + 1, size + 1)
    assert not at_once("dense", size - 1, size - 1)
    assert at_once("compressed", size, size) == (case.comm.size == 1)
    assert not at_once("matrix-free", size, size)
    monkeypatch.setattr(case.bulk, "_signs", case.operator.createVecRight())  # waves in water
    assert not at_once("dense", size, size)
    monkeypatch.setattr(case.bulk, "_signs", None)
    monkeypatch.setattr(case.bulk, "symmetric", False)
    assert not at_once("dense", size, size)


def test_a_dense_one_without_a_mesh():
    """Two masses on springs of 3 and 2 N/m in a row, a joint at each.

    K = [[5, -2], [-2, 2]]: det 6, K^-1 = [[1/3, 1/3], [1/3, 5/6]]; areas 1 and 2 m^2.
    """
    law = dj.FrictionNoTension(normal_stiffness=1.0, shear_stiffness=0.0, friction_angle_deg=0.0)
    gap = np.zeros((6, 2))
    gap[0, 0] = gap[3, 1] = 1.0
    system = dj.MatrixSystem.from_arrays(
        mass=np.eye(2), stiffness=[[5.0, -2.0], [-2.0, 2.0]], gap=gap, law=law, areas=[1.0, 2.0]
    )
    operator = system.contact.operator
    found = Compliance(
        EffectiveMatrix(system, STATIC), operator.constrained(unconstrained_dofs(system)), operator
    )
    assert found.kind == "dense"
    assert found.rough is None
    np.testing.assert_allclose(found.own, [[1.0 / 3.0, 0.0], [5.0 / 3.0, 0.0]], rtol=1e-14)
    whole = found.split.whole()
    assert whole[0, 3] == pytest.approx((1.0 / 3.0) / np.sqrt(5.0 / 18.0), rel=1e-14)
    assert np.count_nonzero(np.abs(whole) > 1e-14) == 2
    with pytest.raises(ValueError, match="needs the coordinates of the joint points"):
        Compliance(
            EffectiveMatrix(system, STATIC),
            operator.constrained(unconstrained_dofs(system)),
            operator,
            kind="compressed",
        )
