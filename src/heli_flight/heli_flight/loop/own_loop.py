# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process with a law given in Python: `closed_loop.fly`, tick by tick.

The same kernels in the same order with the same numbers, called one by one as the nodes call them,
so what set-up has compiled for the nodes is all that it needs.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.wind import injected_gust
from heli_flight.loop.closed_loop import (
    Flight,
    Loop,
    build,
    fly_loop,
    replace_by_truth,
    simulate,
    write_truth,
)
from heli_flight.loop.laws import own_laws, without_own
from heli_flight.loop.linked import rotor_heard, to_inner_loop, to_observer, to_outer_loop, to_plant
from heli_flight.loop.settings import Settings
from heli_flight.loop.track import Track
from heli_inner_hinf.excitation import SENT, excite
from heli_inner_hinf.ground_law import law_or_hand
from heli_inner_hinf.law_state import nine_states
from heli_inner_hinf.own_law import OwnAttitudeLaw
from heli_math.direct import direct
from heli_math.rows import ACTUATOR, MEAS, NAV, NINE, REFERENCE, SETPOINT
from heli_math.sweep import NOTHING as NO_SWEEP
from heli_math.sweep import add_sweep
from heli_math.trajectory import reference_at
from heli_msgs_bridge.links import NOTHING
from heli_observer import observer
from heli_outer_pd import position_law as outer
from heli_outer_pd.hand_law import hand_of
from heli_outer_pd.own_law import OwnPositionLaw
from heli_outer_pd.reference import fill_offset, move
from heli_outer_pd.rotor_watch import hear_rotor
from heli_parameters.python_law import INNER, OUTER, LawError, PythonLaw, find

GAVE_UP = -1
"""Outcome of ticks in which a law has failed."""


def fly_settings(
    settings: Settings,
    laws: Sequence[PythonLaw] = (),
    progress: Callable[[float], None] | None = None,
) -> Flight:
    """Fly a scenario with the laws that are given, else that the settings name, else packaged ones.

    Parameters
    ----------
    settings : Settings
    laws : sequence of PythonLaw
        At most one of each loop. **A law that the settings name is imported**: its code runs.
    progress : callable, optional
        Called with the flight time (s) now and then.

    Returns
    -------
    Flight
        Where a law has failed it ends there, with the law's sentence.

    Raises
    ------
    LawError, ParameterError, TrimError, SynthesisError
    """
    found = laws or [find(source) for source in own_laws(settings).values()]
    if not found:
        return simulate(settings, progress=progress)
    by_loop = {law.loop: law for law in found}
    if len(by_loop) < len(found):
        raise LawError("law: two of one loop are given; allowed: one of each")
    loop = build(without_own(settings))
    ticks = _Ticks(loop, by_loop)
    flight = fly_loop(loop, settings, progress, ticks.fly)
    why = next((law.failure for law in found if law.failure), "")
    return flight._replace(sentence=why) if why else flight


class _Ticks:
    """`fly` is called in the place of the compiled `closed_loop.fly`."""

    def __init__(self, loop: Loop, laws: Mapping[str, PythonLaw]) -> None:
        self._inner = OwnAttitudeLaw(laws.get(INNER))
        self._outer = OwnPositionLaw(laws.get(OUTER))
        self._laws = tuple(laws.values())
        self._y, self._nav = np.zeros(MEAS.size), np.zeros(NAV.size)
        # What is heard of them: the same, but for links that have faults.
        self._heard, self._flown = np.zeros(MEAS.size), np.zeros(ACTUATOR.size)
        self._aim, self._hand = np.zeros(SETPOINT.size), np.zeros(3)
        self._x9, self._u3 = np.zeros(len(NINE)), np.zeros(3)
        self._calls = _compiled(loop, self)

    def fly(
        self,
        loop: Loop,
        first_tick: int,
        n_ticks: int,
        noise_rows: np.ndarray,
        times_ns: np.ndarray,
        points: np.ndarray,
        setpoint: np.ndarray,
        u: np.ndarray,
        track: Track,
    ) -> tuple[int, int]:
        """As `closed_loop.fly`; GAVE_UP at the tick at which a law has failed."""
        status = self._calls["status"]
        for i in range(n_ticks):
            tick = first_tick + i
            before = self._sight(loop)
            self._sense(loop, tick, noise_rows[i], times_ns, points, u, track)
            reference_at(tick * loop.tick_ns, times_ns, points, track.reference[tick])
            if tick % loop.period_ticks == 0:
                self._follow(loop, tick, times_ns, points, setpoint)
            self._act(loop, tick, setpoint, u)
            track.imu[tick] = self._y[MEAS.imu]
            if track.gust.shape[0] > 0:
                self._write_excited(loop, tick, track)
            track.nav[tick], track.setpoint[tick], track.u[tick] = self._nav, setpoint, u
            if any(law.failure for law in self._laws):
                return i + 1, GAVE_UP
            code = status(loop.plant_s, loop.plant_k)
            if code != 0:
                return i + 1, code
            self._flown[:] = u
            if loop.links.k.on:
                to_plant(loop.links, tick, self._y[MEAS.rate], self._flown)
            self._calls["advance"](loop.plant_s, self._flown, loop.plant_k)
            if self._sight(loop) != before:
                return i + 1, 0
        return n_ticks, 0

    @staticmethod
    def _sight(loop: Loop) -> tuple[float, float, float]:
        """What ends a stretch of ticks when it changes."""
        places = outer.MEMORY.sight, outer.MEMORY.gone, outer.MEMORY.spin
        sight, gone, spin = loop.outer_s[list(places)]
        return sight, gone, spin

    def _sense(
        self,
        loop: Loop,
        tick: int,
        noise: np.ndarray,
        times_ns: np.ndarray,
        points: np.ndarray,
        u: np.ndarray,
        track: Track,
    ) -> None:
        """The plant measures, the observer estimates; the law may engage."""
        y, nav = self._y, self._nav
        self._calls["measure"](loop.plant_s, tick, noise, loop.plant_k, y)
        write_truth(loop.plant_s, y, track.truth[tick])
        heard, flown, seen = self._heard, self._flown, loop.seen
        heard[:], flown[:] = y, u
        if loop.links.k.on:
            to_observer(loop.links, tick, loop.observer_s, loop.observer_k, heard, flown)
        self._calls["observe"](loop.observer_s, tick, heard, flown, loop.observer_k, nav)
        if loop.true_navigation:
            replace_by_truth(track.truth[tick], nav)
        seen[:] = nav
        if loop.links.k.on:
            loop.outer_s[outer.MEMORY.is_late] = to_outer_loop(loop.links, tick, seen)
        spun = rotor_heard(loop.links, tick, heard)
        if spun != NOTHING:
            now_s = spun * loop.tick_s
            self._calls["spins"](loop.outer_s, now_s, heard[MEAS.rotor], loop.outer_k)
        if loop.anchor[0] and tick % loop.period_ticks == 0 and outer.flyable(seen):
            offset = np.zeros(3)
            fill_offset(seen[NAV.pos], tick * loop.tick_ns, times_ns, points, offset)
            move(points, offset)
            loop.anchor[0], loop.anchor[1] = 0, tick

    def _follow(
        self,
        loop: Loop,
        tick: int,
        times_ns: np.ndarray,
        points: np.ndarray,
        setpoint: np.ndarray,
    ) -> None:
        k, state, now_ns = loop.outer_k, loop.outer_s, tick * loop.tick_ns
        given = loop.seen, now_ns, times_ns, points, k, state, setpoint
        self._outer.step(tick, tick * loop.tick_s, *given, self._calls["follow"])
        hand_of(state, loop.hand)

    def _act(self, loop: Loop, tick: int, setpoint: np.ndarray, u: np.ndarray) -> None:
        """Nine states, attitude law, excitation: the actuators of this tick."""
        x9, time_s, aim, hand = self._x9, tick * loop.tick_s, self._aim, self._hand
        nine_states(self._nav, self._nav[NAV.rotor], x9)
        aim[:], hand[:] = setpoint, loop.hand
        if loop.links.k.on:
            to_inner_loop(loop.links, tick, loop.period_ticks, self._nav, aim, hand, x9)
        if loop.disturbance_k.shape != NO_SWEEP:
            add_sweep(time_s, loop.disturbance_k, x9)
        given = x9, aim[SETPOINT.attitude], aim[SETPOINT.col], hand
        numbers = loop.inner_k, loop.inner_s, self._u3
        self._inner.step(tick, time_s, *given, *numbers, self._calls["law"])
        u[ACTUATOR.attitude], u[ACTUATOR.col] = self._u3, aim[SETPOINT.col]
        if loop.excitation_k.on:
            excite(time_s, x9, loop.excitation_k, loop.excitation_s, loop.inner_s, u)

    def _write_excited(self, loop: Loop, tick: int, track: Track) -> None:
        track.excitation[tick] = loop.excitation_s[SENT : SENT + ACTUATOR.size]
        sines, time_s = loop.plant_k.wind.sines, tick * loop.tick_s
        injected_gust(loop.plant_s.x, time_s, sines, track.gust[tick])


def _compiled(loop: Loop, ticks: _Ticks) -> dict[str, Callable[..., Any]]:
    """The kernels of every tick for numbers of these types, as the nodes call them."""
    four, three = np.zeros(ACTUATOR.size), np.zeros(3)
    times, points = np.zeros(1, np.int64), np.zeros((1, REFERENCE.size))
    y, nav, x9 = ticks._y, ticks._nav, ticks._x9
    p, o = (loop.plant_s, loop.plant_k), (loop.outer_k, loop.outer_s, four)
    calls: dict[str, tuple[Any, ...]] = {
        "measure": (plant.measure, p[0], 0, np.zeros(NOISE.size), p[1], y),
        "observe": (observer.observe, loop.observer_s, 0, y, four, loop.observer_k, nav),
        "follow": (outer.follow, nav, 0, times, points, *o),
        "spins": (hear_rotor, loop.outer_s, 0.0, 0.0, loop.outer_k),
        "law": (law_or_hand, x9, three, 0.0, three, loop.inner_k, loop.inner_s, three),
        "status": (plant.status, *p),
        "advance": (plant.advance, p[0], four, p[1]),
    }
    return {name: direct(*call) for name, call in calls.items()}
