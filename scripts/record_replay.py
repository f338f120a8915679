#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Make docs/replay.png, and measure how long a jump in a replay takes in a browser.

    ./heli python scripts/record_replay.py

It flies from the ground to the ground in lockstep, opens the flight's replay in a headless
Chromium, jumps to and fro and says how long it took from the slider's move until the new moment was
drawn, then goes to the touch-down and writes the picture.
"""

import argparse
import importlib.util
import io
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

from PIL import Image

from heli_flight.replay import replay_of, served
from heli_live_view.replay import GROUND

ROOT = Path(__file__).resolve().parent.parent
SIZE_PX = (1440, 900)
# Moves the slider as a hand does; done when the frame with that moment has been drawn.
JUMP = """(async () => {
  const slider = document.getElementById("replay-at");
  const begun = performance.now();
  slider.value = WANTED;
  slider.dispatchEvent(new Event("input"));
  const there = () => Math.abs(heliView.flight.last.t - WANTED) < 0.006;
  const frame = () => new Promise((yes) => requestAnimationFrame(yes));
  while (!there()) await frame();
  const drawn = heliView.scene.renderer.info.render.frame;
  while (heliView.scene.renderer.info.render.frame === drawn) await frame();
  return performance.now() - begun;
})()"""


def browser_driver() -> ModuleType:
    """The browser tests' driver of Chromium."""
    spec = importlib.util.spec_from_file_location("driver", ROOT / "tests/browser/conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def fly(folder: Path) -> Path:
    """A flight of the graph from the ground to the ground."""
    command = [sys.executable, "-m", "heli_flight.start", "heli", "hover", "--out", str(folder)]
    subprocess.run([*command, "--scenario", "takeoff_land"], check=False)
    return folder


def jumps(page: object, to_s: float, count: int) -> list[float]:
    """Times that jumps to random moments took, ms."""
    at = random.Random(1)
    return [
        page.value(JUMP.replace("WANTED", f"{at.uniform(0.0, to_s):.2f}"))  # type: ignore[attr-defined]
        for _ in range(count)
    ]


def main() -> int:
    """Fly, or take a flight; measure; write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flight", type=Path, help="a flight's folder (default: fly one)")
    parser.add_argument("--count", type=int, default=40, help="jumps to measure")
    parser.add_argument("--out", type=Path, default=ROOT / "docs/replay.png")
    given = parser.parse_args()
    driver = browser_driver()
    program = next(filter(None, map(driver.shutil.which, driver.NAMES)), None)
    if program is None:
        print("no Chromium on this machine", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        replay, beside = replay_of(given.flight or fly(Path(folder) / "flight"))
        touch = [e.time_s for e in replay.events if e.kind == GROUND][-1:] or [0.0]
        length_s = replay.recording.seconds(replay.recording.last_ns)
        browser = driver.Browser(Path(folder) / "profile", program)
        page = driver.Page(browser)
        try:
            with served(replay, 0, beside) as server:
                page.size(*SIZE_PX)
                page.open(f"{server.url}#t={touch[0]}", "heliView.scene.drawn && heliView.fps > 0")
                took = sorted(jumps(page, length_s, given.count))
                page.value(JUMP.replace("WANTED", f"{touch[0]:.2f}"))
                page.wait("document.querySelector('#events [aria-current]')")
                page.value("new Promise((yes) => setTimeout(yes, 1500))")
                page.screenshot(given.out, whole=False)
        finally:
            browser.close()
    with Image.open(io.BytesIO(given.out.read_bytes())) as picture:
        picture.convert("RGB").save(given.out, optimize=True)
    load, cores = os.getloadavg()[0], os.cpu_count()
    print(
        f"{len(took)} jumps in a record of {length_s:.0f} s, until drawn: median "
        f"{took[len(took) // 2]:.0f} ms, longest {took[-1]:.0f} ms (load {load:.1f}, {cores} cores)"
    )
    print(f"written: {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
