# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops whose machine code is kept by content: every copy of a version shares it.

numba keeps machine code beside the source of a loop, where a new clone or installation has none,
and makes it anew when that file changes, but not when a function or constant that it takes in from
another file does. Here it is kept in the user's cache folder, by the content of all these files.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
from functools import cache
from pathlib import Path
from typing import Any, Self

from numba import config
from numba import njit as njit
from numba.core import event

from dolfinx_joints.common.progress import LOGGER

# For functions that only other loops call: they need no way in from Python, which takes long to
# compile, and are kept with the loops.
part = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)

_PACKAGE = Path(__file__).resolve().parents[1]
_OTHERS = ("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator")


def sources() -> list[Path]:
    """Files with loops, and those that they import from: constants are compiled in."""
    found = set()
    for path in _PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "common.kernels import" in text or "numba" in text:
            names = re.findall(r"^from dolfinx_joints\.([\w.]+) import", text, re.MULTILINE)
            found |= {path, *(_PACKAGE / f"{name.replace('.', '/')}.py" for name in names)}
    return sorted(path for path in found if path.is_file())


@cache
def _folder() -> Path:
    """Where the machine code of these sources is kept."""
    content = hashlib.sha256()
    for path in sources():
        content.update(path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes())
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "dolfinx_joints" / "loops" / content.hexdigest()[:16]


class Locator:
    """Tells numba where the loops of this package are kept (``NUMBA_CACHE_LOCATOR_CLASSES``)."""

    def __init__(self, line: int) -> None:
        """Note the line on which a loop begins."""
        self._line = line

    @classmethod
    def from_function(cls, function: Any, file: str) -> Self | None:
        """A locator for a loop of this package, None for others or where nothing can be kept."""
        if _PACKAGE not in Path(file).resolve().parents:
            return None
        try:
            _folder().mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # no home, or a full disk
            return None
        return cls(function.__code__.co_firstlineno) if os.access(_folder(), os.W_OK) else None

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        _folder().mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(_folder())

    def get_source_stamp(self) -> str:
        """Return what code must agree in; the folder is named by it."""
        return _folder().name

    def get_disambiguator(self) -> str:
        """Return what tells loops of one name apart."""
        return str(self._line)


if not getattr(config, "CACHE_LOCATOR_CLASSES", ""):  # not set by the user; none before numba 0.62
    config.CACHE_LOCATOR_CLASSES = ",".join([f"{__name__}.{Locator.__name__}", *_OTHERS])


class _Told(event.Listener):  # type: ignore[misc]
    """Tells once that loops of this package are being compiled, which the first run waits for."""

    told = False

    def on_start(self, event: Any) -> None:
        """Machine code was not found and is about to be made."""
        module = event.data["dispatcher"].py_func.__module__ or ""  # none where code was executed
        ours = module.startswith("dolfinx_joints.")
        if ours and not self.told and LOGGER.isEnabledFor(logging.INFO):
            LOGGER.info("compiling loops, once for this version: up to a minute")
            self.told = True

    def on_end(self, event: Any) -> None:
        """It has been made."""


_LISTENER = _Told()
event.register("numba:compile", _LISTENER)
