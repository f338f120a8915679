# SPDX-License-Identifier: Apache-2.0
"""gamma* by the level-set / Newton method against bisection to the same accuracy: times and their
ratio.

Usage: ./heli python scripts/bench_gamma_star.py [REPEATS]

Bisection uses the same split of the Riccati equation and, at every step, the acceptance rule but
for ||T_hw|| < gamma, which rounding blurs within 1e-5 of gamma*.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from heli_core.errors import CertificateError
from heli_core.parameters import load
from heli_inner_hinf.design import shaped
from heli_inner_hinf.parameters import NODE_NAME, TABLE
from heli_inner_hinf.regular_form import SplitProblem, checked_plant, regular_form, split, weights
from heli_inner_hinf.synthesis import REL_TOL, acceptance, gamma_star_of

YAML = Path(__file__).resolve().parent.parent / "src/heli_inner_hinf/config/inner_loop.yaml"


def bisected(problem: SplitProblem, upper: float) -> float:
    """gamma* by bisection below `upper`, relative accuracy REL_TOL, given units."""
    form = problem.form
    low, high = 0.0, upper
    while high - low > REL_TOL * high:
        gamma = 0.5 * (low + high)
        mu = (form.wind_scale / gamma) ** 2
        Z = problem.rest(mu)
        good = False
        if Z is not None and problem.coupling(Z)[0] < 1.0:
            certificate, _, _ = acceptance(form, problem.solution(Z, mu), gamma)
            good = all(c.holds for c in certificate.conditions[:-1])
        low, high = (low, gamma) if good else (gamma, high)
    return high


def best_of(action: Callable[[], object], repeats: int) -> float:
    """Shortest of `repeats` run times, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> int:
    """Print the table; 0 on success."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    p = load(TABLE, [YAML], NODE_NAME)
    C, D = weights(p["C11"], p["C22"], p["D11"])
    plants = {
        "aircraft, 9 states": (
            shaped("A", p["model.A"], (9, 9)),
            shaped("B", p["model.B"], (9, 3)),
            shaped("E", p["model.E"], (9, 3)),
            C,
            D,
        )
    }
    rng = np.random.default_rng(1)
    for n in (10, 20, 40):
        A = rng.standard_normal((n, n)) / np.sqrt(n) - 0.8 * np.eye(n)
        weight = np.vstack([rng.standard_normal((3, n)), np.zeros((3, n))])
        plants[f"random, {n} states"] = (
            A,
            rng.standard_normal((n, 3)),
            rng.standard_normal((n, 3)),
            weight,
            np.vstack([np.zeros((3, 3)), np.eye(3)]),
        )
    print("plant                        gamma*   ours ms  bisection ms  ratio agreement")
    for name, plant in plants.items():
        problem = split(regular_form(*checked_plant(*plant)))
        found = gamma_star_of(problem)
        try:
            by_bisection = bisected(problem, 4.0 * found.value)
        except CertificateError as error:
            print(f"{name:<20} bisection failed: {error}")
            continue
        ours = best_of(lambda q=problem: gamma_star_of(q), repeats)
        fewer = max(1, repeats // 3)
        theirs = best_of(lambda q=problem, g=found: bisected(q, 4.0 * g.value), fewer)
        gap = abs(by_bisection / found.value - 1.0)
        print(
            f"{name:<20} {found.value:>14.10f} {1e3 * ours:>9.2f} {1e3 * theirs:>13.1f} "
            f"{theirs / ours:>6.1f} {gap:.1e}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
