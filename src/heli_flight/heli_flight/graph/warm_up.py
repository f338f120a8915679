# SPDX-License-Identifier: Apache-2.0
"""Compile every kernel once, so that the first flight starts at once (part of the set-up).

Two processes: the one-process loop, and what the nodes call one by one.
"""

import contextlib
import subprocess
import sys
import time


def _loop() -> None:
    from heli_flight.loop import closed_loop
    from heli_flight.loop.settings import resolve

    closed_loop.simulate(resolve(duration_s=0.04))


def load_kernels() -> None:
    """Compile, or load from the cache, what the nodes call one by one."""
    import numpy as np

    from heli_dynamics_sim import noise, plant
    from heli_flight.loop.closed_loop import build
    from heli_flight.loop.settings import resolve
    from heli_inner_hinf import attitude_law
    from heli_math.rows import MEAS, NAV
    from heli_observer import observer
    from heli_outer_pd import position_law

    settings = resolve()
    loop = build(settings)
    y, nav, out = np.zeros(MEAS.size), np.zeros(NAV.size), np.zeros(4)
    u = np.zeros(4)
    plant.measure(loop.plant_s, 0, noise.NoiseStreams(0).row(), loop.plant_k, y)
    observer.observe(loop.observer_s, 0, y, u, loop.observer_k, nav)
    way = settings.scenario.reference
    position_law.follow(nav, 0, way.times_ns, way.points, loop.outer_k, loop.outer_s, out)
    attitude_law.attitude_law(np.zeros(9), out[:3].copy(), loop.inner_k, loop.inner_s, np.zeros(3))
    _messages()
    plant.status(loop.plant_s, loop.plant_k)
    observer.status(loop.observer_s, loop.observer_k)
    plant.advance(loop.plant_s, u, loop.plant_k)


def _messages() -> None:
    """The conversions between arrays and messages."""
    import numpy as np

    from heli_msgs_bridge import topics
    from heli_msgs_bridge.frames import datum
    from heli_msgs_bridge.messages import CHANNELS, Decoder, Encoder, MessageError

    origin = datum(0.0, 0.0, 0.0)
    for name, channel in CHANNELS.items():
        place = origin if name == topics.GPS_FIX else None
        row = np.zeros(channel.size)
        with contextlib.suppress(MessageError):
            Decoder(name, place).decode(Encoder(name, (), place).encode(row, 1_000_000_000))


def main() -> int:
    """Compile; returns 0, or 1 with the failing half's own message on stderr."""
    start = time.monotonic()
    nodes = subprocess.Popen([sys.executable, "-m", "heli_flight.graph.warm_up", "nodes"])
    _loop()
    failed = nodes.wait() != 0
    print(f"kernels compiled in {time.monotonic() - start:.0f} s")
    return int(failed)


if __name__ == "__main__":
    if sys.argv[1:] == ["nodes"]:
        load_kernels()
        sys.exit(0)
    sys.exit(main())
