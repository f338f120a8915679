# SPDX-License-Identifier: Apache-2.0
"""Fixtures that tests of packages and of the graph share. ROS is imported where it is used."""

import fcntl
import itertools
import os
import signal
import subprocess
import tempfile
import time
import zlib
from collections import Counter, defaultdict
from pathlib import Path

import hypothesis
import pytest

_DOMAINS = itertools.count((os.getpid() * 7) % 90)


@pytest.fixture(autouse=True)
def _own_environment():
    """What a test or the code in it puts into the environment ends with it."""
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


@pytest.fixture
def own_domain():
    """A ROS domain that no other test run on this machine uses meanwhile."""
    while True:
        domain = next(_DOMAINS) % 100 + 1
        path = Path(tempfile.gettempdir()) / f"heli_hover-test-domain-{domain}-{os.getuid()}.lock"
        with open(path, "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            yield domain
            return


def pytest_configure():
    # A test run started with `&` ignores SIGINT, and so would everything that it starts.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # How long an example takes says nothing on loaded cores.
    hypothesis.settings.register_profile("heli", deadline=None)
    hypothesis.settings.load_profile("heli")


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 4 MB: a disk that fills up."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(disk)]
    if subprocess.run(command, capture_output=True).returncode:
        pytest.skip("a file system of a size of its own needs the right to mount")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


# Files that take many minutes; begun last they would leave the other cores idle.
_LONG = ("tests/commands/test_readme_commands.py",)


def tenths(slow):
    """Which tenth of the slow tests each belongs to: those of a file, which cost alike, in turn.

    A file begins with a tenth of its own, so that files of a few slow tests do not meet in one.
    """
    dealt = Counter()
    for item in slow:
        file = item.nodeid.partition("::")[0]
        yield (zlib.crc32(file.encode()) + dealt[file]) % 10
        dealt[file] += 1


def pytest_collection_modifyitems(config, items):
    """Long files first; of the slow tests the tenth that run_tests.sh names, where it names one."""
    items.sort(key=lambda item: not item.nodeid.startswith(_LONG))
    tenth = os.environ.get("HELI_SLOW_TENTH")
    if tenth is None:
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    left = [item for item, at in zip(slow, tenths(slow), strict=True) if at != int(tenth)]
    config.hook.pytest_deselected(items=left)
    gone = set(left)
    items[:] = [item for item in items if item not in gone]


@pytest.fixture
def ros_context(own_domain):
    """ROS in this process, in a domain of the test's own, on this machine only."""
    import rclpy

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=own_domain)
        yield context
        context.try_shutdown()


@pytest.fixture(
    params=[
        pytest.param((60, 50, True), id="short"),
        pytest.param((3000, 120, False), id="long", marks=pytest.mark.nightly),
    ]
)
def search(request, monkeypatch):
    """Settings of hypothesis: the same examples in every run, or many new ones.

    Its parameter: number of examples, of steps in each, whether they are the same in every run.
    """
    from hypothesis import HealthCheck, settings
    from hypothesis.internal.cache import LRUCache
    from hypothesis.internal.conjecture import providers
    from hypothesis.internal.constants_ast import Constants

    examples, steps, repeatable = request.param
    if repeatable:
        # Hypothesis tries numbers that stand in the modules that are loaded: what other tests of
        # this process have imported would choose the examples.
        monkeypatch.setattr(providers, "_get_local_constants", Constants)
        monkeypatch.setattr(providers, "CONSTANTS_CACHE", LRUCache(1024))
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        derandomize=repeatable,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    )


class Bench:
    """A node alone, fed by the callbacks of its subscriptions; what it sends is kept.

    Attributes
    ----------
    node : TickNode
    sent : dict of list
        Per topic the rows (NED/FRD) that were sent; None for a message that says it has none.
    """

    def __init__(self, kind, context, values):
        from heli_msgs_bridge.frames import datum

        bench, self.sent = self, defaultdict(list)

        class Observed(kind):
            def create_topic_publisher(self, topic):
                send = super().create_topic_publisher(topic)

                def observed(raw):
                    bench.sent[topic].append(bench.decoded(topic, raw))
                    send(raw)

                return observed

        self._origin = datum(*(values[f"origin.{n}"] for n in _ORIGIN))
        self._coders = {}
        self.node = Observed(values, context=context)

    def _coder(self, kind, topic):
        from heli_msgs_bridge import topics

        if (kind, topic) not in self._coders:
            place = self._origin if topic == topics.GPS_FIX else None
            self._coders[kind, topic] = kind(topic, datum=place)
        return self._coders[kind, topic]

    def decoded(self, topic, raw):
        from heli_msgs_bridge.layouts import CHANNELS, MessageError
        from heli_msgs_bridge.messages import Decoder

        if topic not in CHANNELS:
            return raw
        try:
            return self._coder(Decoder, topic).decode(raw).copy()
        except MessageError:
            return None

    def receive(self, topic, message):
        """Hand a message to the node, serialised if it is heard so.

        A latched topic has two subscriptions; what one hears, the other does.
        """
        own = [s for s in self.node.subscriptions if s.topic_name == f"/{topic}"]
        assert own
        if own[0].raw and not isinstance(message, bytes):
            from rclpy.serialization import serialize_message

            message = serialize_message(message)
        own[0].callback(message)
        if self.node.crash is not None:
            raise self.node.crash

    def send(self, topic, tick, row, late_ns=0):
        """A row (NED/FRD) stamped with a tick, or a little later."""
        from heli_msgs_bridge.messages import Encoder

        stamp_ns = self.node.stamp_ns(tick) + late_ns
        self.receive(topic, self._coder(Encoder, topic).encode(row, stamp_ns))

    def fly(self):
        """Configure and activate."""
        from rclpy.lifecycle import TransitionCallbackReturn

        for transition in (self.node.trigger_configure, self.node.trigger_activate):
            assert transition() == TransitionCallbackReturn.SUCCESS, self.node.failure

    def again(self):
        """Deactivate and activate."""
        from rclpy.lifecycle import TransitionCallbackReturn

        for transition in (self.node.trigger_deactivate, self.node.trigger_activate):
            assert transition() == TransitionCallbackReturn.SUCCESS, self.node.failure

    def spin_until(self, condition, limit_s=30.0):
        """Let the node's timers run until the condition holds."""
        from rclpy.executors import SingleThreadedExecutor

        executor = SingleThreadedExecutor(context=self.node.context)
        executor.add_node(self.node)
        deadline = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=1.0)
        executor.remove_node(self.node)
        executor.shutdown()


_ORIGIN = ("latitude_deg", "longitude_deg", "altitude_m")


@pytest.fixture
def bench(ros_context):
    """Make a node of a class, with its packaged parameters but for the changes, on a `Bench`."""
    made = []

    def make(kind, **changes):
        values = kind.SPEC.resolve() | {"peers": [], "peer_timeout_s": 3600.0}
        given = {name.replace("__", "."): value for name, value in changes.items()}
        assert set(given) <= set(values)
        made.append(Bench(kind, ros_context, values | given))
        return made[-1]

    yield make
    for one in made:
        one.node.end()
        one.node.destroy_node()


@pytest.fixture(scope="session")
def identified_once(tmp_path_factory):
    """An identification with seed 1, made once for all processes of a test run.

    Returns
    -------
    (Outcome, Path)
        What was found, and the folder that was written.
    """
    import cloudpickle

    from heli_studies.identify import IdentifyOrder
    from heli_studies.identify_report import execute

    top = tmp_path_factory.getbasetemp()
    top = top.parent if "PYTEST_XDIST_WORKER" in os.environ else top
    folder, outcome = top / "identified_once", top / "identified_once.pickle"
    with open(top / "identified_once.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not outcome.exists():
            found = execute(IdentifyOrder(seed=1, one_process=True), folder)
            outcome.write_bytes(cloudpickle.dumps(found))
    return cloudpickle.loads(outcome.read_bytes()), folder
