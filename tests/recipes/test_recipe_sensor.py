# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING, "To add a sensor": a Doppler radar, velocity over ground in body axes, 10 Hz."""

import json
import math
import subprocess
import sys

import pytest

SIM = "src/heli_dynamics_sim/heli_dynamics_sim"
BRIDGE = "src/heli_msgs_bridge/heli_msgs_bridge"
OBSERVER = "src/heli_observer/heli_observer"
SPELLED = "src/heli_core/test/test_rows.py"
BYTES = "src/heli_msgs_bridge/test/test_bridge_bytes.py"
CHOSEN = "10_seeds and home and rtk"

READ = '''@njit
def read_doppler(tick, x, noise, k, y):
    """Fill the Doppler radar's places of the row y; zeros between the periods."""
    doppler, white, true_vel = y[MEAS.doppler], noise[NOISE.doppler], x[PLANT.vel]
    y[MEAS.doppler_valid] = 1.0 if tick % k.period == 0 else 0.0
    for i in range(3):
        doppler[i] = y[MEAS.doppler_valid] * (true_vel[i] + k.white * white[i])


'''
KERNEL = '''class DopplerParams(NamedTuple):
    """Velocity over ground with white noise."""

    white: float  # m/s
    period: int  # ticks


'''
STORE = '''@njit
def store_doppler(state, tick, y):
    """Put the Doppler radar of this tick into its slot, if finite; after `store_mag_baro`."""
    if y[MEAS.doppler_valid] > 0.5:
        doppler, finite = y[MEAS.doppler], True
        for i in range(3):
            finite = finite and math.isfinite(doppler[i])
        if finite:
            row = state.aid[tick % state.aid.shape[0]]
            row[L.AID_DOPPLER_VALID] = 1.0
            copy_part(row, L.AID_DOPPLER, doppler, 0, 3)
        else:
            state.count[L.C_DOPPLER_DROPPED] += 1


'''
FUSE = '''

@njit
def fuse_doppler(x, P, trial, dx, diag, aid, k):
    """Fuse a velocity over ground of an aid row, turned into NED; True if it passed its gate."""
    R, z, v = scratch_matrix(3, 3), scratch(3), aid[AID_DOPPLER : AID_DOPPLER + 3]
    fill_R_nb(x[X_QUAT : X_QUAT + 4], R)
    for i in range(3):
        z[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]
    var = k.var_doppler
    nis, _, ok = _fuse_triple(x, P, trial, dx, z, X_VEL, E_VEL, 0.0, var, var, k.gates)
    diag[D_NIS_DOPPLER] = nis
    return ok
'''
FUSE_SLOT = """    if row[L.AID_DOPPLER_VALID] > 0.0:
        count[L.C_DOPPLER_SEEN] = tick
        if fuse_doppler(x, P, trial, dx, diag, row, k):
            count[L.C_DOPPLER_OK] = tick
            count[L.C_DOPPLER_FUSED] += 1
        else:
            count[L.C_DOPPLER_REJECTED] += 1
"""
STATUS = """    if now - count[L.C_DOPPLER_OK] > k.doppler_timeout_ticks:
        silent = now - count[L.C_DOPPLER_SEEN] > k.doppler_timeout_ticks
        return _DOPPLER_TIMEOUT if silent else _DOPPLER_REJECTED
"""


class Recipe:
    """Insertions around places that stand once in a file."""

    def __init__(self, copy):
        self.replace = copy.replace
        self.copy = copy

    def after(self, name, place, text):
        self.replace(name, place, place + text)

    def before(self, name, place, text):
        self.replace(name, place, text + place)


def add_to_plant(r):
    """Step 1: the model, its noise, its places, its parameters."""
    r.after("src/heli_core/heli_core/rows.py", "rotor_valid: int = 27\n",
            "    doppler: slice = slice(28, 31)  # velocity over ground, body, m/s\n"
            "    doppler_valid: int = 31\n")  # fmt: skip
    r.replace("src/heli_core/heli_core/rows.py", "sensed: int = 28 ", "sensed: int = 32 ")
    r.replace("src/heli_core/heli_core/rows.py",
              "    wind: slice = slice(28, 31)  # true velocity of the air, NED, m/s\n"
              "    size: int = 31\n",
              "    wind: slice = slice(32, 35)  # true velocity of the air, NED, m/s\n"
              "    size: int = 35\n")  # fmt: skip
    r.before(f"{SIM}/noise.py", "    size: int = 89\n",
             "    doppler: slice = slice(89, 92)  # white\n")  # fmt: skip
    r.replace(f"{SIM}/noise.py", "    size: int = 89\n", "    size: int = 92\n")
    r.after(
        f"{SIM}/noise.py",
        "    Source(3, 29, 30),  # rotor's speed: white, faults\n",
        "    Source(3, 31, 32),\n",
    )
    r.before(f"{SIM}/sensors.py", "class SensorParams(", KERNEL)
    r.replace(
        f"{SIM}/sensors.py", "    imu2: bool  #", "    doppler: DopplerParams\n    imu2: bool  #"
    )
    r.before(f"{SIM}/sensors.py", "@njit\ndef read_sensors(", READ)
    r.after(f"{SIM}/sensors.py", "    read_gps(sensors, tick, x, noise, k.gps, y)\n",
            "    read_doppler(tick, x, noise, k.doppler, y)\n")  # fmt: skip
    r.after(f"{SIM}/config.py", "    BaroParams,\n", "    DopplerParams,\n")
    r.replace(f"{SIM}/config.py",
              "    return SensorParams(imu, mag, baro, _gps(get, rate), rotor, imu2)\n",
              "    period = rate.of(get(\"doppler.period_ticks\"))\n"
              '    doppler = DopplerParams(get("doppler.white_mps"), period)\n'
              "    return SensorParams(imu, mag, baro, _gps(get, rate), rotor, doppler, imu2)\n"
              )  # fmt: skip
    r.after(f"{SIM}/parameters.py",
            '    ticks("sensors.gps.latency_ticks", "Age of a fix on arrival", 0, 1000),\n',
            '    real("sensors.doppler.white_mps", "White error per axis", "m/s", 0.0, 1.0),\n'
            '    ticks("sensors.doppler.period_ticks", "Sampling period", 1, 1000),\n'
            )  # fmt: skip
    r.after("src/heli_dynamics_sim/config/plant.yaml", "        covariance: honest\n",
            "      # Doppler radar.\n      doppler:\n        # White error, m/s, each axis.\n"
            "        white_mps: 0.05\n        # 10: 10 Hz.\n        period_ticks: 10\n"
            )  # fmt: skip


def add_to_bridge(r):
    """Step 2: the topic and its message, sent by the plant; the tests' own words for both."""
    r.before(f"{BRIDGE}/topics.py", 'ODOM = "odom"\n', 'DOPPLER = "doppler"\n')
    r.before(f"{BRIDGE}/topics.py", "    Topic(ODOM, ",
             '    Topic(DOPPLER, "geometry_msgs/msg/TwistWithCovarianceStamped", _PLANT, '
             "_OBSERVER, 10),\n")  # fmt: skip
    r.before(f"{BRIDGE}/layouts.py", "    topics.ODOM: Channel(\n",
             "    topics.DOPPLER: Channel(\n"
             "        3, _BODY, _doubles(TWIST.size), pack_body_vector,\n"
             "        unpack_body_vector, _twist_block, _TWIST_AT,\n    ),\n"
             )  # fmt: skip
    node = f"{SIM}/node.py"
    r.replace(node, "topics.GPS_FIX, topics.GPS_VELOCITY)\n",
              "topics.GPS_FIX, topics.GPS_VELOCITY,\n           topics.DOPPLER)\n")  # fmt: skip
    r.after(f"{SIM}/config.py", '        (v["sensors.gps.velocity_mps"] ** 2,),\n',
            '        (v["sensors.doppler.white_mps"] ** 2,),\n')  # fmt: skip
    r.before(node, "        # Last of the sensors: in real time",
             "        if y[MEAS.doppler_valid]:\n"
             "            send[topics.DOPPLER](y[MEAS.doppler], stamp_ns)\n")  # fmt: skip


def add_to_tests(r):
    """The layouts spelled out a second time, as the tests of rows and bytes demand."""
    r.replace(SPELLED, "omega omega? wn we wd", "omega omega? u v w doppler? wn we wd")
    r.after(SPELLED, '"baro_valid": "baro?", ',
            '"doppler": "u v w", "doppler_valid": "doppler?",\n    ')  # fmt: skip
    r.replace(BYTES, 'def twist(b, stamp_ns):\n    message = TwistWithCovarianceStamped('
              'header=header(stamp_ns, "map"))\n',
              'def twist(b, stamp_ns, frame="map"):\n    message = TwistWithCovarianceStamped('
              "header=header(stamp_ns, frame))\n")  # fmt: skip
    r.after(BYTES, '    "baro": pressure,\n',
            '    "doppler": lambda b, stamp_ns: twist(b, stamp_ns, "base_link"),\n')  # fmt: skip
    r.before(BYTES, "    elif topic == topics.BARO:\n",
             "    elif topic == topics.DOPPLER:\n        block = np.zeros(42)\n"
             "        block[0:3], block[[6, 13, 20]] = flu(row), 0.25\n"
             "        block[[27, 34, 41]] = 4.0\n")  # fmt: skip


def add_to_observer(r):
    """Step 3: storing, fusing with a gate, time-out and sentence; step 4: the schedule."""
    layout = f"{OBSERVER}/layout.py"
    r.replace(layout, "N_AID = 13\n", "AID_DOPPLER_VALID, AID_DOPPLER = 13, 14\nN_AID = 17\n")
    r.replace(layout, "N_COUNT = 43\n",
              "C_DOPPLER_OK, C_DOPPLER_SEEN, C_DOPPLER_DROPPED = 43, 44, 45\n"
              "C_DOPPLER_REJECTED, C_DOPPLER_FUSED = 46, 47\nN_COUNT = 48\n")  # fmt: skip
    r.replace(layout, "N_DIAG = 7\n", "D_NIS_DOPPLER = 7\nN_DIAG = 8\n")
    r.after(layout, "    IMUS_DISAGREE = 13\n",
            "    DOPPLER_TIMEOUT = 14\n    DOPPLER_REJECTED = 15\n")  # fmt: skip
    r.after(layout, '"barometer persistently contradicts the filter, not followed",\n',
            '    ObserverStatus.DOPPLER_TIMEOUT: "no Doppler sample within its time-out",\n'
            '    ObserverStatus.DOPPLER_REJECTED: "Doppler contradicts the filter, not followed",\n'
            )  # fmt: skip
    r.after(layout, "    var_mag: float\n", "    var_doppler: float\n")
    r.after(layout, "    baro_timeout_ticks: int\n", "    doppler_timeout_ticks: int\n")
    config = f"{OBSERVER}/observer.py"
    r.after(config, '        var_mag=v["ekf.mag.noise_t"] ** 2,\n',
            '        var_doppler=v["ekf.doppler.noise_mps"] ** 2,\n')  # fmt: skip
    r.after(config, '            baro_timeout_ticks=ticks(v["ekf.timeout.baro_s"]),\n',
            '            doppler_timeout_ticks=ticks(v["ekf.timeout.doppler_s"]),\n')  # fmt: skip
    table = f"{OBSERVER}/parameters.py"
    r.after(table, '    _period("baro"),\n', '    _period("doppler"),\n')
    r.after(table, '    _timeout("baro"),\n',
            '    _timeout("doppler"),\n'
            '    _sigma("ekf.doppler.noise_mps", "White error, each axis", "m/s", 10.0),\n'
            )  # fmt: skip
    values = "src/heli_observer/config/observer.yaml"
    r.after(values, "      baro_period_ticks: 5\n", "      doppler_period_ticks: 10\n")
    r.after(values, "        baro_s: 2.0\n", "        doppler_s: 2.0\n")
    r.before(values, "      initial:\n        # The filter aligns after",
             "      doppler:\n        # White error of each axis, m/s.\n        noise_mps: 0.05\n"
             )  # fmt: skip
    r.before(f"{OBSERVER}/buffers.py", "@njit\ndef store_gps(", STORE)
    ekf = f"{OBSERVER}/ekf.py"
    r.after(ekf, "    AID_BARO,\n", "    AID_DOPPLER,\n")
    r.after(ekf, "    D_NIS_BARO,\n", "    D_NIS_DOPPLER,\n")
    r.copy.write(ekf, r.copy.path(ekf).read_text() + FUSE)
    core = f"{OBSERVER}/observer.py"
    r.replace(core, "    replaced_for_long,\n    store_gps,",
              "    replaced_for_long,\n    store_doppler,\n    store_gps,")  # fmt: skip
    r.after(core, "    fuse_baro,\n", "    fuse_doppler,\n")
    r.after(core, "_BARO_REJECTED = int(ObserverStatus.BARO_REJECTED)\n",
            "_DOPPLER_TIMEOUT = int(ObserverStatus.DOPPLER_TIMEOUT)\n"
            "_DOPPLER_REJECTED = int(ObserverStatus.DOPPLER_REJECTED)\n")  # fmt: skip
    r.before(core, "    return lost\n\n\n@njit\ndef _filter_step(", FUSE_SLOT)
    r.after(core, "                store_mag_baro(state, now, y)\n",
            "                store_doppler(state, now, y)\n")  # fmt: skip
    r.after(core, "        return _BARO_TIMEOUT if silent else _BARO_REJECTED\n", STATUS)
    node = f"{OBSERVER}/node.py"
    r.after(node, '            Input(topics.BARO, Demand(of(v["schedule.baro_period_ticks"]))),\n',
            '            Input(topics.DOPPLER, Demand(of(v["schedule.doppler_period_ticks"]))),\n'
            )  # fmt: skip
    r.before(node, "        stamp, fix = arrived.get(topics.GPS_FIX, (0, None))\n",
             "        _, doppler = arrived.get(topics.DOPPLER, (0, None))\n"
             "        if doppler is not None:\n"
             "            y[MEAS.doppler], y[MEAS.doppler_valid] = doppler, 1.0\n")  # fmt: skip
    r.after("src/heli_flight/heli_flight/settings.py",
            '"observer", "schedule.baro_period_ticks"),\n',
            '    ("plant", "sensors.doppler.period_ticks", "observer", '
            '"schedule.doppler_period_ticks"),\n')  # fmt: skip


def add_to_consistency(r):
    """Step 3: the sensor in the synthetic flights, its innovations among the others."""
    r.before("tests/support/synthetic_sensors.py", "    parts = (y, pos, vel,",
             "    y[:, MEAS.doppler] = (Rt @ vel[:, :, None])[:, :, 0]\n"
             '    sigma = noise * v["ekf.doppler.noise_mps"]\n'
             "    y[:, MEAS.doppler] += sigma * rng.standard_normal((m, 3))\n"
             '    y[:, MEAS.doppler_valid] = tick % v["schedule.doppler_period_ticks"] == 0\n'
             )  # fmt: skip
    name = "tests/support/estimator_consistency.py"
    r.replace(name, '"magnetometer", "barometer")', '"magnetometer", "barometer", "Doppler")')
    r.replace(name, "L.C_MAG_FUSED, L.C_BARO_FUSED]",
              "L.C_MAG_FUSED, L.C_BARO_FUSED, L.C_DOPPLER_FUSED]")  # fmt: skip
    r.replace(name, "L.D_NIS_MAG, L.D_NIS_BARO]", "L.D_NIS_MAG, L.D_NIS_BARO, L.D_NIS_DOPPLER]")
    r.replace(name, "DOF = np.array([3, 3, 1, 1])", "DOF = np.array([3, 3, 1, 1, 3])")


def perform(copy, leave_out=None):
    recipe = Recipe(copy)
    for step in (add_to_plant, add_to_bridge, add_to_tests, add_to_observer, add_to_consistency):
        if step is not leave_out:
            step(recipe)


OPEN_LOOP = """
import hashlib
import numpy as np
from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.settings import resolve
from heli_core.rows import MEAS
config = plant.PlantConfig.from_parameters(resolve(seed=3).nodes["plant"])
state, streams, y = plant.initial_state(config, 3), NoiseStreams(3), np.zeros(MEAS.size)
u, seen = state.commands[-1].copy(), hashlib.sha256()
for tick in range(200):
    plant.measure(state, tick, streams.row(), config.params, y)
    seen.update(y[:28].tobytes() + y[MEAS.wind].tobytes() + state.x.tobytes())
    plant.advance(state, u, config.params)
print(seen.hexdigest())
"""
RECORDED = """
import json
import sys
from heli_bags.reader import read_bag
from heli_core.rows import PLANT
from heli_msgs_bridge import topics
streams = read_bag(sys.argv[1]).streams
seen, truth = streams[topics.DOPPLER], streams[topics.TRUTH_ODOM]
true_at = dict(zip(truth.stamp_ns.tolist(), truth.rows, strict=True))
errors = [row - true_at[at][PLANT.vel] for at, row in zip(seen.stamp_ns.tolist(), seen.rows)]
print(json.dumps([error.tolist() for error in errors]))
"""
SILENT = """
from heli_core.rows import MEAS, NAV
from heli_observer.observer import ObserverConfig, ObserverStatus, initial_state, observe, status
from support.synthetic_sensors import hover_path, synthesize
from heli_flight.settings import resolve
import numpy as np
values = resolve().nodes["observer"]
config, rows = ObserverConfig(values), synthesize(hover_path(), values, 6.0, 1).y
rows[300:, MEAS.doppler_valid] = 0.0
state, out = initial_state(config), np.zeros(NAV.size)
for tick, y in enumerate(rows):
    observe(state, tick, y, np.array(values["trim.u"]), config.params, out)
print(ObserverStatus(status(state, config.params)).sentence)
"""


def fly(copy, *words, code=0):
    command = ["-m", "heli_flight.cli.hover_test", "--scenario", "attitude", "--duration", "5"]
    return copy.run(*command, "--no-report", *words, code=code)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_new_sensor_is_flown_recorded_and_fused(copy, tmp_path, own_domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    before = subprocess.run([sys.executable, "-c", OPEN_LOOP], capture_output=True, check=True)
    perform(copy)
    copy.link()
    copy.run("-m", "heli_flight.graph.warm_up")
    # Motion, wind and what the other sensors say are what they were, bit for bit.
    assert copy.run("-c", OPEN_LOOP).stdout == before.stdout.decode()

    fly(copy, "--out", tmp_path / "flight")
    errors = json.loads(copy.run("-c", RECORDED, tmp_path / "flight/bag").stdout)
    assert len(errors) == 50
    # Each of the 150 is drawn with the sigma of plant.yaml; 0.8 and 1.2 are 3.5 sigma of their rms.
    squares = [value**2 for error in errors for value in error]
    assert 0.04 < math.sqrt(sum(squares) / len(squares)) < 0.06

    consistency = "tests/verification/test_ekf_consistency.py"
    copy.run("-m", "pytest", "-q", "-p", "no:cacheprovider", consistency, "-k", CHOSEN)
    assert copy.run("-c", SILENT).stdout.strip() == "no Doppler sample within its time-out"

    slow = tmp_path / "slow.yaml"
    slow.write_text("/**/plant:\n  ros__parameters:\n    sensors.doppler.period_ticks: 20\n")
    said = fly(copy, "--params", slow, "--out", tmp_path / "none", code=2).stderr
    assert "observer: schedule.doppler_period_ticks: 10" in said


@pytest.mark.parametrize(
    ("leave_out", "chosen"),
    [(None, "doppler or every_stream or MEAS"), (add_to_tests, "every_stream or has_a_name")],
    ids=["all done", "not spelled out"],
)
def test_the_layouts_of_a_new_sensor_are_checked(copy, leave_out, chosen):
    perform(copy, leave_out)
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", SPELLED, BYTES, "-k", chosen)
    said = copy.run(*words, code=0 if leave_out is None else 1).stdout
    if leave_out is not None:
        assert "test_each_place_has_a_name_and_the_size_fits[MEAS]" in said
        assert "test_every_stream_of_the_graph_is_here" in said
