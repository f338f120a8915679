# SPDX-License-Identifier: Apache-2.0
"""Parameters of the actions; their values stand in config/actions.yaml. No ROS."""

from heli_core.parameters import Parameter

NODE_NAME = "actions"


def _time(name: str, description: str, lower: float) -> Parameter:
    return Parameter(name, "double", description, "s", lower=lower, upper=3600.0)


TABLE: tuple[Parameter, ...] = (
    _time("answer_s", "Flight and wall time in which the outer loop has to answer", 0.1),
    _time("silence_s", "Flight and wall time without navigation or outer loop that ends a goal",
          0.1),
    _time("wall_silence_s", "Wall time without anything of the flight that ends a goal", 0.1),
    _time("patience_s", "Flight time after the end of a way in which its end has to be reached",
          0.0),
    Parameter("tolerance_m", "double", "Distance from the end that counts as there", "m",
              lower=0.01, upper=100.0),
    _time("feedback_period_s", "Wall time between two messages of feedback", 0.02),
)  # fmt: skip
