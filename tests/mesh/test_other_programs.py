# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of Abaqus and Salome: the same body as from Gmsh's own format, and a user's mistakes."""

import itertools
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import gmsh
import ufl
from dolfinx import fem
from med_files import in_vtk_order, med_of, write_med
from networks import network

import dolfinx_joints as dj
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.mesh.reading.gmsh_file import load_msh

pytestmark = pytest.mark.mpi

LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=45.0)
SOLID = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
# Elements, cell, order, and nodes at the edges only.
ELEMENTS = {
    "C3D4": ("tet", 1, False),
    "C3D10": ("tet", 2, False),
    "C3D8": ("hex", 1, False),
    "C3D20": ("hex", 2, True),
    "C3D27": ("hex", 2, False),
}


def size(jointed, measure):
    """Return the volume or area of a measure (collective)."""
    comm = jointed.mesh.comm
    return comm.allreduce(fem.assemble_scalar(fem.form(1.0 * measure)))


def results(jointed):
    """Frequencies [Hz], energy [J] and joint forces [N] under self-weight (collective)."""
    rock, loads = [dj.Fixed(group="base")], [dj.Gravity()]
    model = dj.Model(jointed, material=SOLID, joints=LAW, supports=rock, loads=loads)
    static = dj.Simulation(model).statics()
    forces = dj.JointForces(model)(static.joints)
    return [
        dj.modes(model.system(), 3).frequencies,
        np.array([static.energy.strain]),
        static.energy.joint_elastic,
        np.concatenate([forces[name].force for name in sorted(jointed.joint_names)]),
    ]


def check_equal(results_of_file, expected):
    """Check that results are equal to 1e-10 of the largest number of each quantity."""
    for one, other in zip(results_of_file, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * np.abs(other).max())


def on_root(comm, write):
    """Call a function on rank 0 (collective)."""
    failure = None
    if comm.rank == 0:
        try:
            write()
        except Exception as exc:
            failure = exc
    if failure := comm.bcast(failure, root=0):
        raise failure


def write_inp(msh, path, *, serendipity):
    """Write a .msh file as Abaqus input by Gmsh, with element and node sets of the same names."""
    with gmsh_model.gmsh_session():
        gmsh.merge(str(msh))
        if serendipity:
            gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
            gmsh.model.mesh.setOrder(1)
            gmsh.model.mesh.setOrder(2)
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
        gmsh.write(str(path))


@pytest.mark.parametrize("suffix", [".inp", ".med"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_statics_and_modes_are_those_of_the_msh_file(comm, mesh_file, new_path, element, suffix):
    """Check a file with the same cells: all results are equal to rounding errors."""
    cell, order, serendipity = ELEMENTS[element]
    msh = mesh_file(two_blocks, size=0.5, angle=20.0, cell=cell, order=order)
    path = new_path(f"blocks{suffix}")
    if suffix == ".inp":
        on_root(comm, lambda: write_inp(msh, path, serendipity=serendipity))
    else:
        on_root(comm, lambda: med_of(load_msh(msh), path, serendipity=serendipity))
    expected, jointed = dj.read_msh(msh, comm), dj.read_mesh(path, comm, unit="m")
    assert jointed.shape == expected.shape
    assert jointed.joint_names == expected.joint_names == ("joint_1",)
    assert expected.facet_groups.keys() <= jointed.facet_groups.keys()
    for group in ("lower", "upper"):
        sizes = [size(mesh, mesh.dx(group)) for mesh in (jointed, expected)]
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-12)
    check_equal(results(jointed), results(expected))


def test_curved_dam_with_all_its_joints(comm, mesh_file, new_path):
    """Gmsh's hexahedra of 27 nodes keep the nodes in the faces, which are on the curved surface."""
    msh, path = mesh_file(ambiesta, size=20.0, order=2), new_path("dam.med")
    on_root(comm, lambda: med_of(load_msh(msh), path))
    expected, jointed = dj.read_msh(msh, comm), dj.read_mesh(path, comm, unit="m")
    assert jointed.joint_names == expected.joint_names
    for group in expected.cell_groups:
        sizes = [size(mesh, mesh.dx(group)) for mesh in (jointed, expected)]
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-12)
    for name in expected.joint_names:
        areas = [size(mesh, mesh.dS(name)) for mesh in (jointed, expected)]
        assert areas[0] == pytest.approx(areas[1], rel=1e-12)


# ------------------------------------------------------------------ Abaqus files by hand

EDGES = [
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 0),
    (4, 5),
    (5, 6),
    (6, 7),
    (7, 4),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
]
CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
# Two bricks on each other, with the layout of files of Abaqus/CAE: labels with gaps, data over two
# lines, sets in sets, generate, and an instance of one part.
BRICKS = """\
*Heading
** by hand
*Part, name=dam
*Node
    1, 0., 0., 0.
    2, 2., 0., 0.
    3, 2., 3., 0.
    4, 0., 3., 0.
   11, 0., 0., 1.
   12, 2., 0., 1.
   13, 2., 3., 1.
   14, 0., 3., 1.
  101, 0., 0., 3.
  102, 2., 0., 3.
  103, 2., 3., 3.
  104, 0., 3., 3.
*Element, type=C3D8R, elset=Lower
 10, 1, 2, 3, 4, 11, 12, 13, 14
*Element, type=C3D8R,
 elset=upper
 20, 11, 12, 13, 14, 101,
 102, 103, 104
*Elset, elset=all
 lower, UPPER
*Nset, nset=base, generate
 1, 4, 1
*Nset, nset=Joint_1, generate
 11, 14
*Elset, elset=_top_S2, internal
 20,
*Surface, type=ELEMENT, name=top
 _top_S2, S2
*End Part
*Assembly, name=Assembly
*Instance, name=dam-1, part=dam
*End Instance
*Nset, nset=crest, instance=dam-1
 101, 102
*Elset, elset=whole, instance=dam-1
 dam-1.ALL
*End Assembly
*Step
*Static
*Node Output
U
*End Step
"""


CREST = "*Nset, nset=crest, instance=dam-1\n 101, 102\n"
LAST = " 20, 11, 12, 13, 14, 101,\n 102, 103, 104\n"  # the upper brick


@pytest.fixture
def inp(comm, new_path):
    """``inp(text)``: an input file with this text (collective)."""

    def write(text, name="dam.inp"):
        path = new_path(name)
        on_root(comm, lambda: path.write_text(text))
        return path

    return write


def test_sets_and_surfaces_of_abaqus(comm, inp):
    with (
        pytest.warns(UserWarning, match="of the body, which are not read: crest")
        if (comm.rank == 0)
        else warnings.catch_warnings()
    ):
        jointed = dj.read_mesh(inp(BRICKS), comm, unit="ft")
    foot = 0.3048
    assert jointed.joint_names == ("Joint_1",)
    assert sorted(jointed.cell_groups) == ["Lower", "all", "upper", "whole"]
    assert sorted(jointed.facet_groups) == ["base", "top"]
    for group, volume in (("Lower", 6.0), ("upper", 12.0), ("all", 18.0), ("whole", 18.0)):
        assert size(jointed, jointed.dx(group)) == pytest.approx(volume * foot**3, rel=1e-12)
    for measure in (jointed.ds("base"), jointed.ds("top"), jointed.dS("Joint_1")):
        assert size(jointed, measure) == pytest.approx(6.0 * foot**2, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (LAST, "*Include, input=part.txt\n"),
        ("\n elset=upper\n" + LAST, "\n elset=upper, input=part.txt\n"),
        ("*Heading\n** by hand\n*Part, name=dam\n", "\ufeff"),
        ("nset=base, generate\n", "nset=base,\n generate\n"),
        ("elset=all\n lower, UPPER", 'elset="all"\n "lower", UPPER'),
        ("elset=all\n", "elset=20\n 10\n*Elset, elset=z.10\n 20\n*Elset, elset=all\n"),
        ("elset=all\n lower, UPPER", "elset=20\n 10\n*Elset, elset=all\n 10, 20"),
        ("*Surface, type", "*Surface, name=s, internal\n 10, S1\n*Surface, type"),
        (" _top_S2, S2\n", " s, SNEG\n*Element, type=S4, elset=s\n 9, 101, 102, 103, 104\n"),
    ],
    ids=["include", "input", "BOM", "two lines", "quotes", "digits", "label", "internal", "shell"],
)  # fmt: skip
def test_forms_of_an_abaqus_file(comm, inp, old, new):
    """Check that the bricks are the same in other forms of the same file."""
    text = BRICKS.replace(CREST, "")
    if new == "\ufeff":
        text = text.replace("*End Part\n", "").replace("*Instance, name=dam-1, part=dam\n", "")
    assert old in text
    path = inp(text.replace(old, new))
    if "part.txt" in new:
        on_root(comm, lambda: path.with_name("part.txt").write_text(LAST))
    jointed = dj.read_mesh(path, comm, unit="m")
    assert set(jointed.facet_groups) - {"s"} == {"base", "top"}
    for group, volume in (("Lower", 6.0), ("upper", 12.0), ("all", 18.0), ("whole", 18.0)):
        assert size(jointed, jointed.dx(group)) == pytest.approx(volume, rel=1e-12)
    for measure in (jointed.ds("base"), jointed.ds("top"), jointed.dS("Joint_1")):
        assert size(jointed, measure) == pytest.approx(6.0, rel=1e-12)


@pytest.mark.filterwarnings("ignore:Elements that are not read")
@pytest.mark.filterwarnings("ignore:The surface 'top' has sides of AC3D8")
@pytest.mark.filterwarnings("ignore:Sets without cells or facets")
def test_acoustic_elements_are_not_a_part_of_the_body(comm, inp):
    text = BRICKS.replace(CREST, "").replace("C3D8R,\n elset=upper", "AC3D8,\n elset=upper")
    jointed = dj.read_mesh(inp(text), comm, unit="m", joints=[])
    assert size(jointed, jointed.dx("all")) == pytest.approx(6.0, rel=1e-12)


@pytest.mark.parametrize(
    ("face", "axis", "value"), [(1, 2, 0), (2, 2, 1), (3, 1, 0), (4, 0, 1), (5, 1, 1), (6, 0, 0)]
)
def test_faces_of_a_brick(comm, inp, face, axis, value):
    """Faces S1 to S6 by the manual: 1234 (lower), 5876 (upper), 1562, 2673, 3784, 4851."""
    nodes = "\n".join(f"{k + 1}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(CUBE))
    text = f"*NODE\n{nodes}\n*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
    jointed = dj.read_mesh(
        inp(f"{text}*SURFACE, NAME=side, TYPE=ELEMENT\n1, S{face}\n"), comm, unit="m"
    )
    x = ufl.SpatialCoordinate(jointed.mesh)
    form = fem.form((x[axis] - value) ** 2 * jointed.ds("side"))
    assert size(jointed, jointed.ds("side")) == pytest.approx(1.0)
    assert comm.allreduce(fem.assemble_scalar(form)) == pytest.approx(0.0, abs=1e-14)


def serendipity_volume(x):
    """Volume of a brick of 20 nodes in Abaqus' order, by its shape functions and Gauss points."""
    corners = 2.0 * CUBE - 1.0
    middles = np.array([(corners[a] + corners[b]) / 2 for a, b in EDGES])
    points, weights = np.polynomial.legendre.leggauss(5)
    volume = 0.0

    def shape(p):
        ends = (1 + p * corners).prod(axis=1) * ((p * corners).sum(axis=1) - 2) / 8
        sides = np.where(middles == 0, 1 - p**2, 1 + p * middles).prod(axis=1) / 4
        return np.concatenate([ends, sides])

    for (a, i), (b, j), (c, k) in itertools.product(zip(points, weights, strict=True), repeat=3):
        p, h = np.array([a, b, c]), 1e-5
        # Shape functions are quadratic in each coordinate: central differences are exact.
        slopes = [(shape(p + step) - shape(p - step)) / (2 * h) for step in h * np.eye(3)]
        volume += i * j * k * np.linalg.det(np.array(slopes) @ x)
    return volume


def test_curved_brick_of_20_nodes_keeps_its_geometry(comm, inp):
    """Check the volume of a 20-node brick with bent edges against its shape functions."""
    corners = 4.0 * CUBE
    x = np.vstack([corners, [(corners[a] + corners[b]) / 2 for a, b in EDGES]])
    x += 0.3 * np.random.default_rng(3).uniform(-1, 1, x.shape)
    nodes = "\n".join(f"{k + 1}, {', '.join(map(repr, map(float, p)))}" for k, p in enumerate(x))
    numbers = ", ".join(map(str, range(1, 16))) + ",\n" + ", ".join(map(str, range(16, 21)))
    text = f"*NODE\n{nodes}\n*ELEMENT, TYPE=C3D20R, ELSET=dam\n1, {numbers}\n"
    jointed = dj.read_mesh(inp(text), comm, unit="m")
    assert jointed.shape.degree == 2
    volume = size(jointed, jointed.dx("dam"))
    assert volume == pytest.approx(serendipity_volume(x), rel=1e-8)  # of the differences


PLANE = """\
*NODE
1, 0, 0
2, 2, 0
3, 2, 1
4, 0, 1
5, 1, 0
6, 2, 0.5
7, 1, 1.2
8, 0, 0.5
*ELEMENT, TYPE=CPE8R, ELSET=dam
1, 1, 2, 3, 4, 5, 6, 7, 8
*ELEMENT, TYPE=T2D3, ELSET=top
2, 3, 4, 7
*NSET, NSET=base
1, 2, 5
"""


def test_plane_mesh(comm, inp):
    """Check areas. The upper edge is a parabola with rise 0.2 m: area 2 + 2/3 0.2 2 m^2."""
    jointed = dj.read_mesh(inp(PLANE), comm, unit="m")
    assert sorted(jointed.facet_groups) == ["base", "top"]
    assert size(jointed, jointed.dx("dam")) == pytest.approx(2.0 + 0.8 / 3.0, rel=1e-12)
    assert size(jointed, jointed.ds("base")) == pytest.approx(2.0, rel=1e-12)


# ------------------------------------------------------------------ duplicated nodes and layers

COHESIVE = (
    BRICKS.replace("*Part, name=dam\n", "")
    .split("*End Part")[0]
    .replace("20, 11, 12, 13, 14, 101", "20, 51, 52, 53, 54, 101")
    .replace("*Nset, nset=Joint_1, generate\n 11, 14\n", "")
    .replace("*Element, type=C3D8R, elset=Lower", "".join(
        f"  {51 + k}, {x}, {y}, 1.\n" for k, (x, y) in enumerate([(0, 0), (2, 0), (2, 3), (0, 3)])
    ) + "*Element, type=C3D8R, elset=Lower")
)  # fmt: skip
LAYER = "*Element, type=COH3D8, elset=interface\n 30, 11, 12, 13, 14, 51, 52, 53, 54\n"
FLAT = LAYER.replace("COH3D8", "C3D8")
BOTH = "*Nset, nset=joint_a\n 11, 12, 13, 14, 51, 52, 53, 54\n"
ONE = "*Nset, nset=joint_a\n 11, 12, 13, 14\n"
FACES = "*Surface, name=joint_a-\n lower, S2\n*Surface, name=joint_a+\n upper, S1\n"


@pytest.mark.parametrize(
    ("joint", "name"),
    [
        (LAYER, "interface"),
        (FLAT, "interface"),
        (BOTH, "joint_a"),
        (ONE, "joint_a"),
        (FACES, "joint_a"),
    ],
    ids=["cohesive", "flat", "nodes of both faces", "nodes of one face", "two surfaces"],
)
def test_duplicated_nodes_become_a_joint(comm, inp, joint, name):
    """Check that results are those of the conforming mesh that the package splits."""
    text = BRICKS.replace(CREST, "")
    conforming = dj.read_mesh(inp(text), comm, unit="m")
    jointed = dj.read_mesh(inp(COHESIVE + joint), comm, unit="m")
    assert jointed.joint_names == (name,)
    check_equal(results(jointed), results(conforming))


KINKED = """\
*NODE
1, 0, 0
2, 1, 0
3, 2, 0
4, 0, 1
5, 1, 1
6, 2, 1
*ELEMENT, TYPE=CPE3
1, 1, 2, 5
2, 1, 5, 4
3, 2, 3, 6
4, 2, 6, 5
*NSET, NSET=joint
2, 5, 6
"""


def test_a_kinked_joint_needs_facets(comm, inp):
    """Refuse the set of the cell 2, 5, 6 in the kink: its third edge is not in the joint."""
    with pytest.raises(dj.MeshError, match="'joint' has all vertices of some cells, so that the"):
        dj.read_mesh(inp(KINKED), comm, unit="m")


def test_cohesive_elements_with_a_thickness_keep_it_as_initial_gap(comm, inp):
    text = re.sub(r"(  5[1-4],.*) 1\.\n", r"\1 1.01\n", COHESIVE)
    path = inp(text + LAYER)
    with pytest.raises(dj.MeshError, match="'interface' have a thickness; list 'interface' in"):
        dj.read_mesh(path, comm, unit="m", joints=[])
    jointed = dj.read_mesh(path, comm, unit="m")
    assert jointed.joint_names == ("interface",)
    assert jointed.pairs.gaps_in_geometry
    n = ufl.FacetNormal(jointed.mesh)
    gap = fem.form(
        ufl.dot(ufl.jump(ufl.SpatialCoordinate(jointed.mesh)), n("-")) * jointed.dS("interface")
    )
    assert comm.allreduce(fem.assemble_scalar(gap)) == pytest.approx(6.0 * 0.01, rel=1e-12)


@pytest.mark.parametrize("solid", [False, True], ids=["plane", "solid"])
@pytest.mark.parametrize("cell", ["tet", "hex"])
@pytest.mark.parametrize("order", [1, 2])
def test_duplicated_nodes_at_crossings_and_ends(comm, mesh_file, new_path, cell, order, solid):
    """Check joints that cross, meet and end in the body, with both faces in one group."""
    options = {"cell": cell, "order": order, "solid": solid}
    msh, path = mesh_file(network, **options, duplicated=True), new_path("network.med")

    def write():
        raw, groups = load_msh(msh), {}
        for name, rows in raw.facet_groups.items():
            groups.setdefault(name.rstrip("+-"), []).append(rows)
        groups = {name: np.concatenate(parts) for name, parts in groups.items()}
        med_of(replace(raw, facet_groups=groups), path)

    on_root(comm, write)
    expected = dj.read_msh(mesh_file(network, **options), comm)
    jointed = dj.read_mesh(path, comm, unit="m")
    assert jointed.joint_names == expected.joint_names
    nodes = [mesh.mesh.geometry.index_map().size_global for mesh in (jointed, expected)]
    assert nodes[0] == nodes[1]
    for name in expected.joint_names:
        areas = [size(mesh, mesh.dS(name)) for mesh in (jointed, expected)]
        assert areas[0] == pytest.approx(areas[1], rel=1e-12)


def test_wedges_without_thickness_in_a_med_file(comm, mesh_file, new_path):
    """Joint elements of code_aster: flat wedges between tetrahedra with duplicated nodes."""
    options = {"size": 0.5, "angle": 20.0, "cell": "tet"}
    msh, path = mesh_file(two_blocks, **options, duplicated=True), new_path("layer.med")

    def write():
        raw = load_msh(msh)
        lower, upper = (raw.facet_groups[f"joint_1{end}"] for end in "-+")
        key = [np.round(raw.x[rows].mean(axis=1), 9) for rows in (lower, upper)]
        upper = upper[[int(np.flatnonzero((key[1] == k).all(axis=1))[0]) for k in key[0]]]
        near = np.linalg.norm(raw.x[lower][:, :, None] - raw.x[upper][:, None], axis=3)
        upper = np.take_along_axis(upper, near.argmin(axis=2), axis=1)
        wedges, cells = np.hstack([lower, upper]), in_vtk_order(raw)
        start = len(cells) + len(wedges)
        sets = {**raw.cell_groups, "crack": np.arange(len(cells), start)}
        sets["base"] = np.arange(start, start + len(raw.facet_groups["base"]))
        blocks = {"TE4": cells, "PE6": wedges, "TR3": raw.facet_groups["base"]}
        write_med(path, raw.x, blocks, sets)

    on_root(comm, write)
    wanted = results(dj.read_msh(mesh_file(two_blocks, **options), comm))
    check_equal(results(dj.read_mesh(path, comm, unit="m")), wanted)


# ------------------------------------------------------------------ mistakes

WEDGE = "*Element, type=C3D6, elset=w\n 30, 1, 2, 3, 11, 12, 13\n"
SHELL = "*Element, type=S4, elset=base\n 31, 1, 2, 3, 4\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (BRICKS + WEDGE, "the cells are: 2 hexahedron (8 nodes), 1 wedge (6 nodes). Cells of one"),
        (
            BRICKS.replace("C3D8R", "SPRINGA"),
            "the cells are: 2 SPRINGA (0 nodes). Cells of one kind",
        ),
        (BRICKS.replace("10, 1, 2, 3, 4", "10, 1, 2, 4, 3"), "cells are partly inside out, the"),
        (
            BRICKS.replace(" 20,\n", " 21,\n"),
            "element 21 is used, but the file does not define it.",
        ),
        (BRICKS.replace("1, 4, 1", "1, 5, 1"), "node 5 is used, but the file does not define it."),
        (BRICKS.replace("lower, UPPER", "louer"), "the set 'louer' is used, but the file does not"),
        (BRICKS.replace("lower, UPPER", "all"), "the set 'all' is used, but the file does not"),
        (BRICKS.replace("   12,", "   11,"), "node 11 is defined twice."),
        (BRICKS.replace(" 20, 11", " 10, 11"), "element 10 is defined twice."),
        (
            BRICKS.replace("_top_S2, S2", "20, S7"),
            "surface 'top' has the unknown side 'S7' of hexahedron",
        ),
        (BRICKS.replace(" 11, 14\n", " 11, 12\n"), "all its vertices in the node set 'Joint_1'."),
        (BRICKS.replace("11, 14\n", "1, 4\n"), "Joint 'Joint_1': 1 of its facets do not have one"),
        (BRICKS + "*Nset, nset=top\n 1, 2\n", "'top' is a node set and a set of other facets"),
        (BRICKS + "*Instance, name=dam-2, part=dam\n", "*INSTANCE moves or generates nodes and is"),
        (BRICKS.replace("crest", "base"), "the part and the assembly have a set 'base'; write the"),
        (BRICKS + "*Node\n 1, 0., 0., 9.\n", "the assembly has additional nodes, for"),
        (
            BRICKS.replace("*Node\n", "*Node, system=C\n"),
            "nodes with SYSTEM=C are not in",
        ),
        (BRICKS + "*NCOPY\n", "*NCOPY moves or generates nodes and is not read; write the file"),
        (BRICKS + "*Nset, nset=a, elset=all\n", "the node set 'a' is given by elements; list its"),
        (BRICKS.replace("101,\n 102", "101,\n x"), "is damaged, or not a .inp file: Value"),
        (COHESIVE + LAYER.replace(", elset=interface", ""), "1 cohesive elements or cells without"),
        (
            BRICKS.replace("10, 1, 2, 3, 4", "10, 1, 2, 3, 3"),
            "1 cells have a node twice, the first",
        ),
        (BRICKS + "*Include, input=dam_parts.inp\n", "the included file"),
        ("", "the cells are: none."),
        (
            BRICKS.replace("1, 0., 0., 0.", "1, nan, 0., 0."),
            "coordinates that are not finite numbers",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:Sets without cells", "ignore:Elements that are not")
@pytest.mark.filterwarnings("ignore:The surface 'top' has sides")
def test_mistakes_in_a_file_are_one_error(comm, inp, text, sentence):
    path = inp(text)
    with pytest.raises(dj.MeshError) as failure:
        dj.read_mesh(path, comm, unit="m")
    assert sentence in str(failure.value)
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (BRICKS + "*Nset, nset=all\n 1, 2\n", "of the body, which are not read: all, crest."),
        (BRICKS + "*Surface, name=none\n", "which are not read: crest, none."),
        (BRICKS + "*Elset, elset=none\n", "which are not read: crest, none."),
        (BRICKS + "*Element, type=MASS, elset=m\n 99, 1\n", "Elements that are not read: 1 MASS."),
        (BRICKS + "*Surface, type=NODE, name=n\n base\n", "which are not read: crest, n."),
    ],
)
def test_what_is_not_read_is_reported(comm, inp, text, sentence):
    path = inp(text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dj.read_mesh(path, comm, unit="m")
    if comm.rank == 0:
        assert any(sentence in str(warning.message) for warning in caught)


@pytest.mark.parametrize("unit", ["km", 0, -1.0, float("nan"), None, True])
def test_unknown_units_are_refused(comm, inp, unit):
    with pytest.raises(ValueError, match="it must be one of m, cm, mm, ft, in, or the length of"):
        dj.read_mesh(inp(BRICKS), comm, unit=unit)


def test_files_that_cannot_be_read(comm, inp):
    with pytest.raises(dj.MeshError, match="has no known format; the formats are .inp, .med"):
        dj.read_mesh(inp("x", "dam.stl"), comm, unit="m")
    with pytest.raises(dj.MeshError, match="is damaged, or not a .med file: OSError"):
        dj.read_mesh(inp("x", "dam.med"), comm, unit="m")
    with pytest.raises(dj.MeshError, match="does not exist"):
        dj.read_mesh("nothing.inp", comm, unit="m")
    with pytest.raises(TypeError, match="unit"):
        dj.read_mesh("nothing.inp", comm)
    for joints in ("top", 5, [5]):
        with pytest.raises(
            dj.MeshError, match=re.escape(f"joints is {joints!r}; it must be a list")
        ):
            dj.read_mesh(inp(BRICKS.replace(CREST, "")), comm, unit="m", joints=joints)


def test_a_file_that_includes_itself_is_refused(comm, inp):
    path = inp("")
    on_root(comm, lambda: path.write_text(f"*Include, input={path.name}\n"))
    with pytest.raises(dj.MeshError, match="is damaged, or not a .inp file: RecursionError"):
        dj.read_mesh(path, comm, unit="m")


def test_a_med_file_with_lost_nodes_is_refused(comm, new_path):
    path = new_path("lost.med")
    blocks = {"HE8": np.arange(1, 9)[None]}
    on_root(comm, lambda: write_med(path, CUBE, blocks, {"dam": np.array([0])}))
    with pytest.raises(dj.MeshError, match="node 9 is used, but the file does not define it"):
        dj.read_mesh(path, comm, unit="m")
