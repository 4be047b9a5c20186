# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of tetrahedra from a STEP file of touching solids, with joints at common faces.

python3 geometry/from_step.py dam.step --size 4 --surface base:z=min --out dam.msh
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import gmsh
import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import Length, Order, argument_parser, mesh_path
from dolfinx_joints.geometry.meshing.planes import (
    Plane,
    add_groups,
    check_planes,
    cut_wedge,
    faces_of,
    faces_on_planes,
    mesh_solids,
    sides_of,
)
from dolfinx_joints.geometry.meshing.step_file import (
    PLANE_FORM,
    Where,
    by_name,
    check_step_file,
    check_word,
    face_names,
    is_point,
    named_pair,
    named_plane,
    named_point,
    named_where,
    numbers,
    outer_surfaces,
    pair_of,
)

_NAMELESS = "Open CASCADE STEP translator"  # label that Open CASCADE writes for unnamed solids
_UNIT = "Geometry.OCCTargetUnit"
_GMSH = f"Gmsh declares millimetres; set its option {_UNIT} to 'M' before the export"
_FUZZY = "Geometry.ToleranceBoolean"
_BOUNDS = "Geometry.OCCBoundsUseStl"  # otherwise boxes contain the control points of splines
_OPTIONS = {"Geometry.OCCImportLabels": 1, "Geometry.OCCScaling": 1e-3, _FUZZY: 0.0, _BOUNDS: 1}
JOINED = 1e-6  # faces at a smaller distance, relative to the body's extent, are joined
WEDGE = "wedge"  # volume that planes cut out
NEAR = 2e-3  # wider gaps between faces are assumed to be intended [m]


@checked
def from_step(
    out: str | os.PathLike[str],
    step: str | os.PathLike[str],
    *,
    size: Length,
    joint_size: Length | None = None,
    order: Order = 2,
    solids: Mapping[str, Sequence[float]] | None = None,
    joints: Mapping[str, tuple[str, str]] | None = None,
    tied: Sequence[tuple[str, str]] = (),
    surfaces: Mapping[str, Where] | None = None,
    planes: Mapping[str, Plane] | None = None,
    wedge: Sequence[float] | None = None,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh the solids of a STEP file, conforming where they touch.

    Each solid name is a volume group; unnamed solids are ``solid_1``, ``solid_2``, ... in the order
    of the file. The common faces of two volumes A and B are the joint ``joint_A_B``. Outer faces
    are ``outside`` unless ``surfaces`` names them. Solids with the same name are one volume
    without internal joints. Lengths are converted from the unit of the file to metres.

    Args:
        out: path of the .msh file.
        step: the STEP file.
        size: largest cell size [m].
        joint_size: largest cell size at the joints [m]; ``size`` by default.
        order: order of the tetrahedra, 1 or 2.
        solids: names with a point (x, y, z) inside the solid [m]; they replace names in the file.
        joints: other names of joints; NAME: (A, B) makes the group ``joint_NAME``.
        tied: pairs (A, B) of volumes that are connected without a joint.
        surfaces: names of outer faces, with the plane that contains them such as ("z", "min") or
            ("x", 3.0), a direction and the largest angle to their mean outward normals, below
            90 degrees, such as ("-x", 40.0), a point (x, y, z) on one face [m], or the name of a
            face in the file.
        planes: planes by name, as in `geometry.wedge.wedge`; they bound the volume ``wedge``.
        wedge: point in the wedge [m]; the wedge is cut out of the solid around the point, and its
            face on the plane NAME is the joint ``joint_NAME``.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed, or the size is larger than the body. Also if the
            file cannot be read or has no solids, if solids cannot be built, overlap or touch no
            other solid, or if a name matches no solid or face.
        RuntimeError: if the file cannot be read in a separate process, or Gmsh fails to mesh the
            solids.
    """
    path = mesh_path(out)
    gmsh_model.check_window(gui)
    planes = planes or {}
    if bool(planes) != (wedge is not None):
        raise ValueError("planes and wedge must be given together.")
    if planes:
        check_planes(planes)
    step = Path(step)
    described = check_step_file(step)
    has_names = any(isinstance(where, str) for where in (surfaces or {}).values())
    labels = face_names(step) if has_names else []
    with gmsh_model.gmsh_session():
        unit = gmsh.option.getString(_UNIT)
        numbers = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
        # Open CASCADE uses the unit of the last file for all files that it writes later in the
        # process; restore its default, millimetres.
        gmsh.option.setString(_UNIT, "MM")
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 0)  # move nodes to the curved faces
        try:
            owner, face_of = _import(step, described, size, solids or {}, labels, planes, wedge)
            volumes = {name: [t for t in owner if owner[t] == name] for name in owner.values()}
            _warn_of_gaps(step, volumes)
            on_planes = faces_on_planes(volumes.get(WEDGE, ()), planes)
            faces = _joints(volumes, joints or {}, tied, on_planes)
            solid_of = {f: tag for tag in owner for f in faces_of(tag) if len(sides_of(f)) == 1}
            outer = outer_surfaces(solid_of, surfaces or {}, face_of)
            if shared := sorted(set(faces) & set(outer)):
                raise ValueError(f"A joint and a surface have the same name: {shared[0]!r}.")
            faces |= outer
            add_groups(3, volumes)
            add_groups(2, faces)
            mesh_solids(size, joint_size, faces, order)
            gmsh_model.save(path, gui, duplicated)
        finally:
            gmsh.option.setString(_UNIT, unit)
            for name, value in numbers.items():
                gmsh.option.setNumber(name, value)
    return path


def _import(
    step: Path,
    described: int,
    size: float,
    solids: Mapping[str, Sequence[float]],
    labels: Sequence[str],
    planes: Mapping[str, Plane],
    wedge: Sequence[float] | None,
) -> tuple[dict[int, str], dict[int, str]]:
    """Import the solids and cut them at their common faces; return their names by tag.

    With names of the faces of all solids, the second value is the name of each face after the cut.
    """
    names = []
    for number, (_, label) in enumerate(_read(step, described, scale=1.0), start=1):
        name = re.sub(r"\W+", "_", label).strip("_")
        names.append(f"solid_{number}" if not name or label.startswith(_NAMELESS) else name)
    gmsh.model.occ.remove(gmsh.model.occ.getEntities(3), recursive=True)
    gmsh.model.occ.synchronize()
    # Gmsh drops the names if it scales the shapes.
    tags = [tag for tag, _ in _read(step, described, scale=1e-3)]
    for name, point in solids.items():
        names[_solid_around(name, point, tags)] = name
    extent = _extent(step, size)
    if wedge is not None:
        if WEDGE in names:
            raise ValueError(
                f"A solid is called {WEDGE!r}, a name reserved for the wedge of planes."
            )
        host = _solid_around(WEDGE, wedge, tags)
        part, remaining = cut_wedge(tags[host], planes, wedge)
        names = [*names[:host], *[names[host]] * len(remaining), *names[host + 1 :], WEDGE]
        tags = [*tags[:host], *remaining, *tags[host + 1 :], part]
    pieces = [(3, tag) for tag in tags]
    pieces += [(2, face) for tag in tags for face in (faces_of(tag) if labels else ())]
    if labels and len(pieces) != len(tags) + len(labels):
        raise ValueError(
            f"{step} describes {len(labels)} faces of solids, of which {len(pieces) - len(tags)} "
            "were built; name surfaces by points or directions."
        )
    gmsh.option.setNumber(_FUZZY, JOINED * extent)
    children = [[piece] for piece in pieces]
    if len(tags) > 1:
        _, children = gmsh.model.occ.fragment(pieces[:1], pieces[1:])
    gmsh.model.occ.synchronize()
    owner: dict[int, str] = {}
    for name, parts in zip(names, children[: len(tags)], strict=True):
        for dim, tag in parts:
            if dim == 3 and tag in owner:
                shared = gmsh.model.occ.getMass(3, tag)
                raise ValueError(
                    f"{step}: the solids {owner[tag]!r} and {name!r} overlap by {shared:.3g} m^3, "
                    "but solids may only touch."
                )
            owner[tag] = name
    for tag, name in owner.items() if len(tags) > 1 else ():
        if not any(len(sides_of(face)) == 2 for face in faces_of(tag)):
            others = [other for other in owner if other != tag]
            gap, other = min((gmsh.model.occ.getDistance(3, tag, 3, o)[0], o) for o in others)
            raise ValueError(
                f"{step}: the solid {name!r} shares no face with another solid; {owner[other]!r} "
                f"is {gap:.3g} m away; close the gap, or mesh each solid separately."
            )
    named = zip(labels, children[len(tags) :], strict=True)
    return owner, {face: label for label, parts in named for _, face in parts}


def _read(step: Path, described: int, scale: float) -> list[tuple[int, str]]:
    """Import the shapes in millimetres times ``scale``; return each solid's tag and label."""
    gmsh.option.setNumber("Geometry.OCCScaling", scale)
    try:
        shapes = gmsh.model.occ.importShapes(str(step))
        gmsh.model.occ.synchronize()
    except Exception as error:
        raise ValueError(f"{step} cannot be read: {error}.") from None
    solids = [tag for dim, tag in shapes if dim == 3]
    if len(solids) < described:  # Open CASCADE omits solids that it cannot build
        raise ValueError(
            f"{step} describes {described} solids, of which {len(solids)} were built; the others "
            "are invalid, of a kind that Open CASCADE does not support, or belong to no part."
        )
    if not solids:
        raise ValueError(
            f"{step} has no solids, only {len(shapes)} other shapes; solids are needed."
        )
    return [(tag, gmsh.model.getEntityName(3, tag).rpartition("/")[2]) for tag in solids]


def _extent(step: Path, size: float) -> float:
    """Return the largest extent of the body [m], after checking it against the cell size."""
    extent = float(np.ptp(np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)), axis=0).max())
    unit = f"the body in {step} is {extent:.3g} m long; check its unit of length ({_GMSH})"
    if size > extent:
        raise ValueError(f"size is {size:g} m, but {unit}, or choose a smaller size.")
    if not 1.0 <= extent <= 2e4:
        warn(f"{unit[0].upper()}{unit[1:]}; 1 m to 20 km is usual.", PlausibilityWarning)
    return extent


def _warn_of_gaps(step: Path, volumes: dict[str, list[int]]) -> None:
    """Warn of outer faces of solids that are so close that a joint may be intended."""
    name = {tag: name for name, tags in volumes.items() for tag in tags}
    faces = [(tag, face) for tag in name for face in faces_of(tag) if len(sides_of(face)) == 1]
    box = {f: np.reshape(gmsh.model.getBoundingBox(2, f), (2, 3)) for _, f in faces}
    corners = {f: set(gmsh.model.getBoundary([(2, f)], recursive=True)) for _, f in faces}
    gaps: dict[tuple[int, int], float] = {}
    for (tag_1, f), (tag_2, g) in combinations(faces, 2):
        far = np.maximum(box[f][0] - box[g][1], box[g][0] - box[f][1]).max() > NEAR
        if tag_1 != tag_2 and not far and not corners[f] & corners[g]:
            gap = gmsh.model.occ.getDistance(2, f, 2, g)[0]
            gaps[tag_1, tag_2] = min(gap or np.inf, gaps.get((tag_1, tag_2), np.inf))
    for (tag_1, tag_2), gap in gaps.items():
        if gap <= NEAR:
            warn(
                f"{step}: faces of the solids {name[tag_1]!r} and {name[tag_2]!r} are {gap:.3g} m "
                "apart, without a joint between them; close the gap if a joint is intended."
            )


def _solid_around(name: str, point: Sequence[float], tags: Sequence[int]) -> int:
    """Return the place in ``tags`` of the solid around a point."""
    check_word("A solid", name)
    if not is_point(point):
        raise ValueError(
            f"The solid {shown(name)} is at {shown(point)}, but the point must be (x, y, z)."
        )
    xyz = list(map(float, point))
    hits = [place for place, tag in enumerate(tags) if gmsh.model.isInside(3, tag, xyz)]
    if len(hits) != 1:
        raise ValueError(
            f"{len(hits)} solids contain the point {tuple(point)} of {name!r}, but the point must "
            "be inside exactly one solid."
        )
    return hits[0]


def _joints(
    volumes: dict[str, list[int]],
    joints: Mapping[str, tuple[str, str]],
    tied: Sequence[tuple[str, str]],
    on_planes: dict[str, list[int]],
) -> dict[str, list[int]]:
    """Return the faces of each joint, including those on the planes of a wedge."""
    group = {tag: name for name, tags in volumes.items() for tag in tags}
    touching: dict[frozenset[str], list[int]] = {}
    for _, face in gmsh.model.getEntities(2):
        names_of = frozenset(group[tag] for tag in sides_of(face))
        if len(names_of) == 2 and not any(face in faces for faces in on_planes.values()):
            touching.setdefault(names_of, []).append(face)
    names = {
        frozenset(pair): "_".join(pair)
        for pair in combinations(volumes, 2)
        if frozenset(pair) in touching
    }
    allowed = ", ".join(" and ".join(p) for p in combinations(volumes, 2) if frozenset(p) in names)
    given = [(f"Joint {name!r}", pair, name) for name, pair in joints.items()]
    checked_pairs: set[frozenset[str]] = set()
    for subject, pair, name in [*given, *(("A tied pair", pair, None) for pair in tied)]:
        if isinstance(pair, str) or len(pair) != 2:
            raise ValueError(f"{subject} is {pair!r}, but it must be a pair of names.")
        if frozenset(pair) not in touching:
            raise ValueError(
                f"{subject} is between {shown(pair[0])[1:-1]} and {shown(pair[1])[1:-1]}, which do "
                f"not touch; touching pairs: {allowed or 'none'}."
            )
        if frozenset(pair) in checked_pairs:
            raise ValueError(f"{subject} is between {' and '.join(pair)}, which are given twice.")
        checked_pairs.add(frozenset(pair))
        if name is None:
            del names[frozenset(pair)]
        else:
            check_word("A joint", name)
            names[frozenset(pair)] = name
    if len({*(f"joint_{name}" for name in names.values()), *on_planes}) < len(names) + len(
        on_planes
    ):
        raise ValueError(f"Two joints have the same name: {', '.join(sorted(names.values()))}.")
    return {f"joint_{name}": touching[sides] for sides, name in names.items()} | on_planes


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    parser = argument_parser(from_step, "Mesh the solids of a STEP file.", "step.msh")
    parser.add_argument("step", type=Path, help="STEP file")
    for flag, kind, form, text in (
        ("solid", named_point, "NAME=X,Y,Z", "name the solid around a point [m]"),
        ("joint", named_pair, "NAME=A,B", "name the joint between two volumes"),
        ("tied", pair_of, "A,B", "no joint between two volumes"),
        ("plane", named_plane, PLANE_FORM, "bound the wedge by a plane"),
        (
            "surface",
            named_where,
            "NAME:AXIS=VALUE",
            "name outer faces, e.g. base:z=0, top:z=max, upstream:-x=40 (mean normal within 40 "
            "degrees of -x), toe:1,2,3 (a point on it [m]) or crest:FACE (name in the file)",
        ),
    ):
        parser.add_argument(
            f"--{flag}",
            type=kind,
            action="append",
            default=[],
            metavar=form,
            dest="tied" if flag == "tied" else f"{flag}s",
            help=text,
        )

    help_of_wedge = "point in the wedge, all planes bound it [m]"
    parser.add_argument("--wedge", type=numbers, metavar="X,Y,Z", help=help_of_wedge)

    def model(out: Path, **options: object) -> Path:
        for option in ("solids", "joints", "surfaces", "planes"):
            options[option] = by_name(option, options[option])  # type: ignore[arg-type]
        return from_step(out, **options)  # type: ignore[arg-type]

    gmsh_model.run_script(parser, model, argv)


if __name__ == "__main__":
    main()
