# SPDX-License-Identifier: Apache-2.0
"""Environments for Gymnasium: import this, and `gymnasium.make` knows them.

    import gymnasium
    import heli.gym

    env = gymnasium.make("heli/Hover-v0")
    envs = gymnasium.make_vec("heli/Hover-v0", num_envs=16, vectorization_mode="vector_entry_point")

`heli/Hover-v0` asks to hold a place, `heli/Attitude-v0` to follow an attitude. What an action, an
observation and a reward is: `heli.environments`. An episode is 500 steps of 20 ms. Needs the extra
`gym`.
"""

try:
    import gymnasium
except ImportError as error:
    raise ImportError(
        "heli.gym needs gymnasium, which is not installed here: pip install 'heli-hover[gym]'"
    ) from error

from heli.environments import HeliEnv, HeliVectorEnv

__all__ = ["ENVIRONMENTS"]

ENVIRONMENTS = {"heli/Hover-v0": "hover", "heli/Attitude-v0": "attitude"}
"""Name to task."""
EPISODE_STEPS = 500

for _name, _task in ENVIRONMENTS.items():
    gymnasium.register(
        _name,
        entry_point=f"{HeliEnv.__module__}:{HeliEnv.__qualname__}",
        vector_entry_point=f"{HeliVectorEnv.__module__}:{HeliVectorEnv.__qualname__}",
        max_episode_steps=EPISODE_STEPS,
        kwargs={"task": _task},
    )
