# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural frequencies of Koyna and Pine Flat dams.

One monolith each on rigid ground, empty or with Westergaard's added mass, quadratic cells of 4 m,
whose first frequency is within 0.02 % of its limit. Properties and sources are those of
[the study](../../docs/studies.md#two-gravity-dams), `studies.gravity_dams`, which also takes the
water by finite elements and tells what moves the frequencies. Where the published numbers are of
compressible water, Westergaard's mass is too heavy and lacks the compressibility; the two errors
are opposite. With compressible water by finite elements Koyna in plane strain before an endless
reservoir is 4.5 % above the published number; plane stress and a reservoir that ends at a wall at
103 m, its length in the source, which says neither, give that number.

The last row is the dam itself, shaken with the reservoir at 94 and 105 m: the ratio of the two
frequencies, which does not depend on the modulus, with compressible water by finite elements.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.gravity_dams import (
    ASSUMED,
    CHOPRA_PINE_FLAT,
    FULL,
    MEASURED_PINE_FLAT,
    PUBLISHED,
    frequencies,
    with_water,
)
from validation.atlas import Outcome, Row, new_figure

SOURCE = (
    "Abaqus Example Problems; Sharma et al. 2020; Gorai, Maity 2020; Fenves, Chopra 1986; "
    "Samii, Lotfi 2007; measured by Rea, Liaw, Chopra 1972"
)

REASONS = {
    "Koyna, empty": "their 760 linear cells with reduced integration",
    "Koyna, empty (from damping)": "implied by printed damping factors",
    "Koyna, full": "added mass against compressible water",
    "Pine Flat, empty": "a fit for all dams of its kind",
    "Pine Flat, full": "added mass against compressible water",
}


def run(quick: bool) -> Outcome:
    """Compute the modes; quick on cells twice as long, without the measured ratio."""
    size = 8.0 if quick else 4.0
    rows = []
    for name, published in PUBLISHED.items():
        count = len(published.frequencies)
        found = frequencies(published.dam, size=size, count=count)
        for mode, (ours, theirs) in enumerate(zip(found, published.frequencies, strict=True), 1):
            rows.append(
                Row(
                    quantity=f"{name}, mode {mode} [Hz]",
                    ours=float(ours),
                    theirs=float(theirs),
                    tolerance=0.02,
                    reason=REASONS[name],
                )
            )
    if not quick:
        walled = "plane stress, wall at 103 m"
        for name, dam, theirs, tolerance, reason in (
            ("Koyna, full", *FULL["Koyna"], 0.05, "strain and far end are not stated: next row"),
            (f"Koyna, {walled}", ASSUMED[walled], FULL["Koyna"][1], 0.005, "periods of 4 digits"),
            ("Pine Flat, full", *FULL["Pine Flat"], 0.05, "their reservoir is hardly described"),
        ):
            rows.append(
                Row(
                    quantity=f"{name}, compressible water, mode 1 [Hz]",
                    ours=with_water(dam, "compressible", {"size": size}),
                    theirs=theirs,
                    tolerance=tolerance,
                    reason=reason,
                )
            )
        low, high = (
            with_water(replace(CHOPRA_PINE_FLAT, water=level), "compressible", {"size": size})
            for level in MEASURED_PINE_FLAT
        )
        measured = list(MEASURED_PINE_FLAT.values())
        rows.append(
            Row(
                quantity="Pine Flat, first frequency with water at 105 m / at 94 m, measured",
                ours=high / low,
                theirs=measured[0] / measured[1],
                tolerance=0.005,
                reason="periods printed to 0.001 s",
            )
        )
    figure, ax = new_figure(width=8.0, height=4.2)
    places = np.arange(len(rows))
    ax.barh(places, [100.0 * row.deviation for row in rows])
    ax.set_yticks(places, [row.quantity.partition(" [")[0] for row in rows], fontsize=8)
    ax.invert_yaxis()
    ax.set_axisbelow(True)
    ax.set_xlabel("deviation [%]")
    return Outcome(rows=rows, figure=figure)
