# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A source distribution that keeps the link ``dolfinx_joints/geometry``; see pyproject.toml."""

from pathlib import Path

from setuptools import setup
from setuptools.command.sdist import sdist


class LinkedSdist(sdist):
    """A source distribution with ``geometry`` once, and the link to it."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Put the files, then the link, which setuptools would follow, into a folder."""
        super().make_release_tree(base_dir, files)
        Path(base_dir, "dolfinx_joints", "geometry").symlink_to("../geometry")


setup(cmdclass={"sdist": LinkedSdist})
