# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inclined frictional crack: exact solution, and the model solved on a mesh of it.

Used by its test and by ``benchmarks/quadrature_rules.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from numpy.typing import NDArray

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.inclined_crack import crack_axes, inclined_crack

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class InclinedCrack:
    """A crack of length 2 b in an infinite body in plane strain, pressed along the y axis.

    The remote stress is -sigma along y; the crack makes psi with y, so that the remote tractions
    on its line are t_n = -sigma sin^2(psi), compression, and tau = sigma sin(psi) cos(psi).

    *Rigid contact.* The faces stay together and slide. A slip s(x) is a row of glide
    dislocations, whose normal stress vanishes on their own line, so t_n is uniform. What friction
    does not carry, tau_eff = tau + t_n tan(alpha), is released as in a crack in mode II:
    s = 4 (1 - nu^2)/E tau_eff sqrt(b^2 - x^2), a half-ellipse.

    *Elastic contact.* Normal and tangential jump do not act on each other on a straight line, and
    each obeys, with x = b cos(theta), jump = sum a_m sin(m theta), E' = E/(1 - nu^2),

        t(x) = t_remote - E'/(4 b) sum m a_m sin(m theta)/sin(theta)

    (m = 1 is the half-ellipse), together with the joint law: t_n = k_n g_n, and the shear
    traction k_s s or -t_n tan(alpha), whichever is less. This is Prandtl's lifting-line equation,
    solved here by collocation.

    Sources: the rigid case is the usual test of frictional contact on cracks, as in Phan, Napier,
    Gray and Kaplan 2003 (symmetric-Galerkin boundary elements for friction); the integral
    equations are those of any text on dislocations or cracks.

    Attributes:
        half_length: b [m].
        angle_deg: psi [degrees].
        stress: sigma [Pa].
        young: E [Pa].
        poisson: nu.
        friction_angle_deg: alpha [degrees].
    """

    half_length: float = 1.0
    angle_deg: float = 45.0
    stress: float = 1e6
    young: float = 1e9
    poisson: float = 0.3
    friction_angle_deg: float = 30.0

    @property
    def normal_traction(self) -> float:
        """Uniform t_n of the rigid contact [Pa]."""
        return -self.stress * float(np.sin(np.radians(self.angle_deg)) ** 2)

    @property
    def remote_shear(self) -> float:
        """Remote shear traction along the crack [Pa]."""
        psi = np.radians(self.angle_deg)
        return self.stress * float(np.sin(psi) * np.cos(psi))

    @property
    def modulus(self) -> float:
        """E' of plane strain [Pa]."""
        return self.young / (1.0 - self.poisson**2)

    @property
    def friction(self) -> float:
        """Coefficient of friction."""
        return float(np.tan(np.radians(self.friction_angle_deg)))

    def slip(self, x: Floats) -> Floats:
        """Slip of the rigid contact, [m]; x from the middle along the crack [m]."""
        driving = self.remote_shear + self.friction * self.normal_traction
        inside = np.maximum(self.half_length**2 - np.asarray(x) ** 2, 0.0)
        return 4.0 * driving / self.modulus * np.sqrt(inside)

    def elastic(
        self, x: Floats, normal_stiffness: float, shear_stiffness: float, terms: int = 400
    ) -> tuple[Floats, Floats]:
        """Normal traction [Pa] and slip [m] of the elastic contact at x [m].

        A joint stiffer than 1e4 E'/b is taken as rigid: within 0.9 b the tractions differ by less
        than 1e-4, and the layers at the tips, E'/(4 k_n) wide, would need more terms.

        Args:
            x: From the middle along the crack, at most b [m].
            normal_stiffness: k_n [Pa/m].
            shear_stiffness: k_s [Pa/m].
            terms: Number of terms and of collocation points.
        """
        if min(normal_stiffness, shear_stiffness) > 1e4 * self.modulus / self.half_length:
            return np.full(np.shape(x), self.normal_traction), self.slip(x)
        m = np.arange(1, terms + 1)
        theta = np.pi * m / (terms + 1)
        jump = np.sin(np.outer(theta, m))
        release = self.modulus / (4.0 * self.half_length) * m * jump / np.sin(theta)[:, None]
        opening = np.linalg.solve(
            normal_stiffness * jump + release, np.full(terms, self.normal_traction)
        )
        friction = -self.friction * normal_stiffness * (jump @ opening)
        slides = np.ones(terms, dtype=bool)
        for _ in range(50):
            held = np.where(slides, 0.0, shear_stiffness)[:, None]
            load = self.remote_shear - np.where(slides, friction, 0.0)
            sliding = np.linalg.solve(release + held * jump, load)
            before, slides = slides, shear_stiffness * (jump @ sliding) > friction
            if np.array_equal(before, slides):
                break
        angle = np.arccos(np.clip(np.asarray(x) / self.half_length, -1.0, 1.0))
        at = np.sin(np.outer(angle, m))
        return normal_stiffness * (at @ opening), at @ sliding


@dataclass(frozen=True, kw_only=True)
class CrackResult:
    """What was found on the crack, points sorted along it.

    Attributes:
        x: Places along the crack [m].
        area: Areas of the points [m^2].
        normal_traction: t_n [Pa].
        slip: Jump along the crack, positive where the load drives it [m].
        num_facets: Number of facets of the crack.
        iterations: Newton iterations.
    """

    x: Floats
    area: Floats
    normal_traction: Floats
    slip: Floats
    num_facets: int
    iterations: int

    def deviation(self, exact: Floats | float, reach: float) -> float:
        """Largest |t_n / exact - 1| of the points with |x| <= reach [m]."""
        return float(np.abs(self._error(exact, self._inside(reach))).max())

    def oscillation(self, exact: Floats | float, reach: float) -> float:
        """Root mean square of what a smooth curve leaves of t_n / exact - 1 within |x| <= reach.

        The smooth curve is the polynomial of degree 6 in x of least squares, weighted by the
        areas. An error that alternates by +-a gives a, one that varies slowly next to nothing, and
        it may be asked of any set of points, several at one x included.
        """
        inside = self._inside(reach)
        error = self._error(exact, inside)
        weight = np.sqrt(self.area[inside] / self.area[inside].sum())
        columns = np.polynomial.chebyshev.chebvander(self.x[inside] / reach, 6)
        scaled = columns * weight[:, None]
        smooth = columns @ np.linalg.lstsq(scaled, error * weight, rcond=None)[0]
        return float(np.linalg.norm((error - smooth) * weight))

    def _error(self, exact: Floats | float, points: NDArray[np.bool_]) -> Floats:
        return self.normal_traction[points] / np.broadcast_to(exact, points.shape)[points] - 1.0

    def _inside(self, reach: float) -> NDArray[np.bool_]:
        return np.abs(self.x) < reach * (1.0 + 1e-9)

    def slip_error(self, exact: Floats) -> float:
        """Error of the slip in the L2 norm over the crack, relative."""
        square = self.area @ (self.slip - exact) ** 2
        return float(np.sqrt(square / (self.area @ exact**2)))


def solve_crack(
    crack: InclinedCrack,
    *,
    quadrature: str | int = "auto",
    normal_stiffness: float,
    shear_stiffness: float | None = None,
    **mesh: Any,
) -> CrackResult:
    """Load the crack on a mesh of its own (collective).

    The remote tractions act on the sides of the body, and springs of 1e-7 E per metre of it hold
    it against rigid motions: these loads are balanced, so the springs carry next to nothing.

    Args:
        crack: The problem.
        quadrature: Rule on the joint.
        normal_stiffness: k_n [Pa/m].
        shear_stiffness: k_s, that of the normal direction unless given [Pa/m].
        mesh: Parameters of `inclined_crack`.
    """
    shear = normal_stiffness if shear_stiffness is None else shear_stiffness
    mesh = {"half_length": crack.half_length, "angle": crack.angle_deg, **mesh}
    jointed = mesh_of(inclined_crack, **mesh)
    n = ufl.FacetNormal(jointed.mesh)
    hold = 1e-7 * crack.young / crack.half_length
    solid = jointed.mesh.geometry.dim == 3
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=crack.young, poisson=crack.poisson, density=0.0),
        joints=dj.Joints(
            dj.FrictionNoTension(
                normal_stiffness=normal_stiffness,
                shear_stiffness=shear,
                friction_angle_deg=crack.friction_angle_deg,
            ),
            quadrature=quadrature,
        ),
        supports=[
            dj.Spring(group="outer", normal_stiffness=hold, tangential_stiffness=hold),
            *([dj.Fixed(group="faces", components="z")] if solid else []),
        ],
        loads=[dj.FormLoad(form=lambda v: -crack.stress * n[1] * v[1] * jointed.ds("outer"))],
    )
    static = dj.Simulation(model).statics()
    operator, state = model.contact.operator, static.joints.state
    along, normal = (np.append(axis, 0.0) for axis in crack_axes(crack.angle_deg))
    jump = np.einsum("pk,pki->pi", state.gap, operator.frames)
    # The load is compression along y: the side that the normal points to slides back along x.
    side = np.sign(operator.frames[:, 0] @ normal)
    table = operator.gather(
        np.column_stack(
            [
                operator.points @ along,
                operator.areas,
                static.joints.traction[:, 0],
                -side * (jump @ along),
            ]
        )
    )
    facets = jointed.pairs.count

    def sort() -> CrackResult:
        x, area, traction, slip = table[np.argsort(table[:, 0], kind="stable")].T
        return CrackResult(
            x=x,
            area=area,
            normal_traction=traction,
            slip=slip,
            num_facets=facets,
            iterations=static.reports[-1].iterations,
        )

    return on_root(MPI.COMM_WORLD, sort)
