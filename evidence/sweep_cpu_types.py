# SPDX-License-Identifier: Apache-2.0
"""Run the tests as other processors would: a table of combination, passed, failed, names.

Usage: ./heli python -m evidence.sweep_cpu_types [--quick] [--only NAME] [--json] [OF PYTEST]

BLAS kernels (OPENBLAS_CORETYPE), compiled kernels (NUMBA_CPU_NAME), the C library's mathematics
(GLIBC_TUNABLES), NumPy's loops (NPY_DISABLE_CPU_FEATURES), one and two BLAS threads: one at a time,
and once all of them (cpu_types.py says why that is enough). Each is checked to have taken effect;
what a processor cannot imitate, or what comes out as a combination that has been run, is named and
left out.

Exit code 0: all passed; 1: a test failed; 2: bad input.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from xml.etree import ElementTree

from rich.console import Console

from evidence.cpu_types import Combination, CpuTypeError, Effective, chosen, combinations, effective

ROOT = Path(__file__).resolve().parents[1]
# Tests that compute and open no graph.
NUMERICAL = (
    "src/heli_core",
    "src/heli_dynamics_sim",
    "src/heli_analysis",
    "src/heli_inner_hinf",
    "src/heli_observer",
    "src/heli_outer_pd",
    "tests/verification",
)
_NOTHING_FAILED = (0, 1)


@dataclass
class Outcome:
    """What one combination gave; `remark` says why it was not run, or why pytest ended early."""

    name: str
    chose: Effective | None = None
    passed: int = 0
    skipped: int = 0
    failed: tuple[str, ...] = ()
    seconds: float = 0.0
    remark: str = ""
    broken: bool = False

    @property
    def good(self) -> bool:
        """Whether nothing has failed."""
        return not self.failed and not self.broken


def _name(case: ElementTree.Element) -> str:
    """Name of a test: its module's or class's place, and its own name."""
    return f"{case.get('classname', '').replace('.', '/')}::{case.get('name')}"


def read_results(path: Path) -> tuple[int, int, tuple[str, ...]]:
    """Passed, skipped, and the names of the failed, of pytest's JUnit file."""
    passed, skipped, failed = 0, 0, []
    for case in ElementTree.parse(path).iter("testcase"):
        if case.find("failure") is not None or case.find("error") is not None:
            failed.append(_name(case))
        elif case.find("skipped") is not None:
            skipped += 1
        else:
            passed += 1
    return passed, skipped, tuple(dict.fromkeys(failed))


def run(combination: Combination, chose: Effective, words: Sequence[str]) -> Outcome:
    """Run pytest under a combination; the output of a run that fails goes to stderr."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        junit = Path(folder) / "results.xml"
        options = [f"--rootdir={ROOT}", f"--config-file={ROOT}/pyproject.toml", "-q", "--tb=short"]
        options += ["-p", "no:cacheprovider", f"--junitxml={junit}"]
        command = [sys.executable, "-m", "pytest", *options, *words]
        done = subprocess.run(
            command, cwd=ROOT, env=combination.whole_env, capture_output=True, text=True
        )
        outcome = Outcome(combination.name, chose, seconds=time.monotonic() - begun)
        if junit.is_file():
            outcome.passed, outcome.skipped, outcome.failed = read_results(junit)
    if done.returncode not in _NOTHING_FAILED:
        outcome.broken = True
        output = (done.stdout + done.stderr).strip().splitlines() or ["no words"]
        outcome.remark = f"pytest ended with code {done.returncode}: {output[-1]}"
    if not outcome.good:
        sys.stderr.write(done.stdout + done.stderr)
    return outcome


def sweep(
    wanted: Sequence[Combination], words: Sequence[str], say: Callable[[str], None]
) -> list[Outcome]:
    """Run all combinations, those that come out as another one only once."""
    outcomes: list[Outcome] = []
    run_before: dict[Effective, str] = {}
    for number, combination in enumerate(wanted, 1):
        say(f"{number} of {len(wanted)}: {combination.name}")
        try:
            chose = effective(combination)
        except CpuTypeError as error:
            outcomes.append(Outcome(combination.name, remark=f"not run: {error}"))
            continue
        if chose in run_before:
            remark = f"not run: chooses what {run_before[chose]} chose"
            outcomes.append(Outcome(combination.name, chose, remark=remark))
            continue
        run_before[chose] = combination.name
        outcomes.append(run(combination, chose, words))
    return outcomes


def print_table(outcomes: Sequence[Outcome]) -> None:
    """The outcomes as Markdown, then one line per failed test."""
    print("| combination | BLAS | threads | kernels for | libm | NumPy loops | passed | skipped "
          "| failed | s |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    for row in outcomes:
        c = row.chose
        made = (c.blas, c.threads, c.compiler, c.libm, c.loops) if c else ("",) * 5
        if row.remark.startswith("not run"):
            counts = [row.remark, "", "", ""]
        else:
            counts = [str(row.passed), str(row.skipped), str(len(row.failed)), f"{row.seconds:.0f}"]
        print(f"| {' | '.join(str(cell) for cell in (row.name, *made, *counts))} |")
    for row in outcomes:
        for name in row.failed:
            print(f"FAILED under {row.name}: {name}")
        if row.broken:
            print(f"FAILED under {row.name}: {row.remark}")


def main() -> int:
    """Sweep; 0 all passed, 1 a test failed, 2 bad input."""
    parser = argparse.ArgumentParser(
        description="Run the tests as other processors would.",
        epilog="Everything else goes to pytest: paths, -k, -m.",
    )
    parser.add_argument("--quick", action="store_true", help="only the numerical packages' tests")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="combination")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    options, words = parser.parse_known_args()
    errors = Console(stderr=True, highlight=False)
    try:
        wanted = chosen(options.only, combinations())
    except CpuTypeError as error:
        errors.print(f"--only: {error}", soft_wrap=True)
        return 2
    if options.quick:
        words = [*NUMERICAL, *words]
    outcomes = sweep(wanted, words, lambda line: errors.print(line, soft_wrap=True))
    if options.json:
        print(json.dumps([asdict(row) for row in outcomes], indent=2))
    else:
        print_table(outcomes)
    if not any(row.passed or not row.good for row in outcomes):
        errors.print("no test was run", soft_wrap=True)
        return 2
    return 0 if all(row.good for row in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
