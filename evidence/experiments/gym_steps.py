# SPDX-License-Identifier: Apache-2.0
"""Steps a second of the simulation and of environments, beside rotorpy's.

`benchmarks/gym_steps.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid
from heli_core.ticks import TICK_S

_ROWS = {
    "simulation_nothing": "`sim.step()`, Python loop at 100 Hz",
    "simulation_velocity": "`sim.step(velocity=...)`",
    "simulation_attitude": "`sim.step(attitude=...)`",
    "simulation_actuators": "`sim.step(actuators=...)`",
    "alone": "`heli/Hover-v0`, one",
    "many": "`heli/Hover-v0`, {many} in one call",
    "many_two_threads": "the same on two threads",
    "peer": "peer, {peer}, QuadrotorEnv, one",
}
_LOOSE = (*_ROWS, "times_real_time", "times_peer_alone", "times_peer_many")
produces(
    "gym_steps",
    "./heli python benchmarks/gym_steps.py --json",
    "Steps a second of the simulation and of environments, beside rotorpy's.",
    loose={key: NOT_COMPARED for key in _LOOSE},
)


@table("gym_steps")
def gym_steps(results: Results) -> str:
    """Ticks a second, by who commands."""
    record = results["gym_steps"]
    rows = []
    for key, words in _ROWS.items():
        rate = record["ticks_per_s"][key]
        goal = f"{record['goal_times_real_time']:g}" if key == "simulation_nothing" else ""
        rows.append([words.format(**record), f"{rate:.0f}", f"{rate * TICK_S:.0f}", goal])
    head = ["", "ticks/s", "times real time", "goal"]
    return (
        f"{grid(head, rows)}\n\nMedians of {record['rounds']} rounds, wall time; world paper; a "
        f"step of an environment is {record['ticks_of_a_step']} ticks of 10 ms, of the peer one. "
        f"Ours have wind, sensors and observer, the peer has none. gym-pybullet-drones is in no "
        "package registry, and was not measured."
    )
