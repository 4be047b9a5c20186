# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run the validation atlas: ``make validate``, or with names of cases.

    ./with-dolfinx python3 -m validation
    ./with-dolfinx python3 -m validation grouted_blocks rigid_dam
    ./with-dolfinx python3 -m validation --fine impounded_dam

It writes a page with a figure for each case to ``output/validation`` and prints all rows and the
table of all cases. The exit status is 1 if a deviation exceeds its tolerance or if a stated
deviation has changed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from mpi4py import MPI

from dolfinx_joints.common.command_line import Parser
from validation.atlas import Result, names, refines, run_case, summary, table, write_page


def main(arguments: list[str] | None = None) -> int:
    """Run cases; return 1 if a deviation exceeds its tolerance."""
    parser = Parser(description="Run the validation atlas.")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"one of {', '.join(names())}")
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument(
        "--fine", action="store_true", help="finer cells or shorter steps, if the case has them"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("output/validation"), help="folder of the pages"
    )
    options = parser.parse_args(arguments)
    unknown = [name for name in options.cases if name not in names()]
    if unknown:
        parser.error(f"{unknown[0]!r} is not a case; the cases are {', '.join(names())}")
    chosen = options.cases or [name for name in names() if not options.fine or refines(name)]
    rigid = [name for name in chosen if options.fine and not refines(name)]
    if rigid or (options.fine and options.quick):
        parser.error(f"--fine cannot be used with {rigid[0] if rigid else '--quick'}")
    if MPI.COMM_WORLD.size > 1:
        parser.error("the atlas runs on one rank")
    options.out.mkdir(parents=True, exist_ok=True)
    results: list[Result] = []
    for name in chosen:
        result = run_case(name, quick=options.quick, fine=options.fine)
        results.append(result)
        print(f"\n{result.title} ({name}, {result.seconds:.0f} s)", flush=True)
        print(table(result.outcome.rows) if result.outcome else f"left out: {result.missing}")
        write_page(result, options.out)
    overview = summary(results)
    text = f"# Atlas of validation\n\n{overview}\n"
    (options.out / "index.md").write_text(text, encoding="utf-8")
    print(f"\n{overview}\n\npages: {options.out}, {sum(r.seconds for r in results):.0f} s in total")
    for result in results:
        for row in result.wrong:
            print(f"{result.name}: {row.quantity} deviates by {row.deviation:.3g}", file=sys.stderr)
    return int(any(result.wrong for result in results))


if __name__ == "__main__":
    sys.exit(main())
