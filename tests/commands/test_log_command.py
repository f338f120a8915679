# SPDX-License-Identifier: Apache-2.0
"""`heli log info`: logs written here from each format's own description, and what is no log."""

import json
import math
import tracemalloc
from contextlib import contextmanager

import numpy as np
import pytest
from pyulog import ULog
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat
from scipy.signal import chirp, cont2discrete, lfilter

from evidence import files
from heli_analysis.identification.model import values_of
from heli_bags.tools import LogTopic, ulog
from heli_core.foreign_files import FileCause, FileError
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_flight.cli import app as cli
from heli_studies.logs import show
from heli_studies.logs.fit import fit_log
from heli_studies.logs.info import Cause, LogVerdict, Part, cropped, info_of
from heli_studies.logs.maps import read_map
from heli_studies.logs.read import read_log
from heli_studies.logs.signals import LogCause, LogError
from support.dataflash import MESSAGES, described, log, message, times_us
from support.identification_flights import Flight, fly, true_model

RATE, RUN_S = 100.0, 40.0
GAIN, LAG, DELAY = (2.0, 1.5, 2.5), (8.0, 6.0, 4.0), 3
"""Of p, q, r: rad/s per second and unit, 1/s, samples."""


@pytest.fixture(scope="module")
def flown():
    """Rates of three axes of first order, each swept in its turn, and what was sent."""
    rng = np.random.default_rng(5)
    t = np.arange(int(RUN_S * RATE)) / RATE
    fade = np.clip(np.minimum(t, t[::-1]) / 4.0, 0.0, 1.0)
    one = 0.1 * fade * chirp(t, 0.2, RUN_S, 8.0, method="logarithmic")
    sweep, u, rates = (
        np.zeros((3 * t.size, 3)),
        np.zeros((3 * t.size, 3)),
        np.zeros((3 * t.size, 3)),
    )
    for i in range(3):
        sweep[i * t.size : (i + 1) * t.size, i] = one
        u[:, i] = sweep[:, i] + 0.002 * lfilter([0.1], [1, -0.9], rng.standard_normal(3 * t.size))
        b, a, _ = cont2discrete(([GAIN[i]], [1.0, LAG[i]]), 1.0 / RATE)
        late = np.concatenate([np.zeros(DELAY), u[:-DELAY, i]])
        rates[:, i] = lfilter(b.ravel(), a, late) + 1e-3 * rng.standard_normal(3 * t.size)
    angles = np.cumsum(rates, axis=0) / RATE
    angles -= angles.mean(axis=0)
    return {"sweep": sweep, "u": u, "rates": rates, "angles": angles}


def tables_of(flown):
    """As ArduPilot's SYSTEMID mode logs it."""
    n = flown["u"].shape[0]
    time = times_us(n, RATE)
    deg = np.degrees(flown["rates"])
    angles = np.degrees(flown["angles"])
    u = flown["u"]
    runs = time[:: n // 3][:3]
    every = slice(None, None, 4)
    return {
        "SIDS": {"TimeUS": runs, "Ax": [10, 11, 12], "Mag": [0.1] * 3, "FSt": [0.2] * 3,
                 "FSp": [8.0] * 3, "TR": [RUN_S] * 3},
        "SIDD": {"TimeUS": time, "Targ": flown["sweep"].sum(axis=1), "Gx": deg[:, 0],
                 "Gy": deg[:, 1], "Gz": deg[:, 2], "Az": np.full(n, -9.8)},
        "RATE": {"TimeUS": time + 20, "R": deg[:, 0], "P": deg[:, 1], "Y": deg[:, 2],
                 "ROut": u[:, 0], "POut": u[:, 1], "YOut": u[:, 2], "AOut": np.full(n, 0.5)},
        "ATT": {"TimeUS": time[every], "Roll": angles[every, 0], "Pitch": angles[every, 1],
                "Yaw": np.mod(angles[every, 2] + 180.0, 360.0)},
        "XKF1": {"TimeUS": time[every], "C": np.arange(time[every].size) % 2,
                 "VN": np.arange(time[every].size) % 2, "VE": np.zeros(time[every].size)},
        "RCOU": {"TimeUS": time[every], "C1": np.full(time[every].size, 1510)},
        "RPM": {"TimeUS": time[every], "RPM": np.full(time[every].size, 1860.0)},
        "MSG": {"TimeUS": time[:1], "Message": [b"ArduCopter V4.6.0"]},
    }  # fmt: skip


@pytest.fixture(scope="module")
def dataflash(flown, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "00000012.BIN"
    path.write_bytes(log(tables_of(flown)))
    return path


@pytest.fixture(scope="module")
def info(dataflash):
    return info_of(read_log(dataflash))


def test_a_dataflash_log_is_read_in_si_and_our_signs(flown, dataflash):
    read = read_log(dataflash)
    assert read.signals["p"].source == "SIDD.Gx"
    assert (read.skipped_bytes, read.cut, dict(read.left_out)) == (0, False, {})
    for name, column in zip("pqr", flown["rates"].T, strict=True):
        np.testing.assert_allclose(read.signals[name].value, column, atol=1e-6)
    signs = (("d_lat", 1.0), ("d_lon", 1.0), ("d_ped", -1.0))
    for (name, sign), column in zip(signs, flown["u"].T, strict=True):
        np.testing.assert_allclose(read.signals[name].value, sign * column, atol=1e-7)
    angles = flown["angles"][::4]
    np.testing.assert_allclose(read.signals["phi"].value, angles[:, 0], atol=2e-4)
    np.testing.assert_allclose(
        read.signals["psi"].value, angles[:, 2] + math.pi, atol=2e-4
    )  # over 360 deg without a jump
    assert read.signals["rotor_speed"].value[0] == pytest.approx(1860.0 * math.pi / 30.0)
    assert read.signals["servo_1"].value[0] == 1510.0
    assert set(read.signals["vn"].value) == {0.0}, "of two estimators the first one"
    assert [s.axis for s in read.sweeps] == [10, 11, 12]
    assert read.signals["p"].time_s[0] == 0.0
    rates = {m.name: m.rate_hz for m in read.messages}
    assert rates["RATE"] == pytest.approx(100.0)
    assert rates["ATT"] == pytest.approx(25.0)


def test_its_own_chirps_are_the_references_and_the_axes_identify(info):
    by_part = {p.part: p for p in info.parts}
    for part in (Part.ROLL, Part.PITCH, Part.YAW, Part.KINEMATICS, Part.VIBRATION):
        assert by_part[part].verdict is LogVerdict.YES, part
    assert by_part[Part.GUSTS].cause is Cause.NO_AIR
    assert by_part[Part.HEAVE].cause is Cause.NOT_EXCITED
    assert [(i.name, i.swept, i.moves) for i in info.inputs] == [
        ("d_lat", True, True), ("d_lon", True, True), ("d_ped", True, True),
        ("d_col", False, False),
    ]  # fmt: skip
    assert info.response.instrumented
    for i in range(3):
        omega = info.response.omega_radps
        good = info.response.usable(i, i)
        held = -np.expm1(-1j * omega / RATE) / (1j * omega / RATE)
        true = GAIN[i] / (1j * omega + LAG[i]) * np.exp(-1j * omega * DELAY / RATE) * held
        measured = info.response.value[:, i, i] * (-1.0 if i == 2 else 1.0)
        error = np.abs(measured / true - 1.0)[good]
        assert np.median(error) < 0.03, i
    for k in info.kinematics:
        assert k.scale == pytest.approx(1.0, abs=0.05), k
        assert abs(k.lag_s) <= 0.012, k
        assert k.unexplained < 0.05, k


def test_the_command_prints_facts_and_a_picture(dataflash, tmp_path, capsys):
    assert cli.main(["log", "info", str(dataflash), "--json", "--plot", f"{tmp_path}/a.png"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["schema"], said["format"]) == (1, "ArduPilot DataFlash")
    roll = next(a for a in said["answers"] if a["part"] == "ROLL")
    assert (roll["verdict"], roll["cause"]) == ("YES", None)
    assert roll["usable_hz"][0] < 0.5
    assert roll["usable_hz"][1] > 3.0
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert cli.main(["log", "info", str(dataflash), "--end", "30"]) == 0
    shown = capsys.readouterr().out
    assert "SIDD.Gx" in shown
    assert "d_ped" in shown


def test_every_panel_of_the_picture_says_what_its_axes_are(info, tmp_path, monkeypatch):
    seen, drawn = [], show.picture

    @contextmanager
    def watched(*given, **options):
        with drawn(*given, **options) as (figure, axes):
            yield figure, axes
            seen.extend((ax.get_xlabel(), ax.get_ylabel()) for ax in axes.flat)

    monkeypatch.setattr(show, "picture", watched)
    show.draw_info(info, tmp_path / "a.png")
    assert [x for x, _ in seen] == ["time, s", "time, s", "frequency, Hz", "frequency, Hz"]
    assert all(y for _, y in seen)


@pytest.mark.slow
def test_axes_are_identified_with_gain_pole_delay_and_feedforward(dataflash, tmp_path, capsys):
    words = ["log", "identify", str(dataflash), "--out", str(tmp_path / "m"), "--json"]
    assert cli.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    for axis, gain, pole, name in zip(said["axes"], GAIN, LAG, ("RLL", "PIT", "YAW"), strict=False):
        model = axis["model"]
        assert model["order"] == 1
        sign = -1.0 if name == "YAW" else 1.0  # our pedal is positive for nose left
        assert model["gain"] == pytest.approx(sign * gain / pole, rel=0.03)
        assert model["pole_radps"] == pytest.approx(pole, rel=0.05)
        assert model["delay_s"] == pytest.approx((DELAY + 0.5) / RATE, abs=3e-3)  # and the hold
        assert axis["parameter"] == f"ATC_RAT_{name}_FF"
        assert axis["feedforward"] == pytest.approx(pole / gain, rel=0.03)
    assert said["axes"][3]["model"] is None
    assert sorted(path.name for path in (tmp_path / "m").iterdir()) == [
        "bode.png", "model.json", "responses.csv",
    ]  # fmt: skip
    first = (tmp_path / "m" / "responses.csv").read_text().splitlines()[1].split(",")
    assert first[:2] == ["p", "d_lat"]
    assert cli.main(words) == 2, "the folder is there"


@pytest.mark.slow
def test_a_helicopter_in_a_dataflash_log_gives_eq_10(tmp_path):
    """The linear helicopter of the identification's tests, in a loop, in turbulence, swept."""
    run_s, quiet_s = 90.0, 20.0
    flight = fly(
        Flight(seed=3, chirps_s=run_s, period_s=4 * run_s, periods=1, settle_s=quiet_s,
               u_amplitude=(0.05, 0.05, 0.08, 0.08))
    )  # fmt: skip
    n, p = flight.u.shape[0], np.degrees(flight.rate_body_radps)
    time = times_us(n, RATE)
    R_nb = [quat_to_R_nb(quat_from_euler(*row)) for row in flight.attitude_rad]
    speed = np.einsum("nij,nj->ni", np.array(R_nb), flight.vel_body_mps)
    angles, u = np.degrees(flight.attitude_rad), flight.u
    runs = time[round(quiet_s * RATE) :: round(run_s * RATE)][:4]
    tables = {
        "SIDS": {"TimeUS": runs, "Ax": [10, 11, 12, 13], "TR": [run_s] * 4},
        "SIDD": {"TimeUS": time, "Targ": flight.excitation_u.sum(axis=1) * 1.0, "Gx": p[:, 0],
                 "Gy": p[:, 1], "Gz": p[:, 2]},
        "RATE": {"TimeUS": time, "ROut": u[:, 0], "POut": u[:, 1], "YOut": -u[:, 2],
                 "AOut": u[:, 3]},
        "ATT": {"TimeUS": time, "Roll": angles[:, 0], "Pitch": angles[:, 1],
                "Yaw": np.mod(angles[:, 2], 360.0)},
        "XKF1": {"TimeUS": time, "VN": speed[:, 0], "VE": speed[:, 1], "VD": speed[:, 2]},
    }  # fmt: skip
    path = tmp_path / "swept.bin"
    path.write_bytes(log(tables))
    fitted = fit_log(info_of(read_log(path)))
    assert fitted.hover is not None, fitted.refused
    values = dict(zip(fitted.hover.estimate.names, fitted.hover.estimate.values, strict=True))
    names = [n for n in values if n.startswith("B(")] + ["A(p,b_s)", "A(q,a_s)", "A(r,r)"]
    for name, true in zip(names, values_of(names, true_model()), strict=True):
        if abs(true) > 0.1:
            assert values[name] == pytest.approx(true, rel=0.05), name
    assert fitted.hover.delay_ticks == 1


def test_what_was_not_flown_is_not_identified(dataflash):
    """The first run alone excites roll; the others have causes of their own."""
    parts = {p.part: p for p in info_of(cropped(read_log(dataflash), 0.0, RUN_S)).parts}
    assert parts[Part.ROLL].verdict is LogVerdict.YES
    assert parts[Part.PITCH].verdict is LogVerdict.NO
    with pytest.raises(LogError) as refused:
        cropped(read_log(dataflash), 500.0, None)
    assert refused.value.cause is LogCause.EMPTY


def test_inputs_that_move_together_are_told(flown, tmp_path):
    tables = {name: dict(columns) for name, columns in tables_of(flown).items()}
    del tables["SIDS"]
    tables["RATE"]["POut"] = tables["RATE"]["ROut"]
    path = tmp_path / "together.bin"
    path.write_bytes(log(tables))
    info = info_of(read_log(path))
    assert {a.cause for a in info.answers if a.output == "p"} == {Cause.TOGETHER}


@pytest.mark.parametrize("harm", ["noise", "cut", "unknown"])
def test_bytes_of_no_message_are_skipped_and_counted(dataflash, tmp_path, harm):
    content = dataflash.read_bytes()
    middle = content.index(b"\xa3\x95", len(content) // 2)
    extra = message(200, "B", [1]) if harm == "unknown" else bytes(range(1, 60))
    path = tmp_path / "harmed.bin"
    path.write_bytes(content[:-5] if harm == "cut" else content[:middle] + extra + content[middle:])
    read = read_log(path)
    assert read.cut == (harm == "cut")
    assert read.skipped_bytes == (0 if harm == "cut" else len(extra))
    assert read.signals["p"].value.size >= read_log(dataflash).signals["p"].value.size - 1


def ulog_of(flown):
    """As PX4 logs it, with its topics' names."""
    n = flown["u"].shape[0]
    time = times_us(n, RATE).astype(np.uint64)
    whole = np.ones(n, bool)
    half = np.column_stack([np.cos(flown["angles"][:, 0] / 2), np.sin(flown["angles"][:, 0] / 2)])
    q = np.column_stack([half, np.zeros((n, 2))]).astype(np.float32)
    torque = flown["u"].astype(np.float32)
    rates = flown["rates"].astype(np.float32)
    return ulog(
        time,
        [
            LogTopic("vehicle_angular_velocity", {"xyz": rates}, whole),
            LogTopic("vehicle_torque_setpoint", {"xyz": torque}, whole),
            LogTopic("vehicle_attitude", {"q": q}, np.arange(n) % 2 == 0),
        ],
        {"sys_name": "PX4"},
        {},
    )


def test_a_ulog_is_read_as_pyulog_reads_it(flown, tmp_path):
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulog_of(flown))
    read, theirs = read_log(path), ULog(str(path))
    data = theirs.get_dataset("vehicle_torque_setpoint").data
    np.testing.assert_array_equal(read.signals["d_ped"].value, -data["xyz[2]"].astype(float))
    np.testing.assert_allclose(read.signals["phi"].value, flown["angles"][::2, 0], atol=1e-6)
    verdicts = {p.part: p.verdict for p in info_of(read).parts}
    assert verdicts[Part.ROLL] is verdicts[Part.YAW] is LogVerdict.YES


def test_a_ulog_with_nested_types_padding_and_dropouts(tmp_path):
    """Written by hand: what our own writer never makes."""

    def part(kind, content):
        return len(content).to_bytes(2, "little") + kind + content

    rows = [
        part(b"D", b"\x05\x00" + (10_000 * (k + 1)).to_bytes(8, "little")
             + np.array([k, 2 * k, 3 * k], "<f4").tobytes() + b"\x01")
        for k in range(5)
    ]  # fmt: skip
    content = b"".join([
        b"ULog\x01\x12\x35\x01" + bytes(8), part(b"B", bytes(40)),
        part(b"F", b"vector:float[3] v;"),
        part(b"F", b"vehicle_angular_velocity:uint64_t timestamp;vector xyz;bool ok;"
                   b"uint8_t[3] _padding0;"),
        part(b"F", b"vehicle_acceleration:uint64_t timestamp;float[3] xyz;"),
        part(b"A", b"\x00\x05\x00vehicle_angular_velocity"), *rows[:3],
        part(b"O", (250).to_bytes(2, "little")), part(b"S", bytes(8)), *rows[3:],
        part(b"A", b"\x00\x06\x00vehicle_acceleration"),
        *(part(b"D", b"\x06\x00" + (10_000 * (k + 1)).to_bytes(8, "little")
               + np.array([0, 0, -9.8], "<f4").tobytes()) for k in range(5)),
    ])  # fmt: skip
    path = tmp_path / "nested.ulg"
    path.write_bytes(content)
    read = read_log(path)
    assert read.dropped_s == pytest.approx(0.25)
    assert read.signals["az"].value == pytest.approx([-9.8] * 5, abs=1e-6)
    assert {m.name: m.rows for m in read.messages}["vehicle_angular_velocity"] == 5


MAP = """\
time: {column: "t, ms", unit: ms}
body: flu
signals:
  p: {column: gx, unit: deg/s}
  q: {column: gy, unit: deg/s}
  d_lat: {column: roll_cmd, unit: "%", sign: -1}
"""


def table(flown, rows=4000):
    t = np.arange(rows) * 1e3 / RATE
    gx, gy = np.degrees(flown["rates"][:rows, 0]), -np.degrees(flown["rates"][:rows, 1])
    return {"t, ms": t, "gx": gx, "gy": gy, "roll_cmd": -100.0 * flown["u"][:rows, 0]}


@pytest.mark.parametrize("kind", ["csv", "semicolon", "mat"])
def test_a_table_is_read_by_its_map(flown, tmp_path, kind):
    columns = table(flown)
    said = MAP
    if kind == "mat":
        path = tmp_path / "flight.mat"
        savemat(path, {"t": columns["t, ms"], "x": np.column_stack([columns["gx"], columns["gy"]]),
                       "roll_cmd": columns["roll_cmd"], "text": "no number"})  # fmt: skip
        said = said.replace('"t, ms"', "t").replace("gx", '"x[0]"').replace("gy", '"x[1]"')
    else:
        path = tmp_path / "flight.csv"
        mark = "," if kind == "csv" else ";"
        said = said if kind == "semicolon" else said.replace('"t, ms"', "ms")
        head = mark.join(columns) if kind == "semicolon" else "ms,gx,gy,roll_cmd"
        rows = np.column_stack(list(columns.values()))
        np.savetxt(path, rows, delimiter=mark, header=head, comments="", fmt="%.9g")
    (tmp_path / "map.yaml").write_text(said)
    read = read_log(path, tmp_path / "map.yaml")
    for name, column in (("p", "rates"), ("d_lat", "u")):
        np.testing.assert_allclose(read.signals[name].value, flown[column][:4000, 0], atol=1e-7)
    np.testing.assert_allclose(read.signals["q"].value, flown["rates"][:4000, 1], atol=1e-7)
    assert read.signals["p"].rate_hz == pytest.approx(RATE)


EXAMPLES = files.checkout() / "examples" / "logs"


def test_a_real_record_tells_by_its_kinematics_which_column_is_which(tmp_path):
    real = EXAMPLES / "trex550.csv"
    info = info_of(read_log(real, EXAMPLES / "trex550.yaml"))
    assert {k.angle: 0.75 < k.scale < 0.9 for k in info.kinematics} == {"phi": True, "theta": True}
    assert max(k.unexplained for k in info.kinematics) < 0.05
    parts = {p.part: p for p in info.parts}
    assert parts[Part.PITCH].verdict is LogVerdict.PARTLY
    assert parts[Part.YAW].cause is Cause.LOW_COHERENCE
    text = (EXAMPLES / "trex550.yaml").read_text()
    for right, wrong in (
        ("p: {column: p}", "p: {column: q}"),
        ("q: {column: q}", "q: {column: p}"),
    ):
        assert right in text
        text = text.replace(right, wrong)
    (tmp_path / "wrong.yaml").write_text(text)
    wrong_way = info_of(read_log(real, tmp_path / "wrong.yaml"))
    assert min(k.unexplained for k in wrong_way.kinematics) > 0.5


TOPICS = """\
body: flu
signals:
  p: {topic: /mavros/imu/data, column: angular_velocity.x}
  q: {topic: /mavros/imu/data, column: angular_velocity.y}
  phi: {topic: mavros/imu/data, column: roll}
"""


def test_a_bag_of_others_is_read_by_its_map(flown, tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/Imu"
    types, zeros = store.types, np.zeros(9)
    vector = types["geometry_msgs/msg/Vector3"]
    quaternion = types["geometry_msgs/msg/Quaternion"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        line = writer.add_connection("/mavros/imu/data", kind, typestore=store)
        for k in range(400):
            p, q = flown["rates"][k, :2]
            half = 0.5 * flown["angles"][k, 0]
            head = types["std_msgs/msg/Header"](
                types["builtin_interfaces/msg/Time"](100 + k // 100, 10_000_000 * (k % 100)), "b"
            )
            # of REP-103, nose to the east
            imu = types[kind](
                head, quaternion(np.sin(half), 0.0, 0.0, np.cos(half)), zeros,
                vector(p, -q, 0.0), zeros, vector(0.0, 0.0, 9.8), zeros,
            )  # fmt: skip
            writer.write(line, 5_000_000 * k, store.serialize_cdr(imu, kind))
    (tmp_path / "map.yaml").write_text(TOPICS)
    read = read_log(tmp_path / "bag", tmp_path / "map.yaml")
    np.testing.assert_allclose(read.signals["q"].value, flown["rates"][:400, 1], atol=1e-12)
    np.testing.assert_allclose(read.signals["phi"].value, flown["angles"][:400, 0], atol=1e-9)
    assert read.signals["p"].rate_hz == pytest.approx(RATE), "by the stamps of the messages"
    assert refusal(tmp_path / "bag") is LogCause.MAP_NEEDED


def test_a_column_of_words_or_holes_costs_its_rows(flown, tmp_path):
    columns = table(flown, 200)
    lines = ["ms,gx,gy,roll_cmd"]
    lines += [",".join(f"{c[k]:.6g}" for c in columns.values()) for k in range(200)]
    lines[51] = lines[51].replace(lines[51].split(",")[1], "")
    lines[61] = lines[61].replace(lines[61].split(",")[1], "bad", 1)
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "map.yaml").write_text(MAP.replace('"t, ms"', "ms"))
    read = read_log(tmp_path / "a.csv", tmp_path / "map.yaml")
    assert read.signals["p"].value.size == 198
    assert read.signals["q"].value.size == 200
    assert sum(read.left_out.values()) == 2


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("[1, 2]", "mapping"),
        ("signals: {}", "signals"),
        ("signals: {rollrate: {column: a}}", "rollrate"),
        ("signals: {p: {column: a, unit: furlong}}", "furlong"),
        ("signals: {p: {column: a, sign: 2}}", "sign"),
        ("signals: {p: {column: a, scale: x}}", "scale"),
        ("signals: {p: {unit: rad/s}}", "column"),
        ("signals: {p: {column: a}}\nbody: sideways", "sideways"),
        ("signals: {p: {column: a}}\ntime: {rate_hz: 0}", "rate_hz"),
        ("signals: {p: {column: a}}\nspeed: 1", "speed"),
    ],
)
def test_a_wrong_map_is_named(tmp_path, text, word):
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(LogError, match=word) as refused:
        read_map(tmp_path / "map.yaml")
    assert refused.value.cause is LogCause.BAD_MAP


def refusal(path, log_map=None):
    with pytest.raises((LogError, FileError)) as refused:
        read_log(path, log_map)
    assert "\n" not in str(refused.value)
    return refused.value.cause


def test_what_is_no_log_is_refused_in_a_sentence(flown, tmp_path, capsys):
    good = ulog_of(flown)
    describes = log({"SIDD": {"TimeUS": []}})
    bad = {
        "a.bin": (b"no log at all", LogCause.NOT_A_LOG),
        "b.bin": (b"\xa3\x95" * 40, LogCause.NOT_A_LOG),
        "c.bin": (describes, LogCause.EMPTY),
        "d.bin": (log({"MSG": {"TimeUS": [1], "Message": [b"hi"]}}), LogCause.EMPTY),
        "a.ulg": (b"ULog", LogCause.NOT_A_LOG),
        "b.ulg": (good[:16], LogCause.EMPTY),
        "c.ulg": (good[:16] + b"\x28\x00B" + bytes(8) + b"\x02" + bytes(31), LogCause.UNSUPPORTED),
        "a.csv": (b"", LogCause.NOT_A_LOG),
        "b.csv": (b"\xff\xfe\x00", LogCause.NOT_A_LOG),
        "c.csv": (b"a,b\n1,2\n", LogCause.NO_COLUMN),
        "a.mat": (b"MATLAB 5.0 MAT-file" + bytes(200), LogCause.NOT_A_LOG),
        "a.txt": (b"", LogCause.UNKNOWN_FORMAT),
    }
    (tmp_path / "map.yaml").write_text(MAP)
    for name, (content, cause) in bad.items():
        (tmp_path / name).write_bytes(content)
        mapped = tmp_path / "map.yaml" if name.endswith(("csv", "mat")) else None
        assert refusal(tmp_path / name, mapped) is cause, name
    assert refusal(tmp_path / "a.csv") is LogCause.MAP_NEEDED
    assert cli.main(["log", "info", str(tmp_path / "a.bin")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "a.bin" in said


def test_a_large_or_endless_file_is_refused_before_it_is_read(tmp_path, monkeypatch, dataflash):
    monkeypatch.setenv("HELI_MEMORY_MB", "1")
    with pytest.raises(FileError, match="HELI_MEMORY_MB"):
        read_log(dataflash)
    savemat(tmp_path / "zeros.mat", {"t": np.zeros(1_000_000), "gx": 1.0}, do_compression=True)
    assert (tmp_path / "zeros.mat").stat().st_size < 10_000
    (tmp_path / "map.yaml").write_text(MAP.replace('"t, ms"', "t"))
    with pytest.raises(FileError, match="HELI_MEMORY_MB"):
        read_log(tmp_path / "zeros.mat", tmp_path / "map.yaml")


def test_many_short_messages_or_lines_do_not_take_the_memory(tmp_path, monkeypatch):
    """A message of four bytes, a line of two: a place in a list costs more than they do."""
    short = described(50, "IMU", "b", "I") + message(50, "b", [1]) * 200_000
    (tmp_path / "short.bin").write_bytes(short)
    (tmp_path / "short.csv").write_bytes(b"t\n" + b"1\n" * 200_000)
    (tmp_path / "map.yaml").write_text(MAP)
    monkeypatch.setenv("HELI_MEMORY_MB", "4")
    tracemalloc.start()
    assert refusal(tmp_path / "short.bin") is LogCause.EMPTY
    assert refusal(tmp_path / "short.csv", tmp_path / "map.yaml") is FileCause.TOO_LARGE
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 12e6


@pytest.mark.parametrize("kind", ["bin", "ulg"])
def test_damaged_logs_are_read_or_refused_in_a_sentence(flown, dataflash, tmp_path, kind):
    """Each byte may be any other: no error but a named one."""
    content = dataflash.read_bytes()[:60_000] if kind == "bin" else ulog_of(flown)[:60_000]
    rng = np.random.default_rng(11)
    path = tmp_path / f"harmed.{kind}"
    read = 0
    for _ in range(60):
        harmed = bytearray(content[: int(rng.integers(20, len(content)))])
        for at in rng.integers(0, min(len(harmed), 2000), 6):
            harmed[at] = int(rng.integers(256))
        path.write_bytes(bytes(harmed))
        try:
            read_log(path)
            read += 1
        except (LogError, FileError) as refused:
            assert "\n" not in str(refused)
    assert read > 5


def test_every_message_that_is_written_here_is_described_whole():
    for types, labels in MESSAGES.values():
        assert len(types) == len(labels.split(","))
        assert len(labels) <= 64
