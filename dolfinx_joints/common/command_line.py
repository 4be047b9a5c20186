# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command-line parser that reports errors in one line."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import Any, NoReturn


def at_least(least: int) -> Callable[[str], int]:
    """Return an argument type for whole numbers of at least ``least``."""

    def read(text: str) -> int:
        if not re.fullmatch(r"[+-]?[0-9]{1,18}", text) or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least {least}")
        return int(text)

    return read


class Parser(argparse.ArgumentParser):
    """Argument parser that exits with code 2 and one sentence, without the usage.

    Options must be written in full.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, **options})

    def error(self, message: str) -> NoReturn:
        """Exit with the message."""
        # Python versions differ in whether they quote the choices; leave them out.
        message = message.partition(" (choose from")[0]
        text = "".join(c if c.isprintable() else " " for c in " ".join(message.split()))
        self.exit(2, f"{self.prog}: {text.rstrip('.')}; see --help for the allowed values.\n")
