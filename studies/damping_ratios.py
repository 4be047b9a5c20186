# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of the modes of Koyna for each kind of damping.

./with-dolfinx python3 -m studies.damping_ratios
"""

from __future__ import annotations

from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.common.mpi import abort_on_error
from studies.gravity_dams import ABAQUS_KOYNA, build

RATIO, NAMED, MODES = 0.05, 4, 8


def kinds(first: float, last: float) -> dict[str, dj.Rayleigh | dj.ModalRatios]:
    """Return kinds of damping by name, each 5 % at the frequencies where it can be chosen.

    Args:
        first: Frequency of the first mode [Hz].
        last: Frequency of the last named mode [Hz].
    """
    by_stiffness = dj.stiffness_proportional(ratio=RATIO, frequency=last)
    return {
        "K, at the first": dj.stiffness_proportional(ratio=RATIO, frequency=first),
        "M, at the first": dj.mass_proportional(ratio=RATIO, frequency=first),
        "Rayleigh": dj.rayleigh(ratio=RATIO, frequencies=(first, last)),
        "modes": dj.ModalRatios(ratio=RATIO, modes=NAMED),
        "modes, K beyond": dj.ModalRatios(ratio=RATIO, modes=NAMED, beyond=by_stiffness),
    }


def table(size: float = 4.0) -> str:
    """Return the first frequencies [Hz] and their ratios [%] by kind, as text (collective)."""

    def system(damping: dj.Rayleigh | dj.ModalRatios | None = None) -> dj.MatrixSystem:
        return build(ABAQUS_KOYNA, size=size, damping=damping).system()

    modes = dj.modes(system(), MODES)
    chosen = kinds(modes.frequencies[0], modes.frequencies[NAMED - 1])
    by_kind = {name: dj.modal_damping(system(kind), modes).ratios for name, kind in chosen.items()}
    lines = ["mode      Hz  " + "  ".join(f"{name:>15}" for name in by_kind)]
    for i, frequency in enumerate(modes.frequencies):
        ratios = "  ".join(f"{100.0 * kind[i]:15.2f}" for kind in by_kind.values())
        lines.append(f"{i + 1:4d}  {frequency:6.2f}  {ratios}")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    Parser(description="Damping ratios of the modes of Koyna, in per cent.").parse_args(arguments)
    abort_on_error(MPI.COMM_WORLD)
    text = table()
    if MPI.COMM_WORLD.rank == 0:
        print(text)


if __name__ == "__main__":
    main()
