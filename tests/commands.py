# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Programs called within the tests' own process: how they end, and what they say."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable, Sequence
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

PROJECT = Path(__file__).parents[1]


def loaded(path: str) -> ModuleType:
    """A script of the project as a module, loaded once."""
    name = path.removesuffix(".py").replace("/", ".")
    if name not in sys.modules:
        spec = spec_from_file_location(name, PROJECT / path)
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def spoken(main: Callable[[list[str]], Any], words: Sequence[str]) -> tuple[Any, str]:
    """The code that a program ends with, and what it says on the standard error.

    A ValueError stands for the line that a script prints of it where it is run by itself.
    """
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            code = main(list(words))
        except SystemExit as ended:
            code = ended.code
        except ValueError as error:
            code = 2
            said.write(f"{Path(sys.argv[0]).name}: {error}\n")
    return code, said.getvalue().strip()
