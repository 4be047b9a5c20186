# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thresholds of the solvers: each is used, and a test or a page shows why it is there.

Where no other test does, a small scene is solved with a threshold and without it.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from plates import compressed, kernel, plates

from benchmarks.rigid_friction import rigid, run
from benchmarks.shared.problems import blocks
from dolfinx_joints import FrictionNoTension, MatrixSystem
from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.laws.law import JointState
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.effective_matrix import STATIC, MatrixCoefficients
from dolfinx_joints.solvers.interface import solver as interface
from dolfinx_joints.solvers.interface.corrections import CompiledCorrections
from dolfinx_joints.solvers.newton import NewtonSolver

PROJECT = Path(__file__).parents[2]
SOLVERS = PROJECT / "dolfinx_joints/solvers"
TESTS, VERIFICATION = "tests/solvers/", "tests/verification/"
STEP = "docs/theory/solvers.md"
CONDENSED, STATICS, PATH = (
    f"{STEP}#62-condensed-onto-the-joints",
    f"{STEP}#63-statics",
    f"{STEP}#64-which-path",
)
KEPT = "docs/decisions/two_solvers.md#stored-matrices"
ITERATION = "docs/decisions/kernels.md#the-iteration-on-the-joints"
DIRECT = "docs/decisions/direct_solvers.md#direct-solvers"
JOINTED = "docs/decisions/multigrid.md#jointed-steps"
HERE = f"{TESTS}test_limits.py::"

# For each threshold a test, or a section of a page and words of it.
REASONS: dict[str, str] = {
    "EPSILON": f"{TESTS}test_direct.py::test_what_rounding_of_a_product_leaves_is_accepted",
    "PRODUCT_ROUNDING": f"{HERE}test_stiff_joints_end_at_rounding",
    "GAP_ROUNDING": f"{HERE}test_points_that_touch_take_fewer_iterations",
    "SINGLE_ROUNDING": f"{TESTS}test_gmres.py::test_what_a_matrix_makes_zero_cannot_be_had",
    "LARGEST_ROUNDING": f"{HERE}test_stiff_joints_end_at_rounding",
    "LARGEST_CONTACT_ROUNDING": f"{HERE}test_points_that_touch_take_fewer_iterations",
    "LARGEST_SPRING_ROUNDING": f"{STATICS} large spring forces (`LARGEST_SPRING_ROUNDING`)",
    "BALANCED": f"{STATICS} would move blocks that can rest anywhere (`BALANCED`)",
    "SINGULAR_GROWTH": f"{STEP}#61-monolithic pivots that are rounding errors (`SINGULAR_GROWTH`)",
    "FACTOR_RESIDUAL": f"{TESTS}test_direct.py::test_free_bodies_are_refused",
    "SUPPORTED_RESIDUAL": f"{VERIFICATION}test_loose_blocks.py::test_a_column_of_loose_blocks",
    "PATIENCE": f"{TESTS}test_newton.py::test_whole_corrections_leave_a_residual_that_hardly_falls",
    "LEAST_FALL": f"{STEP}#61-monolithic hardly falls in several iterations (`LEAST_FALL`)",
    "WHOLE_CORRECTIONS": f"{STEP}#61-monolithic corrections are taken whole (`WHOLE_CORRECTIONS`)",
    "BODY_FORCING": f"{STEP}#61-monolithic may leave `BODY_FORCING` of the residual, because",
    "JOINT_FORCING": f"{CONDENSED} costs iterations, a smaller one products (`JOINT_FORCING`)",
    "STATIC_FORCING": f"{STATICS} few solves, so corrections are tighter (`STATIC_FORCING`)",
    "FORCING_MARGIN": f"{STEP}#61-monolithic aims below `FORCING_MARGIN` of the accepted",
    "POLISH": f"{TESTS}test_newton.py::test_a_step_ends_at_rounding",
    "END_OF_STEPS": f"{CONDENSED} the energy balance depends on the residual (`END_OF_STEPS`)",
    "END_OF_STATICS": f"{CONDENSED} statics continue to rounding error (`END_OF_STATICS`)",
    "STALLED": f"{CONDENSED} a correction no longer halves the residual (`STALLED`)",
    "CONVERGED_ENTRIES": f"{ITERATION} takes 2.3 instead of 2.5 ms",
    "STALE": f"{CONDENSED} large compared with the residual (`STALE`)",
    "STALE_NEXT": f"{CONDENSED} with the residual expected next (`STALE_NEXT`)",
    "NEGLIGIBLE": f"{CONDENSED} cannot affect the end of the iteration is ignored (`NEGLIGIBLE`)",
    "REGULARISATIONS": (
        f"{VERIFICATION}test_static_paths.py::test_a_block_without_friction_does_not_drift"
    ),
    "SETTLED": f"{VERIFICATION}test_loose_blocks.py::test_rounding_holds_no_block",
    "REFINEMENTS": rf"{STATICS} repeated from the gaps of the computed $\mathbf x$ (`REFINEMENTS`)",
    "ON_LINE": f"{HERE}test_loads_in_proportion_take_few_iterations",
    "SPRING_COMPLIANCE": f"{STATICS} gives the same solution (`SPRING_COMPLIANCE`)",
    "SOFTENING_COMPLIANCE": (
        f"{VERIFICATION}test_cohesive_joints.py::test_softening_too_steep_for_the_cells_is_refused"
    ),
    "SPRING_REGULARISATION": (
        f"{VERIFICATION}test_static_paths.py::test_a_block_without_friction_does_not_drift"
    ),
    "RIGID_DAMPING": f"{CONDENSED} corrections from following rounding errors (`RIGID_DAMPING`)",
    "RIGID_OPENING": f"{CONDENSED} other points in all later steps (`RIGID_OPENING`)",
    "CONTROLLABLE": "tests/simulation/test_controlled_statics.py::test_bad_input",
    "PSEUDO_FIRST": f"{PATH} so that few points change at a time (`PSEUDO_FIRST`)",
    "PSEUDO_LAST": f"{PATH} the increment fails at the longest step (`PSEUDO_LAST`)",
    "PSEUDO_FALL": "docs/decisions/two_solvers.md#statics falling to 0.03 or 0.3 a step",
    "PSEUDO_STEPS": f"{PATH} after too many steps (`PSEUDO_STEPS`)",
    "PSEUDO_SETTLED": rf"{PATH} in a step that hardly changes $\mathbf x$ (`PSEUDO_SETTLED`)",
    "MOST_PRODUCTS": f"{TESTS}test_gmres.py::test_what_is_spent_buys_the_best_of_the_space",
    "TYPICAL_PRODUCTS": f"{ITERATION} took 14 and 11 products",
    "FINEST_SINGLE": f"{CONDENSED} are in single precision (`FINEST_SINGLE`)",
    "FINEST_COMPRESSED": rf"{CONDENSED} with a compressed $\mathbf S$ (`FINEST_COMPRESSED`)",
    "ORTHOGONAL_REST": f"{TESTS}test_gmres.py::test_directions_stay_orthogonal",
    "SAME_TANGENT": f"{HERE}test_rounding_leaves_a_point_sticking",
    "COMPLEMENT_COST": f"{TESTS}test_corrections.py::test_the_complement_is_made_once_it_pays",
    "COMPLEMENT_PIVOT": f"{CONDENSED} would amplify errors and is not used (`COMPLEMENT_PIVOT`)",
    "NONZERO_SHARE": f"{ITERATION} three rows of the lower triangle at a time",
    "SET_EXCESS": f"{ITERATION} at most 1.4 times as many points as needed",
    "SET_SPARE": f"{TESTS}test_corrections.py::test_what_is_kept_between_solves_does_not_matter",
    "LARGEST_DENSE": f"{KEPT} dense up to 2000 joint unknowns",
    "LARGEST_WHOLE": f"{KEPT} up to 6000 unknowns, not matrix-free",
    "SMALLEST_AT_ONCE": f"{KEPT} S of 300 to 6000 unknowns is computed",
    "AT_ONCE_ERROR": f"{DIRECT} differences of 3e-15 of the largest",
    "SAMPLES": f"{DIRECT} Eight columns are therefore compared",
    "BLOCK_COLUMNS": f"{DIRECT} blocks of 64 columns",
    "STATIC_SOLVE_COLUMNS": f"{TESTS}test_newton.py::test_few_static_solves_keep_no_compliance",
    "COMPRESSION": f"{KEPT} to 1e-12 above",
    "ROUGH_COMPRESSION": f"{KEPT} an approximate S, to 1e-4 in single precision",
    "CLUSTER_POINTS": "docs/decisions/low_rank.md#low-rank-compliances at most 96 points",
    "ADMISSIBLE_SIZE": f"{HERE}test_blocks_of_low_rank_save_memory",
    "LOW_RANK_SHARE": f"{HERE}test_blocks_of_low_rank_save_memory",
    "STORE_GROWTH": f"{TESTS}test_own_blocks.py::test_no_memory_for_what_is_zero",
    "KEPT_BYTES": f"{KEPT} as many as dense matrices would fit into 2 GB",
    "FEWEST_KEPT": f"{TESTS}test_tangent_multigrid.py::test_matrices_of_two_time_steps_are_kept",
    "TANGENTS_KEPT": f"{KEPT} so step lengths are few",
    "MOST_KEPT": f"{KEPT} the last 2 to 8 step lengths",
    "NODE_BLOCK_COLUMN": f"{DIRECT} columns have at most 150 entries on average",
    "NODE_BLOCK_ROWS": f"{DIRECT} at most 25 000 rows",
    "MULTIGRID_TOLERANCE": "docs/decisions/multigrid.md#multigrid stop at 1e-13",
    "STEP_TOLERANCE": "docs/decisions/multigrid.md#linear-steps `STEP_TOLERANCE` is 1e-9",
    "STIFF_AT_NODES": f"{TESTS}test_tangent_multigrid.py::test_stiff_joints_are_condensed",
    "STIFF_ELSEWHERE": f"{JOINTED} beyond a ratio of 10",
    "TIED_STIFFNESS": f"{JOINTED} more than five times the diagonal of A",
    "CUT_REGULARISATION": (
        f"{TESTS}test_tangent_multigrid.py::"
        "test_iterations_hardly_grow_with_the_stiffness_of_the_joint"
    ),
}


def names() -> list[str]:
    return [name for name in vars(limits) if name.isupper()]


def slug(heading: str) -> str:
    words = re.sub(r"[^\w\s-]", "", heading.lower()).strip()
    return re.sub(r"\s+", "-", words)


def section(page: str, anchor: str) -> str:
    """Text below a heading, up to the next one of its level; an error without the heading."""
    parts = re.split(r"^(#+) (.*)$", (PROJECT / page).read_text(), flags=re.MULTILINE)
    texts = {slug(parts[i + 1]): parts[i + 2] for i in range(1, len(parts), 3)}
    return texts[anchor]


def test_thresholds_are_positive_numbers_that_solvers_use():
    code = "\n".join(path.read_text() for path in SOLVERS.rglob("*.py"))
    for name in names():
        assert re.search(rf"\blimits\.{name}\b", code), name
        value = getattr(limits, name)
        numbers = value if isinstance(value, tuple) else (value,)
        assert all(type(number) in (int, float) and number >= 0 for number in numbers), name
        assert max(numbers) > 0, name


def test_each_threshold_has_a_reason():
    assert list(REASONS) == names()
    for name, reason in REASONS.items():
        if reason.startswith("tests/"):
            file, test = reason.split("::")
            assert f"def {test}(" in (PROJECT / file).read_text(), name
        else:
            place, words = reason.split(" ", 1)
            assert words in section(*place.split("#")), name


def test_no_threshold_is_elsewhere():
    # Other numbers with a point or an exponent are exact: halves, the nine entries of a block.
    exact = {0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 8.0, 9.0}
    options = {"relative_tolerance"}  # of the user
    for path in sorted(SOLVERS.rglob("*.py")):
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.AnnAssign) and getattr(node.target, "id", "") in options:
                node.value = None
        found = {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)}
        numbers = {value for value in found if isinstance(value, float)} - exact
        assert path.name == "limits.py" or not numbers, (path, numbers)


def two_masses(ratio: float) -> bool:
    """Whether a step is solved in which two masses on springs of 1 N/m move 1 m as one.

    The force of the joint between them is a third of theirs; its stiffness is ``ratio`` N/m.
    """
    law = FrictionNoTension(normal_stiffness=ratio, shear_stiffness=0.0, friction_angle_deg=0.0)
    gap = [[-1.0, 1.0], [0.0, 0.0], [0.0, 0.0]]
    system = MatrixSystem.from_arrays(mass=np.eye(2), stiffness=np.eye(2), gap=gap, law=law)
    b, x = system.stiffness.createVecLeft(), system.stiffness.createVecRight()
    b.setArray([4.0 / 3.0, 2.0 / 3.0])
    state = JointState.at_rest(system.contact.operator.jump(x))
    try:
        coefficients = MatrixCoefficients(mass=1e-3, damping=0.0, stiffness=1.0)
        NewtonSolver(system).solve(coefficients, b, x, state)
    except ConvergenceError:
        return False
    return bool(np.abs(x.array - 1.0 / 1.001).max() < 1e-7)


@pytest.mark.parametrize("name", ["LARGEST_ROUNDING", "PRODUCT_ROUNDING"])
def test_stiff_joints_end_at_rounding(monkeypatch, name):
    # The gap is rounded to 1e-16 m, forces of 1e8 N/m times that: 1e-8 of them, above 1e-10.
    assert two_masses(1e8)
    monkeypatch.setattr(limits, name, 0.0)
    assert not two_masses(1e8)


def iterations_of(monkeypatch, solve) -> int:
    """Newton iterations of the condensed solver in a run."""
    counts, newton = [], interface.newton

    def counted(*arguments):
        at, norms = newton(*arguments)
        counts.append(len(norms) - 1)
        return at, norms

    with monkeypatch.context() as patch:
        patch.setattr(interface, "newton", counted)
        solve()
    return sum(counts)


@pytest.mark.parametrize("name", ["LARGEST_CONTACT_ROUNDING", "GAP_ROUNDING"])
def test_points_that_touch_take_fewer_iterations(monkeypatch, name):
    # A block falls through a gap of 0.1 mm in 50 steps, to rounding: forces are rounding then.
    def fall():
        run(blocks(end=5.2e-4, law=rigid(1), massless=False), 1e-5)

    few = iterations_of(monkeypatch, fall)
    monkeypatch.setattr(limits, name, 1e-6 if name == "LARGEST_CONTACT_ROUNDING" else 0.0)
    assert iterations_of(monkeypatch, fall) >= 1.3 * few


def test_loads_in_proportion_take_few_iterations(monkeypatch):
    # Four points that stick or slide at a body of twelve dofs, its load in ten parts: in
    # proportion all forces are, and the third solve begins with its solution.
    def load():
        rng, size = np.random.default_rng(1), 12
        stiffness = rng.normal(size=(size, size))
        stiffness = stiffness @ stiffness.T / size + np.eye(size)
        whole = rng.normal(size=size)
        whole[::3] = -3.0
        law = FrictionNoTension(
            normal_stiffness=10.0, shear_stiffness=10.0, friction_angle_deg=30.0
        )
        system = MatrixSystem.from_arrays(
            mass=np.eye(size), stiffness=stiffness, gap=np.eye(size), law=law
        )
        solver = interface.InterfaceSolver(system)
        b, x = system.stiffness.createVecLeft(), system.stiffness.createVecRight()
        state, moved = JointState.at_rest(np.zeros((size // 3, 3))), np.zeros(size)
        for share in np.linspace(0.1, 1.0, 10):
            b.setArray(share * whole - stiffness @ moved)
            x.set(0.0)
            response, _ = solver.solve(STATIC, b, x, state)
            moved, state, solver.carried = moved + x.array, response.state, response.traction

    few = iterations_of(monkeypatch, load)
    monkeypatch.setattr(limits, "ON_LINE", 0.0)
    assert iterations_of(monkeypatch, load) >= 3 * few


def test_rounding_leaves_a_point_sticking(monkeypatch):
    # Pressed together, all points stick. Laws and T0 have their tangent from different products.
    found, solve, rng = [], CompiledCorrections.solve, np.random.default_rng(1)

    def watched(self, residual, tangent, *arguments, **options):
        stuck = self._stuck[:, :, None] * np.eye(3)
        found.append(np.abs(tangent - stuck).max())
        return solve(self, residual, tangent, *arguments, **options)

    monkeypatch.setattr(CompiledCorrections, "solve", watched)
    law = FrictionNoTension(normal_stiffness=7.0, shear_stiffness=3.0, friction_angle_deg=30.0)
    stiffness = rng.normal(size=(12, 12))
    stiffness = stiffness @ stiffness.T / 12 + np.eye(12)
    system = MatrixSystem.from_arrays(mass=np.eye(12), stiffness=stiffness, gap=np.eye(12), law=law)
    b, x = system.stiffness.createVecLeft(), system.stiffness.createVecRight()
    b.setArray(np.tile([-9.0, 0.1, 0.2], 4))
    state = JointState.at_rest(np.zeros((4, 3)))
    coefficients = MatrixCoefficients(mass=1.0, damping=0.0, stiffness=1.0)
    _, report = interface.InterfaceSolver(system).solve(coefficients, b, x, state)
    assert report.counts.stick == 4
    assert 0.0 < found[-1] <= limits.SAME_TANGENT


@pytest.mark.parametrize(
    ("name", "value", "tolerance", "factor"),
    [
        ("ADMISSIBLE_SIZE", 0.5, 1e-4, 1.5),
        ("LOW_RANK_SHARE", 0.5, 1e-12, 1.03),
        ("LOW_RANK_SHARE", 1.0, 1e-12, 1.03),
    ],
)
def test_blocks_of_low_rank_save_memory(monkeypatch, name, value, tolerance, factor):
    points, joint = plates(28, joints=1)
    matrix, sizes = kernel(points, joint), []
    for _ in range(2):
        sizes.append(compressed(matrix, points, tolerance=tolerance).nbytes)
        monkeypatch.setattr(limits, name, value)
    assert sizes[1] > factor * sizes[0]
