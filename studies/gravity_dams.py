# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural frequencies of the gravity dams Koyna and Pine Flat, compared with published values.

    ./with-dolfinx python3 -m studies.gravity_dams
    ./with-dolfinx python3 -m studies.gravity_dams --quick

Each dam is one monolith on rigid ground. Its reservoir is empty or represented by Westergaard's
added mass or by the added mass of an endless reservoir by finite elements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.mpi import abort_on_error, on_root
from dolfinx_joints.geometry.gravity_dam import (
    FOOT,
    KOYNA,
    PINE_FLAT,
    PINE_FLAT_FACES,
    GravitySection,
    battered_section,
    gravity_dam,
)
from studies.convergence import extrapolated

SOUND = 1440.0  # speed in water [m/s]
REPEATS = 50  # iterations for the frequency with compressible water
SIZES = (8.0, 4.0, 2.0)  # of cells [m]
PSI = 6894.757293168  # [Pa]
CLOSED = dj.FrictionNoTension(normal_stiffness=1e12, shear_stiffness=4e11, friction_angle_deg=45.0)


@dataclass(frozen=True, kw_only=True)
class Dam:
    """Monolith on rigid ground.

    Attributes:
        section: Cross-section.
        young: Young's modulus [Pa].
        poisson: Poisson's ratio.
        density: Density [kg/m^3].
        plane: ``stress`` or ``strain``.
        water: Level of the reservoir above the base [m]; empty by default.
        joints: Heights of closed lift joints by name [m].
        width: Width across the valley of a 3-D model [m]; 2-D by default.
        endless: Use a reservoir by finite elements instead of Westergaard's mass.
        vibration: Frequency at which the mass of compressible water in a reservoir by finite
            elements is evaluated [Hz]; zero for incompressible water.
        length: Length of such a reservoir up to a fixed rigid wall [m]; endless by default.
        constrained_sides: Sides that cannot move across the valley. Both sides give plane strain.
            One side is the plane of symmetry of half a monolith, without bending across the valley.
    """

    section: GravitySection
    young: float
    poisson: float
    density: float
    plane: str
    water: float | None = None
    joints: Mapping[str, float] | None = None
    width: float | None = None
    constrained_sides: tuple[str, ...] = ()
    endless: bool = False
    vibration: float = 0.0
    length: float | None = None


@dataclass(frozen=True, kw_only=True)
class Published:
    """Published frequencies of a dam.

    Attributes:
        dam: The dam.
        frequencies: The lowest frequencies [Hz].
        source: Source of the values.
    """

    dam: Dam
    frequencies: tuple[float, ...]
    source: str


ABAQUS_KOYNA = Dam(section=KOYNA, young=31.027e9, poisson=0.15, density=2643.0, plane="stress")
SHARMA_KOYNA = replace(ABAQUS_KOYNA, poisson=0.2, plane="strain")
GORAI_KOYNA = Dam(
    section=KOYNA, young=32.68642e9, poisson=0.235, density=2415.82, plane="strain", water=103.0
)
CHOPRA_PINE_FLAT = Dam(
    section=PINE_FLAT, young=3.25e6 * PSI, poisson=0.2, density=2483.0, plane="stress"
)
SAMII_PINE_FLAT = Dam(
    section=PINE_FLAT, young=22.75e9, poisson=0.2, density=2480.0, plane="stress", water=116.19
)

PUBLISHED = {
    "Koyna, empty": Published(
        dam=ABAQUS_KOYNA,
        frequencies=tuple(w / (2 * np.pi) for w in (18.86, 49.97, 68.16, 98.27)),
        source="Abaqus Example Problems, Seismic analysis of a concrete gravity dam",
    ),
    # Rayleigh damping of 5 % of the first mode, half of it by mass: a = 0.05 omega = 0.9676 / s.
    "Koyna, empty (from damping)": Published(
        dam=SHARMA_KOYNA,
        frequencies=(0.9676 / 0.05 / (2 * np.pi),),
        source="Sharma, Fujisawa, Murakami 2020",
    ),
    "Koyna, full": Published(
        dam=GORAI_KOYNA, frequencies=(1 / 0.393,), source="Gorai, Maity 2020, compressible water"
    ),
    "Pine Flat, empty": Published(
        dam=CHOPRA_PINE_FLAT,
        frequencies=(np.sqrt(3.25e6) / (1.4 * 400.0),),
        source="Fenves, Chopra 1986, T = 1.4 H / sqrt(E) [ft, psi, s] for dams of its kind",
    ),
    "Pine Flat, full": Published(
        dam=SAMII_PINE_FLAT,
        frequencies=(2.5267,),
        source="Samii, Lotfi 2007, compressible water",
    ),
}

MONOLITH = 50 * FOOT  # width of a monolith of Pine Flat [m]

INFLUENCES = {
    "Koyna, empty": {
        "plane strain": replace(ABAQUS_KOYNA, plane="strain"),
        "Poisson's ratio 0.2": replace(ABAQUS_KOYNA, poisson=0.2),
        "base 71 m instead of 70 m": replace(
            ABAQUS_KOYNA,
            section=replace(KOYNA, downstream=((0.0, 71.0), *KOYNA.downstream[1:])),
        ),
        "nine closed lift joints, k_n = 1e12 Pa/m": replace(
            ABAQUS_KOYNA, joints={f"{z}m": float(z) for z in range(10, 100, 10)}
        ),
    },
    "Pine Flat, empty": {
        "plane strain": replace(CHOPRA_PINE_FLAT, plane="strain"),
        "in space, sides constrained": replace(
            CHOPRA_PINE_FLAT, width=MONOLITH, constrained_sides=("front", "back")
        ),
        "in space, sides unconstrained": replace(
            CHOPRA_PINE_FLAT, width=MONOLITH / 2, constrained_sides=("front",)
        ),
        "upstream break 10 m lower": replace(
            CHOPRA_PINE_FLAT,
            section=battered_section(**{**PINE_FLAT_FACES, "upstream_break": 92.1}),
        ),
    },
    "Pine Flat, full": {"plane strain": replace(SAMII_PINE_FLAT, plane="strain")},
}

# Kinds of water: Westergaard's formula, and an endless reservoir by finite elements.
WATERS = ("Westergaard", "incompressible", "compressible")

# Dams on which the kinds of water are compared, with published frequencies [Hz].
FULL = {
    "Koyna": (GORAI_KOYNA, 1 / 0.393),
    "Pine Flat": (SAMII_PINE_FLAT, 2.5267),
    "Pine Flat, plane strain": (replace(SAMII_PINE_FLAT, plane="strain"), 2.5267),
}


def waves(reflection: float) -> dj.ReservoirWaves:
    """Return the reservoir of Koyna: 30 depths long, absorbing over the last 25."""
    return dj.ReservoirWaves(
        group="upstream",
        level=103.0,
        length=30.0 * 103.0,
        absorbing_length=25.0 * 103.0,
        sound_speed=SOUND,
        bottom_reflection=reflection,
    )


# Possible assumptions behind the published period of Koyna with water; the source gives none.
ASSUMED = {
    "plane strain, endless reservoir": GORAI_KOYNA,
    "plane stress": replace(GORAI_KOYNA, plane="stress"),
    "reservoir of 103 m up to a wall": replace(GORAI_KOYNA, length=103.0),
    "reservoir of 206 m up to a wall": replace(GORAI_KOYNA, length=206.0),
    "plane stress, wall at 103 m": replace(GORAI_KOYNA, plane="stress", length=103.0),
    "modulus 9.6 % lower": replace(GORAI_KOYNA, young=0.904 * GORAI_KOYNA.young),
}

# Reservoirs of Koyna with waves: empty, and with a bottom that reflects all or three quarters.
SHAKEN = {
    "empty": None,
    "full, bottom reflects all": waves(1.0),
    "full, bottom reflects 0.75": waves(0.75),
}
FREQUENCIES = np.arange(0.04, 12.0, 0.02)  # [Hz]

# Periods [s] of the whole dam in forced vibration, by level of the reservoir [m].
MEASURED_PINE_FLAT = {94.0: 0.288, 105.0: 0.306}


def frequencies(
    dam: Dam, *, size: float, order: int = 2, count: int = 1, comm: MPI.Comm = MPI.COMM_WORLD
) -> NDArray[np.float64]:
    """Return the lowest natural frequencies [Hz], shape (count,) (collective).

    Args:
        dam: The dam.
        size: Cell size [m].
        order: Degree of the elements, 1 or 2.
        count: Number of frequencies.
        comm: Communicator of the mesh.
    """
    lowest = dj.modes(build(dam, size=size, order=order, comm=comm).system(), count)
    return lowest.frequencies


def build(
    dam: Dam,
    *,
    size: float,
    order: int = 2,
    law: dj.FrictionNoTension = CLOSED,
    comm: MPI.Comm = MPI.COMM_WORLD,
    reservoir: dj.ReservoirWaves | None = None,
    damping: dj.Rayleigh | dj.ModalRatios | None = None,
) -> dj.Model:
    """Return the model of a dam with a fixed base (collective)."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "dam.msh"
        options: dict[str, Any] = {"joints": dam.joints, "width": dam.width}
        on_root(
            comm, lambda: gravity_dam(path, section=dam.section, size=size, order=order, **options)
        )
        jointed = dj.read_msh(path, comm)
    supports = [dj.Fixed(group="base")]
    supports += [dj.Fixed(group=side, components="y") for side in dam.constrained_sides]
    water: list[Any] = [] if reservoir is None else [reservoir]
    if dam.water is not None:
        where: dict[str, Any] = {"group": "upstream", "level": dam.water}
        added: dj.WestergaardMass | dj.ReservoirMass = dj.WestergaardMass(**where)
        if dam.endless:
            options = {"frequency": dam.vibration, "sound_speed": SOUND, "length": dam.length}
            added = dj.ReservoirMass(**where, **options)
        water.append(added)
    return dj.Model(
        jointed,
        material=dj.Elastic(young=dam.young, poisson=dam.poisson, density=dam.density),
        joints=law if dam.joints else None,
        supports=supports,
        body=dj.Body(plane=dam.plane),
        water=water,
        damping=damping,
    )


def crest_response(reservoir: dj.ReservoirWaves | None, size: float) -> NDArray[np.float64]:
    """Return the ratio of crest to ground acceleration of Koyna at `FREQUENCIES` (collective)."""
    model = build(replace(GORAI_KOYNA, water=None), size=size, reservoir=reservoir)
    crest = {"crest": (0.0, 103.0)}
    response = dj.frequency_response(model, FREQUENCIES, points=crest, hysteretic_ratio=0.05)
    return np.abs(response.acceleration("crest")[:, 0])


def convergence(dam: Dam, order: int, sizes: Sequence[float]) -> str:
    """Return the first frequency on finer and finer meshes, with limit and order, as text."""
    first = np.array([frequencies(dam, size=size, order=order)[0] for size in sizes])
    estimate = extrapolated(first, sizes[0] / sizes[1])
    values = "  ".join(f"{f:8.4f}" for f in first)
    share = 100 * estimate.error[-1] / estimate.limit
    rate = f"order {estimate.order:.2f}" if np.isfinite(estimate.order) else "no steady order"
    return f"{values}   limit {estimate.limit:.4f}, {rate}, error of the finest {share:.1g} %"


def deviation(value: float, reference: float) -> str:
    """Return the signed difference in percent of the reference, as text."""
    return f"{100 * (value / reference - 1):+6.2f} %"


def main(arguments: list[str] | None = None) -> None:
    """Compute and print all comparisons."""
    parser = Parser(description="Frequencies of Koyna and Pine Flat dams.")
    parser.add_argument("--quick", action="store_true", help="coarser meshes")
    parser.add_argument("--figure", type=Path, help="file for a picture of the crest response")
    options = parser.parse_args(arguments)
    sizes = [size * (2.0 if options.quick else 1.0) for size in SIZES]
    abort_on_error(MPI.COMM_WORLD)

    def show(text: str) -> None:
        if MPI.COMM_WORLD.rank == 0:
            print(text, flush=True)

    show(f"first frequency [Hz] with cells of {', '.join(f'{h:g}' for h in sizes)} m")
    for name, published in PUBLISHED.items():
        for order in (1, 2):
            show(f"  {name:<28} order {order}  {convergence(published.dam, order, sizes)}")
    cells = {"size": sizes[1], "order": 2}
    show(f"\nagainst published values, order 2, {sizes[1]:g} m")
    for name, published in PUBLISHED.items():
        count = len(published.frequencies)
        computed = frequencies(published.dam, count=count, **cells)
        show(f"  {name} ({published.source})")
        for mode, (ours, theirs) in enumerate(zip(computed, published.frequencies, strict=True), 1):
            against = f"published {theirs:8.4f}, {deviation(ours, theirs)}"
            show(f"    mode {mode}  {ours:8.4f} Hz, {1 / ours:.3f} s, {against}")
    show("\ninfluences on the first frequency")
    for name, others in INFLUENCES.items():
        reference = frequencies(PUBLISHED[name].dam, **cells)[0]
        show(f"  {name}: {reference:.4f} Hz")
        for label, dam in others.items():
            computed = frequencies(dam, **cells)[0]
            show(f"    {label:<42} {computed:8.4f} Hz, {deviation(computed, reference)}")
    show("\nwater: Westergaard's mass, and an endless reservoir by finite elements")
    for name, (dam, published) in FULL.items():
        show(f"  {name}, at {dam.water:g} m: {waters(dam, cells, published)}")
    show("\nKoyna with compressible water: possible assumptions behind the published 2.5445 Hz")
    for label, dam in ASSUMED.items():
        computed = with_water(dam, "compressible", cells)
        show(f"  {label:<34} {computed:8.4f} Hz, {deviation(computed, 1 / 0.393)}")
    show("\nKoyna shaken along the stream, 5 % hysteretic: peaks of the crest's acceleration")
    shaken = {label: crest_response(water, sizes[0]) for label, water in SHAKEN.items()}
    for label, ratios in shaken.items():
        tops, _ = find_peaks(ratios, prominence=0.5)  # the absorbing length causes smaller ripples
        peaks = (f"{ratios[i]:.1f} at {FREQUENCIES[i]:.2f} Hz" for i in tops)
        show(f"  {label:<34} {', '.join(peaks)}")
    if options.figure and MPI.COMM_WORLD.rank == 0:
        first = FREQUENCIES[np.argmax(shaken["empty"])]
        ax = dj.motion_plots.frequency_response(FREQUENCIES, shaken, first=first)
        ax.set_xlabel("frequency / f₁, first of the empty dam")
        ax.set_ylabel("acceleration, crest / ground")
        dj.plots.save(ax.figure, options.figure)
    show("\nPine Flat with water, measured on the whole dam")
    for kind in WATERS:
        show(f"  {kind}")
        computed = [
            with_water(replace(CHOPRA_PINE_FLAT, water=level), kind, cells)
            for level in MEASURED_PINE_FLAT
        ]
        measured = [1 / period for period in MEASURED_PINE_FLAT.values()]
        for level, ours, theirs in zip(MEASURED_PINE_FLAT, computed, measured, strict=True):
            young = CHOPRA_PINE_FLAT.young / 1e9 * (theirs / ours) ** 2
            show(
                f"    level {level:g} m: {ours:.4f} Hz, measured {theirs:.4f} Hz, "
                f"the same with {young:.1f} GPa"
            )
        show(
            f"    ratio of the second to the first: {computed[1] / computed[0]:.4f}, measured "
            f"{measured[1] / measured[0]:.4f}"
        )


def waters(dam: Dam, cells: Mapping[str, Any], published: float) -> str:
    """Return the first frequency of a dam without water and with each kind of water, as text."""
    empty = frequencies(replace(dam, water=None), **cells)[0]
    own = SOUND / (4 * (dam.water or np.inf))
    lines = [
        f"empty {empty:.4f} Hz, published with water {published:.4f} Hz, "
        f"the reservoir's own c/4H {own:.2f} Hz"
    ]
    for kind in WATERS:
        f = with_water(dam, kind, cells)
        change, error = deviation(f, empty), deviation(f, published)
        lines.append(
            f"{kind:<15} {f:.4f} Hz, {change} of empty, {error} of published, "
            f"(f0/f)^2 - 1 = {(empty / f) ** 2 - 1:.3f}"
        )
    return "\n    ".join(lines)


def with_water(dam: Dam, kind: str, cells: Mapping[str, Any]) -> float:
    """Return the first frequency of a dam with one of `WATERS` [Hz] (collective).

    The mass of compressible water depends on the frequency, so the frequency is found by iteration.
    """
    dam = replace(dam, endless=kind != "Westergaard", vibration=0.0)
    frequency = float(frequencies(dam, **cells)[0])
    if kind != "compressible":
        return frequency
    for _ in range(REPEATS):
        last = frequency
        frequency = float(frequencies(replace(dam, vibration=last), **cells)[0])
        if abs(frequency - last) < 1e-5 * frequency:
            return frequency
    raise RuntimeError(
        f"The frequency did not converge in {REPEATS} iterations; the last value is {frequency} Hz."
    )


if __name__ == "__main__":
    main()
