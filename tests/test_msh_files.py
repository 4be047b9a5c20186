# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Malformed and hostile ``.msh`` files: one sentence each, and nothing in them is run."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.msh import load_msh
from geometry import _base
from geometry.two_blocks import two_blocks


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """The lines of two cells as an ASCII file of version 4.1."""
    path = tmp_path_factory.mktemp("msh") / "blocks.msh"
    two_blocks(path, size=1.0)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(str(path))
        gmsh.option.setNumber("Mesh.Binary", 0)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path.read_text().split("\n")


def refusal(path):
    with pytest.raises(dj.MeshError) as failure:
        dj.read_msh(path, MPI.COMM_SELF)
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
    assert refusal(path).endswith(f"is no Gmsh mesh file: {sentence}")


@pytest.mark.parametrize("name", ["evil.msh", "evil.geo"])
def test_a_script_is_not_run(tmp_path, name):
    path, mark = tmp_path / name, tmp_path / "mark"
    start = "" if name == "evil.msh" else "$MeshFormat\n"
    path.write_text(f'{start}SystemCall "touch {mark}";\n')
    assert "is no Gmsh mesh file" in refusal(path)
    assert not mark.exists()


def test_options_beside_a_mesh_are_not_run(tmp_path, lines):
    path, mark = tmp_path / "good.msh", tmp_path / "mark"
    path.write_text("\n".join(lines))
    (tmp_path / "good.msh.opt").write_text(f'SystemCall "touch {mark}";\n')
    assert "has the file 'good.msh.opt' beside it" in refusal(path)
    assert not mark.exists()


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_truncated_mesh_is_refused(tmp_path, lines, share):
    path, text = tmp_path / "bad.msh", "\n".join(lines)
    path.write_text(text[: int(share * len(text))])
    refusal(path)


@pytest.mark.parametrize(
    ("section", "offset", "line", "sentence"),
    [
        ("$MeshFormat", 1, "9.9 0 8", "is of the format '9.9 0 8'; 4.1 and 2.2 are read"),
        ("$Nodes", 1, "6 999999999999 1 12", "$Nodes announces 999999999999 and holds 12."),
        ("$Nodes", 1, "6 12 1 1000", "$Nodes announces tags from 1 to 1000 and holds 1 to 12."),
        ("$Elements", 1, "6 999999999999 1 13", "$Elements announces 999999999999 and holds"),
        ("$Elements", 1, "6 14 1 13", "$Elements announces 14 and holds"),
        ("$Elements", 3, "x y z", "$Elements holds something else than numbers."),
        ("$Elements", 3, "3 1 4 10 99999", "the node 99999, which is none of the file's."),
        ("$Elements", 2, "2 77 2 2", "names the entity 77 of dimension 2, which is none of the"),
        ("$Elements", 2, "2 1 999 2", "has cells of Gmsh type 999, which is none."),
        ("$PhysicalNames", 2, '5 3 "base"', "must have 6 lines of a dimension, a tag and a name."),
        ("$Entities", 1, "0 0 -4 2", "holds a negative number where a count or a tag is needed."),
    ],
)
def test_wrong_numbers_are_refused(tmp_path, lines, section, offset, line, sentence):
    # Gmsh itself crashes or never ends at some of them.
    path, bad = tmp_path / "bad.msh", list(lines)
    bad[bad.index(section) + offset] = line
    path.write_text("\n".join(bad))
    assert sentence in refusal(path)


def old_version(path, lines, binary):
    """The mesh of these lines as a file of version 2.2."""
    source = path.with_name("source.msh")
    source.write_text("\n".join(lines))
    with _base.gmsh_session():
        gmsh.merge(str(source))
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(path))


@pytest.mark.parametrize("binary", [0, 1])
def test_the_older_version_is_read_too(tmp_path, lines, binary):
    # As many nodes and cells, in as many groups, as the file has from which it was made.
    path = tmp_path / "old.msh"
    old_version(path, lines, binary)
    old, new = load_msh(path), load_msh(path.with_name("source.msh"))
    assert old.x.shape == new.x.shape
    assert old.cells.shape == new.cells.shape
    assert {k: v.shape for k, v in old.facet_groups.items()} == {
        k: v.shape for k, v in new.facet_groups.items()
    }


@pytest.mark.parametrize("section", ["Periodic", "NodeData", "Anything"])
def test_what_is_no_mesh_is_left_out(tmp_path, lines, section):
    # Gmsh would take its numbers for counts: 10^9 of them.
    path, plain = tmp_path / "more.msh", tmp_path / "plain.msh"
    plain.write_text("\n".join(lines))
    path.write_text("\n".join([*lines, f"${section}\n1000000000\n0 1 1\n$End{section}\n"]))
    np.testing.assert_array_equal(load_msh(path).cells, load_msh(plain).cells)


def test_groups_without_names_are_refused(tmp_path, lines):
    path, bad = tmp_path / "bad.msh", list(lines)
    del bad[bad.index("$PhysicalNames") : bad.index("$EndPhysicalNames") + 1]
    path.write_text("\n".join(bad))
    assert "has no named physical group of cells" in refusal(path)


def test_comments_may_come_first(lines, tmp_path):
    path = tmp_path / "blocks.msh"
    path.write_text("\n".join(["$Comments", "by hand", "$EndComments", *lines]))
    # As many cells as the file without them has.
    plain = tmp_path / "plain.msh"
    plain.write_text("\n".join(lines))
    assert len(load_msh(path).cells) == len(load_msh(plain).cells) > 0
