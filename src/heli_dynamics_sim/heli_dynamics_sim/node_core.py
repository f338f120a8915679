# SPDX-License-Identifier: Apache-2.0
"""What the node `plant` has while it is configured, and while time runs."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from heli_dynamics_sim import plant
from heli_dynamics_sim.fallback import Fallback
from heli_dynamics_sim.fault_log import FaultLog
from heli_dynamics_sim.noise import NOISE
from heli_math.direct import direct
from heli_math.rows import JOINTS, MEAS
from heli_msgs_bridge import sums
from heli_msgs_bridge.tick_node import Send, TickCore


@dataclass(kw_only=True)
class Aircraft(TickCore):
    """What the plant has while it is configured.

    Attributes
    ----------
    config : PlantConfig
        Swapped when the gusts change.
    state : PlantState
    noise : iterator of (NOISE.size,) array
        One row a tick.
    n_ticks : int
        Length of the flight.
    u : (4,) array
        Command in force, -1..1; in real time by `fallback`.
    send : dict
        Per topic what sends a row.
    send_clock : callable
        Sends the bytes of a clock message; None: another node does.
    begun : bool
        Whether tick 0 has been sent.
    wall_s : float
        Wall time that has been flown, up to the last pause.
    over : str
        How the flight ended, if it did.
    fault_log : FaultLog
        What came and went in flight.
    describe : list of callable
        Send what the aircraft looks like, latched.
    truth_sums : sums.SumWriter or None
        Of the ground truth that is sent, for who scores the flight.
    measure, advance : callable
        Compiled, for numbers of these types.
    """

    config: plant.PlantConfig
    state: plant.PlantState
    noise: Iterator[np.ndarray]
    n_ticks: int
    u: np.ndarray
    fallback: Fallback
    send: dict[str, Send]
    send_clock: Callable[[bytes], None] | None
    y: np.ndarray = field(default_factory=lambda: np.zeros(MEAS.size))
    joints: np.ndarray = field(default_factory=lambda: np.zeros(JOINTS.size))
    gust: np.ndarray = field(default_factory=lambda: np.zeros(3))
    begun: bool = False
    wall_s: float = 0.0
    over: str = ""
    fault_log: FaultLog = field(default_factory=FaultLog)
    describe: list[Callable[[], None]] = field(default_factory=list)
    truth_sums: sums.SumWriter | None = None
    measure: Callable[..., None] = field(init=False)
    advance: Callable[..., None] = field(init=False)

    def __post_init__(self) -> None:
        self.fly(self.config)

    def fly(self, config: plant.PlantConfig) -> None:
        """Fly these numbers from now on."""
        k, state = config.kernel, self.state
        self.config = config
        self.measure = direct(plant.measure, state, 0, np.zeros(NOISE.size), k, self.y)
        self.advance = direct(plant.advance, state, self.u, k)


@dataclass
class Flight:
    """What the plant has while time runs: wall time (s) of flight time 0 without pauses."""

    zero_s: float
