#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Coverage-guided fuzz of a parser (cdr, yaml, mcap), by atheris.

    ./heli python -m pip install --no-deps --require-hashes -r requirements/hashes/fuzz.txt
    ./heli python scripts/fuzz_atheris.py mcap [--seconds 300] [--corpus FOLDER]

What reaches a new branch is kept in the corpus, which begins with good inputs. What fails is
written to `FOLDER/crash-...`, and to try it again: `... mcap --corpus FOLDER --again FILE`.
"""

import argparse
import contextlib
import os
import sys
import tempfile
from pathlib import Path

try:
    import atheris
except ImportError:
    sys.exit(
        "fuzz_atheris: atheris is not installed; ./heli python -m pip install --no-deps "
        "--require-hashes -r requirements/hashes/fuzz.txt"
    )

# What is imported here tells which of its branches are taken; kernels are compiled and cannot.
_WATCHED = ["heli_bags", "heli_msgs_bridge", "heli_core", "mcap", "rosbags.typesys", "yaml"]
_KERNELS = [f"heli_msgs_bridge.{name}" for name in ("frames", "layouts", "links")]
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
with atheris.instrument_imports(_WATCHED, _KERNELS, enable_loader_override=False):
    from support.fuzz_parsers import PARSERS

# A message or a file is no longer; the memory, MB, that one input may take.
_MOST_BYTES, _MOST_MB, _MOST_S = 65_536, 4096, 20


def main() -> int:
    """Fuzz until the time is over or something fails; atheris ends the process."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parser", choices=PARSERS)
    parser.add_argument("--seconds", type=int, default=300, metavar="S")
    parser.add_argument("--corpus", type=Path, metavar="FOLDER", help="by default a passing one")
    parser.add_argument("--again", type=Path, metavar="FILE", help="try this one input")
    asked = parser.parse_args()
    tried = PARSERS[asked.parser]
    with tempfile.TemporaryDirectory(prefix="heli_fuzz_") as passing:
        corpus = asked.corpus or Path(passing) / "corpus"
        corpus.mkdir(parents=True, exist_ok=True)
        for number, seed in enumerate(tried.seeds()):
            (corpus / f"seed{number}").write_bytes(seed)
        if asked.again:
            print(tried.attempt(asked.again.read_bytes(), Path(passing)) or "taken")
            return 0
        words = [sys.argv[0], f"-max_total_time={asked.seconds}", f"-max_len={_MOST_BYTES}"]
        words += [f"-rss_limit_mb={_MOST_MB}", f"-timeout={_MOST_S}", "-print_final_stats=1"]
        kept = asked.corpus or Path.cwd()
        words += [f"-artifact_prefix={kept}/", str(corpus)]
        # The fuzzer ends its process by itself, with nothing put away.
        fuzzing = os.fork()
        if not fuzzing:
            atheris.Setup(words, lambda data: tried.attempt(data, Path(passing)) and None)
            atheris.Fuzz()
        with contextlib.suppress(KeyboardInterrupt):
            return os.waitstatus_to_exitcode(os.waitpid(fuzzing, 0)[1])
        os.waitpid(fuzzing, 0)
    return 130


if __name__ == "__main__":
    sys.exit(main())
