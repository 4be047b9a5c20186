# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tests of imports: time and public names of ``import dolfinx_joints``, modules that runs load.

Scenes of `benchmarks.lean` are runs to the first step; docs/design.md has the counts of modules.
"""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "dolfinx_joints"
FOLDERS = sorted({path.parent for path in PACKAGE.rglob("*.py")})
LIGHT = ("laws", "materials", "motions", "results", "postprocessing", "report")
BLOCKED = """
import importlib, pkgutil, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"dolfinx", "petsc4py", "slepc4py", "mpi4py", "basix", "ufl"}:
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Refuse())
"""

OUTPUT = ("report", "export", "geometry", "exact")
PLASTIC = ("body.nonlinear_cells", "body.strain_operator", "materials.drucker_prager")
RESULTS = (*OUTPUT, *PLASTIC, "gradient", "monitors", "postprocessing", "results", "study")
JOINTS = (
    "solvers.interface",
    "solvers.compliance",
    "solvers.pseudo_time",
    "solvers.multigrid.tangent",
)
LAWS = ("laws.friction", "laws.rigid", "laws.mohr_coulomb", "laws.points.discrete_gradient")
WATER = ("loads.water",)
# Parts that a scene uses, parts that it must not load, and the largest number of modules.
LOADS = {
    "linear 2-D": ("body", (*RESULTS, *JOINTS, *LAWS, *WATER), 150),
    "friction 3-D": ("laws.friction", (*RESULTS, *WATER, "solvers.multigrid.tangent"), 180),
    "bonds": ("laws.mohr_coulomb", (*RESULTS, *WATER, "solvers.multigrid.tangent"), 180),
    "water": ("loads.water.reservoir_waves", (*RESULTS, *JOINTS, *LAWS), 160),
    "free field": ("loads.free_field", (*RESULTS, *JOINTS, *LAWS, *WATER), 150),
    "motion suite": (
        "study.motion_suite",
        (*OUTPUT, *PLASTIC, "gradient", "study.fragility_curves"),
        235,
    ),
}


def run(code: str) -> str:
    """Output of a Python process that finds the package."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=PACKAGE.parent, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_is_light():
    heavy = ("dolfinx", "petsc4py", "slepc4py", "mpi4py", "gmsh", "matplotlib", "scipy", "h5py")
    code = f"import sys, dolfinx_joints; print([m for m in {heavy} if m in sys.modules])"
    assert run(code).strip() == "[]"


@pytest.mark.parametrize("scene", LOADS)
def test_runs_load_what_they_use(scene):
    pytest.importorskip("dolfinx")
    from benchmarks import lean

    used, unneeded, most = LOADS[scene]
    row = lean.measure(scene)
    loaded = {module.removeprefix("dolfinx_joints.") for module in row["modules"]}
    assert used in loaded
    excess = [m for m in loaded if any(f"{m}.".startswith(f"{part}.") for part in unneeded)]
    assert sorted(excess) == []
    assert len(loaded) <= most
    files = {"h5py"} if scene == "motion suite" else set()
    unused = {"h5py", "gmsh", "matplotlib", "pyvista", *lean.PARTS_OF_SCIPY}
    assert set(row["libraries"]) & unused == files


def test_public_names_exist_and_dir_shows_nothing_else():
    pytest.importorskip("dolfinx")
    code = "import dolfinx_joints as d, dolfinx_joints.geometry; print(dir(d) == sorted(d.__all__))"
    assert run(f"{code}; [getattr(d, name) for name in d.__all__]").strip() == "True"


@pytest.mark.slow
def test_public_names_are_known_to_static_analysis(tmp_path):
    # As in an editor: from the stub, names with their types, and an error for any other.
    pytest.importorskip("mypy")
    import dolfinx_joints

    lines = [f"dj.{name}" for name in dolfinx_joints.__all__]
    lines += ["reveal_type(dj.Elastic(young=1.0, poisson=0.0, density=1.0))", "dj.Nothing"]
    script = tmp_path / "script.py"
    script.write_text("\n".join(["import dolfinx_joints as dj", *lines]))
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", str(script)]
    done = subprocess.run(
        command, cwd=PACKAGE.parent, capture_output=True, text=True, timeout=600, check=False
    )
    assert "found 1 error" in done.stdout.lower(), done.stdout
    assert 'Module has no attribute "Nothing"' in done.stdout
    assert 'Revealed type is "dolfinx_joints.materials.elastic.Elastic"' in done.stdout


def test_unknown_name_is_an_attribute_error():
    import dolfinx_joints

    with pytest.raises(AttributeError, match="No dolfinx_joints attribute Nothing"):
        dolfinx_joints.Nothing  # noqa: B018


@pytest.mark.parametrize("wing", LIGHT)
def test_light_wings_need_no_dolfinx(wing):
    if wing in ("postprocessing", "report"):
        pytest.importorskip("matplotlib")
    run(
        BLOCKED
        + f"""
wing = importlib.import_module("dolfinx_joints.{wing}")
for module in pkgutil.walk_packages(wing.__path__, wing.__name__ + "."):
    importlib.import_module(module.name)
"""
    )


def test_light_names_work_without_dolfinx():
    # A law at work, with every heavy import refused.
    out = run(
        BLOCKED
        + """
import numpy as np
from dolfinx_joints import FrictionNoTension, Motion, Results, read_record, spectra
from dolfinx_joints.laws.law import JointState
law = FrictionNoTension(normal_stiffness=1e9, shear_stiffness=1e9, friction_angle_deg=30.0)
state = JointState.at_rest(np.zeros((1, 3)))
print(law.backward_euler(np.array([[-1e-3, 0, 0]]), state).traction[0, 0])
"""
    )
    assert float(out) == pytest.approx(-1e6)


def test_communicators_come_from_the_caller():
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        used |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        assert "COMM_WORLD" not in used, path


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_folders_and_modules_stay_small(folder):
    modules = [path for path in folder.glob("*.py") if path.stem != "__init__"]
    rooms = modules + [path for path in folder.iterdir() if path in FOLDERS]
    assert len(rooms) >= 2, folder
    assert len(modules) <= (5 if folder == PACKAGE else 14), folder
    for path in modules:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 400, path
