# SPDX-License-Identifier: Apache-2.0
"""The way out of DDS, which may have no end.

To destroy a participant rmw_fastrtps calls `DomainParticipant::set_listener` of Fast DDS, which
waits until the listener is not being called. In the wheels' build (2.14) the limit of that wait is
beyond what 64 bits hold: the wait returns at once, as the wrong argument it is, and keeps the lock
for which the listener waits. Who leaves in the moment in which it is told of another one's coming
or leaving turns in this loop for ever, with Python's lock held, so that no thread can help.
"""

import contextlib
import ctypes
import os
import signal
import sys
import time
from collections.abc import Iterator

from rclpy.node import Node

LIMIT_S = 5.0
"""Wall time for leaving; it takes 0.03 s, on loaded cores up to a second."""
_QUIET_S, _WAIT_S, _LOOK_S = 0.05, 0.5, 0.01
_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int)


@contextlib.contextmanager
def limited(code: int, limit_s: float = LIMIT_S) -> Iterator[None]:
    """End this process with an exit code if what is done inside does not end.

    Called in the main thread by who has nothing left to do. A handler of Python's would wait for
    the interpreter's next step, which does not come; this one is called in the midst of the loop.
    """
    sys.stdout.flush()
    libc = ctypes.CDLL(None)
    libc.signal.argtypes, libc.signal.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_void_p
    end = _HANDLER(lambda number: os._exit(code))
    before = libc.signal(signal.SIGALRM, ctypes.cast(end, ctypes.c_void_p))
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        libc.signal(signal.SIGALRM, before)


def wait_for_quiet(node: Node) -> None:
    """Wait until nobody comes or leaves, for half a second at most; not where ROS has ended.

    For who has work left when its node is destroyed.
    """
    seen: object = None
    begun_s = since_s = time.monotonic()
    while node.context.ok():
        now_s = time.monotonic()
        if (found := _others(node)) != seen:
            seen, since_s = found, now_s
        if now_s - since_s >= _QUIET_S or now_s - begun_s >= _WAIT_S:
            return
        time.sleep(_LOOK_S)


def _others(node: Node) -> tuple[object, ...]:
    """Who is in the graph, and what is sent and heard there."""
    topics = node.get_topic_names_and_types()
    return (
        sorted(node.get_node_names_and_namespaces()),
        [(name, node.count_publishers(name), node.count_subscribers(name)) for name, _ in topics],
    )
