# SPDX-License-Identifier: Apache-2.0
"""Laws given in Python: the packaged ones, wrapped, fly the same; what goes wrong is said."""

import re
import threading

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
import pytest

import heli
from heli_core.jit import njit
from heli_flight.cli.app import main
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import initial_law_state
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.design import attitude_params
from heli_outer_pd import position_law as outer
from heli_outer_pd.parameters import outer_params

OPTIONS = {"seed": 3, "gps": "rtk", "quiet": True}


class Attitude:
    """The packaged attitude law, wrapped."""

    def __init__(self):
        self.k, self.u = attitude_params(resolve().nodes["inner_loop"]), np.zeros(3)

    def reset(self):
        self.state = initial_law_state(self.k)

    def step(self, x, r, t):
        attitude_law(x, r, self.k, self.state, self.u)
        return self.u


class Position:
    """The packaged position law, wrapped."""

    loop = "outer"

    def __init__(self):
        nodes = resolve(world="honest").nodes
        self.k, self.out = outer_params(nodes["outer_loop"]), np.zeros(4)

    def reset(self):
        self.state = outer.initial_state(self.k)

    def step(self, x, r, t):
        outer.position_law(x, r, self.k, self.state, self.out)
        return self.out


@pytest.fixture(scope="module")
def compiled():
    return heli.fly(duration_s=30, **OPTIONS)


@pytest.mark.parametrize("law", [Attitude, Position, [Attitude, Position]])
def test_a_packaged_law_in_python_flies_the_compiled_loop_bit_for_bit(compiled, law):
    """Over the climb, in the wind: every signal of every tick."""
    flown = heli.fly(law=law, duration_s=30, **OPTIONS)
    assert not flown.lost and len(flown) == len(compiled) == 3000
    for name, column in compiled.columns().items():
        assert np.array_equal(flown.columns()[name], column, equal_nan=True), name


def test_the_rows_that_are_written_for_identification_are_the_same():
    """Excitation, gust, inertial sensors."""
    options = {"scenario": "identify_actuators", "duration_s": 12, "seed": 3, "quiet": True}
    options["controller"] = "hinf_output"
    one, two = heli.fly(**options), heli.fly(law=Attitude, **options)
    for name in ("excitation_u", "gust_ned_mps", "imu", "u"):
        assert np.array_equal(getattr(one._flown.record, name), getattr(two._flown.record, name))


def test_from_the_ground_to_the_ground_the_law_flies_what_is_in_the_air():
    begun, first = [], []

    class Law(Attitude):
        def reset(self, x, r, u):
            begun.append(u)
            super().reset()

        def step(self, x, r, t):
            first.append(t)
            return super().step(x, r, t)

    flown = heli.fly("takeoff_land", law=Law, seed=3, gps="rtk", quiet=True)
    assert not flown.lost
    assert len(begun) == 1 and np.isfinite(begun[0]).all()
    tick = round(first[0] * 100)
    assert flown.mode[tick] == "takeoff" and flown.mode[tick - 100] == "takeoff"
    # Where it begins nothing is stepped: the difference to what was flown fades.
    u = flown._flown.record.u[:, :3]
    assert u[tick] == pytest.approx(begun[0]) and u[tick - 1] == pytest.approx(begun[0])
    # On the ground, after the landing, it is not asked.
    assert first[-1] < flown.time_s[-1] - 1.0


def test_the_law_reads_what_it_is_said_to_read(compiled):
    inputs = []

    class Law(Attitude):
        def step(self, x, r, t):
            inputs.append((t, x.copy(), r.copy()))
            x[:], r[:] = 0.0, 0.0  # its own copies
            return super().step(*inputs[-1][1:], t)

    flown = heli.fly(law=Law, duration_s=10, **OPTIONS)
    assert np.array_equal(flown.u.delta_lat, compiled.u.delta_lat[:1000])
    t, x, r = inputs[-1]
    assert t == pytest.approx(flown.time_s[-1])
    nine = heli.NINE
    assert x[nine.q] == flown.nav.q_radps[-1]
    assert x[nine.psi] == pytest.approx(flown.nav.psi_rad[-1], abs=1e-12)
    assert r.tolist() == [flown.setpoint[n][-1] for n in ("phi_rad", "theta_rad", "psi_rad")]


def test_a_function_may_be_compiled_and_is_cut_at_the_limits():
    @njit
    def law(x, r, t):
        return 2.0, -2.0, 0.0

    flown = heli.fly(law=law, duration_s=2, **OPTIONS)
    limit = flown.parameters["inner_loop"]["actuator_limit"]
    assert flown.u.delta_lat[-1] == limit and flown.u.delta_lon[-1] == -limit


def test_what_the_outer_law_asks_is_cut_at_the_tilt_limit():
    def law(x, r, t):
        return 3.0, -3.0, 0.0, 5.0

    law.loop = "outer"
    flown = heli.fly(law=law, duration_s=1, **OPTIONS)
    p = flown.parameters["outer_loop"]
    most = np.radians(p["tilt_limit_deg"])
    assert flown.setpoint.phi_rad[-1] == pytest.approx(p["trim.phi"] + most)
    assert flown.setpoint.theta_rad[-1] == pytest.approx(p["trim.theta"] - most)
    assert flown.u.delta_col[-1] == pytest.approx(0.98)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda x, r, t: 1 / 0, "step raised ZeroDivisionError: division by zero"),
        (lambda x, r, t: (0.0, float("nan"), 0.0), "step gave nan for d_lon"),
        (lambda x, r, t: (0.0, 0.0), "step gave 2 numbers; allowed: 3 finite numbers, d_lat"),
        (lambda x, r, t: None, "step gave nan for d_lat|step gave 1 numbers"),
        (lambda x, r, t: "left", "step gave a str"),
        (lambda x, r, t: exit(), "step raised SystemExit"),
    ],
)
def test_a_law_that_fails_ends_the_flight_with_a_sentence(law, words):
    def late(x, r, t):
        return law(x, r, t) if t > 0.995 else (0.0, 0.0, 0.0)

    flown = heli.fly(law=late, duration_s=4, **OPTIONS)
    assert len(flown) == 101 and flown.exit_code == 1
    begin = r"The inner controller .*late failed at tick 100 \(1\.00 s\): "
    assert re.match(f"{begin}({words})", flown.lost), flown.lost
    assert "\n" not in flown.lost
    # The last good command is what was flown.
    assert np.isfinite(flown.u.delta_lat).all()


class Wrong:
    """Laws that are none."""

    class Loop:
        loop = "middle"

        def step(self, x, r, t):
            return 0.0, 0.0, 0.0

    class Step:
        def step(self, x, t):
            return 0.0, 0.0, 0.0

    class Reset:
        def reset(self, x):
            return None

        def step(self, x, r, t):
            return 0.0, 0.0, 0.0

    class Made:
        def __init__(self):
            raise RuntimeError("no numbers")

        def step(self, x, r, t):
            return 0.0, 0.0, 0.0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Wrong.Loop, "loop = 'middle' is not allowed; allowed: inner, outer"),
        (Wrong.Step, r"step\(x, t\) must take x, r, t"),
        (Wrong.Reset, r"reset\(x\) must take nothing, or x, r, u"),
        (Wrong.Made, "cannot be made: RuntimeError: no numbers"),
        (lambda x: 0.0, r"step\(x\) must take x, r, t"),
        (3, "is a int; allowed: a function"),
        ([Attitude, Attitude], "two of one loop"),
        ("nowhere", "write MODULE:NAME or FILE.py:NAME"),
        ("no_such_module:Law", "cannot be imported: ModuleNotFoundError"),
        ("no_such_file.py:Law", "cannot be imported: FileNotFoundError: there is no file"),
        ("python:Law", "is in no file"),
    ],
)
def test_what_is_no_law_is_one_sentence_before_anything_flies(law, words):
    with pytest.raises(heli.LawError, match=words) as refusal:
        heli.fly(law=law, duration_s=1, **OPTIONS)
    assert "\n" not in str(refusal.value)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "own.py"
    path.write_text("class Law:\n    def step(self, x, r, t):\n        return 0.0, 0.0, 0.0\n")
    return path


def test_a_file_names_its_law_and_alone_runs_no_code(file, tmp_path, capsys):
    words = ["hover", "--one-process", "--no-report", "--duration", "1"]
    folder = tmp_path / "one"
    assert main([*words, "--custom-law", f"{file}:Law", "--out", str(folder)]) == 0
    assert "own controller: own:Law in place of the inner loop" in capsys.readouterr().out
    flown = heli.load(folder)
    assert flown.parameters["inner_loop"]["own_law"] == f"{file}:Law"
    assert "own:Law" in repr(flown)

    again = [*words, "--params", str(folder / "params.yaml"), "--out", str(tmp_path / "two")]
    file.write_text(file.read_text() + "raise SystemExit('its code has run')\n")
    assert main(again) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"--custom-law {file}:Law" in error and "has run" not in error
    file.write_text(file.read_text().replace("raise SystemExit('its code has run')\n", ""))
    assert main([*again, "--custom-law", f"{file}:Law"]) == 0
    twice = heli.load(tmp_path / "two")
    assert np.array_equal(flown.truth.pos_ned_m, twice.truth.pos_ned_m)


def test_what_flies_compiled_laws_alone_refuses_another():
    named = resolve(overrides={"outer_loop": {"own_law": "own.py:Law"}})
    with pytest.raises(heli.LawError, match="outer_loop: own_law: own:Law is flown by heli hover"):
        simulate(named)


def test_many_seeds_of_a_law(compiled):
    table = heli.campaign(seeds=[3], law=Attitude, gps="rtk", duration_s=30, quiet=True)
    value = compiled.metrics.of("truth")["altitude"].value
    assert table.column("max.altitude (truth)") == [value]


@pytest.mark.slow
def test_workers_fly_a_law_to_the_same_rows():
    def gains(x, r, t):
        return 0.3 * (r[0] - x[0]), 0.3 * (r[1] - x[1]), 0.0

    flights = {"seeds": "1..3", "scenario": "attitude", "duration_s": 8, "law": gains}
    here = heli.campaign(quiet=True, **flights)
    there = heli.campaign(quiet=True, workers=2, **flights)
    assert list(there) == list(here) and there.column("seed") == [1, 2, 3]


def test_a_law_that_cannot_be_sent_is_named():
    law = type("Law", (), {"step": lambda self, x, r, t: (0.0, 0.0, 0.0)})()
    law.lock = threading.Lock()
    with pytest.raises(heli.LawError, match="Law: cannot be sent to workers"):
        heli.campaign(seeds=[1], scenario="attitude", law=law, workers=1, quiet=True)


def test_a_campaign_is_drawn_beside_its_bounds_and_written(tmp_path):
    table = heli.campaign(seeds="1..2", scenario="attitude", duration_s=8, quiet=True)
    axes = [axis for axis in table.plot().axes if axis.get_visible()]
    assert [axis.get_xlabel() for axis in axes] == ["roll error (deg)", "pitch error (deg)"]
    truth, bound = axes[0].get_lines()[0], axes[0].get_lines()[-1]
    assert sorted(table.column("max.roll (truth)")) == list(truth.get_xdata())
    assert (
        bound.get_xdata()[0]
        == heli.fly("attitude", duration_s=8, seed=1, quiet=True).metrics["roll"].paper
    )
    assert pyarrow.csv.read_csv(table.write(tmp_path / "rows.csv")).num_rows == 2
    assert table[:1].plot().axes


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_flight_is_written_as_a_table(tmp_path, ending):
    flight = heli.fly(duration_s=2, quiet=True)
    path = flight.write(tmp_path / f"flight.{ending}")
    read = pyarrow.csv.read_csv if ending == "csv" else pyarrow.parquet.read_table
    table = read(path)
    assert table.column_names == list(flight.columns())
    for name, values in flight.columns().items():
        assert np.array_equal(table[name].to_numpy(), values, equal_nan=True)
    for bad in ("flight.xls", "none/flight.csv"):
        with pytest.raises(heli.ParameterError, match="path"):
            flight.write(tmp_path / bad)
