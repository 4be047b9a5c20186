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
except ImportError:  # tests of records, spectra, results and plots also run without MPI
    MPI = None


# Allowed energy errors of a static stage, relative to its largest energy. Solvers accept a residual
# of 1e-10 of the forces.
LEDGER_ERROR = 1e-10
RIGID_ERROR = 1e-7


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the tests without the marker ``mpi`` on several ranks."""
    if MPI is None or MPI.COMM_WORLD.size == 1:
        return
    single = [item for item in items if item.get_closest_marker("mpi") is None]
    config.hook.pytest_deselected(items=single)
    items[:] = [item for item in items if item not in single]


def pytest_unconfigure(config: pytest.Config) -> None:
    """End all ranks if a test failed on one of them: the others may be waiting for it."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    failed = reporter is not None and any(reporter.stats.get(k) for k in ("failed", "error"))
    if MPI is not None and MPI.COMM_WORLD.size > 1 and failed:
        sys.stdout.flush()
        MPI.COMM_WORLD.Abort(1)


@pytest.fixture(scope="session", autouse=True)
def freed_only_together() -> None:
    """Disable garbage collection on several ranks, so that only `freed_together` frees meshes.

    Imported objects are excluded (``gc.freeze``): examining them takes longer than most tests.
    """
    if MPI is not None and MPI.COMM_WORLD.size > 1:
        gc.disable()
        gc.freeze()


@pytest.fixture(autouse=True)
def freed_together() -> Iterator[None]:
    """Free meshes after each test, on all ranks at the same point.

    MPI requires that all ranks free a communicator together. Python's collector runs at a different
    time on each rank, and Open MPI 5.0.7 then waited without end in the next MPI_Comm_dup.
    """
    yield
    if MPI is not None and MPI.COMM_WORLD.size > 1:
        gc.collect()


@pytest.fixture(autouse=True)
def static_ledgers_close(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check in all tests that the energies of each static stage balance to `LEDGER_ERROR`.

    A larger residual that a solver reports is allowed, too, and the rounding error of K u, about
    eps |K| |u|, which matters for stiff blocks with large displacements. With rigid joints
    `RIGID_ERROR` is allowed, because unresolved openings of rigid points are set to zero.
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
        allowed = max([least, *(report.residual for report in state.reports)])
        rounding = 16.0 * sys.float_info.epsilon * size
        assert abs(state.energy.error) <= allowed * state.energy.scale + rounding
        return state

    monkeypatch.setattr(stages, "march", checked)


@pytest.fixture(scope="session")
def comm() -> Any:
    """Communicator of all ranks that run the tests."""
    return pytest.importorskip("mpi4py.MPI").COMM_WORLD


@pytest.fixture(scope="session")
def new_path(comm: Any, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """``new_path(name)``: a new path at each call, in a folder shared by all ranks (collective)."""
    made = str(tmp_path_factory.mktemp("shared")) if comm.rank == 0 else None
    folder = Path(comm.bcast(made, root=0))
    count = itertools.count()
    return lambda name: folder / f"{next(count)}_{name}"


@pytest.fixture(scope="session")
def mesh_file(comm: Any, new_path: Callable[[str], Path]) -> Callable[..., Path]:
    """``mesh_file(script, **parameters)``: a script's .msh file, written once (collective)."""
    pytest.importorskip("gmsh")
    cache: dict[tuple[Any, ...], Path] = {}

    def make(script: Callable[..., Any], **parameters: Any) -> Path:
        key = (script.__name__, repr(sorted(parameters.items())))
        if key not in cache:
            cache[key] = new_path(f"{script.__name__}.msh")
            failure = None
            if comm.rank == 0:
                try:
                    script(cache[key], **parameters)
                except Exception as exc:
                    failure = exc
            failure = comm.bcast(failure, root=0)
            if failure is not None:
                raise failure
        return cache[key]

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
        base, low_right, joint, low_left, up_right, top, up_left = lines
        lower = geo.addPlaneSurface([geo.addCurveLoop([base, low_right, joint, low_left])])
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
        groups += [("top", 1, [top]), ("sides", 1, [low_right, low_left, up_right, up_left])]
        for name, dim, tags in [*groups, ("joint_1", 1, [joint])]:
            gmsh.model.addPhysicalGroup(dim, tags, name=name)
        gmsh.write(str(out))


@pytest.fixture(scope="session")
def two_rectangles_file(mesh_file: Callable[..., Path]) -> Callable[..., Path]:
    """``two_rectangles_file(cell=, order=, angle=)``: ``two_blocks`` in 2-D."""
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
    """``read(path)``: the mesh on all ranks, or on those of ``on``; read once (collective)."""
    from dolfinx_joints import read_msh

    cache: dict[tuple[Any, ...], Any] = {}

    def load(path: Path, on: Any = None, joints: list[str] | None = None) -> Any:
        on = comm if on is None else on
        key = (str(path), on.size, None if joints is None else tuple(joints))
        if key not in cache:
            cache[key] = read_msh(path, on, joints=joints)
        return cache[key]

    return load
