# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Refusals in the package's own words; NumPy's and Python's carry no full stop."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any


def one_sentence(call: Callable[[], Any], refusals: Any = ValueError) -> Callable[[], Any]:
    """A call of which a refusal must be a sentence, raised by a ``raise`` statement."""

    def checked() -> Any:
        try:
            return call()
        except refusals as error:
            line = traceback.extract_tb(error.__traceback__)[-1].line or ""
            own = line.split()[:1] == ["raise"] and str(error).endswith((".", "?"))
            if not own:
                raise AssertionError(f"not a sentence of the package's own: {error!r}") from error
            raise

    return checked
