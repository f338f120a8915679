# SPDX-License-Identifier: Apache-2.0
"""Launch files executed without launch: stand-ins for the few actions that ours use.

`launch` and `launch_ros` are no wheels. The stand-ins do what the originals do with what our files
ask of them (launch 3.4, launch_ros 0.26 of Jazzy): arguments are declared, defaulted and checked
against their choices; a node becomes the command line that launch_ros would run; its end goes to
its handler. An action or option that is not known here is an error. What only the real tool can
show: signals and the `ros2 launch` command (where a user has upstream's launch,
tests/graph/launching/test_upstream_launch.py runs it).
"""

import importlib.util
import sys
import types
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

from heli_core.command_line import executable, share_folder


class LaunchError(RuntimeError):
    """What `ros2 launch` would refuse, in its own way."""


@dataclass
class Context:
    """Launch arguments by name, as the originals keep them."""

    launch_configurations: dict[str, str] = field(default_factory=dict)
    is_shutdown: bool = False


@dataclass(frozen=True)
class DeclareLaunchArgument:
    name: str
    default_value: str | None = None
    choices: list[str] | None = None
    description: str = ""

    def __post_init__(self):
        assert self.default_value is None or isinstance(self.default_value, str)

    def execute(self, context):
        value = context.launch_configurations.get(self.name, self.default_value)
        if value is None:
            raise LaunchError(f"argument {self.name} is required")
        if self.choices is not None and value not in self.choices:
            raise LaunchError(f"argument {self.name}: {value} is none of {self.choices}")
        context.launch_configurations[self.name] = value
        return []


@dataclass(frozen=True)
class Shutdown:
    """Ends all that was started."""

    reason: str = "reason not given"


@dataclass(frozen=True)
class Exit:
    """What a handler of on_exit gets: launch's event ProcessExited."""

    process_name: str
    returncode: int


@dataclass(frozen=True)
class OpaqueFunction:
    function: object

    def execute(self, context):
        return self.function(context) or []


@dataclass(frozen=True)
class Node:
    """launch_ros's Node with the options that our files use."""

    package: str
    executable: str
    name: str = ""
    namespace: str = ""
    parameters: tuple = ()
    ros_arguments: tuple = ()
    output: str = "log"
    on_exit: object = None
    additional_env: object = None
    respawn: bool = False
    respawn_delay: float = 0.0

    def execute(self, context):
        namespace = self.namespace
        full_name = f"/{namespace.strip('/')}/{self.name}".replace("//", "/")
        layers = []
        for layer in self.parameters:
            if isinstance(layer, dict):
                layers.append({full_name: {"ros__parameters": layer}})
                continue
            # A file that is not there is passed over with a warning.
            layers += [Path(layer)] if Path(layer).is_file() else []
        words = tuple(self.ros_arguments)
        return [
            Started(
                self.package, self.executable, self.name, namespace, tuple(layers), words,
                self.on_exit, dict(self.additional_env or {}), self.respawn, self.respawn_delay,
            )
        ]  # fmt: skip


@dataclass(frozen=True)
class Started:
    """A node that launch would start: parameter layers are files, or contents of temporary ones."""

    package: str
    executable: str
    name: str
    namespace: str
    layers: tuple
    ros_arguments: tuple = ()
    on_exit: object = None
    env: dict = field(default_factory=dict)
    respawn: bool = False
    respawn_delay: float = 0.0

    def ended(self, returncode, shutting_down=False):
        """What launch does when the node's process has ended: its exit code, None if it goes on.

        As upstream does: an exception of a handler ends the launch with 1, Shutdown with 0.
        """
        context = Context(is_shutdown=shutting_down)
        try:
            actions = self.on_exit(Exit(f"{self.name}-1", returncode), context)
        except Exception:
            return 1
        return 0 if any(isinstance(action, Shutdown) for action in actions or ()) else None

    @property
    def full_name(self):
        return f"/{self.namespace.strip('/')}/{self.name}".replace("//", "/")

    def files(self, folder):
        """The layers as files; inline ones are written into the folder."""
        paths = []
        for number, layer in enumerate(self.layers):
            if isinstance(layer, dict):
                path = folder / f"{self.name}_{number}.yaml"
                path.write_text(yaml.safe_dump(layer))
                layer = path
            paths.append(layer)
        return paths

    def command(self, folder):
        """The command line that launch_ros runs."""
        words = [sys.executable, str(executable(self.package, self.executable)), "--ros-args"]
        words += [*self.ros_arguments, "--ros-args"]
        words += ["-r", f"__node:={self.name}"] if self.name else []
        if self.namespace:
            words += ["-r", f"__ns:=/{self.namespace.strip('/')}"]
        for path in self.files(folder):
            words += ["--params-file", str(path)]
        return words


@dataclass(frozen=True)
class LaunchDescription:
    entities: list

    def execute(self, context):
        """Every node that would be started; all or none."""
        started, waiting = [], list(self.entities)
        while waiting:
            entity = waiting.pop(0)
            if isinstance(entity, Started):
                started.append(entity)
                continue
            waiting[:0] = entity.execute(context)
        return started


def stand_ins():
    """Modules by name, for sys.modules."""
    contents = {
        "launch": {"LaunchDescription": LaunchDescription},
        "launch.actions": {
            "DeclareLaunchArgument": DeclareLaunchArgument,
            "OpaqueFunction": OpaqueFunction,
            "Shutdown": Shutdown,
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": Node},
    }
    modules = {}
    for name, content in contents.items():
        modules[name] = types.ModuleType(name)
        vars(modules[name]).update(content)
    return modules


@pytest.fixture
def describe(monkeypatch):
    """Executes a package's launch file with the stand-ins; returns its LaunchDescription."""
    for name, module in stand_ins().items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "heli_msgs_bridge.launching", raising=False)

    def run(package, name):
        path = share_folder(package) / "launch" / name
        spec = importlib.util.spec_from_file_location(path.stem.replace(".", "_"), path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.generate_launch_description()

    yield run
    sys.modules.pop("heli_msgs_bridge.launching", None)


@pytest.fixture
def launch(describe):
    """`launch(package, file, "name:=value", ...)` gives the nodes that would be started."""

    def run(package, name, *arguments):
        values = dict(argument.split(":=", 1) for argument in arguments)
        description = describe(package, name)
        declared = {e.name for e in description.entities if isinstance(e, DeclareLaunchArgument)}
        unknown = set(values) - declared
        if unknown:
            raise LaunchError(f"arguments that the file does not declare: {sorted(unknown)}")
        return description.execute(Context(values))

    return run
