# SPDX-License-Identifier: Apache-2.0
"""Build sdist and wheel of heli-hover, and try the wheel in an empty environment without ROS.

    ./heli python scripts/release.py            # dist/*.whl, dist/*.tar.gz; says what was tried
    ./heli python scripts/release.py --tag      # and tags the commit, if all of it works

The environment has the wheel and what it needs, nothing else, and the tries are run from an empty
folder with no ROS in sight. Tried is this machine's platform alone. Exit code: 0, 1 a try failed,
2 versions or commit do not agree.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SPEC = """flights: 2
world: paper
gps: rtk
duration_s: 8.0
disperse:
  plant.scale.mass: {uniform: [0.95, 1.05]}
"""
SCRIPT = """
import heli, importlib.util
assert importlib.util.find_spec("rclpy") is None, "rclpy is here"
flight = heli.fly(seed=3, gps="rtk", duration_s=8.0, quiet=True)
assert not flight.lost
assert flight.report("from_python").is_file()
print(heli.__version__)
"""
TRIES = (
    ("version", ["heli", "--version"]),
    ("fly", ["heli", "hover", "--one-process", "--duration", "8", "--out", "flight"]),
    ("report", ["heli", "report", "flight"]),
    ("design", ["heli", "design", "--out", "design"]),
    ("campaign", ["heli", "campaign", "spec.yaml", "--out", "campaign"]),
    ("Python", ["python", "-c", SCRIPT]),
)


def versions() -> dict[str, str]:
    """The version by each file that says it."""
    found = {
        "pyproject.toml": tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    }
    citation = re.search(r"(?m)^version: (\S+)$", (ROOT / "CITATION.cff").read_text())
    found["CITATION.cff"] = citation[1] if citation else ""
    for manifest in sorted(ROOT.glob("src/*/package.xml")):
        said = re.search(r"<version>([^<]+)</version>", manifest.read_text())
        found[str(manifest.relative_to(ROOT))] = said[1] if said else ""
    heads = re.findall(r"(?m)^## (\d\S*) ", (ROOT / "CHANGELOG.md").read_text())
    found["CHANGELOG.md"] = heads[0] if heads else ""
    return found


def build(out: Path) -> tuple[Path, Path]:
    """sdist and wheel in a folder, from the files that git knows."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name) / "tree"
        subprocess.run(["git", "clone", "-q", "--no-hardlinks", str(ROOT), str(tree)], check=True)
        builder = "from setuptools import build_meta as b; import sys; "
        builder += "print(getattr(b, sys.argv[1])(sys.argv[2]))"
        made = []
        for what in ("build_sdist", "build_wheel"):
            command = [sys.executable, "-c", builder, what, str(out.resolve())]
            done = subprocess.run(command, cwd=tree, capture_output=True, text=True)
            if done.returncode:
                raise SystemExit(f"release: {what} failed:\n{done.stderr}")
            made.append(out / done.stdout.split()[-1])
    return made[0], made[1]


def tried(wheel: Path, folder: Path) -> bool:
    """Install the wheel into an environment of its own, run every try; whether all succeeded."""
    home = folder / "venv"
    uv = Path(sys.prefix) / "heli_uv/bin/uv"
    venv.create(home, with_pip=not uv.is_file())
    python = str(home / "bin/python")
    pip = [python, "-m", "pip", "install", "--quiet"]
    if uv.is_file():
        pip = [str(uv), "pip", "install", "--quiet", "--python", python]
    constraints = ["--constraint", str(ROOT / "requirements/constraints.txt")]
    subprocess.run([*pip, *constraints, str(wheel.resolve())], check=True)
    there = folder / "work"
    there.mkdir()
    (there / "spec.yaml").write_text(SPEC)
    # Neither this checkout nor a ROS of the machine is in sight.
    hidden = ("PYTHONPATH", "AMENT_PREFIX_PATH", "ROS_DISTRO", "LD_LIBRARY_PATH", "VIRTUAL_ENV")
    env = {name: value for name, value in os.environ.items() if name not in hidden}
    env |= {"PATH": f"{home / 'bin'}:/usr/bin:/bin", "XDG_CACHE_HOME": str(folder / "cache")}
    good = True
    for what, words in TRIES:
        begun = time.monotonic()
        done = subprocess.run(words, cwd=there, env=env, capture_output=True, text=True)
        # A flight outside its bounds was flown, too.
        is_good = done.returncode in ((0, 1) if what in ("fly", "campaign") else (0,))
        is_good = is_good and "Traceback" not in done.stderr
        last = (done.stdout if is_good else done.stderr).strip().splitlines()[-1:]
        word = "works" if is_good else f"FAILS (exit code {done.returncode})"
        print(f"{what}: {word}, {time.monotonic() - begun:.0f} s: {' '.join(last)}", flush=True)
        good = good and is_good
    return good


def main() -> int:
    """Run; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", metavar="DIR")
    parser.add_argument("--tag", action="store_true", help="tag the commit if all of it works")
    options = parser.parse_args()
    said = versions()
    if len(set(said.values())) != 1:
        print(f"release: versions differ: {said}", file=sys.stderr)
        return 2
    (version,) = set(said.values())
    dirty = subprocess.run(
        ["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True
    )
    if options.tag and dirty.stdout:
        print("release: --tag: commit your changes first", file=sys.stderr)
        return 2
    sdist, wheel = build(options.out)
    for path in (sdist, wheel):
        print(f"built: {path} ({path.stat().st_size / 1e6:.1f} MB)", flush=True)
    with tempfile.TemporaryDirectory() as name:
        if not tried(wheel, Path(name)):
            return 1
    print("not tried: macOS, Windows, ARM; heli-hover[ros], which is for Linux on x86_64")
    if options.tag:
        subprocess.run(
            ["git", "tag", "-a", f"v{version}", "-m", f"heli-hover {version}"], cwd=ROOT, check=True
        )
        print(f"tagged: v{version}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
