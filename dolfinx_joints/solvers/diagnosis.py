# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error messages of factorizations that failed."""

from __future__ import annotations

import math

from petsc4py import PETSc

SINGULAR = (
    "The matrix is singular to working precision: is every block restrained by supports, "
    "springs or a closed joint?"
)
NOT_FINITE = (
    "The matrix contains values that are not finite: look for NaN in a material, a law's tangent "
    "or a form."
)
NO_MEMORY = (
    "The factor of the matrix does not fit into memory: use a coarser mesh, more memory, or the "
    "iterative solver"
)
NOT_FACTORED = (
    "The matrix could not be factored (singular, or not positive definite: is every block "
    "restrained by supports?)"
)

# PETSc's error codes for a zero or negative pivot, and for insufficient memory.
_ZERO_PIVOT = (71, 81)
_OUT_OF_MEMORY = 55

# INFOG(1) of MUMPS; its user's guide lists the other codes.
_MUMPS = {
    -6: "structurally singular",
    -9: "real workspace too small",
    -10: "numerically singular",
    -13: "allocation failed in the factorization",
    -40: "not positive definite",
}


def why_singular(matrix: PETSc.Mat) -> str:
    """Return the error message for a matrix that is singular or not finite (collective)."""
    # The Frobenius norm is NaN if an entry is NaN; the largest absolute value may be finite.
    finite = math.isfinite(matrix.norm(PETSc.NormType.NORM_FROBENIUS))
    return SINGULAR if finite else NOT_FINITE


def reported_by_package(pc: PETSc.PC) -> str:
    """Return the reason that MUMPS reports, as " (...)", or an empty string."""
    if pc.getFactorSolverType() != "mumps":
        return ""
    factor = pc.getFactorMatrix()
    code, size = factor.getMumpsInfog(1), factor.getMumpsInfog(2)
    if code >= 0:
        return ""
    reason = _MUMPS.get(code, "see its user's guide")
    return f" (MUMPS: {reason}; INFOG(1) = {code}, INFOG(2) = {size})"


def of_error(error: PETSc.Error, matrix: PETSc.Mat) -> str:
    """Return the error message for an error of PETSc in a factorization (collective)."""
    if why_singular(matrix) == NOT_FINITE:
        return NOT_FINITE
    if error.ierr in _ZERO_PIVOT:
        return f"{NOT_FACTORED}."
    if error.ierr == _OUT_OF_MEMORY:
        return f"{NO_MEMORY}."
    last = str(error).strip().rsplit("\n", 1)[-1].removeprefix("[0] ")
    return f"{NOT_FACTORED}; PETSc reports: {last}."
