# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""``.msh`` files: what is read, one message each for damaged ones, and no script is run."""

import sys

from mpi4py import MPI

import gmsh
import numpy as np
import pytest

import dolfinx_joints as dj
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.mesh.reading.gmsh_file import load_msh


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """The lines of two cells as an ASCII file of version 4.1."""
    path = tmp_path_factory.mktemp("msh") / "blocks.msh"
    two_blocks(path, size=1.0)
    with gmsh_model.gmsh_session():
        gmsh.merge(str(path))
        gmsh.option.setNumber("Mesh.Binary", 0)
        gmsh.write(str(path))
    return path.read_text().split("\n")


def refusal(path, reader=dj.read_msh):
    with pytest.raises(dj.MeshError) as failure:
        reader(path, MPI.COMM_SELF)
    assert not gmsh.isInitialized()
    text = str(failure.value)
    assert str(path) in text
    assert "\n" not in text
    assert text.endswith(".")
    return text


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "it is empty."),
        (b"Dear reader", "it does not begin with '$MeshFormat'."),
        (b"\x89HDF\r\n\x1a\n" + bytes(90), "it does not begin with '$MeshFormat'."),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path, content, sentence):
    path = tmp_path / "bad.msh"
    path.write_bytes(content)
    assert refusal(path).endswith(f"is not a Gmsh mesh file: {sentence}")


@pytest.mark.parametrize("name", ["evil.msh", "evil.geo"])
@pytest.mark.parametrize("reader", [dj.read_msh, lambda path, _: gmsh_model.describe(path)])
def test_a_script_is_not_run(tmp_path, name, reader):
    path, mark = tmp_path / name, tmp_path / "mark"
    start = "" if name == "evil.msh" else "$MeshFormat\n"
    path.write_text(f'{start}SystemCall "touch {mark}";\n')
    assert "is not a Gmsh mesh file" in refusal(path, reader)
    assert not mark.exists()


def test_options_beside_a_mesh_are_not_run(tmp_path, lines):
    path, mark = tmp_path / "good.msh", tmp_path / "mark"
    path.write_text("\n".join(lines))
    (tmp_path / "good.msh.opt").write_text(f'SystemCall "touch {mark}";\n')
    assert "would run the file 'good.msh.opt' in the folder of" in refusal(path)
    assert not mark.exists()


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_truncated_mesh_is_refused(tmp_path, lines, share):
    path, text = tmp_path / "bad.msh", "\n".join(lines)
    path.write_text(text[: int(share * len(text))])
    refusal(path)


@pytest.mark.parametrize(
    ("section", "offset", "line", "sentence"),
    [
        ("$MeshFormat", 1, "9.9 0 8", "Unknown MSH file version 9.9."),
        ("$Nodes", 1, "6 999999999999 1 12", "$Nodes does not match its header."),
        ("$Nodes", 1, "6 4 1 12", "$Nodes does not match its header."),
        (
            "$Elements",
            1,
            "6 999999999999 1 13",
            "$Elements does not match its header.",
        ),
        ("$Elements", 1, "x", "$Elements does not match its header."),
        ("$Elements", 3, "3 1 4 10 99999", "Unknown node 99999 in element 3."),
        ("$PhysicalNames", 2, '5 3 "base"', "$PhysicalNames must be a dimension, a tag and a name"),
    ],
)
def test_wrong_counts_are_refused(tmp_path, lines, section, offset, line, sentence):
    # Gmsh itself crashes or takes all memory at most of them.
    path, bad = tmp_path / "bad.msh", list(lines)
    bad[bad.index(section) + offset] = line
    path.write_text("\n".join(bad))
    assert sentence in refusal(path)


@pytest.mark.parametrize("binary", [0, 1])
def test_wrong_counts_of_the_older_version_are_refused(tmp_path, lines, binary):
    path = tmp_path / "old.msh"
    old_version(path, lines, binary)
    head, nodes = path.read_bytes().split(b"$Nodes\n")
    path.write_bytes(head + b"$Nodes\n999999" + nodes)
    assert "$Nodes does not match its header." in refusal(path)


def old_version(path, lines, binary):
    """The mesh of these lines as a file of version 2.2."""
    source = path.with_name("source.msh")
    source.write_text("\n".join(lines))
    with gmsh_model.gmsh_session():
        gmsh.merge(str(source))
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(path))


def test_groups_without_names_are_refused(tmp_path, lines):
    path, bad = tmp_path / "bad.msh", list(lines)
    del bad[bad.index("$PhysicalNames") : bad.index("$EndPhysicalNames") + 1]
    path.write_text("\n".join(bad))
    assert "has no named physical group of cells" in refusal(path)


def test_cells_without_a_name_are_told_of(tmp_path):
    path = tmp_path / "half.msh"
    with gmsh_model.gmsh_session():
        named, unnamed = (gmsh.model.occ.addRectangle(x, 0, 0, 1, 1) for x in (0, 1))
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [named], name="dam")
        gmsh.model.addPhysicalGroup(2, [unnamed])
        gmsh.model.mesh.generate(2)
        count = len(gmsh.model.mesh.getElements(2, unnamed)[1][0])
        gmsh.write(str(path))
    with pytest.warns(UserWarning, match=f"{count} cells are in no named physical group and"):
        load_msh(path)


def test_curved_cells_in_a_part_too_thin_for_them_are_refused(tmp_path):
    """The middle of an edge along the inner face leaves its chord by 3.8 times the thickness."""
    path = tmp_path / "shell.msh"
    with gmsh_model.gmsh_session():
        occ = gmsh.model.occ
        disk, hole = (occ.addDisk(0, 0, 0, radius, radius) for radius in (10.2, 10.0))
        occ.cut([(2, disk)], [(2, hole)])
        occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [disk], name="shell")
        for _, line in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(line, 9)
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 0)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
    assert "cells are partly inside out, the first one around (" in refusal(path)


def test_comments_may_come_first(lines, tmp_path):
    path = tmp_path / "blocks.msh"
    path.write_text("\n".join(["$Comments", "by hand", "$EndComments", *lines]))
    # As many cells as the file without them has.
    plain = tmp_path / "plain.msh"
    plain.write_text("\n".join(lines))
    assert len(load_msh(path).cells) == len(load_msh(plain).cells) > 0


def test_gmsh_without_a_library_of_the_system_is_one_sentence(tmp_path, monkeypatch):
    # What Gmsh from PyPI does where nothing of a desktop is installed.
    missing = "libGLU.so.1: cannot open shared object file: No such file or directory"
    (tmp_path / "gmsh.py").write_text(f"raise OSError({missing!r})\n")
    monkeypatch.delitem(sys.modules, "gmsh")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(dj.MeshError, match=f"^Gmsh cannot be loaded: {missing}; install that"):
        load_msh(tmp_path / "any.msh")


NODES = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0), (9, 9, 0)]


def write_plane(path, elements, *, nodes=NODES, lines=1):
    """A .msh file of elements (dim, entity, kind, nodes) in named groups "body" and "edge"."""
    entities = {0: {}, 1: {n: [] for n in range(1, lines + 1)}, 2: {}}
    for dim, entity, kind, corners in elements:
        entities[dim].setdefault(entity, []).append((kind, corners))
    with gmsh_model.gmsh_session():
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        model, number = gmsh.model, 0
        for dim in (2, 1):
            for entity, parts in entities[dim].items():
                model.addDiscreteEntity(dim, entity)
                if dim == 2 and entity == 1:
                    tags = list(range(1, len(nodes) + 1))
                    model.mesh.addNodes(2, 1, tags, [c for node in nodes for c in node])
                for kind, corners in parts:
                    number += 1
                    model.mesh.addElements(dim, entity, [kind], [[number]], [corners])
        model.addPhysicalGroup(2, list(entities[2]), name="body")
        model.addPhysicalGroup(2, [1], name="first")
        model.addPhysicalGroup(1, list(entities[1]), name="edge")
        gmsh.write(str(path))
    return path


LINE, TRIANGLE, QUAD = 1, 2, 3
SQUARE, NEXT = (2, 1, QUAD, (1, 2, 3, 4)), (2, 2, QUAD, (2, 5, 6, 3))
EDGE = (1, 1, LINE, (1, 2))


def test_cells_of_two_groups_are_read_once(tmp_path):
    raw = load_msh(write_plane(tmp_path / "good.msh", [SQUARE, NEXT, EDGE]))
    assert len(raw.cells) == 2
    assert {name: cells.tolist() for name, cells in raw.cell_groups.items()} == {
        "body": [0, 1],
        "first": [0],
    }
    assert raw.facet_groups["edge"].shape == (1, 2)


WARPED = [(x, y, 0.1 * x * y) for x, y, _ in NODES]


@pytest.mark.parametrize(
    ("elements", "options", "sentence"),
    [
        ([SQUARE, (2, 2, TRIANGLE, (2, 5, 6)), EDGE], {}, "has cells of Gmsh types [2, 3]; use"),
        (
            [SQUARE, (2, 1, TRIANGLE, (2, 5, 6)), EDGE],
            {},
            "entity 1 has 2 kinds of cells; one kind is needed.",
        ),
        ([SQUARE, EDGE], {"nodes": WARPED}, "is a surface mesh but not in a plane z = constant."),
        ([SQUARE], {}, "Group 'edge' has no facets; mesh it before writing the file."),
        (
            [SQUARE, (1, 1, LINE, (2, 7))],
            {},
            "Group 'edge' has facets with nodes that belong to no cell.",
        ),
        ([SQUARE, (1, 1, LINE, (1, 3))], {}, "Group 'edge': 1 of its facets belong to no cell."),
    ],
    ids=["types", "kinds", "warped", "no facets", "foreign nodes", "diagonal"],
)
def test_what_is_in_a_plane_mesh_is_checked(tmp_path, elements, options, sentence):
    path = write_plane(tmp_path / "bad.msh", elements, **options)
    with pytest.raises(dj.MeshError) as failure:
        dj.read_msh(path, MPI.COMM_SELF, joints=[])
    assert sentence in str(failure.value)
    assert str(failure.value).endswith(".")


def test_a_body_of_which_only_the_surface_is_meshed_is_refused(tmp_path):
    with gmsh_model.gmsh_session():
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="body")
        gmsh.model.addPhysicalGroup(2, [1], name="side")
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "box.msh"))
    assert "entity 1 of dimension 3 has no cells; mesh it by gmsh." in refusal(tmp_path / "box.msh")


@pytest.mark.parametrize("read", [dj.read_msh, dj.read_split])
def test_readers_need_a_communicator(tmp_path, read):
    with pytest.raises(ValueError, match="comm is None; it must be an MPI communicator such as"):
        read(tmp_path / "any.msh", None)


def test_joints_are_a_list_of_names(tmp_path):
    path = write_plane(tmp_path / "good.msh", [SQUARE, NEXT, EDGE])
    with pytest.raises(dj.MeshError, match="joints is 'edge'; it must be a list of names"):
        dj.read_msh(path, MPI.COMM_SELF, joints="edge")


def old_files(folder, *, binary):
    """The same tetrahedra in each of Gmsh's formats, a volume and a face with two names each."""
    paths = []
    with gmsh_model.gmsh_session():
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        for dim, sign, name in [(3, 1, "body"), (3, 1, "all"), (2, 1, "side"), (2, -1, "outside")]:
            gmsh.model.addPhysicalGroup(dim, [sign], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        gmsh.model.mesh.generate(3)
        for version in (2.2, 4.1) if binary else (2.2, 4.0, 4.1):  # Gmsh writes no binary 4.0
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            paths.append(folder / f"v{version:g}.msh")
            gmsh.write(str(paths[-1]))
    return paths


@pytest.mark.parametrize("binary", [0, 1])
def test_all_formats_hold_the_same(tmp_path, binary):
    *old, new = (load_msh(path) for path in old_files(tmp_path, binary=binary))
    assert len(new.cells) > 100
    for raw in (*old, new):
        edges = np.diff(raw.x[raw.cells], axis=1)
        assert np.abs(np.linalg.det(edges)).sum() / 6 == pytest.approx(1.0, rel=1e-12)
        assert {name: len(cells) for name, cells in raw.cell_groups.items()} == {
            "body": len(new.cells),
            "all": len(new.cells),
        }
        assert set(raw.facet_groups) == {"side", "outside"}
        for facets in raw.facet_groups.values():
            assert len(facets) == len(new.facet_groups["side"])


def test_reading_a_mesh_leaves_the_models_of_gmsh_alone(wall_file):
    path = wall_file()
    gmsh.initialize()
    try:
        gmsh.model.add("mine")
        load_msh(path)
        assert gmsh.model.getCurrent() == "mine"
        assert "mine" in gmsh.model.list()
    finally:
        gmsh.finalize()
