# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium driven over its own DevTools pipe: no driver, no further package.

One process of a test run has one browser, as to start it takes longer than most tests; each test
has a tab of its own, with a profile of its own.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
    "--enable-unsafe-swiftshader", "--remote-debugging-pipe", "--disable-renderer-backgrounding",
    "--disable-background-timer-throttling", "--disable-backgrounding-occluded-windows",
)  # fmt: skip
ANSWER_LIMIT_S = 120.0
_WAIT = """new Promise((yes, no) => {
  const end = performance.now() + LIMIT_MS;
  const look = () => {
    let ok = false;
    try { ok = Boolean(WANTED); } catch (error) { ok = false; }
    if (ok) yes(true);
    else if (performance.now() > end) no(new Error("not in time"));
    else setTimeout(look, 20);
  };
  look();
})"""


# Every way by which a script may send something, and the directive that forbids it.
_SENDING = """(() => {
  const [to, seen] = ["https://example.org/upload", []];
  document.addEventListener("securitypolicyviolation", (e) => seen.push(e.effectiveDirective));
  const load = (tag, name) => {
    const made = document.createElement(tag);
    if (tag === "link") made.rel = "stylesheet";
    made[name] = to;
    document.body.append(made);
  };
  fetch(to, { method: "POST", body: "flight" }).catch(() => {});
  navigator.sendBeacon(to, "flight");
  new WebSocket(to.replace("https", "wss"));
  new EventSource(to);
  for (const [tag, name] of [["img", "src"], ["script", "src"], ["iframe", "src"], ["link", "href"],
    ["object", "data"], ["video", "src"]]) load(tag, name);
  const form = document.createElement("form");
  [form.action, form.method, form.target] = [to, "post", "_self"];
  document.body.append(form);
  form.submit();
  const inline = document.createElement("script");
  inline.textContent = "window.ranForeign = true";
  document.body.append(inline);
  window.forbidden = seen;
})()"""
_FORBIDDEN = {
    "connect-src", "img-src", "script-src-elem", "frame-src", "style-src-elem", "object-src",
    "media-src", "form-action",
}  # fmt: skip


class Browser:
    """A Chromium that the pages of a test run share."""

    def __init__(self, profile: Path, program: str):
        spare = []
        while not spare or spare[-1] < 10:
            # So that none of our own descriptors is 3 or 4, which the browser speaks on.
            spare.append(os.open(os.devnull, os.O_RDONLY))
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()

        def speak_on_3_and_4():
            os.dup2(to_read, 3)
            os.dup2(to_write, 4)

        command = [program, *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            command, pass_fds=(3, 4), preexec_fn=speak_on_3_and_4, stderr=subprocess.DEVNULL
        )
        for descriptor in (*spare, to_read, to_write):
            os.close(descriptor)
        self._buffer, self._count = b"", 0
        self.broken = False
        self.listeners: dict[str, Callable[[str, dict], None]] = {}

    def call(self, method: str, session: str | None, **parameters):
        """Send a command, return its result; events that come before it go to their sessions.

        What breaks in the middle of an answer leaves a browser that nobody can speak to any more.
        """
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if session:
            message["sessionId"] = session
        self.broken = True
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._count:
            if listener := self.listeners.get(answer.get("sessionId", "")):
                listener(answer["method"], answer["params"])
        self.broken = False
        assert "error" not in answer, f"{method}: {answer['error']}"
        return answer["result"]

    def _next(self) -> dict:
        until = time.monotonic() + ANSWER_LIMIT_S
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, until - time.monotonic()))
            assert ready, f"the browser was silent for {ANSWER_LIMIT_S:g} s"
            data = os.read(self._read, 1 << 20)
            assert data, "the browser has ended"
            self._buffer += data
        raw, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(raw)

    def close(self) -> None:
        """End it."""
        try:
            os.write(self._write, b'{"id": 0, "method": "Browser.close"}\0')
            self._process.wait(10.0)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)


class Page:
    """One tab in a profile of its own; collects what goes wrong in it and what it asks for."""

    def __init__(self, browser: Browser):
        self.browser, self._session = browser, None
        self.errors: list[str] = []
        self._asked: dict[str, str] = {}
        self._profile = self.call("Target.createBrowserContext")["browserContextId"]
        made = self.call("Target.createTarget", url="about:blank", browserContextId=self._profile)
        attached = self.call("Target.attachToTarget", targetId=made["targetId"], flatten=True)
        self._session = attached["sessionId"]
        browser.listeners[self._session] = self._note
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    @property
    def requests(self) -> list[str]:
        """Addresses that were asked of the network."""
        return list(self._asked.values())

    def call(self, method: str, **parameters):
        """Send a command, return its result; events that come before it are noted."""
        return self.browser.call(method, self._session, **parameters)

    def _note(self, method: str, event: dict) -> None:
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(event["exceptionDetails"])[:500])
        elif method == "Runtime.consoleAPICalled" and event["type"] in ("error", "warning"):
            self.errors.append(json.dumps(event["args"])[:500])
        elif method == "Log.entryAdded" and event["entry"]["level"] in ("error", "warning"):
            text = event["entry"]["text"]
            # Remarks of the drawing software on its own speed are not the page's.
            if "GL Driver Message" not in text:
                self.errors.append(text)
        elif method == "Network.requestWillBeSent":
            self._asked[event["requestId"]] = event["request"]["url"]
        elif method == "Network.loadingFailed" and event.get("blockedReason") == "csp":
            # What the page's own policy has stopped never left the browser.
            self._asked.pop(event["requestId"], None)

    def try_to_send(self) -> None:
        """Try every way to send something; the page's policy must forbid each."""
        self.value(_SENDING)
        wanted = json.dumps(sorted(_FORBIDDEN))
        self.wait(f"{wanted}.every(name => window.forbidden.includes(name))")
        # fetch, beacon, WebSocket and EventSource; twice where a header forbids it, too
        tried = "window.forbidden.filter(name => name === 'connect-src').length"
        self.wait(f"{tried} >= 4")
        assert self.value("window.ranForeign === undefined")

    def tabs(self) -> list[str]:
        """Addresses of all open tabs."""
        targets = self.call("Target.getTargets")["targetInfos"]
        return [
            target["url"] for target in targets
            if target["type"] == "page" and target["browserContextId"] == self._profile
        ]  # fmt: skip

    def size(self, width: int, height: int, phone: bool = False) -> None:
        """Size of the window in CSS pixels; as a phone also its touch and its scale."""
        scale = 2 if phone else 1
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=scale, mobile=phone,
        )  # fmt: skip
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)

    def prefer(self, scheme: str) -> None:
        """What the user's system prefers: light or dark."""
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.call("Emulation.setEmulatedMedia", features=[feature])

    def open(self, where: Path | str, ready: str) -> None:
        """Load a file or an address and wait until the expression `ready` is true."""
        url = where if isinstance(where, str) else where.absolute().as_uri()
        self.call("Page.navigate", url=url)
        self.wait(ready)

    def wait(self, expression: str, limit_s: float = ANSWER_LIMIT_S) -> None:
        """Wait until an expression is true."""
        script = _WAIT.replace("LIMIT_MS", f"{1000 * limit_s:g}").replace("WANTED", expression)
        until = time.monotonic() + limit_s
        while True:
            # A page that is still being loaded may take the first attempt's context with it.
            answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True)
            if "exceptionDetails" not in answer and answer["result"].get("value") is True:
                return
            assert time.monotonic() < until, f"not in time: {expression}"

    def value(self, expression: str):
        """Value of an expression; a promise is awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def text(self, selector: str) -> str:
        """Text of an element as it is seen."""
        return self.value(f"document.querySelector({json.dumps(selector)}).innerText")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press, move, release the left button."""
        middle = tuple(0.5 * (a + b) for a, b in zip(start, end, strict=True))
        steps = (("mousePressed", start), ("mouseMoved", middle), ("mouseMoved", end))
        for kind, (x, y) in (*steps, ("mouseReleased", end)):
            self.call(
                "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1,
                clickCount=1,
            )  # fmt: skip

    def screenshot(self, path: Path, whole: bool = True) -> None:
        """Write a PNG of the window, or of the whole page."""
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=whole, **self._clip(whole))
        path.write_bytes(base64.b64decode(shot["data"]))

    def _clip(self, whole: bool) -> dict:
        if not whole:
            return {}
        box = self.call("Page.getLayoutMetrics")["cssContentSize"]
        return {"clip": {**box, "scale": 1}}

    def close(self) -> None:
        """Close the tab, and forget its profile."""
        if self.browser.broken:
            return
        self.browser.listeners.pop(self._session)
        self._session = None
        self.call("Target.disposeBrowserContext", browserContextId=self._profile)


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of a Chromium; the tests are skipped where there is none."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no Chromium on this machine: install the package chromium")
    return path


@pytest.fixture(scope="session")
def new_page(chromium, tmp_path_factory):
    """Opens a tab, in the browser of this process; in another one after one that is broken."""
    browsers: list[Browser] = []

    def opened() -> Page:
        if not browsers or browsers[-1].broken:
            browsers.append(Browser(tmp_path_factory.mktemp("browser") / "profile", chromium))
        return Page(browsers[-1])

    yield opened
    for browser in browsers:
        browser.close()


@pytest.fixture
def page(new_page):
    """A fresh tab, as of a new browser."""
    tab = new_page()
    yield tab
    tab.close()
