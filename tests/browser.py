"""A headless Chromium for the tests of pages, spoken to over a pipe in its own protocol: no package is needed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PROGRAM = next(filter(None, map(shutil.which, NAMES)), None)
MISSING = "there is no Chromium on this machine: `apt-get install chromium` brings one"
WINDOW = "1280,800"


class Tab:
    """One page: what its JavaScript says, and its keys."""

    def __init__(self, into: BinaryIO, out: BinaryIO) -> None:
        self._into, self._out = into, out
        self._number, self._session = 0, ""
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.requests: list[str] = []
        self.errors: list[str] = []
        for domain in ("Page", "Network", "Runtime", "Performance"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **params: Any) -> Any:
        """Sends a command and gives its result; notes meanwhile what the page asks for, and what goes wrong in it."""
        self._number += 1
        told = {"id": self._number, "method": method, "params": params}
        if self._session:
            told["sessionId"] = self._session
        self._into.write(json.dumps(told).encode() + b"\0")
        self._into.flush()
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def _read(self) -> dict[str, Any]:
        text = bytearray()
        while (byte := self._out.read(1)) != b"\0":
            assert byte, "Chromium has ended"
            text += byte
        answer: dict[str, Any] = json.loads(text)
        match answer.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(answer["params"]["request"]["url"])
            case "Runtime.exceptionThrown":
                self.errors.append(str(answer["params"]["exceptionDetails"]))
        return answer

    def open(self, path: Path, fragment: str = "") -> None:
        self.send("Page.navigate", url=f"about:blank#{self._number}")  # else another fragment would load nothing
        self.send("Page.navigate", url=path.resolve().as_uri() + fragment)
        while self.value("document.readyState") != "complete" or self.value("location.protocol") != "file:":
            pass

    def value(self, expression: str) -> Any:
        """What an expression comes to, a promise included."""
        found = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def seconds(self) -> float:
        """The processor time that the process of the page has taken."""
        found = {metric["name"]: metric["value"] for metric in self.send("Performance.getMetrics")["metrics"]}
        return float(found["ProcessTime"])

    def press(self, key: str, shift: bool = False) -> None:
        text = {"text": key} if len(key) == 1 else {}
        for kind in ({"type": "keyDown", **text}, {"type": "keyUp"}):
            self.send("Input.dispatchKeyEvent", key=key, modifiers=8 * shift, **kind)


@contextmanager
def tab() -> Iterator[Tab]:
    """A new browser with one page."""
    assert PROGRAM is not None, MISSING
    from_us, into = os.pipe()
    out, to_us = os.pipe()
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", f"--window-size={WINDOW}",
                 "--disable-dev-shm-usage", f"--user-data-dir={folder}", "--remote-debugging-pipe"]  # fmt: skip
        # Chromium reads from 3 and writes to 4.
        command = f'exec "$0" "$@" 3<&{from_us} 4>&{to_us}'
        browser = subprocess.Popen(
            ["bash", "-c", command, PROGRAM, *flags], pass_fds=(from_us, to_us), stderr=subprocess.DEVNULL
        )
        os.close(from_us)
        os.close(to_us)
        with os.fdopen(into, "wb") as to_browser, os.fdopen(out, "rb") as from_browser:
            try:
                yield Tab(to_browser, from_browser)
            finally:
                browser.terminate()
                browser.wait(10)
