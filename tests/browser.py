"""A real browser (Chromium, headless) controlled over a pipe in its own protocol, without another dependency."""

import base64
import json
import os
import re
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.peers import absent

_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-pipe",
)
_PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
# puts its ends of two pipes at the browser's descriptors, 3 and 4, and becomes the browser
_START = """
import os, sys
ends = [os.dup(os.dup(os.dup(int(fd)))) for fd in sys.argv[1:3]]
for fd, wanted in zip(ends, (3, 4)):
    os.dup2(fd, wanted)
os.execv(sys.argv[3], sys.argv[3:])
"""
_PATIENCE_S = 120.0


class Browser:
    """One page of a running browser; ``events`` are its notifications since the start: method and parameters."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._number, self._session = 0, ""
        self._rest = b""
        self.events: list[tuple[str, dict[str, Any]]] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer to one question."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        for answer in self._messages():
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer)
                return dict(answer["result"])
        raise AssertionError(f"{method}: no answer")

    def show(self, address: str, width_px: int, height_px: int = 900) -> None:
        """Open an address in a window of this size and wait until all of it is there."""
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width_px,
            height=height_px,
            deviceScaleFactor=1,
            mobile=width_px < 600,
        )
        self.events.clear()
        assert "errorText" not in self.ask("Page.navigate", url=address)
        while not any(method == "Page.loadEventFired" for method, _ in self.events):
            next(self._messages())

    def value(self, script: str) -> Any:
        """Return what a script's last expression is worth on the page."""
        answer = self.ask("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def printed(self) -> tuple[int, bytes]:
        """Return how many pages it prints on its paper, and the PDF."""
        answer = self.ask("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        content = base64.b64decode(answer["data"])
        return len(re.findall(rb"/Type\s*/Page\b", content)), content

    @contextmanager
    def on_paper(self, width_px: int) -> Iterator[None]:
        """Lay the page out as for print, on paper of this width between its margins."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width_px, height=900, deviceScaleFactor=1, mobile=False)
        self.ask("Emulation.setEmulatedMedia", media="print")
        try:
            yield
        finally:
            self.ask("Emulation.setEmulatedMedia", media="")

    def complaints(self) -> list[str]:
        """Return what it has complained of since `show`: errors and warnings in its console, exceptions."""
        kinds = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
        return [json.dumps(params) for method, params in self.events if method in kinds]

    def requests(self) -> list[str]:
        """Return the addresses requested since `show`."""
        return [params["request"]["url"] for method, params in self.events if method == "Network.requestWillBeSent"]

    def _messages(self) -> Iterator[dict[str, Any]]:
        while True:
            while b"\0" not in self._rest:
                assert select.select([self._from], [], [], _PATIENCE_S)[0], "the browser says nothing"
                part = os.read(self._from, 1 << 20)
                assert part, "the browser has gone"
                self._rest += part
            one, self._rest = self._rest.split(b"\0", 1)
            message = json.loads(one)
            if "method" in message:
                self.events.append((message["method"], message.get("params", {})))
            yield message


@contextmanager
def browser(profile: Path, flags: Sequence[str] = ()) -> Iterator[Browser]:
    """Start Chromium with a new profile, and with these flags after its own; without it the test skips.

    It fails where Chromium is required.
    """
    program = next((found for name in _PROGRAMS if (found := shutil.which(name))), None)
    if program is None:
        absent("chromium", "apt install chromium")
    theirs_in, ours_out = os.pipe()
    ours_in, theirs_out = os.pipe()
    start = [sys.executable, "-S", "-c", _START, str(theirs_in), str(theirs_out)]
    process = subprocess.Popen(
        [*start, program, *_FLAGS, *flags, f"--user-data-dir={profile}"],
        pass_fds=(theirs_in, theirs_out),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs_in)
    os.close(theirs_out)
    try:
        found = Browser(ours_out, ours_in)
        yield found
        found.ask("Browser.close")
    finally:
        os.close(ours_out)
        os.close(ours_in)
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
