# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a ``.msh`` file says, gone through before Gmsh reads it.

Gmsh believes the counts, dimensions and tags of a file, and crashes or reads for ever where they
are wrong. The grammar is that of Gmsh's reference manual, MSH file format versions 4.1 and 2.2, as
text and binary. Numbers are not looked at beyond their counts, types and tags.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError

Floats = NDArray[np.float64]
Tags = NDArray[np.int64]

READ = ("PhysicalNames", "Entities", "Nodes", "Elements")
"""Sections that hold a mesh; what others hold is not given to Gmsh."""

_NAME = re.compile(rb"\s*(-?\d{1,9})\s+(-?\d{1,9})\s+\"([^\"\n]*)\"[ \t\r]*\n")
_LARGEST = 2**53  # of whole numbers that are read as floating ones; tags are counted up in practice
_MOST_TAGS = 2**31 - 1  # of entities and physical groups, which are 32 bits wide


class _Section:
    """Numbers of a section, one after the other.

    Args:
        name: Of the section.
        source: What errors call the file.
        data: The file.
        start: Where the section's content begins.
        binary: Whether its numbers are.
    """

    def __init__(self, name: str, source: str, data: bytes, start: int, binary: bool) -> None:
        self.name, self._source, self._data = name, source, data
        self._start, self._place, self._binary = start, start, binary
        self._numbers: Floats | None = None
        if not binary:
            self._end = data.find(b"$", start)
            if self._end < 0:
                self.fail("does not end")
            self._numbers, self._place = self._text(data[start : self._end]), 0

    def fail(self, what: str) -> NoReturn:
        """Refuse the section."""
        raise MeshError(f"{self._source}: the section ${self.name} {what}.")

    def _text(self, content: bytes) -> Floats:
        with warnings.catch_warnings():  # how NumPy tells that it stopped at what is no number
            warnings.simplefilter("error")
            try:
                return np.fromstring(content, dtype=np.float64, sep=" ")
            except (DeprecationWarning, ValueError):
                self.fail("holds something else than numbers")

    def take(self, count: int, kind: str) -> Floats | Tags:
        """The next numbers: ``i4`` and ``u8`` whole ones, ``f8`` any."""
        if self._numbers is None:
            size = count * int(kind[1])
            if count < 0 or self._place + size > len(self._data):
                self.fail("ends before what it announces")
            found = np.frombuffer(self._data, f"<{kind}", count, self._place)
            self._place += size
        else:
            if count < 0 or self._place + count > len(self._numbers):
                self.fail("ends before what it announces")
            found = self._numbers[self._place : self._place + count]
            self._place += count
        if kind == "f8":
            return found
        if count and not (
            found.min() >= -_LARGEST and found.max() <= _LARGEST and (found % 1 == 0).all()
        ):
            self.fail("holds a number where a whole one is needed")
        if count and kind == "u8" and found.min() < 0:
            self.fail("holds a negative number where a count or a tag is needed")
        return found.astype(np.int64)

    def whole(self, count: int, kind: str = "i4") -> list[int]:
        """The next whole numbers."""
        return [int(number) for number in self.take(count, kind)]

    def table(self, rows: int, columns: int, kind: str) -> Any:
        """The next rows of numbers, shape (rows, columns)."""
        if rows < 0 or rows > len(self._data):
            self.fail("announces more than the file can hold")
        return self.take(rows * columns, kind).reshape(rows, columns)

    def records(self, count: int, kind: list[Any]) -> Any:
        """The next records of a binary section."""
        size = count * np.dtype(kind).itemsize
        if count < 0 or self._place + size > len(self._data):
            self.fail("ends before what it announces")
        self._place += size
        return np.frombuffer(self._data, kind, count, self._place - size)

    def alike(self, most: int, width: int, column: int, values: tuple[int, ...]) -> int:
        """How many of the next rows hold some values from a column on."""
        if self._numbers is None:
            count = min(most * width, (len(self._data) - self._place) // 4)
            ahead: Any = np.frombuffer(self._data, "<i4", count, self._place)
        else:
            ahead = self._numbers[self._place : self._place + most * width]
        rows = ahead[: len(ahead) // width * width].reshape(-1, width)
        other = (rows[:, column : column + len(values)] != values).any(axis=1)
        return int(other.argmax()) if other.any() else len(rows)

    def end(self) -> int:
        """Where the file goes on after the section."""
        if self._numbers is not None and self._place != len(self._numbers):
            self.fail("holds more numbers than it announces")
        place = self._place if self._numbers is None else self._end
        return _after(self._data, place, self.name, self.fail)


def _after(data: bytes, place: int, name: str, fail: Callable[[str], NoReturn]) -> int:
    """Where a file goes on after the end mark of a section."""
    mark = re.compile(rb"\s*\$End" + name.encode() + rb"[ \t\r]*(\n\s*|$)").match(data, place)
    if mark is None:
        fail(f"does not end with '$End{name}' after what it announces")
    return mark.end()


class Contents:
    """What is known of a mesh while its sections are gone through.

    Args:
        data: The file.
        source: What errors call it.
        nodes_per_cell: Number of nodes of a Gmsh type of cell; raises an exception without one.

    Raises:
        MeshError: The file contradicts itself or is of another version.
    """

    def __init__(self, data: bytes, source: str, nodes_per_cell: Callable[[int], int]) -> None:
        self._data, self._source, self._nodes_per_cell = data, source, nodes_per_cell
        self._entities: set[tuple[int, int]] = set()
        self._nodes: Tags = np.zeros(0, dtype=np.int64)
        self._binary, self._old = False, False
        self.others = False
        self.parts: list[bytes] = []
        place = 0
        while place < len(data):
            place = self._section(place)

    def _section(self, place: int) -> int:
        """Go through one section; return where the next begins."""
        mark = re.compile(rb"\s*\$(\w{1,40})[ \t\r]*\n").match(self._data, place)
        if mark is None:
            shown = self._data[place : place + 30].decode("latin-1")
            raise MeshError(f"{self._source} has {shown!r} where a section must begin.")
        name, start = mark[1].decode(), mark.end()
        if name in ("ParametricNodes", "PartitionedEntities"):
            self._refuse(
                f"has a section ${name}; write it without parameters of nodes and unpartitioned"
            )
        if name not in ("MeshFormat", *READ):
            end = self._data.find(f"$End{name}".encode(), start)
            if end < 0:
                raise MeshError(f"{self._source}: the section ${name} does not end.")
            self.others = True
            return _after(self._data, end, name, self._refuse)
        if name != "MeshFormat" and not self.parts:
            raise MeshError(f"{self._source} must begin with the section $MeshFormat.")
        if name.encode() in [part.split(None, 1)[0][1:] for part in self.parts]:
            raise MeshError(f"{self._source} has two sections ${name}.")
        end = {
            "MeshFormat": self._format,
            "PhysicalNames": self._names,
            "Entities": self._entities_of,
            "Nodes": self._nodes_22 if self._old else self._nodes_41,
            "Elements": self._elements_22 if self._old else self._elements_41,
        }[name](start)
        self.parts.append(self._data[mark.start() : end])
        return end

    def _refuse(self, what: str) -> NoReturn:
        raise MeshError(f"{self._source} {what}.")

    def _format(self, start: int) -> int:
        head = re.compile(rb"\s*([\d.]{1,9})\s+([01])\s+8[ \t\r]*\n").match(self._data, start)
        if head is None or head[1] not in (b"4.1", b"2.2"):
            line = self._data[start : start + 30].split(b"\n")[0].decode("latin-1")
            raise MeshError(
                f"{self._source} is of the format {line!r}; 4.1 and 2.2 are read, with numbers of "
                "8 bytes."
            )
        self._old, self._binary, place = head[1] == b"2.2", head[2] == b"1", head.end()
        if self._binary:
            if self._data[place : place + 4] != b"\1\0\0\0":
                raise MeshError(f"{self._source} was written with another order of bytes.")
            place += 4
        return _after(self._data, place, "MeshFormat", self._refuse)

    def _names(self, start: int) -> int:
        count = re.compile(rb"\s*(\d{1,6})[ \t\r]*\n").match(self._data, start)
        if count is None:
            raise MeshError(f"{self._source}: the section $PhysicalNames must begin with a count.")
        place = count.end()
        for _ in range(int(count[1])):
            found = _NAME.match(self._data, place)
            if found is None or not (0 <= int(found[1]) <= 3 and int(found[2]) > 0):
                raise MeshError(
                    f"{self._source}: the section $PhysicalNames must have {int(count[1])} lines "
                    "of a dimension, a tag and a name."
                )
            try:
                found[3].decode()
            except UnicodeDecodeError:
                raise MeshError(f"{self._source} has a name that is no UTF-8.") from None
            place = found.end()
        return _after(self._data, place, "PhysicalNames", self._refuse)

    def _open(self, name: str, start: int) -> _Section:
        return _Section(name, self._source, self._data, start, self._binary)

    def _entities_of(self, start: int) -> int:
        section = self._open("Entities", start)
        for dim, count in enumerate(section.whole(4, "u8")):
            for _ in range(count):
                (tag,) = section.whole(1)
                if not 0 < tag <= _MOST_TAGS or (dim, tag) in self._entities:
                    section.fail(f"has the tag {tag} of dimension {dim}, which no entity can have")
                self._entities.add((dim, tag))
                box = section.take(6 if dim else 3, "f8")
                if not np.isfinite(box).all():
                    section.fail("holds a coordinate that is not finite")
                (groups,) = section.whole(1, "u8")
                if not all(0 < abs(t) <= _MOST_TAGS for t in section.whole(groups)):
                    section.fail("holds a tag that no group can have")
                if dim:
                    (sides,) = section.whole(1, "u8")
                    section.take(sides, "i4")
        return section.end()

    def _entity(self, section: _Section) -> tuple[int, int, int, int]:
        """Head of a block of nodes or cells: dimension, tag, a number of its own, how many."""
        (dim, tag, own), (count,) = section.whole(3), section.whole(1, "u8")
        if (dim, tag) not in self._entities:
            section.fail(f"names the entity {tag} of dimension {dim}, which is none of the file's")
        return dim, tag, own, count

    def _nodes_41(self, start: int) -> int:
        section = self._open("Nodes", start)
        blocks, total, least, most = section.whole(4, "u8")
        tags = []
        for _ in range(blocks):
            dim, _, parametric, count = self._entity(section)
            if parametric not in (0, 1):
                section.fail("has nodes that are neither parametric nor not")
            tags.append(section.table(count, 1, "u8")[:, 0])
            section.table(count, 3 + dim * parametric, "f8")
        self._nodes = np.concatenate([self._nodes, *tags])
        self._check_tags(section, self._nodes, total, least, most)
        return section.end()

    def _elements_41(self, start: int) -> int:
        section = self._open("Elements", start)
        blocks, total, least, most = section.whole(4, "u8")
        tags: list[Tags] = [np.zeros(0, dtype=np.int64)]
        for _ in range(blocks):
            _, _, kind, count = self._entity(section)
            cells = section.table(count, 1 + self._count_of(section, kind), "u8")
            tags.append(cells[:, 0])
            self._check_known(section, cells[:, 1:])
        self._check_tags(section, np.concatenate(tags), total, least, most)
        return section.end()

    def _nodes_22(self, start: int) -> int:
        section = self._open_22("Nodes", start)
        (total,) = section.whole(1)
        if self._binary:
            self._nodes = section.records(total, [("tag", "<i4"), ("x", "<f8", 3)])["tag"]
        else:
            rows = section.table(total, 4, "f8")
            if not (rows[:, 0] % 1 == 0).all():
                section.fail("holds a number where a whole one is needed")
            self._nodes = rows[:, 0]
        self._nodes = self._nodes.astype(np.int64)
        self._check_tags(section, self._nodes, total, 1, _MOST_TAGS, exact=False)
        return section.end()

    def _elements_22(self, start: int) -> int:
        section = self._open_22("Elements", start)
        (total,), found, tags, nodes, window = section.whole(1), 0, [], [], 16
        while found < total:
            if self._binary:
                kind, many, more = section.whole(3)
            else:
                tag, kind, more = section.whole(3)
                many = 1
            if many < 1 or found + many > total or not 2 <= more <= 1000:
                section.fail("has a cell whose number of tags or of cells cannot be")
            count = self._count_of(section, kind)
            width = self._binary + more + count
            rows = section.table(many, width, "i4")
            if not self._binary:
                rows = np.insert(rows, 0, tag, axis=1)
            if many == 1:  # Gmsh writes a head for each cell: those that follow and are like it
                head = (kind, 1, more) if self._binary else (kind, more)
                most = min(total - found - 1, window)
                like = section.alike(most, 3 + width, 0 if self._binary else 1, head)
                more_rows = section.table(like, 3 + width, "i4")
                if self._binary:
                    rows = np.vstack([rows, more_rows[:, 3:]])
                else:
                    rows = np.vstack([rows, np.delete(more_rows, (1, 2), axis=1)])
                many += like
                window = 2 * many + 16
            tags.append(rows[:, 0])
            nodes.append(rows[:, 1 + more :].ravel())
            if not (rows[:, 1 : 1 + more] >= 0).all():
                section.fail("has a cell with a negative tag")
            found += many
        self._check_known(section, np.concatenate([self._nodes[:0], *nodes]))
        numbers = np.concatenate([self._nodes[:0], *tags])
        self._check_tags(section, numbers, total, 1, _MOST_TAGS, exact=False)
        return section.end()

    def _open_22(self, name: str, start: int) -> _Section:
        """A section of version 2.2, which begins with a count."""
        return _Section22(name, self._source, self._data, start, self._binary)

    def _count_of(self, section: _Section, kind: int) -> int:
        """Number of nodes of a type of cell."""
        try:
            return self._nodes_per_cell(kind)
        except Exception:
            section.fail(f"has cells of Gmsh type {kind}, which is none")

    def _check_known(self, section: _Section, nodes: Tags) -> None:
        if not np.isin(nodes, self._nodes).all():
            missing = int(nodes[~np.isin(nodes, self._nodes)].flat[0])
            section.fail(f"has a cell with the node {missing}, which is none of the file's")

    def _check_tags(
        self, section: _Section, tags: Tags, total: int, least: int, most: int, exact: bool = True
    ) -> None:
        """Refuse tags that are not what the section's first line says."""
        if len(tags) != total:
            section.fail(f"announces {total} and holds {len(tags)}")
        if not len(tags):
            return
        low, high = int(tags.min()), int(tags.max())
        if low < max(least, 1) or high > most or (exact and (low, high) != (least, most)):
            section.fail(f"announces tags from {least} to {most} and holds {low} to {high}")
        if len(np.unique(tags)) < len(tags):
            section.fail("holds a tag twice")


class _Section22(_Section):
    """A section of version 2.2: its first number is text, also in a binary file."""

    def __init__(self, name: str, source: str, data: bytes, start: int, binary: bool) -> None:
        self.name, self._source = name, source
        self._count: int | None = None
        if binary:
            head = re.compile(rb"\s*(\d{1,9})[ \t\r]*\n").match(data, start)
            if head is None:
                self.fail("must begin with a count")
            self._count, start = int(head[1]), head.end()
        super().__init__(name, source, data, start, binary)

    def whole(self, count: int, kind: str = "i4") -> list[int]:
        """The next whole numbers."""
        if self._count is not None:
            first, self._count = self._count, None
            return [first]
        return super().whole(count, kind)
