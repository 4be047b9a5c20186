# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of I-DEAS, Exodus and VTK: the same body as from Gmsh's format, and a user's mistakes."""

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import gmsh
from med_files import in_vtk_order
from scipy.io import netcdf_file
from test_other_programs import ELEMENTS, check_equal, on_root, results, size

import dolfinx_joints as dj
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.mesh.reading.gmsh_file import load_msh

pytestmark = pytest.mark.mpi

# Types and orders of Exodus' manual, from VTK's order: vertical edges before the upper ones, then
# the centre and the faces at -z, +z, -x, +x, -y, +y.
EXODUS = {4: "TETRA4", 10: "TETRA10", 8: "HEX8", 20: "HEX20", 27: "HEX27"}
HEX27 = [*range(12), *range(16, 20), *range(12, 16), 26, 24, 25, 20, 21, 22, 23]
SIDES = {
    4: ["124", "234", "143", "132"],
    8: ["1265", "2376", "3487", "1584", "1432", "5678"],
}
VTK = {4: 10, 10: 24, 8: 12, 20: 25, 27: 29}


def write_unv(msh, path, serendipity):
    """Write a .msh file as a universal file by Gmsh."""
    with gmsh_model.gmsh_session():
        gmsh.merge(str(msh))
        if serendipity:
            gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
            gmsh.model.mesh.setOrder(1)
            gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))


def sides_of(corners, facets):
    """Return the element and the side from 1 of facets, in the numbers of Exodus."""
    table = SIDES[corners.shape[1]]
    key = {}
    for side, local in enumerate(table, 1):
        rows = np.sort(corners[:, [int(v) - 1 for v in local]], axis=1)
        key |= {tuple(row): (cell + 1, side) for cell, row in enumerate(rows.tolist())}
    return np.array([key[tuple(sorted(facet))] for facet in facets.tolist()]).T


def write_exodus(raw, path, serendipity):
    """Write a `RawMesh` as an Exodus file: HDF5, or classic netCDF if the name ends in .g."""
    cells = in_vtk_order(raw)[:, : 20 if serendipity else None]
    count = cells.shape[1]
    order = HEX27[:count] if count in (20, 27) else range(count)
    variables, attributes = {f"coord{a}": raw.x[:, k] for k, a in enumerate("xyz")}, {}
    for k, own in enumerate(raw.cell_groups.values(), 1):
        variables[f"connect{k}"] = cells[own][:, list(order)] + 1
        attributes[f"connect{k}"] = EXODUS[count]
    whole = np.concatenate([cells[own] for own in raw.cell_groups.values()])
    corners = whole[:, : 4 if count in (4, 10) else 8]
    for k, name in enumerate(facets := [n for n in raw.facet_groups if n != "base"], 1):
        sides = sides_of(corners, raw.facet_groups[name])
        variables[f"elem_ss{k}"], variables[f"side_ss{k}"] = sides
    variables["node_ns1"] = np.unique(raw.facet_groups["base"]) + 1
    for part, names in (("eb", raw.cell_groups), ("ss", facets), ("ns", ["base"])):
        variables[f"{part}_prop1"] = np.arange(10, 10 + len(names))
        letters = [list(name.ljust(33, "\0").encode()) for name in names]
        variables[f"{part}_names"] = np.array(letters, dtype=np.uint8).view("S1")
    if path.suffix == ".g":
        with netcdf_file(path, "w") as file:
            for name, values in variables.items():
                values = values.astype("i4") if values.dtype.kind == "i" else values
                for axis, length in enumerate(values.shape):
                    file.createDimension(f"{name}_{axis}", length)
                axes = tuple(f"{name}_{axis}" for axis in range(values.ndim))
                variable = file.createVariable(name, values.dtype.str[1:].replace("S1", "c"), axes)
                variable[:] = values
                if name in attributes:
                    variable.elem_type = attributes[name]
        return
    with h5py.File(path, "w") as file:
        for name, values in variables.items():
            file[name] = values
            if name in attributes:
                file[name].attrs["elem_type"] = attributes[name]


def write_vtu(raw, path, serendipity):
    """Write a `RawMesh` as the text of VTK's manual, with groups as arrays of cells and points."""
    cells = in_vtk_order(raw)[:, : 20 if serendipity else None]
    facets = np.concatenate([own for name, own in raw.facet_groups.items() if name != "base"])
    material = np.zeros(len(cells) + len(facets), dtype=int)
    for value, name in enumerate(("lower", "upper"), 1):
        material[raw.cell_groups[name]] = value
    faces = {4: 9, 3: 5}[facets.shape[1]]
    joint = np.isin(np.arange(len(material)), len(cells) + np.arange(len(facets)))
    start = len(cells)
    for name, own in raw.facet_groups.items():
        if name != "base":
            joint[start : start + len(own)] = name == "joint_1"
            material[start : start + len(own)] = {"joint_1": 3, "top": 4, "sides": 5}[name]
            start += len(own)
    base = np.isin(np.arange(len(raw.x)), raw.facet_groups["base"]).astype(int)
    widths = [cells.shape[1]] * len(cells) + [facets.shape[1]] * len(facets)
    types = [VTK[cells.shape[1]]] * len(cells) + [faces] * len(facets)

    def array(name, values, kind="Int64", parts=1):
        text = " ".join(map(repr, np.asarray(values).ravel().tolist()))
        options = f'type="{kind}" Name="{name}" NumberOfComponents="{parts}" format="ascii"'
        return f"<DataArray {options}>{text}</DataArray>"

    nodes = np.concatenate([cells.ravel(), facets.ravel()])
    path.write_text(
        '<VTKFile type="UnstructuredGrid" version="1.0"><UnstructuredGrid>'
        f'<Piece NumberOfPoints="{len(raw.x)}" NumberOfCells="{len(types)}">'
        f"<PointData>{array('base', base)}</PointData>"
        f"<CellData>{array('part', material, 'Float64')}"
        f"{array('joint_1', joint.astype(int))}</CellData>"
        f"<Points>{array('Points', raw.x, 'Float64', 3)}</Points>"
        f"<Cells>{array('connectivity', nodes)}{array('offsets', np.cumsum(widths))}"
        f"{array('types', types, 'UInt8')}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )


FILES = [(element, suffix) for element in ELEMENTS for suffix in (".unv", ".exo", ".g", ".vtu")]
FILES.remove(("C3D27", ".unv"))  # universal files have no hexahedra with 27 nodes


@pytest.mark.parametrize(("element", "suffix"), FILES)
def test_statics_and_modes_are_those_of_the_msh_file(comm, mesh_file, new_path, element, suffix):
    """Check a file with the same cells: all results are equal to rounding errors."""
    cell, order, serendipity = ELEMENTS[element]
    if suffix == ".vtu":
        pytest.importorskip("vtkmodules")
    msh = mesh_file(two_blocks, size=0.5, angle=20.0, cell=cell, order=order)
    path = new_path(f"blocks{suffix}")
    writers = {".unv": write_unv, ".vtu": write_vtu}
    write, source = writers.get(suffix, write_exodus), msh
    on_root(comm, lambda: write(source if suffix == ".unv" else load_msh(msh), path, serendipity))
    expected, jointed = dj.read_msh(msh, comm), dj.read_mesh(path, comm, unit="m")
    assert jointed.shape == expected.shape
    assert jointed.joint_names == ("joint_1",)
    lower = "part_1" if suffix == ".vtu" else "lower"
    volumes = size(jointed, jointed.dx(lower)), size(expected, expected.dx("lower"))
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-12)
    sides = "part_5" if suffix == ".vtu" else "sides"
    assert size(jointed, jointed.ds(sides)) == pytest.approx(8.0, rel=1e-12)
    check_equal(results(jointed), results(expected))


def write_square(path, kind, facets):
    """Write a square of 2 m x 1 m, whose elements have 4 nodes, as an Exodus file."""
    with h5py.File(path, "w") as file:
        for axis, values in zip("xyz", ([0, 2, 2, 0], [0, 0, 1, 1], [0] * 4), strict=True):
            file[f"coord{axis}"] = np.array(values, dtype=float)
        file["connect1"], file["eb_prop1"] = np.array([[1, 2, 3, 4]]), np.array([1])
        file["connect1"].attrs["elem_type"] = kind
        for name, values in facets.items():
            file[name] = values


@pytest.mark.parametrize(("kind", "side"), [("QUAD4", 1), ("SHELL4", 3)])
def test_edges_of_shells_in_a_side_set(comm, new_path, kind, side):
    """Check the edge of 2 m at y = 0. Edges of shells have numbers from 3 (Exodus' manual)."""
    path = new_path("plate.exo")
    facets = {"elem_ss1": [1], "side_ss1": [side], "ss_prop1": [7]}
    on_root(comm, lambda: write_square(path, kind, facets))
    jointed = dj.read_mesh(path, comm, unit="m")
    assert size(jointed, jointed.ds("sideset_7")) == pytest.approx(2.0, rel=1e-12)


def test_named_sets_without_numbers(comm, new_path):
    path = new_path("plate.exo")
    letters = np.array([list("base")], dtype="S1")
    on_root(comm, lambda: write_square(path, "QUAD4", {"node_ns1": [1, 2], "ns_names": letters}))
    jointed = dj.read_mesh(path, comm, unit="m")
    assert size(jointed, jointed.ds("base")) == pytest.approx(2.0, rel=1e-12)


UNV = """\
    -1
  2411
         1         1         1        11
   0.0D+00   0.0D+00   0.0D+00
         2         1         1        11
   1.0D+00   0.0D+00   0.0D+00
         3         1         1        11
   0.0D+00   1.0D+00   0.0D+00
    -1
    -1
  2412
         7        41         1         1         7         3
         1         2         3
        {element}
    -1
    -1
  2467
         1         0         0         0         0         0         0         2
base
         7         1         0         0         7         2         0         0
         2         0         0         0         0         0         0         1
{name}
         8         {label}         0         0
    -1
"""
MASS = "9 161 1 1 7 1\n         1"


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"name": "base"}, "two groups have the name 'base'."),
        ({"label": 8}, "element 8 is used, but the file does not define it."),
        ({"element": "8 44 1 1 7 4\n 1 2 3 4"}, "node 4 is used, but the file does not define it."),
        ({"element": "8 44 1 1 7 4"}, "is damaged, or not a .unv file: StopIteration"),
    ],
)
def test_mistakes_in_a_universal_file_are_one_error(comm, new_path, options, sentence):
    path = new_path("plate.unv")
    text = UNV.format(**{"element": MASS, "name": "dam", "label": 7, **options})
    on_root(comm, lambda: path.write_text(text))
    with pytest.raises(dj.MeshError) as failure:
        dj.read_mesh(path, comm, unit="m")
    assert sentence in str(failure.value)


@pytest.mark.filterwarnings("ignore:Elements that are not read")
def test_groups_of_a_universal_file_by_hand(comm, new_path):
    """Check a triangle with the area 1/2 cm^2 and its lower edge of 1 cm, a group of nodes."""
    path = new_path("plate.unv")
    on_root(comm, lambda: path.write_text(UNV.format(element=MASS, name="dam", label=7)))
    jointed = dj.read_mesh(path, comm, unit="cm")
    assert size(jointed, jointed.dx("dam")) == pytest.approx(0.5e-4, rel=1e-12)
    assert size(jointed, jointed.ds("base")) == pytest.approx(0.01, rel=1e-12)


@pytest.mark.filterwarnings("ignore:Elements that are not read")
@pytest.mark.parametrize(
    ("kind", "radius", "global_axes"),
    [(0, "1.0D+00", True), (1, "1.0D+00", False), (0, "-1", False)],
)
def test_coordinate_systems_of_a_universal_file(comm, new_path, kind, radius, global_axes):
    """Dataset 2420 has cylindrical (1) or turned systems; nodes of the file are in system 1."""
    rows = f" {radius} 0 0\n 0 1 0\n 0 0 1\n 0 0 0\n"
    system = f"    -1\n  2420\n 1\nPart\n 1 {kind} 8\nCS1\n{rows}    -1\n"
    text, path = UNV.format(element=MASS, name="dam", label=7), new_path("plate.unv")
    on_root(comm, lambda: path.write_text(system + text))
    if global_axes:
        jointed = dj.read_mesh(path, comm, unit="m")
        assert size(jointed, jointed.dx("dam")) == pytest.approx(0.5, rel=1e-12)
        return
    with pytest.raises(dj.MeshError, match="nodes are in the local coordinate system 1; write the"):
        dj.read_mesh(path, comm, unit="m")


@pytest.mark.parametrize("suffix", [".unv", ".exo", ".g", ".vtu"])
@pytest.mark.parametrize("content", [b"", b"text", b"CDF\x05abcd", b"<VTKFile>"])
def test_files_that_cannot_be_read(comm, new_path, suffix, content):
    path = new_path(f"dam{suffix}")
    on_root(comm, lambda: path.write_bytes(content))
    with pytest.raises(dj.MeshError, match=path.name):
        dj.read_mesh(path, comm, unit="m")


def test_vtk_that_is_not_installed(comm, new_path, monkeypatch):
    path = new_path("dam.vtu")
    on_root(comm, lambda: path.write_text("x"))
    monkeypatch.setitem(__import__("sys").modules, "vtkmodules.vtkIOXML", None)
    with pytest.raises(dj.MeshError, match="install it by python3 -m pip install vtk"):
        dj.read_mesh(path, comm, unit="m")
