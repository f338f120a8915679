# SPDX-License-Identifier: Apache-2.0
"""Bytes of a fuzzer for what reads foreign bytes: messages, parameter files, damaged bags.

Each parser takes any bytes: they are taken, or refused in a sentence. The first byte of a message
or parameter file says of which topic or node it is.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heli_bags.repair import State, salvage
from heli_bags.writer import BagError, BagRecorder, Format
from heli_core.command_line import config_folder
from heli_core.parameters import stated
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.layers import TABLES
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS, MessageError
from heli_msgs_bridge.messages import Decoder, Encoder
from support.fuzz_messages import good_bytes, good_row, place
from support.fuzzing import is_sentence

_NAMES, _NODES = tuple(CHANNELS), tuple(TABLES)
_FILES = {
    "plant": "heli_dynamics_sim", "observer": "heli_observer", "inner_loop": "heli_inner_hinf",
    "outer_loop": "heli_outer_pd", "recorder": "heli_bags",
}  # fmt: skip
_BAG_TICKS = 20


@dataclass(frozen=True)
class Parser:
    """Something that reads bytes of others.

    Attributes
    ----------
    name : str
    attempt : callable
        Reads these bytes, with a folder to write to: the sentence of the refusal, empty if they
        were taken; AssertionError for what may not be.
    seeds : callable
        Good inputs, to begin with.
    """

    name: str
    attempt: Callable[[bytes, Path], str]
    seeds: Callable[[], list[bytes]]


def _sentence(text: str) -> str:
    assert is_sentence(text), text
    return text


def _cdr(data: bytes, folder: Path) -> str:
    name = _NAMES[data[0] % len(_NAMES)] if data else _NAMES[0]
    try:
        row = Decoder(name, place(name), namespace="").decode(data[1:])
    except MessageError as error:
        return _sentence(str(error))
    assert np.isfinite(row).all(), row
    return ""


def _cdr_seeds() -> list[bytes]:
    return [bytes([number]) + good_bytes(name) for number, name in enumerate(_NAMES)]


def _yaml(data: bytes, folder: Path) -> str:
    node = _NODES[data[0] % len(_NODES)] if data else _NODES[0]
    path = folder / "fuzzed.yaml"
    path.write_bytes(data[1:])
    try:
        stated(TABLES[node], [path], node)
    except ParameterError as error:
        assert str(path) in str(error), error
        return _sentence(str(error))
    return ""


def _yaml_seeds() -> list[bytes]:
    return [
        bytes([_NODES.index(node)]) + (config_folder(package) / f"{node}.yaml").read_bytes()
        for node, package in _FILES.items()
    ]


def _mcap(data: bytes, folder: Path) -> str:
    path = folder / "fuzzed.mcap"
    path.write_bytes(data)
    try:
        for channel, stamp_ns, raw in salvage(path, State()):
            assert isinstance(channel.topic, str) and isinstance(raw, bytes)
            assert 0 <= stamp_ns < 2**63
    except BagError as error:
        return _sentence(str(error))
    return ""


def _mcap_seeds() -> list[bytes]:
    """A small bag of two topics, plain and compressed."""
    seeds = []
    with tempfile.TemporaryDirectory(prefix="heli_fuzz_") as folder:
        for form in (Format(), Format(zstd=True)):
            names = topics.BARO, topics.COLLECTIVE
            bag = BagRecorder(Path(folder) / str(form.zstd), names, "/", form, NS_PER_S)
            encoders = {name: Encoder(name) for name in names}
            for tick in range(_BAG_TICKS):
                for name in names:
                    stamp_ns = NS_PER_S + tick * TICK_NS
                    bag.write(name, encoders[name].encode(good_row(name), stamp_ns))
            bag.close()
            seeds += [path.read_bytes() for path in bag.folder.glob("*.mcap")]
    return seeds


PARSERS = {
    parser.name: parser
    for parser in (
        Parser("cdr", _cdr, _cdr_seeds),
        Parser("yaml", _yaml, _yaml_seeds),
        Parser("mcap", _mcap, _mcap_seeds),
    )
}
