# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice of the joint stiffnesses k_n and k_s for a body, and the errors that they cause.

Theory, assumptions and limits are in docs/theory/joint_stiffness.md, (35) to (37).
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.friction import FrictionNoTension

# Largest k_n h/E without a warning. A traction t is k_n times a difference of displacements u. Its
# relative rounding error is eps k_n u/t with eps = 2.2e-16. u is at least the shortening t h/E of a
# cell. Bars of four or eight cells have errors of 1e-15 to 5e-15 k_n h/E, so ten digits remain
# up to this ratio.
LARGEST_RATIO = 1e5

Stiffness = Annotated[float, at.Gt(0), at.Unit("Pa/m")]
Modulus = Annotated[float, at.Gt(0), at.Unit("Pa")]
Poisson = Annotated[float, at.Interval(gt=-1, lt=0.5)]
Length = Annotated[float, at.Gt(0), at.Unit("m")]
Pressure = Annotated[float, at.Ge(0), at.Unit("Pa")]


@dataclass(frozen=True, kw_only=True)
@checked
class StiffnessProposal:
    """Joint stiffnesses, chosen by `propose_stiffness`, with the errors that they cause.

    Construct it directly to evaluate user-defined stiffnesses.

    Attributes:
        normal_stiffness: k_n [Pa/m].
        shear_stiffness: k_s [Pa/m].
        young: Young's modulus E of the body [Pa].
        poisson: Poisson's ratio of the body.
        block_size: Spacing L of the joints [m].
        pressure: Largest expected pressure p on a joint [Pa].
        friction_angle_deg: Friction angle [degrees], needed for the elastic slip.
        element_size: Cell size h at the joints [m], needed for the rounding error.
        governed_by: Bound that determines k_n, empty for user-defined stiffnesses.
    """

    normal_stiffness: Stiffness
    shear_stiffness: Stiffness
    young: Modulus
    poisson: Poisson
    block_size: Length
    pressure: Pressure
    friction_angle_deg: float | None = None
    element_size: Length | None = None
    governed_by: str = ""

    def __post_init__(self) -> None:
        if self.friction_angle_deg is not None:
            self.law(self.friction_angle_deg)

    @property
    def added_compliance(self) -> float:
        """Ratio of joint to block compliance: M/(k_n L) or G/(k_s L), whichever is larger."""
        oedometric, shear = _moduli(self.young, self.poisson)
        return max(
            oedometric / (self.normal_stiffness * self.block_size),
            shear / (self.shear_stiffness * self.block_size),
        )

    @property
    def frequency_shift(self) -> float:
        """Estimated bound on the relative drop of the first frequency."""
        return min(0.5 * self.added_compliance, 1.0)

    @property
    def overlap(self) -> float:
        """Interpenetration p/k_n [m]."""
        return self.pressure / self.normal_stiffness

    @property
    def elastic_slip(self) -> float | None:
        """Elastic slip mu p/k_s before sliding [m], mu = tan(angle); None without an angle."""
        if self.friction_angle_deg is None:
            return None
        mu = math.tan(math.radians(self.friction_angle_deg))
        return mu * self.pressure / self.shear_stiffness

    @property
    def stiffness_ratio(self) -> float | None:
        """Stiffness ratio k_n h/E of joint and cell, None without cell size."""
        if self.element_size is None:
            return None
        return self.normal_stiffness * self.element_size / self.young

    def law(self, friction_angle_deg: float | None = None) -> FrictionNoTension:
        """Return the law with these stiffnesses; by default with the proposal's friction angle."""
        angle = self.friction_angle_deg if friction_angle_deg is None else friction_angle_deg
        if angle is None:
            raise ValueError("The proposal has no friction angle; pass friction_angle_deg.")
        return FrictionNoTension(
            normal_stiffness=self.normal_stiffness,
            shear_stiffness=self.shear_stiffness,
            friction_angle_deg=angle,
        )

    def report(self) -> str:
        """Return the stiffnesses and the errors that they cause, in a few lines."""
        governed = f" ({self.governed_by} governs)" if self.governed_by else ""
        lines = [
            f"k_n = {self.normal_stiffness:.3g} Pa/m, "
            f"k_s = {self.shear_stiffness:.3g} Pa/m{governed}",
            f"closed joints {self.block_size:.3g} m apart add about "
            f"{100 * self.added_compliance:.3g} % to the compliance of the blocks",
            f"the first frequency drops by at most about {100 * self.frequency_shift:.3g} %",
            f"overlap {1e3 * self.overlap:.3g} mm at {1e-6 * self.pressure:.3g} MPa",
        ]
        if self.elastic_slip is not None:
            lines.append(f"elastic slip up to {1e3 * self.elastic_slip:.3g} mm before sliding")
        if self.stiffness_ratio is not None:
            rounding = self.stiffness_ratio * sys.float_info.epsilon
            lines.append(f"k_n h/E = {self.stiffness_ratio:.3g}")
            if self.stiffness_ratio > LARGEST_RATIO:
                lines[-1] += (
                    f"; too large: the tractions have relative rounding errors of {rounding:.1g} "
                    "or more; reduce k_n"
                )
        return "\n".join(lines)


@checked
def propose_stiffness(
    *,
    young: Modulus,
    poisson: Poisson,
    block_size: Length,
    pressure: Pressure,
    added_compliance: Annotated[float, at.Gt(0)] = 0.01,
    overlap: Length = 1e-4,
    friction_angle_deg: float | None = None,
    element_size: Length | None = None,
) -> StiffnessProposal:
    """Choose the softest joint that keeps compliance and interpenetration below their bounds.

    k_n = max(M/(added_compliance L), p/overlap) and k_s = k_n G/M, with the oedometric modulus M
    and the shear modulus G. Joint and block then have the same ratio of shear to normal stiffness.

    Args:
        young: Young's modulus E of the body [Pa].
        poisson: Poisson's ratio of the body.
        block_size: Spacing L of the joints [m]; the smallest spacing if it varies.
        pressure: Largest expected pressure p on a joint [Pa]; may be zero.
        added_compliance: Bound on the ratio of the joint compliance to the block compliance.
        overlap: Bound on the interpenetration [m].
        friction_angle_deg: Friction angle [degrees], needed for the elastic slip.
        element_size: Cell size at the joints [m], needed for the rounding error.

    Example:
        >>> import dolfinx_joints as dj
        >>> proposal = dj.propose_stiffness(young=24e9, poisson=0.0, block_size=12.0, pressure=2e6)
        >>> law = proposal.law(friction_angle_deg=45.0)
        >>> f"{law.normal_stiffness:.3g}"  # E / (0.01 * 12 m) [Pa/m]
        '2e+11'
        >>> f"{law.shear_stiffness:.3g}"  # half of k_n, as G = E / 2 [Pa/m]
        '1e+11'
    """
    oedometric, shear = _moduli(young, poisson)
    bounds = {
        "the added compliance": oedometric / (added_compliance * block_size),
        "the overlap": pressure / overlap,
    }
    governing = max(bounds, key=lambda name: bounds[name])
    return StiffnessProposal(
        normal_stiffness=bounds[governing],
        shear_stiffness=bounds[governing] * shear / oedometric,
        young=young,
        poisson=poisson,
        block_size=block_size,
        pressure=pressure,
        friction_angle_deg=friction_angle_deg,
        element_size=element_size,
        governed_by=governing,
    )


def _moduli(young: float, poisson: float) -> tuple[float, float]:
    """Return the oedometric modulus M and the shear modulus G [Pa]."""
    shear = young / (2.0 * (1.0 + poisson))
    return 2.0 * shear * (1.0 - poisson) / (1.0 - 2.0 * poisson), shear
