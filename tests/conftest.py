# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes shared by the tests and by all ranks."""

import gc
import itertools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

try:
    from mpi4py import MPI
except ImportError:  # records, spectra, results and plots are tested without MPI as well
    MPI = None


# Of the largest energy of a static stage: the residual that solvers accept is 1e-10 of the forces.
LEDGER_ERROR = 1e-10
RIGID_ERROR = 1e-7


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out on several ranks what is written for one."""
    if MPI is None or MPI.COMM_WORLD.size == 1:
        return
    single = [item for item in items if item.get_closest_marker("mpi") is None]
    config.hook.pytest_deselected(items=single)
    items[:] = [item for item in items if item not in single]


def pytest_unconfigure(config: pytest.Config) -> None:
    """End every rank where the tests of one failed, which may have left the others waiting."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    failed = reporter is not None and any(reporter.stats.get(k) for k in ("failed", "error"))
    if MPI is not None and MPI.COMM_WORLD.size > 1 and failed:
        sys.stdout.flush()
        MPI.COMM_WORLD.Abort(1)


@pytest.fixture(scope="session", autouse=True)
def freed_only_together() -> None:
    """Leave it to `freed_together` to free meshes on several ranks.

    What has been imported is left out: to look through it would take longer than most tests.
    """
    if MPI is not None and MPI.COMM_WORLD.size > 1:
        gc.disable()
        gc.freeze()


@pytest.fixture(autouse=True)
def freed_together() -> Iterator[None]:
    """Free meshes on all ranks at the same place, as MPI asks for their communicators.

    Left to Python's collector, which runs at another time on each rank, Open MPI 5.0.7 was seen to
    wait for ever in the next MPI_Comm_dup.
    """
    yield
    if MPI is not None and MPI.COMM_WORLD.size > 1:
        gc.collect()


@pytest.fixture(autouse=True)
def static_ledgers_close(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check in all tests that the energies of each static stage balance to `LEDGER_ERROR`.

    Beside it the residual that a solver reports is allowed, and rounding of K u, of some
    eps |K| |u|: of stiff blocks that move far. Openings of rigid points that a solve does not
    resolve are set to zero, which leaves `RIGID_ERROR`.
    """
    stages = sys.modules.get("dolfinx_joints.simulation.simulation")
    if stages is None:
        return
    march = stages.march

    def checked(model: Any, *arguments: Any, **options: Any) -> Any:
        state = march(model, *arguments, **options)
        size = model.stiffness.norm() * state.displacement.norm() ** 2
        rigid = model.contact is not None and model.contact.rigid
        least = RIGID_ERROR if rigid else LEDGER_ERROR
        left = max([least, *(report.residual for report in state.reports)])
        rounding = 16.0 * sys.float_info.epsilon * size
        assert abs(state.energy.error) <= left * state.energy.scale + rounding
        return state

    monkeypatch.setattr(stages, "march", checked)


@pytest.fixture(scope="session")
def comm() -> Any:
    """The communicator of all ranks that run the tests."""
    return pytest.importorskip("mpi4py.MPI").COMM_WORLD


@pytest.fixture(scope="session")
def new_path(comm: Any, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Paths in one folder that all ranks see, a new one for each call (collective)."""
    made = str(tmp_path_factory.mktemp("shared")) if comm.rank == 0 else None
    folder = Path(comm.bcast(made, root=0))
    count = itertools.count()
    return lambda name: folder / f"{next(count)}_{name}"


@pytest.fixture(scope="session")
def mesh_file(comm: Any, new_path: Callable[[str], Path]) -> Callable[..., Path]:
    """``mesh_file(script, **parameters)``: its .msh file, written once by rank 0 (collective)."""
    pytest.importorskip("gmsh")
    known: dict[tuple[Any, ...], Path] = {}

    def make(script: Callable[..., Any], **parameters: Any) -> Path:
        key = (script.__name__, repr(sorted(parameters.items())))
        if key not in known:
            known[key] = new_path(f"{script.__name__}.msh")
            failure = None
            if comm.rank == 0:
                try:
                    script(known[key], **parameters)
                except Exception as exc:
                    failure = exc
            failure = comm.bcast(failure, root=0)
            if failure is not None:
                raise failure
        return known[key]

    return make


def _two_rectangles(
    out: Path, *, cell: str = "quad", order: int = 1, angle: float = 20.0, divisions: int = 3
) -> None:
    """Mesh [0, 1] x [0, 2] with a joint through (1/2, 1), ``angle`` degrees from the horizontal.

    Groups as in ``two_blocks``: surfaces ``lower``, ``upper``; lines ``base``, ``top``, ``sides``
    and ``joint_1``.
    """
    import math

    import gmsh

    from dolfinx_joints.geometry.meshing.gmsh_model import gmsh_session

    rise = 0.5 * math.tan(math.radians(angle))
    with gmsh_session():
        geo = gmsh.model.geo
        corners = [(0, 0), (1, 0), (1, 1 + rise), (0, 1 - rise), (1, 2), (0, 2)]
        p = [geo.addPoint(x, y, 0) for x, y in corners]
        ends = [(0, 1), (1, 2), (2, 3), (3, 0), (2, 4), (4, 5), (5, 3)]
        lines = [geo.addLine(p[a], p[b]) for a, b in ends]
        base, right, joint, left, up_right, top, up_left = lines
        lower = geo.addPlaneSurface([geo.addCurveLoop([base, right, joint, left])])
        upper = geo.addPlaneSurface([geo.addCurveLoop([-joint, up_right, top, up_left])])
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, divisions + 1)
        for surface in (lower, upper):
            geo.mesh.setTransfiniteSurface(surface)
            if cell == "quad":
                geo.mesh.setRecombine(2, surface)
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        groups = [("lower", 2, [lower]), ("upper", 2, [upper]), ("base", 1, [base])]
        groups += [("top", 1, [top]), ("sides", 1, [right, left, up_right, up_left])]
        for name, dim, tags in [*groups, ("joint_1", 1, [joint])]:
            gmsh.model.addPhysicalGroup(dim, tags, name=name)
        gmsh.write(str(out))


@pytest.fixture(scope="session")
def two_rectangles_file(mesh_file: Callable[..., Path]) -> Callable[..., Path]:
    """``two_rectangles_file(cell=, order=, angle=)``: the plane twin of ``two_blocks``."""
    return lambda **parameters: mesh_file(_two_rectangles, **parameters)


@pytest.fixture(scope="session")
def blocks_file(mesh_file: Callable[..., Path]) -> Callable[..., Path]:
    """``blocks_file(**parameters)``: two blocks, coarse, inclined by 20 degrees by default."""
    from dolfinx_joints.geometry.two_blocks import two_blocks

    return lambda **parameters: mesh_file(two_blocks, **{"size": 0.5, "angle": 20.0, **parameters})


@pytest.fixture(scope="session")
def wall_file(mesh_file: Callable[..., Path]) -> Callable[..., Path]:
    """``wall_file(**parameters)``: a jointed wall of 4 x 1 x 3 cells by default."""
    from dolfinx_joints.geometry.jointed_wall import jointed_wall

    return lambda **parameters: mesh_file(jointed_wall, **{"divisions": (4, 1, 3), **parameters})


@pytest.fixture(scope="session")
def read(comm: Any) -> Callable[..., Any]:
    """``read(path)``: the mesh on all ranks, or on ``comm=``; read once (collective)."""
    from dolfinx_joints import read_msh

    known: dict[tuple[Any, ...], Any] = {}

    def load(path: Path, on: Any = None, joints: list[str] | None = None) -> Any:
        on = comm if on is None else on
        key = (str(path), on.size, None if joints is None else tuple(joints))
        if key not in known:
            known[key] = read_msh(path, on, joints=joints)
        return known[key]

    return load
