# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A headless Chromium that is driven over a pipe, for tests of the report."""

import base64
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any, Self

OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-extensions",
    "--no-first-run",
    "--remote-debugging-pipe",
    "--hide-scrollbars",
)


def chromium() -> str | None:
    """Path of the browser, None where there is none."""
    names = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


class Browser:
    """One page in a browser of its own, and what it said and asked for.

    Attributes:
        errors: of the console, and exceptions.
        requests: addresses that the page asked for, its own first.
    """

    def __init__(self) -> None:
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._home = tempfile.TemporaryDirectory(prefix="browser-", ignore_cleanup_errors=True)
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()

        def connect() -> None:  # the browser reads its descriptor 3 and writes to 4
            spare = [os.dup2(fd, 100 + i) for i, fd in enumerate((to_browser, from_browser))]
            for target, fd in zip((3, 4), spare, strict=True):
                os.dup2(fd, target)

        self._process = subprocess.Popen(
            [str(chromium()), *OPTIONS, f"--user-data-dir={self._home.name}", "about:blank"],
            preexec_fn=connect,
            close_fds=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._received = b""
        self._number = 0
        self._session: str | None = None
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._out)
        os.close(self._in)
        self._home.cleanup()

    def size(self, width: int, height: int) -> None:
        """Set the size of the page."""
        options = {"deviceScaleFactor": 1, "mobile": width < 600}
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, **options)

    def open(self, path: Path) -> None:
        """Open a file and wait until its report is drawn."""
        self._call("Page.navigate", url=path.resolve().as_uri())
        self.run(
            """new Promise((done, fail) => {
                const look = () => {
                    const failed = document.querySelector('main > [role=alert].alert');
                    if (document.documentElement?.dataset.drawn !== undefined) done(true);
                    else if (failed && failed.textContent.includes('could not be drawn')) fail(
                        new Error(failed.textContent));
                    else setTimeout(look, 50);
                };
                look();
            })"""
        )

    def run(self, expression: str) -> Any:
        """Value of an expression in the page."""
        options = {"awaitPromise": True, "returnByValue": True}
        answer = self._call("Runtime.evaluate", expression=expression, **options)
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"]["exception"].get("description"))
        return answer["result"].get("value")

    def screenshot(self, path: Path, element: str | None = None) -> Path:
        """Picture of an element, or of the whole page."""
        options: dict[str, Any] = {"captureBeyondViewport": True}
        if element is not None:
            box = self.run(
                f"""(() => {{ const box = document.querySelector({element!r})
                .getBoundingClientRect(); return {{x: box.x + scrollX, y: box.y + scrollY,
                width: box.width, height: box.height, scale: 1}}; }})()"""
            )
            options["clip"] = box
        data = self._call("Page.captureScreenshot", **options)["data"]
        path.write_bytes(base64.b64decode(data))
        return path

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                result: dict[str, Any] = answer["result"]
                return result
            self._note(answer)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._received:
            part = os.read(self._in, 1 << 20)
            assert part, f"the browser ended with {self._process.wait()}"
            self._received += part
        message, self._received = self._received.split(b"\0", 1)
        found: dict[str, Any] = json.loads(message)
        return found

    def _note(self, event: dict[str, Any]) -> None:
        method, content = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(content["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and content["type"] == "error":
            self.errors.append(json.dumps(content["args"]))
        elif method == "Log.entryAdded" and content["entry"]["level"] == "error":
            self.errors.append(content["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(content["request"]["url"])
