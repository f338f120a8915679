# SPDX-License-Identifier: Apache-2.0
"""Node `plant` alone: time goes on by commands, and for a while without; it ends; winds change."""

import time

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus
from std_srvs.srv import Trigger

from heli_core import command_line
from heli_core.errors import ParameterCause as Cause
from heli_core.errors import ParameterError
from heli_core.faults import Fault, faults_of
from heli_core.ticks import TICK_NS
from heli_dynamics_sim.config import message_variances
from heli_dynamics_sim.faults import FaultLog
from heli_dynamics_sim.node import PlantNode
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.messages import ClockEncoder

SUCCESS = TransitionCallbackReturn.SUCCESS
U = np.array([0.01, -0.02, 0.03, -0.1])
FALLS_BACK = "no message on 'actuators' from inner_loop: the trim is held, rates are damped"
SILENT = "no message on 'actuators' from inner_loop: going on with the last command"


def positions(plant):
    return [row[:3].tolist() for row in plant.sent[topics.TRUTH_ODOM]]


def test_a_tick_per_command_and_no_more(bench):
    plant = bench(PlantNode)
    plant.fly()
    assert plant.node.tick == 0 and len(plant.sent[topics.CLOCK]) == 1
    for tick in range(5):
        plant.send(topics.ACTUATORS, tick, U)
        plant.send(topics.ACTUATORS, tick, -U)
        plant.send(topics.ACTUATORS, tick - 1, -U)
        assert plant.node.tick == tick + 1
    assert len(plant.sent[topics.TRUTH_ODOM]) == 6


def test_the_flight_is_a_function_of_its_commands(bench):
    """A command that comes twice, late or much too early leaves no trace in it."""
    clean, noisy = bench(PlantNode), bench(PlantNode)
    for plant in (clean, noisy):
        plant.fly()
    for tick in range(30):
        clean.send(topics.ACTUATORS, tick, U)
        noisy.send(topics.ACTUATORS, tick + 5000, -U)
        noisy.send(topics.ACTUATORS, tick, U)
        noisy.send(topics.ACTUATORS, tick, -U)
    assert positions(clean) == positions(noisy)


def test_a_silent_inner_loop_is_waited_for_then_flown_without_and_heard_again(bench):
    plant = bench(PlantNode, peer_timeout_s=0.2)
    plant.fly()
    plant.send(topics.ACTUATORS, 0, U)
    plant.spin_until(lambda: plant.node.tick >= 4)
    assert (plant.node.health.level, plant.node.health.message) == (Level.WARN, SILENT)
    here = plant.node.tick
    plant.send(topics.ACTUATORS, here, U)
    assert plant.node.tick == here + 1 and plant.node.silence() == ""
    plant.send(topics.ACTUATORS, here + 1, U)
    assert plant.node.tick == here + 2
    assert plant.node.health.message == "flying"
    assert len(positions(plant)) == here + 3, "every tick was sent, once"


def test_the_flight_ends_at_its_length(bench):
    plant = bench(PlantNode, duration_s=0.05)
    plant.fly()
    for tick in range(20):
        plant.send(topics.ACTUATORS, tick, U)
    assert plant.node.tick == 4 and len(positions(plant)) == 5
    assert plant.node.health.message.endswith(" 0.05 s")
    assert plant.node.health.facts["over"] == "true" and plant.node.finished


def test_real_time_begins_and_ends_with_activation(bench):
    plant = bench(PlantNode, lockstep=False)
    assert plant.node.trigger_configure() == SUCCESS
    before = len(list(plant.node.timers))
    assert plant.node.trigger_activate() == SUCCESS
    plant.send(topics.ACTUATORS, 0, U)
    plant.spin_until(lambda: plant.node.tick >= 5)
    assert plant.node.core.u.tolist() == U.tolist()
    assert plant.node.trigger_deactivate() == SUCCESS
    assert len(list(plant.node.timers)) == before


def test_real_time_names_a_silent_inner_loop_and_flies_on_without(bench):
    plant = bench(PlantNode, lockstep=False)
    plant.fly()
    plant.spin_until(lambda: plant.node.health.message == FALLS_BACK)
    flown = plant.node.tick
    assert flown > 10 and plant.node.core.fallback.times == 1
    plant.send(topics.ACTUATORS, flown, U)
    plant.spin_until(lambda: plant.node.health.message == "flying")
    plant.spin_until(lambda: "without_commands" in plant.node.health.facts)
    assert plant.node.health.facts["without_commands"].startswith("1 times, 0.")


def test_gusts_change_in_flight_and_refused_ones_change_nothing(bench):
    plant = bench(PlantNode)
    plant.fly()
    config = plant.node.core.config

    def ask(**values):
        return plant.node.set_parameters_atomically(
            [Parameter(f"wind.gust.{name}", value=value) for name, value in values.items()]
        )

    refused = ask(start_s=[1.0, 2.0])
    assert not refused.successful and "gust" in refused.reason
    assert plant.node.core.config is config
    assert ask(
        start_s=[0.0], duration_s=[2.0], amplitude_mps=[1.0, 0.0, 0.0], frame="ned"
    ).successful
    changed = plant.node.core.config
    assert changed.wind is not config.wind and changed.helicopter is config.helicopter


def called(plant, kind, name, request):
    """Answer of a service of the plant, as who calls it gets it."""
    (service,) = [s for s in plant.node.services if s.service_name.endswith(f"/{name}")]
    got, answer = [], service.callback(request, kind.Response())
    if hasattr(answer, "send_by"):
        answer.send_by(got.append)
        plant.spin_until(lambda: got)
        (answer,) = got
    return answer


def with_faults(plant, *texts):
    request = SetParametersAtomically.Request()
    request.parameters = [Parameter("faults", value=list(texts)).to_parameter_msg()]
    return called(plant, SetParametersAtomically, "set_parameters_atomically", request).result


def test_a_fault_without_a_beginning_begins_when_the_plant_hears_of_it(bench):
    """By its clock, not by the sender's; then it is as one that was given with that time."""
    plant, from_file = bench(PlantNode), bench(PlantNode)
    for one in (plant, from_file):
        one.fly()
        for tick in range(20):
            one.send(topics.ACTUATORS, tick, U)
    texts = ("{what: imu, kind: bias, value: [1, 0, 0, 0, 0, 0], duration_s: 0.1}",
             "{what: baro, kind: loss, start_s: now}")  # fmt: skip
    assert with_faults(plant, *texts).successful
    later = "start_s: 0.21"
    begun = plant.node.get_parameter("faults").value
    assert len(begun) == 2 and all(later in text for text in begun)
    assert with_faults(from_file, *begun).successful
    for one in (plant, from_file):
        for tick in range(20, 40):
            one.send(topics.ACTUATORS, tick, U)
    imu = np.array(plant.sent[topics.IMU])
    np.testing.assert_array_equal(imu, from_file.sent[topics.IMU])
    felt = np.flatnonzero(np.abs(np.diff(imu[:, 0])) > 0.5) + 1
    assert felt.tolist() == [21, 31]
    facts, (imu_bias, baro_loss) = plant.node._facts_now(), faults_of(begun)
    assert (imu_bias.start_s, imu_bias.end_s) == pytest.approx((0.21, 0.31))
    assert facts["faults"] == baro_loss.words
    assert facts["faults_in_flight"] == f"{imu_bias.words}; {baro_loss.words}"


@pytest.mark.parametrize(
    ("bad", "cause"),
    [("{what: gps, kind: melts}", Cause.CHOICE), ("{what: gps", Cause.SYNTAX)],
)
def test_a_bad_fault_changes_nothing_and_is_told_in_a_sentence(bench, bad, cause):
    plant = bench(PlantNode)
    plant.fly()
    with pytest.raises(ParameterError) as caught:
        faults_of([bad])
    refused = with_faults(plant, bad)
    assert not refused.successful and caught.value.cause is cause
    assert str(caught.value) in refused.reason
    assert plant.node.core.config.faults == () and "faults" not in plant.node._facts_now()


def test_faults_are_cleared_by_a_service(bench):
    plant = bench(PlantNode)
    plant.fly()
    answer = called(plant, Trigger, "clear_faults", Trigger.Request())
    assert answer.success and answer.message == FaultLog.cleared((), 0.0)
    loss = Fault("baro", "loss", 0.01)
    assert with_faults(plant, f"{{what: {loss.what}, kind: {loss.kind}}}").successful
    plant.send(topics.ACTUATORS, 0, U)
    assert plant.node.core.config.faults == (loss,)
    assert plant.node.health.message == f"fault: {loss.what} {loss.kind}"
    answer = called(plant, Trigger, "clear_faults", Trigger.Request())
    assert answer.success and answer.message == f"cleared: {loss.words}"
    plant.send(topics.ACTUATORS, 1, U)
    assert plant.node.health.message == "flying" and plant.node.core.config.faults == ()
    facts = plant.node._facts_now()
    assert "faults" not in facts and facts["faults_in_flight"].endswith("cleared at 0.02 s")


@pytest.mark.parametrize("lockstep", [True, False])
def test_clean_up_leaves_nothing_behind(bench, lockstep):
    plant = bench(PlantNode, lockstep=lockstep)

    def entities():
        node = plant.node
        return [len(list(kind)) for kind in (node.publishers, node.subscriptions, node.timers)]

    before = entities()
    for _ in range(2):
        plant.fly()
        assert sum(entities()) > sum(before) + 8
        assert plant.node.trigger_deactivate() == SUCCESS
        assert plant.node.trigger_cleanup() == SUCCESS
        assert entities() == before


def test_the_plant_waits_for_every_link_of_a_flight():
    """Time does not begin while anybody still gets ready, whoever hears the plant itself."""

    class Named:
        values = PlantNode.SPEC.resolve()

    links = PlantNode.awaited_links(Named)
    assert links[topics.ODOM] == {"inner_loop", "outer_loop"}
    assert links[topics.ACTUATORS] == {"plant", "observer"}
    assert links[topics.ATTITUDE_SETPOINT] == {"inner_loop"}
    assert topics.REFERENCE not in links and topics.EXCITATION_WIND not in links


def test_messages_say_what_the_parameters_say_of_the_sensors(bench):
    """RTK sets the status of the fixes; variances are those of the simulated errors."""
    raw = {}

    class Heard(PlantNode):
        def create_topic_publisher(self, topic):
            send = super().create_topic_publisher(topic)

            def heard(message):
                raw[topic] = message
                send(message)

            return heard

    preset = command_line.config_folder("heli_dynamics_sim") / "gps_rtk.yaml"
    rtk = PlantNode.SPEC.resolve([str(preset)])
    gps = {n.replace(".", "__"): v for n, v in rtk.items() if n.startswith("sensors.gps.")}
    plant = bench(Heard, **gps)
    plant.fly()
    for tick in range(40):
        plant.send(topics.ACTUATORS, tick, U)
    fix = deserialize_message(raw[topics.GPS_FIX], NavSatFix)
    assert fix.status.status == fix.status.STATUS_GBAS_FIX
    level = 0.006**2 + 0.006**2
    wanted = np.diag([level, level, level * 1.75**2]).ravel()
    assert fix.position_covariance == pytest.approx(wanted)
    imu = deserialize_message(raw[topics.IMU], Imu)
    assert imu.angular_velocity_covariance[0] == pytest.approx(1e-4**2 / 0.01)
    assert imu.orientation_covariance[0] == -1.0


def test_a_receiver_without_a_fix_says_so_on_schedule(bench):
    """Outages: a message at every fifth of a second, STATUS_NO_FIX in one, its stamp as ever."""
    heard = []

    class Heard(PlantNode):
        def create_topic_publisher(self, topic):
            send = super().create_topic_publisher(topic)

            def keep(message):
                if topic == topics.GPS_FIX:
                    heard.append(deserialize_message(message, NavSatFix))
                send(message)

            return keep

    plant = bench(
        Heard,
        sensors__gps__outage__interval_s=0.4,
        sensors__gps__outage__duration_s=0.4,
    )
    plant.fly()
    for tick in range(300):
        plant.send(topics.ACTUATORS, tick, U)
    states = {fix.status.status for fix in heard}
    assert states == {NavSatStatus.STATUS_NO_FIX, NavSatStatus.STATUS_FIX}
    for fix in heard:
        assert np.isnan(fix.latitude) == (fix.status.status == NavSatStatus.STATUS_NO_FIX)
    stamps = np.array([fix.header.stamp.sec + 1e-9 * fix.header.stamp.nanosec for fix in heard])
    assert len(heard) == 16 and np.diff(stamps) == pytest.approx(np.full(15, 0.2), abs=1e-6)


@pytest.mark.parametrize("covariance", ["honest", "receiver"])
def test_covariance_knows_of_multipath_or_not(covariance):
    values = PlantNode.SPEC.resolve() | {
        "sensors.gps.multipath.sigma_m": 2.0,
        "sensors.gps.jump.sigma_m": 1.0,
        "sensors.gps.covariance": covariance,
    }
    level = 0.3**2 + 1.0**2 + (5.0 if covariance == "honest" else 0.0)
    assert message_variances(values)["gps"][0] == pytest.approx((level, level, 2.25 * level))


@pytest.mark.parametrize("late", [False, True], ids=["before the pause", "in the pause"])
def test_a_pause_leaves_no_trace_in_the_flight(bench, late):
    """Time stands still and goes on; the command of the present tick may come in the pause."""
    through, paused = bench(PlantNode), bench(PlantNode)
    for plant in (through, paused):
        plant.fly()
    for tick in range(40):
        through.send(topics.ACTUATORS, tick, U)
        if tick % 7 == 3 and late:
            assert paused.node.trigger_deactivate() == SUCCESS
            paused.send(topics.ACTUATORS, tick, U)
            assert paused.node.tick == tick
            assert paused.node.trigger_activate() == SUCCESS
        else:
            paused.send(topics.ACTUATORS, tick, U)
            if tick % 7 == 3:
                paused.again()
                paused.again()
        assert paused.node.tick == tick + 1
    assert paused.sent[topics.CLOCK] == through.sent[topics.CLOCK]
    for topic in (topics.TRUTH_ODOM, topics.TRUTH_WIND, topics.IMU):
        np.testing.assert_array_equal(paused.sent[topic], through.sent[topic])


def test_a_pause_in_real_time_does_not_count(bench):
    """Not the wall time of the pause is made up for, nor is the last command called missing."""
    plant = bench(PlantNode, lockstep=False)
    plant.fly()
    plant.spin_until(lambda: plant.node.tick >= 10)
    assert plant.node.trigger_deactivate() == SUCCESS
    here, flown_s = plant.node.tick, plant.node.core.wall_s
    waited = []
    plant.node.create_timer(1.0, lambda: waited.append(1))
    plant.spin_until(lambda: waited)
    assert plant.node.tick == here
    resumed_s = time.monotonic()
    assert plant.node.trigger_activate() == SUCCESS
    plant.send(topics.ACTUATORS, here, U)
    plant.spin_until(lambda: plant.node.tick > here)
    assert plant.node.health.message == "flying"
    plant.spin_until(lambda: plant.node.tick >= here + 20)
    counted_s = float(plant.node._facts_now()["wall_s"]) - flown_s
    assert counted_s < time.monotonic() - resumed_s + 0.01
    stamps = [stamp_of(raw) for raw in plant.sent[topics.CLOCK]]
    assert set(np.diff(stamps)) == {TICK_NS}, "no tick is sent twice, none is left out"


def test_another_flight_begins_after_clean_up_only(bench):
    """One that is over does not go on; cleaned up and configured, it begins at tick 0."""
    plant = bench(PlantNode, duration_s=0.05, autostart=False)
    plant.fly()
    for tick in range(5):
        plant.send(topics.ACTUATORS, tick, U)
    assert plant.node.health.facts["over"] == "true"
    first, over = positions(plant), plant.node.health.message
    assert plant.node.trigger_deactivate() == SUCCESS
    assert plant.node.trigger_activate() != SUCCESS
    assert plant.node.failure.startswith(f"{over}: ")
    assert plant.node.trigger_cleanup() == SUCCESS
    plant.fly()
    assert plant.node.tick == 0 and "over" not in plant.node.health.facts
    for tick in range(5):
        plant.send(topics.ACTUATORS, tick, U)
    assert positions(plant) == first * 2


class TestInAWorldOfSeveralAircraft:
    """Its clock is another node's, and nobody is more than a tick ahead of it."""

    @pytest.fixture
    def plant(self, bench):
        plant = bench(PlantNode, clock="world")
        # Nobody listens here: not waited for.
        plant.node.expected_listeners = lambda topic: set()
        plant.fly()
        return plant

    def show(self, plant, tick):
        plant.receive("clock", ClockEncoder().encode(plant.node.stamp_ns(tick)))

    def test_it_sends_no_clock_and_waits_for_it(self, plant):
        plant.send(topics.ACTUATORS, 0, U)
        assert plant.node.tick == 0 and topics.CLOCK not in plant.sent
        self.show(plant, 0)
        assert plant.node.tick == 1
        self.show(plant, 1)
        assert plant.node.tick == 1
        plant.send(topics.ACTUATORS, 1, U)
        assert plant.node.tick == 2 and topics.CLOCK not in plant.sent

    def test_a_clock_that_is_cut_off_is_none(self, plant):
        plant.send(topics.ACTUATORS, 0, U)
        plant.receive("clock", ClockEncoder().encode(plant.node.stamp_ns(0))[:11])
        assert plant.node.tick == 0

    def test_it_goes_on_alone_when_the_clock_has_been_silent_for_long(self, bench):
        plant = bench(PlantNode, clock="world", peer_timeout_s=0.05)
        plant.node.expected_listeners = lambda topic: set()
        plant.fly()
        plant.send(topics.ACTUATORS, 0, U)
        plant.spin_until(lambda: plant.node.tick == 1)
        assert "'/clock' from world_clock" in plant.node.silence()

    def test_its_truth_must_be_heard_by_the_clock(self, bench):
        node = bench(PlantNode, clock="world").node
        assert "world_clock" in node.expected_listeners(topics.TRUTH_ODOM)
        assert "world_clock" not in node.expected_listeners(topics.IMU)
        assert "world_clock" not in bench(PlantNode).node.expected_listeners(topics.TRUTH_ODOM)


def test_the_exit_code_says_whether_the_helicopter_came_through(bench):
    """`ros2 launch` ends with it: 0 after a flight, 1 after a loss."""
    plant = bench(PlantNode, duration_s=0.02)
    plant.fly()
    plant.send(topics.ACTUATORS, 0, U)
    plant.send(topics.ACTUATORS, 1, U)
    assert (plant.node.finished, plant.node.exit_code) == (True, 0)
    lost = bench(PlantNode, **{"limits.distance_m": 1.0})
    lost.fly()
    for tick in range(1000):
        if lost.node.finished:
            break
        lost.send(topics.ACTUATORS, tick, -np.ones(4))
    assert lost.node.health.level == Level.ERROR
    assert (lost.node.finished, lost.node.exit_code) == (True, 1)


def test_a_tick_is_sent_in_the_order_that_bags_have(bench):
    plant = bench(
        PlantNode, sensors__imu2__enabled=True, wind__sines__amplitude_mps=[1.0, 0.0, 0.0],
        wind__sines__frequency_hz=[1.0], wind__sines__phase_rad=[0.0, 0.0, 0.0],
    )  # fmt: skip
    plant.fly()
    in_order = [name for name in topics.SENDING_ORDER if "plant" in topics.KNOWN[name].source]
    assert [name for name in plant.sent if name in in_order] == in_order


def test_a_led_plant_has_the_same_exit_code_and_waits_to_be_ended(bench):
    """Whoever shuts it down after a loss ends its process with 1, too."""
    lost = bench(PlantNode, autostart=False, **{"limits.distance_m": 1.0})
    lost.fly()
    for tick in range(1000):
        if lost.node.health.level == Level.ERROR:
            break
        lost.send(topics.ACTUATORS, tick, -np.ones(4))
    assert (lost.node.finished, lost.node.exit_code) == (False, 1)
