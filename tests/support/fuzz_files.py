# SPDX-License-Identifier: Apache-2.0
"""Damaged YAML and damaged bags for the commands that read them."""

import contextlib
import functools
import io
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from heli_bags.writer import BagRecorder, Format
from heli_core.command_line import config_folder
from heli_core.parameters import stated
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_dynamics_sim.aircraft import AircraftError, HelicopterParameters
from heli_flight.cli import app
from heli_flight.layers import TABLES
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder
from heli_studies.campaign.spec import spec_of
from support.fuzz_messages import good_row, hostile
from support.fuzzing import Target, damaged_bytes, damaged_text

FORMS = {"mcap": Format(), "zstd": Format(zstd=True), "sqlite3": Format("sqlite3")}
_NODES = (
    ("heli_dynamics_sim", "plant"), ("heli_observer", "observer"),
    ("heli_inner_hinf", "inner_loop"), ("heli_outer_pd", "outer_loop"), ("heli_bags", "recorder"),
)  # fmt: skip
_STREAMS = (
    topics.TRUTH_ODOM, topics.ODOM, topics.ACTUATORS, topics.ATTITUDE_SETPOINT, topics.BARO,
    topics.GPS_VELOCITY, topics.TRUTH_WIND,
)  # fmt: skip
_SCENARIO = config_folder("heli_flight") / "scenarios" / "mte_pirouette.yaml"
_TICKS = 60
_SPEC = """\
flights: 4
sampling: latin_hypercube
seed: 3
flight_seeds: each
levels: 3
chunk: 2
scenario: hover
gps: rtk
world: paper
duration_s: 20.0
set:
  plant.scale.mass: 1.1
  plant.initial.pos_ned_m[2]: -12.0
disperse:
  plant.scale.thrust: {uniform: [0.9, 1.1]}
  plant.delay_ticks: {uniform: [1, 3]}
  plant.wind.profile_speed_mps[1]: {truncated_normal: [3.0, 1.0, 0.0, 6.0]}
  aircraft.body.mass_kg: {normal: [8.2, 0.1]}
correlate:
  - [plant.scale.thrust, plant.delay_ticks, 0.5]
"""


_PROGRESS = re.compile(r"^\w+: \d+ of \d+\n", re.MULTILINE)
_OF_NODES = tuple(f"{node}: " for node in TABLES)


def run_command(*words: str) -> str:
    """A command in this process: what it says when it refuses, empty if it does not.

    AssertionError for a refusal of more than a line, and for another exit code than 0, 1 and 2.
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = app.main(list(words))
    stderr = err.getvalue()
    if code in (0, 1):
        return ""
    assert code == 2, (code, stderr)
    stderr = _PROGRESS.sub("", stderr)
    assert stderr.count("\n") == 1 and stderr.startswith("heli: "), stderr
    return stderr.removesuffix("\n")


# --- YAML ----------------------------------------------------------------------------------------


def _write(numbers: random.Random, path: Path, text: str) -> Path:
    """The damaged text in a file; now and then not even a text."""
    raw = damaged_text(numbers, text).encode("utf-8", "surrogatepass")
    path.write_bytes(damaged_bytes(numbers, raw) if numbers.random() < 0.15 else raw)
    return path


def _parameters(package: str, node: str) -> Target:
    text = (config_folder(package) / f"{node}.yaml").read_text(encoding="utf-8")

    def attempt(numbers: random.Random, folder: Path) -> str:
        path = _write(numbers, folder / "fuzzed.yaml", text)
        try:
            resolve(params=[path])
        except (ParameterError, ValueError) as error:
            return _naming(str(error), path)
        return ""

    return Target(f"parameters {node}", attempt, 300)


def _yaml() -> Target:
    """A node's file by itself: reader, keys and bounds, without the flight's other files."""
    texts = {
        node: (config_folder(package) / f"{node}.yaml").read_text(encoding="utf-8")
        for package, node in _NODES
    } | {"scenario": _SCENARIO.read_text(encoding="utf-8")}

    def attempt(numbers: random.Random, folder: Path) -> str:
        node = numbers.choice(tuple(texts))
        path = _write(numbers, folder / f"{node}.yaml", texts[node])
        try:
            stated(TABLES[node], [path], node)
        except ParameterError as error:
            assert str(path) in str(error), error
            return str(error)
        return ""

    return Target("parameters read", attempt)


def _naming(sentence: str, path: Path) -> str:
    # What two nodes' parameters must agree in is no matter of one file.
    assert str(path) in sentence or sentence.startswith(_OF_NODES), sentence
    return sentence


def _scenario() -> Target:
    text = _SCENARIO.read_text(encoding="utf-8")

    def attempt(numbers: random.Random, folder: Path) -> str:
        path = _write(numbers, folder / "scenario_fuzzed.yaml", text)
        try:
            resolve(params=[path])
        except (ParameterError, ValueError) as error:
            return str(error)
        return ""

    return Target("scenario file", attempt, 300)


def _campaign() -> Target:
    def attempt(numbers: random.Random, folder: Path) -> str:
        path = _write(numbers, folder / "spec.yaml", _SPEC)
        try:
            spec_of(path)
        except (ParameterError, ValueError) as error:
            return _naming(str(error), path)
        return ""

    return Target("campaign spec", attempt, 200)


def _aircraft() -> Target:
    source = config_folder("heli_dynamics_sim") / "aircraft"
    text = sorted(source.glob("*.yaml"))[0].read_text(encoding="utf-8")

    def attempt(numbers: random.Random, folder: Path) -> str:
        path = _write(numbers, folder / "aircraft.yaml", text)
        try:
            HelicopterParameters.from_yaml(path)
        except AircraftError as error:
            return _naming(str(error), path)
        return ""

    return Target("aircraft file", attempt)


# --- bags ----------------------------------------------------------------------------------------


def _messages() -> list[tuple[str, bytes]]:
    """Topic and bytes of a short flight, in its order."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from rclpy.serialization import serialize_message

    from heli_msgs_bridge.command_messages import encode_reference

    status = DiagnosticStatus(name="outer_loop", message="follows", hardware_id="helicopter")
    status.values = [KeyValue(key="mode", value="hover")]
    diagnostics = DiagnosticArray(status=[status])
    diagnostics.header.stamp.sec = 1
    way = Trajectory.hover(np.array([0.0, 0.0, -10.0]), 0.0)
    sent = [
        (topics.REFERENCE, bytes(serialize_message(encode_reference(way)))),
        (topics.DIAGNOSTICS, bytes(serialize_message(diagnostics))),
    ]
    encoders = {name: Encoder(name) for name in _STREAMS}
    for tick in range(_TICKS):
        stamp_ns = NS_PER_S + tick * TICK_NS
        sent += [
            (name, encoders[name].encode(good_row(name), stamp_ns))
            for name in _STREAMS
            if topics.due(name, tick)
        ]
    return sent


def _record(folder: Path, sent: list[tuple[str, bytes]], form: Format) -> None:
    names = (topics.REFERENCE, topics.DIAGNOSTICS, *_STREAMS)
    recorder = BagRecorder(folder, names, "/", form, NS_PER_S)
    for name, raw in sent:
        recorder.write(name, raw)
    recorder.close()


@functools.cache
def _whole(folder: Path, form: str) -> Path:
    """An undamaged bag of a form, made once per folder."""
    bag = folder / "whole" / form
    _record(bag, _messages(), FORMS[form])
    return bag


def _damaged_inside(numbers: random.Random, folder: Path, bag: Path, form: str) -> None:
    """A bag whose file is whole, but hostile messages are in it."""
    sent, spoilt_once = _messages(), set()
    for _ in range(numbers.randint(1, 4)):
        at = numbers.randrange(len(sent))
        if at in spoilt_once:
            continue
        spoilt_once.add(at)
        name, raw = sent[at]
        spoilt = hostile(numbers, raw, topics.BY_NAME[name].type)
        if len(spoilt) >= _LEAST_BYTES:
            sent[at] = name, spoilt
    _record(bag, sent, FORMS[form])


# The recorder hears nothing shorter: a stamp has to be in it.
_LEAST_BYTES = 12


def damaged_bag(numbers: random.Random, folder: Path) -> Path:
    """A bag of any form, damaged in its file, its metadata or its messages."""
    form, bag = numbers.choice(tuple(FORMS)), folder / "bag"
    shutil.rmtree(bag, ignore_errors=True)
    kind = numbers.randrange(10)
    if kind == 0:
        _damaged_inside(numbers, folder, bag, form)
        return bag
    shutil.copytree(_whole(folder, form), bag)
    metadata = bag / "metadata.yaml"
    if kind <= 3:
        text = damaged_text(numbers, metadata.read_text(encoding="utf-8"))
        metadata.write_bytes(text.encode("utf-8", "surrogatepass"))
    if kind >= 3:
        (file,) = (path for path in bag.iterdir() if path.suffix in (".mcap", ".db3"))
        file.write_bytes(damaged_bytes(numbers, file.read_bytes()))
        if kind == 9:
            metadata.unlink()
            return file
    return bag


def _command(name: str, words: Callable[[Path, Path], tuple[str, ...]], short: int) -> Target:
    def attempt(numbers: random.Random, folder: Path) -> str:
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        sentence = run_command(*words(damaged_bag(numbers, folder), out))
        assert not (sentence and out.exists()), f"left behind: {list(out.iterdir())}"
        return sentence

    return Target(f"heli {name}", attempt, short)


TARGETS = (
    _yaml(),
    *(_parameters(package, node) for package, node in _NODES),
    _scenario(),
    _campaign(),
    _aircraft(),
    _command("bag info", lambda bag, out: ("bag", "info", str(bag)), 40),
    _command("bag echo", lambda bag, out: ("bag", "echo", str(bag), "odom", "--count", "3"), 40),
    _command("bag csv", lambda bag, out: ("bag", "csv", str(bag), "--out", str(out)), 40),
    _command("bag repair", lambda bag, out: ("bag", "repair", str(bag), "--out", str(out)), 40),
    _command("score", lambda bag, out: ("score", str(bag), "--mte", "hover"), 40),
    _command("report", lambda bag, out: ("report", str(bag), "--out", str(out)), 5),
)
