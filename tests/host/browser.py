"""A headless Chromium driven over two pipes by its own debugging protocol: nothing to install beside the browser."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any, Self

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *(
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-unsafe-swiftshader",
        "--disable-quic",
    ),
    *(
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
    ),
    *("--hide-scrollbars", "--force-device-scale-factor=1", "--remote-debugging-pipe"),
)
ANSWER_LIMIT_S = 120.0


class BrowserError(Exception):
    """The browser is missing, does not answer, or a script in the page failed."""


def find_browser() -> str:
    """Path of the browser.   Errors: BrowserError."""
    for name in NAMES:
        if (path := shutil.which(name)) is not None:
            return path
    raise BrowserError(f"none of {', '.join(NAMES)} is installed; run `make setup`")


class Page:
    """One tab. Everything it asks for and everything it complains of is kept."""

    def __init__(self, width: int = 1440, height: int = 900) -> None:
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self._profile = tempfile.TemporaryDirectory(prefix="crease-browser-")
        self._pid, self._to, self._from = self._start()
        self._bytes = b""
        self._last = 0
        target = self._ask("Target.createTarget", {"url": "about:blank"})["targetId"]
        attached = self._ask("Target.attachToTarget", {"targetId": target, "flatten": True})
        self._session: str | None = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")
        self.resize(width, height)

    def _start(self) -> tuple[int, int, int]:
        """The browser reads commands from descriptor 3 and writes answers to 4."""
        command_r, command_w = os.pipe()
        answer_r, answer_w = os.pipe()
        quiet = os.open(os.devnull, os.O_RDWR)
        actions = [
            # Moved out of the way first: a pipe may itself be 3 or 4.
            (os.POSIX_SPAWN_DUP2, command_r, 63),
            (os.POSIX_SPAWN_DUP2, answer_w, 64),
            (os.POSIX_SPAWN_DUP2, 63, 3),
            (os.POSIX_SPAWN_DUP2, 64, 4),
            (os.POSIX_SPAWN_DUP2, quiet, 1),
            (os.POSIX_SPAWN_DUP2, quiet, 2),
        ]
        program = find_browser()
        pid = os.posix_spawn(
            program,
            [program, *FLAGS, f"--user-data-dir={self._profile.name}", "about:blank"],
            os.environ,
            file_actions=actions,
        )
        for handle in (command_r, answer_w, quiet):
            os.close(handle)
        return pid, command_w, answer_r

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session = None
        try:
            self._ask("Browser.close", {})
        finally:
            os.close(self._to)
            os.close(self._from)
            os.waitpid(self._pid, 0)
            self._profile.cleanup()

    def _ask(self, method: str, params: dict[str, Any], session: str | None = None) -> Any:
        self._last += 1
        message: dict[str, Any] = {"id": self._last, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._to, data) :]
        end_s = time.monotonic() + ANSWER_LIMIT_S
        while True:
            answer = self._read(end_s)
            if answer.get("id") == self._last:
                if "error" in answer:
                    raise BrowserError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self._note(answer)

    def _read(self, end_s: float) -> dict[str, Any]:
        while b"\0" not in self._bytes:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end_s - time.monotonic()))
            chunk = os.read(self._from, 1 << 16) if ready else b""
            if not chunk:
                raise BrowserError("the browser does not answer")
            self._bytes += chunk
        line, self._bytes = self._bytes.split(b"\0", 1)
        message: dict[str, Any] = json.loads(line)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        """Requests, and whatever a console would show in yellow or red."""
        params = event.get("params", {})
        match event.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(params["request"]["url"])
            case "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                self.complaints.append(
                    details.get("exception", {}).get("description") or details["text"]
                )
            case "Runtime.consoleAPICalled" if params["type"] in ("error", "warning", "assert"):
                self.complaints.append(
                    " ".join(str(a.get("value", a.get("description"))) for a in params["args"])
                )
            case "Log.entryAdded" if params["entry"]["level"] == "error":
                self.complaints.append(params["entry"]["text"])

    def ask(self, method: str, **params: Any) -> Any:
        """One command of the debugging protocol to the tab."""
        return self._ask(method, params, self._session)

    def run(self, script: str) -> Any:
        """The value of an expression in the page, awaited.   Errors: BrowserError when it throws."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise BrowserError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def resize(self, width: int, height: int) -> None:
        """Size of the window inside, in pixels."""
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            **{"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
        )

    def dark(self, dark: bool) -> None:
        """What the page is told that its reader prefers."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])

    def open(self, path: Path, fragment: str = "") -> None:
        """Load a page of ours from disk, until it is ready."""
        self.ask("Page.navigate", url=path.resolve().as_uri() + fragment)
        end_s = time.monotonic() + ANSWER_LIMIT_S
        while not self.run("Boolean(window.crease)"):
            if time.monotonic() > end_s or self.complaints:
                raise BrowserError(f"{path}: does not come up: {'; '.join(self.complaints)}")
            time.sleep(0.05)
        self.run("crease.ready.then(() => 0)")

    def seek(self, frame: int) -> None:
        """Show a tick, and wait until it is on the screen."""
        twice = "requestAnimationFrame(() => requestAnimationFrame(() => done(0)))"
        self.run(f"crease.seek({frame}); new Promise((done) => {twice})")

    def press(self, key: str, shift: bool = False) -> None:
        """One key down and up."""
        for kind in ("keyDown", "keyUp"):
            self.ask(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                modifiers=8 if shift else 0,
                **({"text": key} if len(key) == 1 and kind == "keyDown" else {}),
            )

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """mousePressed, mouseMoved, mouseReleased or mouseWheel at a place of the window."""
        self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """The left button down at one place, up at another."""
        self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        self.mouse("mouseMoved", *end, button="left", buttons=1)
        self.mouse("mouseReleased", *end, button="left", clickCount=1)

    def picture(self, path: Path) -> None:
        """A screenshot as PNG."""
        data = self.ask("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))
