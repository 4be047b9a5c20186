# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios that each kind of damping gives the modes of Koyna.

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
    """Damping of 5 % where it can be chosen, by name.

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
    """Frequencies of the first modes [Hz] and their ratios [%] by each kind (collective)."""

    def system(damping: dj.Rayleigh | dj.ModalRatios | None = None) -> dj.MatrixSystem:
        return build(ABAQUS_KOYNA, size=size, damping=damping).system()

    modes = dj.modes(system(), MODES)
    asked = kinds(modes.frequencies[0], modes.frequencies[NAMED - 1])
    found = {name: dj.modal_damping(system(each), modes).ratios for name, each in asked.items()}
    lines = ["mode      Hz  " + "  ".join(f"{name:>15}" for name in found)]
    for i, frequency in enumerate(modes.frequencies):
        ratios = "  ".join(f"{100.0 * each[i]:15.2f}" for each in found.values())
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
