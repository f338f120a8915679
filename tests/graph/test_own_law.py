# SPDX-License-Identifier: Apache-2.0
"""A law in Python flies in the graph: `./hover_test.sh --custom-law`."""

import json

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import fly_settings
from heli_flight.report.write import recorded
from heli_flight.settings import resolve
from heli_msgs_bridge.diagnostics import FACT_LAW_FAILED

LAWS = '''
import numpy as np

TRIM = np.array([0.007, -0.006, 0.0])


class Attitude:
    def reset(self, x, r, u):
        self.integral = u - TRIM

    def step(self, x, r, t):
        error = r - x[[0, 1, 8]]
        self.integral = self.integral + 0.002 * error
        return TRIM + self.integral + [0.8, 0.8, -0.8] * error - [0.02, 0.02, -0.02] * x[[2, 3, 6]]


class Position:
    loop = "outer"

    def step(self, x, r, t):
        a = 0.8 * (r[0:3] - x[0:3]) + 1.6 * (r[3:6] - x[3:6])
        return 0.039 + a[1] / 9.8, -a[0] / 9.8, r[9], -0.175 + 0.03 * a[2]


class Breaks(Attitude):
    def step(self, x, r, t):
        return super().step(x, r, t) if t < 1.995 else 1 / 0


class Late(Position):
    """So late that nothing becomes of it."""

    def step(self, x, r, t):
        return super().step(x, r, t) if t < 7.895 else [np.nan] * 4
'''


@pytest.fixture
def laws(tmp_path):
    path = tmp_path / "own_laws.py"
    path.write_text(LAWS)
    return path


def test_a_law_flies_the_same_in_the_graph_as_in_one_process(hover_test, tmp_path, laws):
    """Of the inner loop and of the outer one together, number for number."""
    named = {"inner_loop": f"{laws}:Attitude", "outer_loop": f"{laws}:Position"}
    words = [word for name in named.values() for word in ("--custom-law", name)]
    folder = tmp_path / "flight"
    done = hover_test("--out", folder, "--seed", 3, "--duration", 8, "--world", "honest", *words)
    assert "own_laws:Attitude" in done.stdout and "own_laws:Position" in done.stdout
    result = json.loads((folder / "result.json").read_text())
    assert result["own_laws"] == {"inner": named["inner_loop"], "outer": named["outer_loop"]}
    assert result["lost"] == "" and result["notes"] == []
    over = {node: {"own_law": name} for node, name in named.items()}
    settings = resolve(seed=3, duration_s=8.0, world="honest", overrides=over)
    alone = fly_settings(settings).record
    graph = flight_from_bag(folder / "bag", settings).record
    assert len(graph) == len(alone) == 800
    for name in ("truth_pos_ned_m", "nav_pos_ned_m", "setpoint", "u"):
        np.testing.assert_allclose(getattr(graph, name), getattr(alone, name), atol=1e-6)
    # It is this law that flew: the packaged ones do not step the pedal so.
    packaged = fly_settings(resolve(seed=3, duration_s=8.0, world="honest")).record
    assert np.abs(graph.u - packaged.u).max() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "at", "facts"),
    [
        ("Breaks", 200, ("inner", "own_laws:Breaks", "tick 200 (2.00 s)", "ZeroDivisionError")),
        ("Late", 790, ("outer", "own_laws:Late", "tick 790 (7.90 s)", "nan for phi")),
    ],
)
def test_a_law_that_fails_is_the_loss_in_the_graph_as_in_one_process(
    hover_test, tmp_path, laws, law, at, facts
):
    """Its last good command is held, and the flight goes on; that it did is no success."""
    folder = tmp_path / "flight"
    words = ("--world", "honest", "--seed", 3, "--duration", 8, "--custom-law", f"{laws}:{law}")
    done = hover_test("--out", folder, *words)
    result = json.loads((folder / "result.json").read_text())
    assert done.returncode == result["exit_code"] == 1
    assert all(fact in result["lost"] for fact in facts)
    assert "LOST after " in done.stdout and all(fact in done.stdout for fact in facts)
    assert not any(f"own_laws:{law}" in note for note in result["notes"])
    bag = read_bag(folder / "bag")
    failed = [r for r in bag.remarks if FACT_LAW_FAILED in r.facts]
    assert failed and failed[0].level == 2 and failed[0].node == f"{facts[0]}_loop"
    assert result["lost"].startswith(failed[0].facts[FACT_LAW_FAILED])
    u = bag.streams["actuators"].rows
    if law == "Breaks":
        assert (u[at:, :3] == u[at - 1, :3]).all()
        assert (u[at - 2, :3] != u[at - 1, :3]).any()
    # Without result.json the bag alone says it, and in one process it is the same sentence.
    alone = recorded(folder / "bag")
    (folder / "result.json").unlink()
    assert recorded(folder).result.lost == result["lost"] == alone.result.lost
    one = hover_test("--one-process", "--out", tmp_path / "one", *words)
    in_one_process = json.loads((tmp_path / "one/result.json").read_text())
    assert one.returncode == in_one_process["exit_code"] == 1
    assert result["lost"].startswith(in_one_process["lost"])
    assert all(fact in in_one_process["lost"] for fact in facts)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("{}:Missing", "own_laws:Missing: "),
        ("nowhere.py:Law", "nowhere.py"),
        ("nowhere", "MODULE:NAME or FILE.py:NAME"),
    ],
)
def test_a_law_that_is_none_starts_nothing(hover_test, tmp_path, laws, law, words):
    done = hover_test("--out", tmp_path / "flight", "--custom-law", law.format(laws))
    assert done.returncode == 2
    errors = done.stderr.splitlines()
    assert len(errors) == 1 and words in errors[0]
    assert not (tmp_path / "flight").exists()
