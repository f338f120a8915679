#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Make docs/live_view.webp and docs/live_view.png: the live view of a real flight of the graph.

    ./heli python scripts/record_live_view.py

It flies the hover test in real time, keeps what the live view sends to browsers, shows that again
to a headless Chromium at a sixth of the speed (so that every frame can be taken, also where the
picture is drawn in software) and writes the frames as an animation at the flight's own speed.
"""

import argparse
import asyncio
import importlib.util
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import ModuleType

import aiohttp
from PIL import Image

from heli_flight.terminal import steps
from heli_live_view.access import Access
from heli_live_view.server import PageServer

ROOT = Path(__file__).resolve().parent.parent
WEB = ROOT / "src/heli_live_view/web"
SLOWER = 6.0
FRAMES_HZ = 10
LEAD_S = 1.5
ANIMATION_PX = (1280, 800)
WRITTEN_PX = (1024, 640)
STILL_PX = (1440, 900)
LARGEST_BYTES = 3_000_000


def browser_driver() -> ModuleType:
    """The browser tests' driver of Chromium."""
    spec = importlib.util.spec_from_file_location("driver", ROOT / "tests/browser/conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


async def listen(url: str) -> list[dict]:
    """All messages of a live view, until it ends."""
    async with aiohttp.ClientSession() as session:
        async with session.ws_connect(f"{url}ws", max_msg_size=0) as socket:
            return [json.loads(m.data) async for m in socket if m.type == aiohttp.WSMsgType.TEXT]


def fly(arguments: list[str], folder: Path) -> list[dict]:
    """Messages of a real-time flight, from its start to its end."""
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--live"]
    command += ["--live-port", "0", "--foxglove-port", "0", "--out", str(folder), *arguments]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=dict(os.environ)
    )
    assert process.stdout is not None
    for line in process.stdout:
        print(line, end="")
        if found := re.search(r"http://127\.0\.0\.1:\d+/", line):
            messages = asyncio.run(listen(found.group()))
            print(process.communicate()[0])
            return messages
    raise SystemExit(f"the flight gave no page (exit code {process.wait()})")


class Replay:
    """Serves the page with recorded messages of the flight times from `start_s` on, slowly."""

    def __init__(self, messages: list[dict], start_s: float) -> None:
        hello = next(m for m in messages if m["type"] == "hello")
        timed = [m for m in messages if m["type"] != "hello" and m.get("t") is not None]
        past = [m for m in timed if m["t"] < start_s]
        self._coming = [m for m in timed if m["t"] >= start_s]
        events = [m for m in past if m["type"] == "event"]
        rows = [m for m in past if m["type"] == "state"][::3]
        shown = {**hello, "history": rows, "events": events, "state_hz": 30 / SLOWER}
        self._hello = json.dumps(shown)
        self._start_s = start_s
        self._go = threading.Event()
        self.server = PageServer(WEB, 0, Access(""), self._greet, lambda command: None)
        self.server.start()
        threading.Thread(target=self._send, daemon=True).start()

    def _greet(self) -> str:
        self._go.set()
        return self._hello

    def _send(self) -> None:
        self._go.wait()
        begun = time.monotonic()
        for message in self._coming:
            due = begun + SLOWER * (message["t"] - self._start_s)
            time.sleep(max(0.0, due - time.monotonic()))
            send = self.server.send_state if message["type"] == "state" else self.server.send
            send(json.dumps(message))


def pictures(
    driver: ModuleType, messages: list[dict], times_s: list[float], size: tuple[int, int]
) -> list[Image.Image]:
    """Screenshots at flight times."""
    program = next(filter(None, map(driver.shutil.which, driver.NAMES)), None)
    if program is None:
        raise SystemExit("no Chromium on this machine: install the package chromium")
    replay = Replay(messages, times_s[0] - LEAD_S)
    taken = []
    with tempfile.TemporaryDirectory() as folder:
        browser = driver.Browser(Path(folder) / "profile", program)
        page = driver.Page(browser)
        page.prefer("dark")
        page.size(*size)
        page.open(f"{replay.server.url}?quality=high", "window.heliView && heliView.scene.drawn")
        file = Path(folder) / "frame.png"
        late_s = 0.0
        with steps("frames", len(times_s)) as progress:
            for t in times_s:
                page.wait(f"heliView.flight.playout >= {t}")
                page.screenshot(file, whole=False)
                taken.append(Image.open(io.BytesIO(file.read_bytes())).convert("RGB"))
                late_s = max(late_s, page.value("heliView.flight.playout") - t)
                progress(len(taken))
        browser.close()
    print(f"{len(taken)} frames, at most {late_s:.2f} s late")
    replay.server.stop()
    return taken


def write_animation(frames: list[Image.Image], path: Path) -> None:
    """Write an animated WebP, as fine as the largest size allows."""
    small = [frame.resize(WRITTEN_PX, Image.Resampling.LANCZOS) for frame in frames]
    for quality in (70, 60, 50, 40, 30):
        small[0].save(
            path, save_all=True, append_images=small[1:], duration=round(1000 / FRAMES_HZ), loop=0,
            quality=quality, method=4,
        )  # fmt: skip
        if path.stat().st_size < LARGEST_BYTES:
            break
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, {len(frames)} frames, quality {quality}")


def main() -> None:
    """Fly, record, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder (default docs)")
    parser.add_argument("--seed", default="11")
    parser.add_argument("--gps", default="rtk", choices=("rtk", "standalone"))
    parser.add_argument("--from", dest="start_s", type=float, default=16.5, help="flight time, s")
    parser.add_argument("--length", type=float, default=9.0, help="s")
    parser.add_argument("--still", type=float, default=15.0, help="flight time of the still, s")
    options = parser.parse_args()
    driver = browser_driver()
    end_s = max(options.start_s + options.length, options.still) + 1.0
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["--seed", options.seed, "--gps", options.gps, "--duration", f"{end_s:g}"]
        messages = fly(arguments, Path(folder) / "flight")
    still = pictures(driver, messages, [options.still], STILL_PX)[0]
    still.save(options.out / "live_view.png", optimize=True)
    count = round(options.length * FRAMES_HZ)
    times_s = [options.start_s + k / FRAMES_HZ for k in range(count)]
    write_animation(
        pictures(driver, messages, times_s, ANIMATION_PX), options.out / "live_view.webp"
    )


if __name__ == "__main__":
    main()
