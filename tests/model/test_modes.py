# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural frequencies against closed forms, joints in series, participation."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("slepc4py")

from petsc4py import PETSc

import dolfinx_joints as dj
from dolfinx_joints.mesh import dolfinx_versions

pytestmark = pytest.mark.mpi

E, RHO, LENGTH, CELLS = 25e9, 2400.0, 8.0, 8
BAR = dj.Elastic(young=E, poisson=0.0, density=RHO)
CELERITY = math.sqrt(E / RHO)
AXIAL = (dj.Fixed(group="base"), dj.Fixed(group="sides", components="xy"))


@pytest.fixture
def column(blocks_file, read):
    """A column of 1 m x 1 m x 8 m with the joint z = 4 m, or without."""

    def make(order=1, joints=None):
        heights = {"lower_height": LENGTH / 2, "upper_height": LENGTH / 2}
        return read(blocks_file(angle=0.0, size=1.0, order=order, **heights), joints=joints)

    return make


def line_matrices(joint=None):
    """K and M of linear bar elements by hand (area 1), the base held; a spring in the middle."""
    number = np.arange(CELLS + 1)
    if joint is not None:
        number[CELLS // 2 + 1 :] += 1
    size = number[-1] + 1
    k, m, h = np.zeros((size, size)), np.zeros((size, size)), LENGTH / CELLS
    for i in range(CELLS):
        ends = [number[i] + (joint is not None and i == CELLS // 2), number[i + 1]]
        k[np.ix_(ends, ends)] += E / h * np.array([[1, -1], [-1, 1]])
        m[np.ix_(ends, ends)] += RHO * h / 6 * np.array([[2, 1], [1, 2]])
    if joint is not None:
        both = [CELLS // 2, CELLS // 2 + 1]
        k[np.ix_(both, both)] += joint * np.array([[1, -1], [-1, 1]])
    return k, m


def line_frequencies(joint=None):
    k, m = (a[1:, 1:] for a in line_matrices(joint))
    return np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(m, k)).real)) / (2 * np.pi)


def test_bar_of_linear_cells(column):
    # A row of linear elements with consistent mass has, in closed form,
    # omega^2 = 6 c^2 / h^2 (1 - cos kh) / (2 + cos kh), k = (2 n - 1) pi / (2 L).
    model = dj.Model(column(joints=[]), material=BAR, supports=AXIAL)
    found = dj.modes(model.system(), 4).frequencies
    h = LENGTH / CELLS
    phase = (2 * np.arange(1, 5) - 1) * np.pi / (2 * LENGTH) * h
    omega = CELERITY / h * np.sqrt(6 * (1 - np.cos(phase)) / (2 + np.cos(phase)))
    np.testing.assert_allclose(found, omega / (2 * np.pi), rtol=1e-9)


def test_bar_of_quadratic_cells(column):
    # (2 n - 1) c / (4 L); quadratic elements of an eighth of the length are within 1e-3.
    model = dj.Model(column(order=2, joints=[]), material=BAR, supports=AXIAL)
    found = dj.modes(model.system(), 3).frequencies
    np.testing.assert_allclose(found, np.array([1, 3, 5]) * CELERITY / (4 * LENGTH), rtol=1e-3)


def test_cantilever(column):
    # Euler and Bernoulli: f = 1.8751^2 / (2 pi L^2) sqrt(E I / (rho A)), once for each axis.
    # Shear and rotary inertia take about 1 % off it at L / h = 8.
    model = dj.Model(column(order=2, joints=[]), material=BAR, supports=[dj.Fixed(group="base")])
    found = dj.modes(model.system(), 2)
    exact = 1.875104**2 / (2 * np.pi * LENGTH**2) * CELERITY * math.sqrt(1 / 12)
    np.testing.assert_allclose(found.frequencies, exact, rtol=0.02)
    assert np.all(found.frequencies < exact)
    # A cantilever's first mode takes 61.3 % of its mass (shape function integral 0.7830).
    share = np.sum(found.participation**2, axis=0) / (RHO * LENGTH)
    np.testing.assert_allclose(share[:2], 0.613, atol=0.02)
    assert share[2] <= 1e-6


@pytest.mark.parametrize("stiffness", [1e9, 1e10, 1e12, 1e14])
def test_joint_in_series_softens(column, stiffness):
    # Reference: linear bar elements by hand with a spring of k_n times 1 m^2 in the middle.
    law = dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=30.0
    )
    model = dj.Model(column(), material=BAR, supports=AXIAL, joints=law)
    found = dj.modes(model.system(), 3).frequencies
    np.testing.assert_allclose(found, line_frequencies(stiffness)[:3], rtol=1e-8)
    assert found[0] < line_frequencies()[0]


def test_equal_parts_have_each_mode_as_often_as_they_are():
    # Four bars of 30 linear elements of length 1, E = rho = 1, held at one end: modes sin(j theta),
    # omega^2 = 6 (1 - cos theta) / (2 + cos theta), theta = (i - 1/2) pi / 30 (Strang and Fix).
    cells, copies = 30, 4
    k = 2.0 * np.eye(cells) - np.eye(cells, k=1) - np.eye(cells, k=-1)
    m = 4.0 * np.eye(cells) + np.eye(cells, k=1) + np.eye(cells, k=-1)
    k[-1, -1], m[-1, -1] = 1.0, 2.0
    system = dj.MatrixSystem.from_arrays(
        mass=np.kron(np.eye(copies), m / 6.0), stiffness=np.kron(np.eye(copies), k)
    )
    cosine = np.cos((np.arange(cells) + 0.5) * np.pi / cells)
    one = np.sqrt(6.0 * (1.0 - cosine) / (2.0 + cosine)) / (2.0 * np.pi)
    for asked in range(1, 25):
        found = dj.modes(system, asked)
        np.testing.assert_allclose(found.frequencies, np.repeat(one, copies)[:asked], rtol=1e-8)
        for i, shape in enumerate(found.shapes):
            products = [shape.dot(system.mass * other) for other in found.shapes]
            np.testing.assert_allclose(products, np.eye(asked)[i], atol=1e-8)


def test_shapes_are_normalised_and_participation_adds_up(column, comm):
    # All modes of the 4 nodes on each of 8 levels, shearing ones included: the sum of squares is
    # f . M^-1 f with f = M 1 at the free dofs, which is the mass without the part that moves with
    # the base; from the matrices by hand.
    model = dj.Model(column(joints=[]), material=BAR, supports=AXIAL)
    system = model.system()
    found = dj.modes(system, 4 * CELLS)
    _, m = line_matrices()
    force = m.sum(axis=1)[1:]
    total = force @ np.linalg.solve(m[1:, 1:], force)
    sums = np.sum(found.participation**2, axis=0)
    assert sums[2] == pytest.approx(total, rel=1e-8)
    assert np.abs(sums[:2]).max() <= 1e-12 * total
    assert 0.9 * RHO * LENGTH < total < RHO * LENGTH
    work = found.shapes[0].duplicate()
    for i, one in enumerate(found.shapes):
        system.mass.mult(one, work)
        for j, two in enumerate(found.shapes):
            assert two.dot(work) == pytest.approx(float(i == j), abs=1e-8)
        held = np.abs(one.getArray(readonly=True)[system.constrained]).max(initial=0.0)
        assert comm.allreduce(held) <= 1e-12


def test_asking_for_what_is_not_there(column):
    system = dj.Model(column(joints=[]), material=BAR, supports=AXIAL).system()
    with pytest.raises(ValueError, match=f"the system has {4 * CELLS} modes"):
        dj.modes(system, 4 * CELLS + 1)


def test_a_body_without_stiffness_has_no_modes():
    system = dj.MatrixSystem.from_arrays(mass=np.eye(2), stiffness=np.zeros((2, 2)))
    with pytest.raises(dj.JointsError, match="The modes could not be computed: the stiffness"):
        dj.modes(system, 1)


def test_other_errors_than_petscs_are_not_taken_for_its_own():
    hidden, other = SystemError("a result with an exception set"), SystemError("no room")
    hidden.__cause__ = PETSc.Error(76)
    assert dolfinx_versions.petsc_code(hidden) == dolfinx_versions.petsc_code(PETSc.Error(76)) == 76
    with pytest.raises(SystemError, match="no room"):
        dolfinx_versions.petsc_code(other)


def test_effective_masses_of_a_body_on_springs_are_its_mass(column):
    # No dof is held, so all modes together take all of the mass, in every direction: 4 nodes on
    # each of 9 levels, 108 unknowns.
    springs = [dj.Spring(group="base", normal_stiffness=1e9, tangential_stiffness=1e9)]
    model = dj.Model(column(joints=[]), material=BAR, supports=springs)
    found = dj.modes(model.system(), model.num_dofs)
    np.testing.assert_allclose(found.mass, RHO * LENGTH, rtol=1e-12)
    np.testing.assert_allclose(found.effective_mass.sum(axis=0), RHO * LENGTH, rtol=1e-8)
    np.testing.assert_allclose(found.effective_share.sum(axis=0), 1.0, rtol=1e-8)
    last = found.report().splitlines()[-1]
    assert last == "all             100.0 %  100.0 %  100.0 %"


def test_modes_in_a_file(column, comm, new_path):
    # Shapes at the nodes have unit modal mass by the mass matrix of linear bars by hand.
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=30.0)
    model = dj.Model(column(), material=BAR, supports=AXIAL, joints=law)
    found, path, tables = dj.modes(model.system(), 3), new_path("modes.h5"), new_path("tables")
    dj.write_modes(found, model, path)
    if comm.rank == 0:
        with dj.Results(path) as results:
            assert results.complete
            nodes, shape = results.static("mesh/nodes"), results.static("modes/shape")
            assert shape.shape == (3, len(nodes), 3)
            assert results.static("modes/frequency").tolist() == found.frequencies.tolist()
            written = dj.write_csv(results, tables)[0].read_text().splitlines()
        assert written[0].split(",")[:3] == [
            "mode [-]",
            "frequency [Hz]",
            "participation x [kg^1/2]",
        ]
        numbers = [float(value) for value in written[2].split(",")]
        assert numbers[:2] == [2.0, found.frequencies[1]]
        assert numbers[2:5] == found.participation[1].tolist()
        assert numbers[5:8] == found.effective_mass[1].tolist()
        # All four nodes of a level move alike along z: a level's mean is its motion, and nodes are
        # in the order of the mesh file, where the two of the joint are told apart by their motion.
        _, m = line_matrices(1e10)
        for mode in shape[:, :, 2]:
            at = {z: np.unique(np.round(mode[np.isclose(nodes[:, 2], z)], 9)) for z in range(9)}
            assert [len(values) for values in at.values()] == [1, 1, 1, 1, 2, 1, 1, 1, 1]
            moved = np.concatenate(list(at.values()))
            swapped = moved[[0, 1, 2, 3, 5, 4, 6, 7, 8, 9]]
            assert min(abs(v @ m @ v - 1.0) for v in (moved, swapped)) < 1e-6
    with pytest.raises(Exception, match="exists") as failure:
        dj.write_modes(found, model, path)
    assert len(set(comm.allgather(str(failure.value)))) == 1
    other = dj.Model(column(joints=[]), material=BAR, supports=AXIAL)
    with pytest.raises(ValueError, match="The modes have 120 unknowns, the model has 108"):
        dj.write_modes(found, other, path, overwrite=True)


@pytest.mark.parametrize("supports", [(), (dj.Fixed(group="sides", components="xy"),)])
def test_a_body_that_nothing_holds_is_refused(column, supports):
    # The second may still rise.
    with pytest.raises(dj.JointsError, match="can move without any force"):
        dj.modes(dj.Model(column(joints=[]), material=BAR, supports=list(supports)).system(), 2)


def test_a_block_that_nothing_holds_is_refused(column):
    # The upper half slides on the lower one and turns on it about z.
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=0.0, friction_angle_deg=30.0)
    model = dj.Model(column(), material=BAR, supports=[dj.Fixed(group="base")], joints=law)
    with pytest.raises(dj.JointsError, match="one of its blocks is unsupported"):
        dj.modes(model.system(), 6)
