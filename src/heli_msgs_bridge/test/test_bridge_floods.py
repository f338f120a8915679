# SPDX-License-Identifier: Apache-2.0
"""Limits of what may be asked of a node: counted in a clock of the test's own."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParameters

from heli_msgs_bridge.message_size import MOST_BYTES, too_long
from heli_msgs_bridge.services import RateLimit, guard

SENTENCE = "more than 10 requests a second; ask less often"


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


def test_a_burst_passes_then_so_many_a_second():
    clock = Clock()
    limit = RateLimit(10.0, 20.0, "requests", clock)
    assert sum(limit.admits() for _ in range(1000)) == 20 and limit.refused == 980
    clock.now_s += 0.5
    assert sum(limit.admits() for _ in range(1000)) == 5
    clock.now_s += 1000.0
    assert sum(limit.admits() for _ in range(1000)) == 20
    assert (limit.per_s, limit.what, limit.sentence) == (10.0, "requests", SENTENCE)


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=200))
def test_never_more_than_the_rate_and_the_burst(pauses_s):
    clock = Clock()
    limit, passed = RateLimit(7.0, 4.0, "x", clock), 0
    for pause_s in pauses_s:
        clock.now_s += pause_s
        passed += limit.admits()
        assert passed <= 4.0 + 7.0 * (clock.now_s - 100.0) + 1e-6
    assert passed + limit.refused == len(pauses_s) and passed >= 1


@pytest.mark.parametrize(("size", "refused"), [(MOST_BYTES, False), (MOST_BYTES + 1, True)])
def test_a_message_may_be_so_long(size, refused):
    assert bool(too_long("odom", size)) == refused


class Service:
    """What `guard` needs of rclpy's."""

    def __init__(self, kind):
        self.srv_type, self.service_name, self.asked = kind, "/plant/x", 0
        self.callback, self.send_response = self.answer, print

    def answer(self, request, response):
        self.asked += 1
        return response


def test_a_flood_is_refused_in_the_answer_before_anything_is_judged():
    log = []
    service = Service(SetParameters)
    guard(service, log.append, lambda: SENTENCE)
    request = SetParameters.Request(parameters=[Parameter(name="a"), Parameter(name="b")])
    answer = service.callback(request, SetParameters.Response())
    assert [r.reason for r in answer.results] == [SENTENCE] * 2
    assert not any(r.successful for r in answer.results) and service.asked == 0 and not log
    free = Service(ChangeState)
    guard(free, log.append)
    free.callback(ChangeState.Request(), ChangeState.Response())
    assert free.asked == 1
