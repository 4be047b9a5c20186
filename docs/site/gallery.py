# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Page of demos: one card per demo, with a small picture, the title and the first sentence."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Mapping
from pathlib import Path

from PIL import Image

# Picture of a demo that draws several; without an entry it is the first one.
PICTURES = {"03_ambiesta": "deformed"}
WIDTH = 640  # of a small picture [pixels], twice the width of a card on the screen
HEIGHT = 400


def gallery(pages: Mapping[str, str], runs: Path) -> str:
    """Return the Markdown of the page, pictures included.

    Args:
        pages: Markdown of each demo's page, by the name of the demo.
        runs: Folder with one folder per demo, in which the demo ran.
    """
    cards = [_card(name, text, runs / name) for name, text in pages.items()]
    return "# Demos\n\n" + '<div class="gallery">\n' + "\n".join(cards) + "\n</div>\n"


def _card(name: str, page: str, run: Path) -> str:
    title = page.partition("\n")[0].removeprefix("# ")
    figures = sorted(run.rglob("*.png"))
    chosen = [figure for figure in figures if figure.stem == PICTURES.get(name)] or figures
    picture = f'<img src="{small(chosen[0])}" alt=""/>' if chosen else "<i></i>"
    return (
        f'<a href="{name}.html">{picture}<b>{html.escape(title)}</b>'
        f"<span>{html.escape(first_sentence(page))}</span></a>"
    )


def first_sentence(page: str) -> str:
    """Return the first sentence below a page's title, without Markdown."""
    paragraphs = [p for p in page.split("\n\n")[1:] if p[:1].isalnum()]
    words = " ".join(paragraphs[0].split()) if paragraphs else ""
    plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", words).replace("`", "").replace("*", "")
    return re.split(r"(?<=[.:])\s+(?=[A-Z])", plain)[0].removesuffix(":")


def small(figure: Path) -> str:
    """Return a picture, scaled to the width of a card and cut to its height, as a data URL."""
    with Image.open(figure) as whole:
        picture = whole.convert("RGB")
    height = round(picture.height * WIDTH / picture.width)
    picture = picture.resize((WIDTH, height), Image.Resampling.LANCZOS)
    card = Image.new("RGB", (WIDTH, HEIGHT), "white")
    card.paste(picture, (0, max(0, (HEIGHT - height) // 2)))
    file = io.BytesIO()
    card.save(file, "JPEG", quality=85)
    return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode()}"
