# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report section on the assumptions of the model and on what the runs do not cover."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report.page import Section, bullets, heading, plain, reference
from dolfinx_joints.report.parameter_sections import parsed
from dolfinx_joints.report.runs import Content, Run, grouped

_SMALL = (
    "Strains and displacements are small: equilibrium holds in the undeformed body, and joint "
    "points keep their initial partners."
)
_MATERIALS = {
    "Elastic": "is linear elastic and isotropic: it does not crack or yield",
    "Orthotropic": "is linear elastic with three planes of symmetry: it does not crack or yield",
    "DruckerPrager": "is elastic and perfectly plastic with the limit of Drucker and Prager",
    "UflMaterial": "follows a user-defined law of the strain in UFL",
    "NumpyMaterial": "follows a user-defined law of the strain in NumPy",
}
_LAWS = {
    "FrictionNoTension": "transmit pressure elastically, shear up to Coulomb's limit, no tension",
    "MohrCoulombJoint": "are bonded up to the limit of Mohr and Coulomb, and then rub",
    "AdhesiveJoint": "transmit pressure, tension, and shear with an adhesion that stays",
    "CohesiveJoint": "are bonded; the bond softens as it breaks, and the broken part rubs",
    "RigidJoint": "transmit pressure without overlap, shear up to Coulomb's limit, no tension",
    "KeyedJoint": "transmit pressure elastically, no tension, and shear by keys at any opening",
    "ShearKeyJoint": "rub and have shear keys, whose teeth can shear off",
}
_FRICTIONLESS = re.compile(r"\b(friction_coefficient|shear_stiffness)=0\.0\b")
_RAYLEIGH = {"mass_factor": "1/s times the mass", "stiffness_factor": "s times the stiffness"}
_LIMITS = ("Ten steps per period", "Ten nodes per shear wavelength")  # of `Resolved`
_WAVES = {"ViscousBoundary", "FreeField", "ObliqueFreeField"}  # boundaries that absorb waves
_DRY = {"Gravity", "Temperature", "FreeField", "ObliqueFreeField"}
_ON_FACES = {"HydrostaticPressure", "SiltPressure"}


def assumptions(content: Content, sections: Sequence[Section]) -> Section:
    """Return the section, from the files of the runs and from the other sections."""
    labels = [run.label for run in content.runs]
    assumed = [(run.label, text) for run in content.runs for text in _assumed(run)]
    excluded = [(run.label, text) for run in content.runs for text in _excluded(run)]
    missing = [f"{s.title}: the files have no {s.missing}." for s in sections if not s.pieces]
    pieces = [bullets([_SMALL, *grouped(assumed, labels)])]
    if excluded or missing:
        pieces += [heading("Not covered"), bullets([*grouped(excluded, labels), *missing])]
    return Section("assumptions", "Assumptions and limits", pieces)


def _assumed(run: Run) -> Iterator[str]:
    """Yield sentences on body, joints, damping, loads, supports, time scheme and mesh."""
    made = run.results.metadata.get("manifest") or {}
    body, settings = made.get("body") or {}, made.get("settings") or {}
    if "mesh/surface" in run.results.statics:
        state = f", in plane {body['plane']}" if body.get("plane") else ""
        yield f"The model is plane{state}." if run.plane else "The model is three-dimensional."
    materials = ((parsed(text)[0], name) for name, text in made.get("material", {}).items())
    for kind, groups in _by_first(materials).items():
        where = "" if groups == ["all"] else f" of {', '.join(groups)}"
        yield f"The material{where} {_MATERIALS.get(kind, f'follows {kind}')}."
    laws = _by_first((_law(text), name) for name, text in made.get("joint_laws", {}).items())
    for words, joints in laws.items():
        subject = "The joints" if len(laws) == 1 else f"The joints {', '.join(joints)}"
        yield f"{subject} {words} ({reference('Laws of the joints')})."
    if not run.results.joints:
        yield "The body has no joints."
    kind, values = parsed(made.get("damping"))
    if kind == "Rayleigh":
        terms = [f"{plain(values[n])} {unit}" for n, unit in _RAYLEIGH.items() if values.get(n)]
        yield f"Rayleigh damping of the body is {' plus '.join(terms) or 'zero'}."
    elif kind == "ModalRatios":
        yield "Damping is given by ratios of the lowest modes with closed joints."
    to = " relative to the ground" if run.results.relative and run.moves else ""
    supports = map(parsed, made.get("supports", []))
    fixed = (_fixed(values) for kind, values in supports if kind == "Fixed")
    for along, places in _by_first(fixed).items():
        yield f"The displacement{along}{to} is zero at {', '.join(places)}."
    if made.get("loads"):
        kinds = dict.fromkeys(parsed(load)[0] for load in made["loads"])
        yield f"The loads are {', '.join(kinds)} ({reference('Loads')})."
    for added in made.get("added_mass", []):
        kind, values = parsed(added)
        yield f"Water at {values.get('group')} acts as added mass ({kind})."
    if made.get("reservoir"):
        yield f"Waves in the reservoir are computed ({parsed(made['reservoir'])[0]})."
    if settings.get("ground motion") and run.results.relative:
        given = str(settings["ground motion"])
        motion = "a function of time" if given.startswith("<") else given
        yield f"The ground moves by {motion}, the same at all supports."
    if "time step" in settings:
        scheme = parsed(settings.get("time scheme"))[0]
        yield f"Time steps are {plain(settings['time step'])} s, with the scheme {scheme}."
    if "degree" in body and "dofs" in run.results.metadata:
        dofs = run.results.metadata["dofs"]
        yield f"The mesh has {dofs} degrees of freedom; elements have the degree {body['degree']}."
    resolved = measures.resolved_frequencies(run.results)
    for limit, value in zip(_LIMITS, resolved, strict=False):
        if math.isfinite(value):
            yield f"{limit} resolve motions up to {value:.3g} Hz."


def _excluded(run: Run) -> Iterator[str]:
    """Yield sentences on water, waves and errors that the run does not have."""
    made = run.results.metadata.get("manifest")
    if made:
        kinds = {parsed(load)[0] for load in made.get("loads", [])}
        water = made.get("added_mass") or made.get("reservoir")
        if not water and kinds <= _DRY:
            yield "There is no load of water, no added mass and no reservoir."
        elif run.results.joints and kinds <= _DRY | _ON_FACES:
            yield "Water pressure does not act in the joints."
        if "JointWater" in kinds:
            yield "Water does not flow in the joints."
        if any(parsed(added)[0] == "WestergaardMass" for added in made.get("added_mass", [])):
            yield "The water is incompressible: it has no waves."
        present = kinds | {parsed(support)[0] for support in made.get("supports", [])}
        if run.moves and not present & _WAVES:
            yield "No viscous boundary and no free field absorbs waves."
    if run.static_alone:
        yield "The run has static stages alone: no earthquake."
    if not run.bars:
        yield "The errors of time step and mesh are not estimated (dj.accuracy)."


def _law(text: str) -> str:
    """Return the words on a joint law."""
    kind, values = parsed(text)
    contact = parsed(values["law"])[0] if kind == "ViscousJoint" else kind
    words = _LAWS.get(contact, f"follow {contact}")
    if _FRICTIONLESS.search(text):
        words = words.replace("shear up to Coulomb's limit", "no shear")
    return words if contact == kind else f"{words}, and have dashpots that act while closed"


def _fixed(values: Mapping[str, Any]) -> tuple[str, str]:
    """Return the components, in words, and the place of a support."""
    point, letters = values.get("point"), values.get("components")
    along = f" along {', '.join(letters)}" if letters else ""
    return along, f"the point ({plain(point)}) m" if point else str(values.get("group"))


def _by_first(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Return the second texts of pairs by their first texts."""
    groups: dict[str, list[str]] = {}
    for first, second in pairs:
        groups.setdefault(first, []).append(second)
    return groups
