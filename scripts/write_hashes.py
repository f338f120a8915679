#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Write requirements/hashes/*.txt: every package that set-up installs, with its files' hashes.

    ./heli python scripts/write_hashes.py

Of what requirements/*.txt ask for, in the versions of constraints.txt, uv looks up which packages
that takes on each Python from 3.11 on, and the SHA-256 of every file that the index has of them.
Set-up installs these lists with `--require-hashes`: another file of the same name is refused.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parents[1] / "requirements"
OLDEST = "3.11"
# What scripts/fuzz_atheris.py needs besides; set-up does not install it, so it is in no other list.
FUZZER = "atheris==3.0.0"
# The same of evidence/experiments/ah1s.py and of its tests.
OTHERS_PLANT = "jsbsim==1.3.3"
HEAD = "# Written by scripts/write_hashes.py from requirements/*.txt and constraints.txt.\n"
_BEGIN = re.compile(r"^(?=\S)", re.MULTILINE)
_PIN = re.compile(r"([\w.-]+)==([^\s;\\]+)")


def uv() -> str:
    """The uv that set-up has brought, or the one on PATH."""
    own = Path(sys.prefix) / "heli_uv" / "bin" / "uv"
    found = str(own) if own.is_file() else shutil.which("uv")
    if not found:
        raise SystemExit("write_hashes: there is no uv")
    return found


def locked(wanted: str) -> list[str]:
    """The blocks of a list with hashes, one per package, for requirements on lines."""
    command = [uv(), "pip", "compile", "--universal", "--python-version", OLDEST, "--no-header"]
    command += ["--generate-hashes", "--no-annotate", "-c", str(REQUIREMENTS / "constraints.txt")]
    done = subprocess.run([*command, "-"], input=wanted, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit("write_hashes: uv could not look them up")
    return [block for block in _BEGIN.split(done.stdout) if _PIN.match(block)]


def text_of(*names: str) -> str:
    """What requirement files ask for."""
    return "\n".join((REQUIREMENTS / f"{name}.txt").read_text("utf-8") for name in names)


def write(name: str, blocks: Sequence[str]) -> None:
    """Write a list."""
    folder = REQUIREMENTS / "hashes"
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.txt").write_text(HEAD + "".join(blocks), encoding="utf-8")


def main() -> int:
    """Write the lists: of uv, of what flies, and of what tests, guided fuzz, another's plant and
    compiled types need besides."""
    flying = locked(text_of("ros", "python") + "\npip\n")
    both = locked(text_of("ros", "python", "ros_test", "test") + "\npip\n")
    write("uv", locked("uv\n"))
    write("flight", flying)
    write("test", [block for block in both if block not in flying])
    write("fuzz", locked(f"{FUZZER}\n"))
    write("jsbsim", [block for block in locked(f"{OTHERS_PLANT}\n") if block not in flying])
    write("interfaces", [block for block in locked(text_of("interfaces")) if block not in flying])
    return 0


if __name__ == "__main__":
    sys.exit(main())
