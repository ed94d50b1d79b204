"""Chromium without a screen, by its DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.request import Request, urlopen

from websockets.sync.client import ClientConnection, connect

if TYPE_CHECKING:
    from collections.abc import Iterator

PATIENCE = 60.0
"""Seconds: longer than anything takes."""
READY = "tfdb.scene.drawn > 0 && tfdb.state.drawn > 0 && tfdb.state.facts"
"""Of the page of `tfdb view`: it shows frames."""
OPTIONS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--remote-debugging-port=0",
]


class Page:
    """A tab of the browser. Threads: one."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._number = 0
        self.events: list[dict[str, Any]] = []

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol."""
        self._number += 1
        self._connection.send(json.dumps({"id": self._number, "method": method, "params": params}))
        while True:
            message = json.loads(self._connection.recv(timeout=PATIENCE))
            if message.get("id") == self._number:
                assert "error" not in message, message
                result: dict[str, Any] = message["result"]
                return result
            self.events.append(message)

    def run(self, code: str) -> Any:
        """Return the value of an expression of JavaScript; promises are awaited."""
        found = self.call(
            "Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, code: str) -> Any:
        """Wait, in the page, until an expression is true; return it."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = self.run(
                "new Promise((done) => { let left = 40; const look = () => {"
                f"let found; try {{ found = {code}; }} catch {{ found = null; }}"
                "if (found || !--left) done(typeof found === 'object' ? !!found : found);"
                "else setTimeout(look, 25); }; look(); })"
            )
            if found:
                return found
        raise AssertionError(f"not within {PATIENCE:.0f} s: {code}")

    def open(self, address: str, width: int = 1440, height: int = 900) -> None:
        """Load an address, and note all requests and errors from then on."""
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.resize(width, height)
        self.call("Page.navigate", url=address)

    def resize(self, width: int, height: int) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip

    def key(self, key: str) -> None:
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def type(self, text: str) -> None:
        self.call("Input.insertText", text=text)

    def click(self, x: float, y: float) -> None:
        where = {"x": x, "y": y, "button": "left", "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self.call("Input.dispatchMouseEvent", type="mousePressed", **where)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", **where)

    def place_of(self, selector: str) -> tuple[float, float]:
        """Return the middle of an element."""
        x, y = self.run(
            f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])"
            f"(document.querySelector({selector!r}).getBoundingClientRect())"
        )
        return x, y

    def press(self, selector: str) -> None:
        self.click(*self.place_of(selector))

    def screenshot(self) -> bytes:
        """Return a PNG of the page."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    @property
    def requests(self) -> list[str]:
        """Addresses that were asked for, WebSockets too."""
        self.run("1")
        names = {"Network.requestWillBeSent", "Network.webSocketCreated"}
        found = [each["params"] for each in self.events if each.get("method") in names]
        return [each["request"]["url"] if "request" in each else each["url"] for each in found]

    @property
    def errors(self) -> list[Any]:
        """Errors and warnings of the page."""
        self.run("1")
        found = []
        for each in self.events:
            if each.get("method") == "Runtime.exceptionThrown":
                found.append(each["params"]["exceptionDetails"])
            elif each.get("method") == "Log.entryAdded":
                found.append(each["params"]["entry"])
        return found


class Browser:
    """A browser that runs."""

    def __init__(self, port: int) -> None:
        self._port = port

    @contextmanager
    def page(self) -> Iterator[Page]:
        """Open a tab."""
        request = Request(f"http://127.0.0.1:{self._port}/json/new?about:blank", method="PUT")
        with urlopen(request, timeout=PATIENCE) as answer:
            target = json.load(answer)
        options: dict[str, Any] = {"max_size": None, "compression": None, "open_timeout": PATIENCE}
        with connect(target["webSocketDebuggerUrl"], **options) as connection:
            page = Page(connection)
            yield page
            page.call("Page.close")


def find_chromium() -> str | None:
    """Return the path of the browser, if there is one."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


@contextmanager
def chromium(program: str) -> Iterator[Browser]:
    """Run the browser."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        process = subprocess.Popen(
            [program, *OPTIONS, f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            written = Path(folder, "DevToolsActivePort")
            end = time.monotonic() + PATIENCE
            while not (written.exists() and "\n" in written.read_text()):
                assert process.poll() is None, "the browser ended"
                assert time.monotonic() < end, "the browser does not listen"
                time.sleep(0.05)
            yield Browser(int(written.read_text().split()[0]))
        finally:
            process.terminate()
            process.wait(PATIENCE)
