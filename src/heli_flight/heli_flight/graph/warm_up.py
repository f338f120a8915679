# SPDX-License-Identifier: Apache-2.0
"""Compile every kernel that the nodes call, so that the first flight starts at once (set-up).

Four parts that share few kernels are compiled side by side, one process per core. They are forks of
one process that has imported everything, so that byte code is made and modules are loaded once.
The kernel of the one-process loop is not among them: who uses that loop first compiles it.
"""

import contextlib
import gc
import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from heli_core.inbox import empty_inbox
from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, MEAS, NAV, NINE, SETPOINT
from heli_core.ticks import NS_PER_S
from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.wind import injected_gust
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.controller_state import initial_law_state, nine_states
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.ground_and_manual import law_or_manual
from heli_msgs_bridge import topics
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS, MessageError
from heli_msgs_bridge.messages import Decoder, Encoder
from heli_observer import observer
from heli_outer_pd import outer_loop
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.reference import warm_up

# numba makes many objects that live long: looking for garbage as often as usual costs an eighth.
_GARBAGE_THRESHOLD = 100_000


def _observer(settings: Settings) -> None:
    config = observer.ObserverConfig.from_parameters(settings.nodes["observer"])
    state = observer.initial_state(config)
    inbox = empty_inbox(len(observer.INPUTS))
    observer.step(state, inbox, 0, config.params, np.zeros(NAV.size))
    observer.status(state, config.params)


def _plant(settings: Settings) -> None:
    config = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    state, k = plant.initial_state(config, settings.seed), config.params
    plant.measure(state, 0, NoiseStreams(0).row(), k, np.zeros(MEAS.size))
    injected_gust(state.x, 0.0, k.wind.sines, np.zeros(3))
    plant.status(state, k)
    plant.advance(state, np.zeros(ACTUATOR.size), k)


def _laws(settings: Settings) -> None:
    values, reference = settings.nodes["outer_loop"], settings.scenario.reference
    outer, inbox = outer_params(values), empty_inbox(len(outer_loop.INPUTS))
    known = outer_loop.initial_loop(outer, values["navigation_timeout_s"], settings.rate)
    arguments = reference.times_ns, reference.points.copy(), outer, np.zeros(SETPOINT.size)
    outer_loop.step(known, inbox, 0, 1, 0, *arguments)
    nav = np.zeros(NAV.size)
    warm_up(outer, known.law)
    inner = AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).params
    x9 = np.zeros(len(NINE))
    nine_states(nav, nav[NAV.rotor], x9)
    law, manual = initial_law_state(inner), np.full(3, np.nan)
    law_or_manual(x9, np.zeros(3), 0.0, manual, inner, law, np.zeros(3))
    euler_from_quat(np.array([1.0, 0.0, 0.0, 0.0]))


def _messages(settings: Settings) -> None:
    """The conversions between arrays and messages."""
    v = settings.nodes["plant"]
    origin = datum(v["origin.latitude_deg"], v["origin.longitude_deg"], v["origin.altitude_m"])
    for name, channel in CHANNELS.items():
        place = origin if name == topics.GPS_FIX else None
        row = np.zeros(channel.size)
        with contextlib.suppress(MessageError):
            Decoder(name, place).decode(Encoder(name, (), place).encode(row, NS_PER_S))


# The longest first, so that the processes end at about the same time.
_PARTS: tuple[Callable[[Settings], None], ...] = (_observer, _plant, _laws, _messages)


def load_kernels() -> None:
    """Compile, or load from the cache, what the nodes call."""
    settings = resolve()
    for part in _PARTS:
        part(settings)


def main() -> int:
    """Compile with all cores; returns the exit code."""
    settings = resolve()
    gc.set_threshold(_GARBAGE_THRESHOLD, 100, 100)
    workers = min(len(_PARTS), len(os.sched_getaffinity(0)))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("fork")) as pool:
        for done in [pool.submit(part, settings) for part in _PARTS]:
            done.result()
    return 0


if __name__ == "__main__":
    sys.exit(main())
