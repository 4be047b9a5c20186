# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Malformed files of every kind at every reader: type and form of the refusal, and their page."""

from pathlib import Path

import pytest
from bad_files import Bad, Door, doors, page, put, refusal

DOORS = {door.title: door for door in doors()}
CASES = [
    pytest.param(door, bad, id=f"{door.title}: {kind}")
    for door in DOORS.values()
    for kind, bad in door.bad.items()
    if isinstance(bad, Bad)
]


@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_the_file_that_is_damaged_is_a_good_one(tmp_path: Path, door: Door) -> None:
    # Else the refusals would say nothing of the damage; and no kind is forgotten.
    door.read(put(tmp_path, door, door.good))
    assert set(door.bad) == set(door.kinds)


@pytest.mark.parametrize(("door", "bad"), CASES)
def test_refused_in_one_sentence_of_the_readers_own(tmp_path: Path, door: Door, bad: Bad) -> None:
    kind, sentence = refusal(tmp_path, door, bad)
    assert kind == door.error.__name__, sentence or "read without a word"
    assert str(tmp_path / f"FILE{door.suffix}") in sentence
    assert sentence.endswith(".")
    assert not sentence.endswith("..")
    assert sentence.isprintable()
    assert len(sentence.replace(str(tmp_path), "")) < 300


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs /proc")
@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_a_file_that_cannot_be_read(tmp_path: Path, door: Door) -> None:
    # Reading the memory of a process at address 0 fails, also for those who may read every file.
    path = tmp_path / f"FILE{door.suffix}"
    path.symlink_to("/proc/self/mem")
    with pytest.raises(door.error) as refused:
        door.read(path)
    assert str(path) in str(refused.value)
    assert "cannot be read" in str(refused.value)
    assert str(refused.value).endswith("Input/output error.")


def test_the_page_says_what_the_readers_say() -> None:
    written = Path(__file__).parents[1] / "docs" / "bad_files.md"
    assert written.read_text(encoding="utf-8") == page()
