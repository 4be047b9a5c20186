# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plugin of pytest for ``make doctest``: examples in docstrings, each in an empty folder.

The examples write meshes and results. Functions under `checked` are wrapped in another module,
and Python's doctest passes over functions of other modules: it is shown what they wrap.
"""

import doctest
import inspect

import pytest


class ExampleFinder(doctest.DocTestFinder):
    """Finder of examples in the docstrings of wrapped functions, too."""

    def _from_module(self, module, object):
        return super()._from_module(module, inspect.unwrap(object))


@pytest.hookimpl(tryfirst=True)
def pytest_configure():
    doctest.DocTestFinder = ExampleFinder  # pytest derives its finder from this name


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
