# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Content of a Gmsh mesh file by group, and the volume of a dam from its formulas."""

import gmsh
import numpy as np

from dolfinx_joints.geometry.meshing import gmsh_model

ELEMENTS = [("hex", 1, "hex8"), ("hex", 2, "hex27"), ("tet", 1, "tet4"), ("tet", 2, "tet10")]

FACES = {
    (3, 8): [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
    (3, 4): [[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]],
    (2, 4): [[0, 1], [1, 2], [2, 3], [3, 0]],
    (2, 3): [[0, 1], [1, 2], [2, 0]],
}


class Groups:
    """The content of a mesh file: nodes by group, vertices of cells and facets."""

    def __init__(self, path):
        with gmsh_model.gmsh_session():
            gmsh.merge(str(path))
            tags, points, _ = gmsh.model.mesh.getNodes()
            number = np.zeros(int(tags.max()) + 1, dtype=int)
            number[tags] = np.arange(tags.size)
            self.points = points.reshape(-1, 3)
            self.nodes, self.facets, self.cells = {}, {}, {}
            self.dim = gmsh.model.getDimension()
            for dim, physical in gmsh.model.getPhysicalGroups():
                name = gmsh.model.getPhysicalName(dim, physical)
                (entity,) = gmsh.model.getEntitiesForPhysicalGroup(dim, physical)
                (kind,), _, (flat,) = gmsh.model.mesh.getElements(dim, entity)
                size, corners = gmsh.model.mesh.getElementProperties(kind)[3::2][:2]
                nodes = number[flat.reshape(-1, size)]
                self.nodes[name] = np.unique(nodes)
                (self.cells if dim == self.dim else self.facets)[name] = nodes[:, :corners]

    def at(self, name):
        return self.points[self.nodes[name]]


def check_groups(groups):
    """Check that each outer facet is in one group and each joint facet between two cells."""
    cells = np.concatenate(list(groups.cells.values()))
    faces = np.array(FACES[groups.dim, cells.shape[1]])
    faces = np.sort(cells[:, faces].reshape(-1, faces.shape[1]))
    faces, count = np.unique(faces, axis=0, return_counts=True)
    assert set(count) <= {1, 2}  # the mesh is conforming
    inner = {tuple(f) for f in faces[count == 2]}
    named = [
        tuple(sorted(f))
        for name, facets in groups.facets.items()
        if not name.startswith("joint")
        for f in facets
    ]
    assert len(named) == len(set(named))
    assert set(named) == {tuple(f) for f in faces[count == 1]}
    joint = [
        tuple(sorted(f))
        for name, facets in groups.facets.items()
        if name.startswith("joint")
        for f in facets
    ]
    assert len(joint) == len(set(joint))
    assert set(joint) <= inner


def area(groups, name):
    """Return the area of a surface of plane facets, or of plane cells [m^2]."""
    x = groups.points[(groups.facets | groups.cells)[name]]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    if x.shape[1] == 4:
        normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    return 0.5 * np.linalg.norm(normal, axis=1).sum()


def facet_area(path, name):
    """Return the area of a surface group of plane triangles [m^2]."""
    with gmsh_model.gmsh_session():
        gmsh.merge(str(path))
        for dim, physical in gmsh.model.getPhysicalGroups(2):
            if gmsh.model.getPhysicalName(dim, physical) == name:
                tags = gmsh.model.getEntitiesForPhysicalGroup(dim, physical)
                total = 0.0
                for tag in tags:
                    (kind,), _, _ = gmsh.model.mesh.getElements(2, tag)
                    points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
                    _, det, _ = gmsh.model.mesh.getJacobians(kind, points, tag)
                    total += float((det.reshape(-1, weights.size) @ weights).sum())
                return total
    raise AssertionError(name)


def dam_volume(dam, top=1.0):
    """Integrate the volume of an arch dam from its formulas [m^3].

    At each level the section is the integral over s of (R^2 - (R - t)^2)/2 phi; zeta = u^5 makes
    the integrand smooth at the base, where the chord grows as zeta^0.6 = u^3.
    """
    u, weights = np.polynomial.legendre.leggauss(40)
    s, zeta = u[None, :], (((u + 1) / 2) ** 5 * top)[:, None]
    r, t = dam.radius(zeta), dam.thickness(zeta, s)
    section = (r * t - 0.5 * t**2) @ weights * dam.half_angle(zeta[:, 0])
    return dam.height * top * (section * 2.5 * ((u + 1) / 2) ** 4) @ weights
