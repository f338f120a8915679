# SPDX-License-Identifier: Apache-2.0
"""What a node hears over links that have faults: between what came and its step. No ROS."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from heli_math.ticks import Rate
from heli_msgs_bridge.channels import CHANNELS
from heli_msgs_bridge.link_faults import fault_rows, link_faults_of
from heli_msgs_bridge.links import (
    COUNTED,
    NOTHING,
    PLACE,
    initial_links,
    link_kernel,
    receive,
    send,
)
from heli_msgs_bridge.stepping import Arrived


class HeardLinks:
    """The links to one node.

    Parameters
    ----------
    node : str
        Its name in the table of topics.
    lags : mapping
        Per topic that it hears ticks from a message's stamp to its sending.
    values : mapping
        Parameters: `link_faults`, `link_seed`, `rate_hz`.

    Raises
    ------
    ParameterError
        A fault that is none.
    """

    def __init__(self, node: str, lags: Mapping[str, int], values: Mapping[str, Any]) -> None:
        self._rate = Rate.of_parameters(values)
        rows = fault_rows(values["link_faults"], node, self._rate)
        self._kernel = link_kernel(rows, values["link_seed"], self._rate)
        self._faults = [
            (fault, topic)
            for fault in link_faults_of(values["link_faults"])
            for topic, sink in fault.links
            if sink == node and topic in lags
        ]
        self._lags = {
            topic: lag
            for topic, lag in lags.items()
            if (topic, node) in PLACE and self._kernel.faulty[PLACE[topic, node]]
        }
        self._places = {topic: PLACE[topic, node] for topic in self._lags}
        self._state = initial_links(self._kernel, self._rate)
        self._rows = {topic: np.empty(_size(topic)) for topic in self._lags}

    @property
    def faulty(self) -> bool:
        """Whether any link has a fault at some time."""
        return bool(self._lags)

    def has(self, topic: str) -> bool:
        """Whether the link of a topic has a fault at some time."""
        return topic in self._lags

    def begin_anew(self) -> None:
        """Another flight: nothing is under way."""
        self._state = initial_links(self._kernel, self._rate)

    def through(self, tick: int, came: Arrived) -> Arrived:
        """What of a tick's messages has arrived: topics that did not are absent.

        Parameters
        ----------
        tick : int
        came : Arrived
            What the sender has sent.
        """
        if not self._lags:
            return came
        state, k = self._state, self._kernel
        heard = {topic: told for topic, told in came.items() if topic not in self._lags}
        for topic, link in self._places.items():
            row = self._rows[topic]
            stamp, value = came.get(topic, (0, None))
            if value is not None:
                row.fill(np.nan)
                row[: value.size] = value
                send(state, k, link, stamp + self._lags[topic], stamp, row)
            stamp = receive(state, link, tick, row)
            if stamp != NOTHING:
                heard[topic] = (stamp, row.copy())
        return heard

    def acting(self, time_s: float) -> str:
        """What acts at a flight time, in words; empty for nothing."""
        now = [f"{topic} {fault.kind}" for fault, topic in self._faults if fault.acts(time_s)]
        return f"link fault: {', '.join(dict.fromkeys(now))}" if now else ""

    def facts(self) -> dict[str, str]:
        """What has become of messages so far, by link, for /diagnostics."""
        return {f"link.{topic}": _counted(self._state.counts[place])
                for topic, place in self._places.items()}  # fmt: skip


def _size(topic: str) -> int:
    channel = CHANNELS[topic]
    return channel.wider.size if channel.wider is not None else channel.size


def _counted(counts: Iterable[int]) -> str:
    said = [f"{name} {count}" for name, count in zip(COUNTED, counts, strict=True) if count]
    return ", ".join(said) or "nothing lost"
