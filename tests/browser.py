# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Headless Chromium that opens an HTML file, for tests of the report and of the site."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # any network access is an error
    "--virtual-time-budget=10000",
    "--dump-dom",
)
# Script that writes the value of a promise, and all errors until then, into the page.
PROBE = """
const errors = [], page = document.documentElement;
console.error = (...words) => errors.push(words.join(' '));
addEventListener('error', ({target, error}) => {
    if (error || target !== window) errors.push(String(error?.stack ?? target.outerHTML));
}, true);
addEventListener('load', async () => {
    const value = await (%s).catch((error) => { errors.push(error.stack); });
    page.dataset.found = JSON.stringify([value ?? null, errors]);
});
"""


def chromium() -> str | None:
    """Return the path of the browser, or None if no browser is installed."""
    names = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


def value_in(page: Path, promise: str, *, width: int = 1200) -> Any:
    """Return the value of a promise in a page; fail on any error or network access."""
    script = PROBE % promise
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    html = page.read_text("utf-8").replace("script-src ", f"script-src 'sha256-{digest}' ", 1)
    probed = page.with_name(f"probed_{page.name}")
    probed.write_text(html.replace("</head>", f"<script>{script}</script></head>", 1), "utf-8")
    command = [str(chromium()), *OPTIONS, f"--window-size={width},900", probed.as_uri()]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    finally:
        probed.unlink()
    (text,) = re.findall(r'<html[^>]* data-found="([^"]*)"', done.stdout)
    value, errors = json.loads(unescape(text))
    assert errors == [], page
    return value
