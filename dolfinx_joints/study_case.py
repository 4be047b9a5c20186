# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One case of a study, in an interpreter of its own: ``python3 -m dolfinx_joints.study_case``.

The runner sends the job as a line of JSON on the standard input and keeps it open: its end means
that the runner is gone, and ends the case as well.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time as clock
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any

from dolfinx_joints.common.memory_use import peak_mb
from dolfinx_joints.study_table import plain_text, plain_values, write_row


def main() -> None:
    """Run the job of the standard input and write its row."""
    job = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_the_runner, daemon=True).start()
    sys.path[:] = job["sys_path"]
    began = clock.perf_counter()
    row: dict[str, Any] = {"case": job["case"], "status": "complete", "reason": ""}
    values: dict[str, float | str] = {}
    try:
        function = getattr(import_module(job["module"]), job["function"])
        returned = function(Path(job["folder"]), **job["parameters"])
        values = plain_values(returned, job["parameters"])
    except Exception as error:
        traceback.print_exc()
        said = " ".join(str(error).split())
        row |= {"status": "failed", "reason": plain_text(f"{type(error).__name__}: {said}")}
    row |= {"wall_s": clock.perf_counter() - began, "peak_mb": peak_mb()}
    write_row(Path(job["row"]), {**row, "parameters": job["parameters"], "values": values})


def _end_with_the_runner() -> None:
    """Wait for the end of the standard input."""
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
