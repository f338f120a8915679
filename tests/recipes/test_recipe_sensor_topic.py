# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING, "To add a sensor", as a topic of the graph: a Doppler radar in five files.

Velocity over ground in body axes, 10 Hz: a row of the table of sensors, what the plant measures,
how the observer fuses it, its numbers in two YAMLs. All else follows from the row.
"""

import json
import subprocess
import sys

import pytest

TABLE = "src/heli_core/heli_core/sensors.py"
MODEL = "src/heli_dynamics_sim/heli_dynamics_sim/sensors.py"
FILTER = "src/heli_observer/heli_observer/ekf.py"
PLANT_VALUES = "src/heli_dynamics_sim/config/plant.yaml"
OBSERVER_VALUES = "src/heli_observer/config/observer.yaml"
MOST_FILES = 6

ROW = """DOPPLER = SampledSensor(
    "doppler", "Doppler radar", "doppler", "geometry_msgs/msg/TwistWithCovarianceStamped",
    "base_link", "body", "m/s", "mps", "velocity", 10, 10.0, OBSERVER, 0.5, numbers=3,
)  # fmt: skip

"""
MEASURES = """
    if which == _DOPPLER:
        for i in range(3):
            out[i] = x[PLANT.vel][i]"""
FUSES = '''_DOPPLER = len(AID_PLACES) - 1


@njit
def fuse_doppler(x, P, trial, dx, diag, aid, k):
    """Fuse a velocity over ground, turned into NED; True if it passed its gate."""
    at, R, z = AID_PLACES[_DOPPLER], scratch_matrix(3, 3), scratch(3)
    fill_R_nb(x[NOMINAL.quat : NOMINAL.quat + 4], R)
    for i in range(3):
        z[i] = R[i, 0] * aid[at.slot] + R[i, 1] * aid[at.slot + 1] + R[i, 2] * aid[at.slot + 2]
    var = k.var_aid[_DOPPLER]
    nis, _, passed = _fuse_triple(
        x, P, trial, dx, z, NOMINAL.vel, ERROR.vel, 0.0, var, var, k.gates
    )
    diag[at.nis] = nis
    return passed


'''
SIMULATED = """      doppler:
        # White noise of each axis, m/s; steps of what it says, none; 10: 10 Hz.
        white_mps: 0.05
        step_mps: 0.0
        period_ticks: 10
"""
BELIEVED = """      doppler:
        # White velocity error, m/s. Default 0.05.
        noise_mps: 0.05
"""


class Sensor:
    """The recipe's steps, and the files that they touch."""

    def __init__(self, copy):
        self.copy, self.files = copy, set()

    def before(self, name, place, text):
        self.files.add(name)
        self.copy.replace(name, place, text + place)

    def add(self):
        table = "PLAIN: tuple[SampledSensor, ...] = (ROTOR_SPEED,)"
        self.copy.replace(TABLE, table, table.replace(",)", ", DOPPLER)"))
        self.before(TABLE, "PLAIN: tuple", ROW)
        self.before(MODEL, "\n\n@njit\ndef true_sample(", '\n_DOPPLER = place_of("doppler", PLAIN)')
        self.before(MODEL, "\n\n@njit\ndef read_plain(", MEASURES)
        self.before(FILTER, "@njit\ndef fuse_aid(", FUSES)
        self.before(FILTER, "    if which == BARO_AID:\n", "    if which == _DOPPLER:\n"
                    "        return fuse_doppler(x, P, trial, dx, diag, aid, k)\n")  # fmt: skip
        self.before(PLANT_VALUES, "      baro:\n        # White noise of a sample, Pa", SIMULATED)
        for place, text in (
            ("      gps_period_ticks: 20\n", "      doppler_period_ticks: 10\n"),
            ("      mag:\n        # White error of each axis, T", BELIEVED),
            ("        baro_s: 2.0\n", "        doppler_s: 1.0\n"),
        ):
            self.before(OBSERVER_VALUES, place, text)


OPEN_LOOP = """
import hashlib
import numpy as np
from heli_core.rows import MEAS
from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.settings import resolve
config = plant.PlantConfig.from_parameters(resolve(seed=3).nodes["plant"])
state, streams, y = plant.initial_state(config, 3), NoiseStreams(3), np.zeros(MEAS.size)
u, digest = state.commands[-1].copy(), hashlib.sha256()
for tick in range(200):
    plant.measure(state, tick, streams.row(), config.params, y)
    digest.update(y[:28].tobytes() + y[MEAS.wind].tobytes() + state.x.tobytes())
    plant.advance(state, u, config.params)
print(digest.hexdigest())
"""
RECORDED = """
import json, sys
import numpy as np
from heli_bags.reader import read_bag
from heli_core.rows import PLANT
bag = read_bag(sys.argv[1])
samples, truth = bag.streams["doppler"], bag.streams["ground_truth/odom"]
true_at = dict(zip(truth.stamp_ns.tolist(), truth.rows, strict=True))
off = [row - true_at[at][PLANT.vel] for at, row in zip(samples.stamp_ns.tolist(), samples.rows)]
facts = [remark.facts for remark in bag.remarks if remark.node == "observer"]
print(json.dumps({
    "samples": len(off), "rms": float(np.sqrt(np.mean(np.square(off)))),
    "fused": max(int(fact.get("doppler_fused", 0)) for fact in facts),
    "rejected": max(int(fact.get("doppler_rejected", 0)) for fact in facts),
    "status": [fact["status"] for fact in facts if "status" in fact],
}))
"""
FAULT = "faults:\n  - {what: doppler, kind: loss, start_s: 4.0}\n"


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_new_sensor_is_flown_in_the_graph_recorded_and_fused(
    copy, tmp_path, own_domain, monkeypatch
):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    before = subprocess.run([sys.executable, "-c", OPEN_LOOP], capture_output=True, check=True)
    sensor = Sensor(copy)
    sensor.add()
    assert len(sensor.files) <= MOST_FILES
    copy.link()
    copy.run("-m", "heli_flight.graph.warm_up")
    # Motion, wind and what the other sensors say are what they were, bit for bit.
    assert copy.run("-c", OPEN_LOOP).stdout == before.stdout.decode()

    fault, out = tmp_path / "fault.yaml", tmp_path / "flight"
    fault.write_text(FAULT)
    command = ["-m", "heli_flight.cli.hover_test", "--scenario", "attitude", "--no-report"]
    copy.run(*command, "--duration", "6", "--faults", fault, "--out", out, code=None)
    result = json.loads(copy.run("-c", RECORDED, out / "bag").stdout)
    assert result["samples"] == 40
    # 120 numbers, drawn with the sigma of plant.yaml: 0.8 and 1.2 are 3 sigma of their rms.
    assert 0.04 < result["rms"] < 0.06
    assert result["fused"] >= 35 and result["rejected"] == 0
    assert "DOPPLER_TIMEOUT" in result["status"]

    slow = tmp_path / "slow.yaml"
    slow.write_text("/**/plant:\n  ros__parameters:\n    sensors.doppler.period_ticks: 20\n")
    refused = copy.run(*command, "--params", slow, "--out", tmp_path / "none", code=2).stderr
    assert "schedule.doppler_period_ticks" in refused


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_pages_policy_and_layouts_follow_the_row(copy):
    Sensor(copy).add()
    copy.link()
    for script, page in (
        ("scripts/ros_page.py", "docs/ros.md"),
        ("scripts/security_policy.py", "src/heli_flight/config/security/policy.xml"),
    ):
        copy.run(script)
        assert "doppler" in copy.path(page).read_text()
    layouts = "src/heli_core/test/test_rows.py", "src/heli_msgs_bridge/test/test_bridge_bytes.py"
    chosen = "doppler or every_stream or MEAS"
    copy.run("-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", chosen, *layouts)
    copy.packaging("test_packaging_files.py", "-k", "plant or observer")
