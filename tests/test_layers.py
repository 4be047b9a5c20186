# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Who may import whom, and what ``import dolfinx_joints`` costs."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "dolfinx_joints"
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py") if path.stem != "__init__")

# A module imports only from levels below its own; tenths order the modules of one level.
LEVELS = {
    "checks": 0.0,
    "errors": 0.0,
    "parallel": 0.1,
    "memory": 0.1,
    "_compat": 0.1,
    "quadrature": 0.1,
    "lowrank": 0.0,
    "gmres": 0.0,
    "row_matrix": 0.0,
    "midpoint_law": 0.0,
    "end_point_law": 0.0,
    "laws": 0.1,
    "law_options": 0.2,
    "mohr_coulomb": 0.2,
    "rigid": 0.2,
    "redistribution": 4.5,
    "stiffness": 0.2,
    "motion_processing": 0.0,
    "records": 0.1,
    "record_text": 0.2,
    "record_formats": 0.3,
    "record_columns": 0.3,
    "record_cosmos": 0.4,
    "record_reading": 0.5,
    "hdf5_checks": 0.05,
    "results": 0.1,
    "result_requests": 0.15,
    "command_line": 0.0,
    "exact": 0.1,
    "slabs": 0.0,
    "memory_use": 0.1,
    "results_stream": 0.2,
    "file_lock": 0.1,
    "results_room": 0.1,
    "results_writer": 0.3,
    "results_layout": 0.4,
    "checkpoint_file": 0.1,
    "joint_surface": 0.2,
    "envelopes": 0.4,
    "spectra": 0.2,
    "spectrum_matching": 0.3,
    "study_table": 0.2,
    "study_case": 0.3,
    "study": 0.3,
    "cells": 0.1,
    "orientation": 0.2,
    "report_page": 0.1,
    "report_runs": 1.1,
    "report_figures": 0.2,
    "report_scene": 1.2,
    "report_sections": 1.3,
    "report_response": 1.4,
    "report_body": 1.5,
    "paper_statements": 1.5,
    "report": 1.6,
    "cli": 1.7,
    "__main__": 1.8,
    "splitting": 1.0,
    "msh_checks": 0.1,
    "msh": 1.1,
    "rendering": 0.1,
    "pictures": 0.2,
    "measures": 1.0,
    "resultants": 0.2,
    "tables": 1.1,
    "results_overview": 0.2,
    "mode_files": 6.1,
    "water_pressures": 5.1,
    "joint_forces": 6.35,
    "joint_values": 1.05,
    "plots": 1.1,
    "response_plots": 1.2,
    "motion_plots": 1.3,
    "views": 1.1,
    "gathering": 1.2,
    "mesh": 2.0,
    "jointpoints": 2.1,
    "joints": 2.2,
    "contact": 3.0,
    "small_displacements": 3.1,
    "absorbing": 2.9,
    "orthotropic": 0.1,
    "plasticity": 0.2,
    "elasticity": 3.0,
    "bulk_points": 3.1,
    "resistance": 3.1,
    "plastic_bulk": 3.2,
    "damping": 3.0,
    "supports": 3.0,
    "wetted": 3.0,
    "system": 4.0,
    "model_checks": 4.0,
    "matrices": 4.0,
    "loads": 4.0,
    "water": 4.1,
    "reservoir": 4.1,
    "joint_paths": 2.2,
    "joint_pressures": 4.0,
    "joint_water": 4.1,
    "joint_water_state": 4.1,
    "thermal": 4.1,
    "free_field": 4.1,
    "temperature_fields": 4.2,
    "temperature_file": 1.0,
    "krylov": 4.0,
    "factor_faults": 4.0,
    "manifest": 0.1,
    "linear": 4.1,
    "joint_springs": 4.1,
    "unit_forces": 4.15,
    "compliance": 4.2,
    "tangent": 4.2,
    "solver": 4.25,
    "corrections": 4.3,
    "condensed": 4.4,
    "joint_step": 4.45,
    "interface": 4.5,
    "solver_choice": 4.6,
    "model": 5.0,
    "modal": 5.0,
    "damping_ratios": 5.1,
    "states": 5.0,
    "schemes": 5.1,
    "energy": 6.0,
    "stepping": 6.1,
    "stages": 6.2,
    "construction": 6.3,
    "static_run": 6.4,
    "dynamic_run": 6.3,
    "fingerprint": 6.3,
    "checkpoint": 6.4,
    "simulation": 7.0,
    "probes": 6.0,
    "stresses": 6.1,
    "monitors": 8.0,
}

# What runs without DOLFINx, PETSc and MPI.
LIGHT = [
    "errors",
    "midpoint_law",
    "end_point_law",
    "laws",
    "gmres",
    "lowrank",
    "row_matrix",
    "law_options",
    "mohr_coulomb",
    "stiffness",
    "orthotropic",
    "plasticity",
    "exact",
    "slabs",
    "motion_processing",
    "records",
    "record_text",
    "record_formats",
    "record_columns",
    "record_cosmos",
    "record_reading",
    "spectra",
    "spectrum_matching",
    "results",
    "results_stream",
    "hdf5_checks",
    "file_lock",
    "results_room",
    "results_writer",
    "results_layout",
    "checkpoint_file",
    "memory_use",
    "study_table",
    "study_case",
    "study",
    "envelopes",
    "temperature_file",
    "measures",
    "resultants",
    "tables",
    "results_overview",
    "joint_values",
    "rendering",
    "pictures",
    "plots",
    "response_plots",
    "motion_plots",
    "views",
    "report_runs",
    "report",
    "cli",
]


def imports(module: str, *, all_of_them: bool) -> set[str]:
    """Modules of the package that ``module`` imports: when it is imported itself, or anywhere.

    Imports under ``if TYPE_CHECKING`` are annotations and count in neither case.
    """
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    found: set[str] = set()

    def visit(nodes: list[ast.stmt]) -> None:
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
                found.update(
                    part[1]
                    for name in names
                    if (part := name.split("."))[0] == "dolfinx_joints" and part[1] in MODULES
                )
            elif isinstance(node, ast.Import):
                found.update(
                    alias.name.split(".")[1]
                    for alias in node.names
                    if alias.name.startswith("dolfinx_joints.")
                )
            elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
                visit(node.orelse)
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                if all_of_them or isinstance(node, ast.ClassDef):
                    visit(node.body)
            else:
                for name in ("body", "orelse", "handlers", "finalbody"):
                    visit(getattr(node, name, []))

    visit(tree.body)
    return found


def test_every_module_has_a_level():
    # A new module gets a level in the table above.
    assert set(LEVELS) == set(MODULES)


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_downwards(module):
    known = imports(module, all_of_them=False) & set(LEVELS)
    wrong = {other for other in known if LEVELS[other] >= LEVELS.get(module, 9.0)}
    assert not wrong, f"{module} imports from its own level or above: {', '.join(sorted(wrong))}"


def test_no_cycles_even_within_functions():
    graph = {module: imports(module, all_of_them=True) for module in MODULES}
    graph["mesh"].discard("gathering")  # a function of mesh uses it; it needs nothing of mesh
    assert "mesh" not in graph["gathering"]
    left = dict(graph)
    while left:
        free = [module for module, needs in left.items() if not needs & set(left)]
        assert free, f"a cycle among {', '.join(sorted(left))}"
        for module in free:
            del left[module]


@pytest.mark.parametrize("module", MODULES)
def test_relative_and_star_imports_are_not_used(module):
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0
            assert all(alias.name != "*" for alias in node.names)


@pytest.mark.parametrize("module", MODULES)
def test_communicators_come_from_the_caller(module):
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    used |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert "COMM_WORLD" not in used


def test_matplotlib_is_imported_for_plots_only():
    users = [
        module
        for module in MODULES
        if any(
            name.split(".")[0] == "matplotlib"
            for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8")))
            for name in _imported(node)
        )
    ]
    assert set(users) <= {
        "plots",
        "joint_surface",
        "joint_values",
        "motion_plots",
        "pictures",
        "response_plots",
        "views",
    }


def _imported(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if isinstance(node, ast.ImportFrom) else []


def run(code: str) -> str:
    """Output of a Python process that finds the package."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_is_light():
    heavy = ("dolfinx", "petsc4py", "slepc4py", "mpi4py", "gmsh", "matplotlib", "scipy", "h5py")
    code = f"import sys, dolfinx_joints; print([m for m in {heavy} if m in sys.modules])"
    assert run(code).strip() == "[]"


def test_public_names_exist():
    pytest.importorskip("dolfinx")
    code = "import dolfinx_joints as d; [getattr(d, n) for n in d.__all__]; print(len(d.__all__))"
    assert int(run(code)) > 20


def test_public_names_are_listed_before_their_first_use():
    import dolfinx_joints

    assert set(dolfinx_joints.__all__) <= set(dir(dolfinx_joints))


def test_unknown_name_is_an_attribute_error():
    import dolfinx_joints

    with pytest.raises(AttributeError, match="module 'dolfinx_joints' has no attribute 'Nothing'"):
        dolfinx_joints.Nothing  # noqa: B018


BLOCKED = """
import importlib, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"dolfinx", "petsc4py", "slepc4py", "mpi4py", "basix", "ufl"}:
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Refuse())
"""


@pytest.mark.parametrize("module", LIGHT)
def test_light_modules_need_no_dolfinx(module):
    if module in ("plots", "response_plots", "motion_plots"):
        pytest.importorskip("matplotlib")
    run(f"{BLOCKED}\nimportlib.import_module('dolfinx_joints.{module}')")


def test_light_names_work_without_dolfinx():
    # A spectrum of a made-up motion and a law at work, with every heavy import refused.
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
