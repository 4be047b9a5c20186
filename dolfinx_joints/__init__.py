# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Seismic response of jointed structures on FEniCSx: friction no-tension joints in dams.

The public names below are imported on first use, so that ``import dolfinx_joints`` is light and
records, spectra, results and plots work without DOLFINx.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "abort_on_error": "parallel",
    "AnnualWave": "temperature_fields",
    "BaseMotion": "loads",
    "CheckpointError": "errors",
    "Checkpoints": "checkpoint",
    "Constraints": "supports",
    "ConvergenceError": "errors",
    "Elastic": "elasticity",
    "DruckerPrager": "plasticity",
    "EnergyConsistent": "schemes",
    "FieldMonitor": "monitors",
    "Fixed": "supports",
    "FormLoad": "loads",
    "FrictionNoTension": "laws",
    "FreeField": "free_field",
    "frictionless": "law_options",
    "GeneralizedAlpha": "schemes",
    "Gravity": "loads",
    "HilberHughesTaylor": "schemes",
    "HydrostaticPressure": "water",
    "ImplicitContact": "schemes",
    "JointedMesh": "mesh",
    "JointsError": "errors",
    "JointWater": "joint_water",
    "KeyedJoint": "law_options",
    "JointForces": "joint_forces",
    "MatrixSystem": "system",
    "MeshError": "errors",
    "Model": "model",
    "MohrCoulombJoint": "mohr_coulomb",
    "Motion": "records",
    "Newmark": "schemes",
    "NewtonOptions": "solver",
    "Orthotropic": "orthotropic",
    "Prescribed": "supports",
    "Pressure": "loads",
    "ProgressMonitor": "monitors",
    "Rayleigh": "damping",
    "RecordError": "errors",
    "Results": "results",
    "ResultsError": "errors",
    "ResultsMonitor": "monitors",
    "redistribute": "redistribution",
    "ReservoirMass": "reservoir",
    "ReservoirTemperature": "temperature_fields",
    "RigidJoint": "rigid",
    "SeepageLine": "joint_water",
    "seasonal_temperatures": "temperature_fields",
    "SiltPressure": "water",
    "Simulation": "simulation",
    "Spring": "supports",
    "SupportForces": "free_field",
    "StepControl": "stepping",
    "StiffnessProposal": "stiffness",
    "Temperature": "thermal",
    "TemperatureError": "errors",
    "temperature_from_file": "temperature_file",
    "Traction": "loads",
    "ViscousBoundary": "absorbing",
    "Uplift": "joint_water",
    "ViscousJoint": "law_options",
    "WestergaardMass": "water",
    "incident_wave": "free_field",
    "mass_proportional": "damping",
    "modal_damping": "damping_ratios",
    "modes": "modal",
    "write_csv": "tables",
    "write_modes": "mode_files",
    "propose_stiffness": "stiffness",
    "rayleigh": "damping",
    "read_msh": "mesh",
    "read_record": "record_reading",
    "split_mesh": "mesh",
    "steady_temperature": "temperature_fields",
    "stiffness_proportional": "damping",
    "synthetic_motion": "records",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
