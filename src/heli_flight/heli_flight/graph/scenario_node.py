# SPDX-License-Identifier: Apache-2.0
"""Node `scenario`: publishes a scenario's reference, latched, for a graph that starts itself.

`./hover_test.sh` does this in its supervisor; this node is for `ros2 run` and `ros2 launch`, where
every node configures and activates itself.
"""

import sys
from collections.abc import Sequence

import rclpy
from rclpy.executors import ExternalShutdownException

from heli_flight.graph.supervisor import Supervisor
from heli_flight.loop.scenario import NODE_NAME, TABLE, Scenario
from heli_parameters import command_line
from heli_parameters.common_table import with_common
from heli_parameters.locate import MissingFileError, config_folder
from heli_parameters.parameters import ParameterError, load


def _parameters(argv: Sequence[str]) -> dict:
    line = command_line.parse(argv, NODE_NAME)
    defaults = [
        config_folder("heli_parameters") / "common.yaml",
        config_folder("heli_flight") / "scenarios" / "hover.yaml",
    ]
    return load(with_common(TABLE), [*defaults, *line.params_files], line.full_name, line.rules)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_flight scenario`; returns the exit code."""
    argv = list(sys.argv[1:] if args is None else args)
    try:
        parameters = _parameters(argv)
        scenario = Scenario.from_parameters(parameters)
    except (ParameterError, MissingFileError, ValueError) as error:
        print(f"{NODE_NAME}: {error}", file=sys.stderr)
        return 2
    try:
        rclpy.init(args=[NODE_NAME, *argv])
        node = Supervisor(())
    except Exception as error:
        print(f"{NODE_NAME}: ROS 2 cannot start: {error}", file=sys.stderr)
        return 2
    try:
        node.publish_reference(scenario, round(parameters["start_time_s"] * 1e9))
        node.get_logger().info(f"reference published: {scenario.kind}")
        node.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        node.close()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
