"""ROS 2 topics without a ROS installation: Cyclone DDS carries what `rosbags` encodes."""

from __future__ import annotations

import math
import time
from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype

from ndtorch.errors import InputError
from ndtorch.utils.packages import need
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.navigator_runner import NavigatorRunner, seen_obstacles
from ndtorch_robot.ports import Report, Step
from ndtorch_robot.run_config import Ros2Table
from ndtorch_robot.step_thread import StepThread

CONFIG = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface {}/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers>{}</Peers></Discovery></Domain></CycloneDDS>"""
"""Participants are looked for at named peers, without multicast."""

PUBLISHED = {"scan": "sensor_msgs/msg/LaserScan", "odom": "nav_msgs/msg/Odometry", "tf": "tf2_msgs/msg/TFMessage"}

GOAL = "geometry_msgs/msg/PoseStamped"


class Ros2Bridge(StepThread):
    """An observer that publishes /scan, /odom and /tf, and takes /goal_pose where there are goals, in its own thread.

    Topics and types have the names that ROS 2 gives them over DDS: `/scan` is `rt/scan`. Publishers are reliable;
    goals are taken with best effort, which gets on with every publisher.

    Raises:
        InputError: Cyclone DDS is not installed, or does not start.
    """

    patience, poll_s = 1.0, 0.01

    def __init__(self, settings: Ros2Table, runner: NavigatorRunner, report: Report) -> None:
        need("cyclonedds", "a bridge to ROS 2")
        from cyclonedds.core import DDSException, Policy, Qos
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        loopback = settings.peer in ("127.0.0.1", "localhost")
        interface = 'name="lo"' if loopback else 'autodetermine="true"'
        try:
            config = CONFIG.format(interface, f'<Peer address="{settings.peer}"/>')
            self.domain: Any = Domain(settings.domain_id, config)
            self.participant: Any = DomainParticipant(settings.domain_id)
        except DDSException as error:
            raise InputError(f"Cyclone DDS does not start in domain {settings.domain_id}: {error.msg}") from None
        self.runner, self.wall_clock, participant = runner, math.inf, self.participant

        def topic(name: str, kind: str) -> Any:
            return Topic(participant, f"rt/{name}", wire_type(kind))

        reliable = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(1))
        self.writers = {name: DataWriter(participant, topic(name, PUBLISHED[name]), qos=reliable) for name in PUBLISHED}
        best_effort = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
        has_goals = runner.navigator.controller.has_goals
        self.goals = DataReader(participant, topic("goal_pose", GOAL), qos=best_effort) if has_goals else None
        super().__init__("bridge to ROS 2", 1, "newest", report)

    __call__ = StepThread.put

    def handle(self, item: Step) -> None:
        # The least delay so far is taken for none: steps have the times of the loop's clock, stamps those of the wall.
        self.wall_clock = min(self.wall_clock, time.time() - item.time)
        now, state = item.time + self.wall_clock, item.state
        if state is None:
            return
        messages = {
            "scan": ros.laser_scan(seen_obstacles(state, self.runner.navigator), now),
            "odom": ros.odometry(state.pose, item.driven, now),
            "tf": ros.transforms(state.pose, state.place, now),
        }
        for name, message in messages.items():
            self.writers[name].write(wire_type(PUBLISHED[name]).of(ros.to_cdr(message)))

    def idle(self) -> None:
        for sample in () if self.goals is None else self.goals.take(10):
            if hasattr(sample, "cdr"):
                goal = ros.from_cdr(sample.cdr, GOAL).pose.position
                self.runner.drive_to(goal.x, goal.y)

    def finish(self) -> None:
        self.participant = self.domain = None


@cache
def wire_type(kind: str) -> Any:
    """The IDL type of Cyclone DDS for a message type, of the definitions of `rosbags`.

    It is announced with all its fields, while samples are bytes that stay as they are.
    """
    from cyclonedds.idl import make_idl_struct

    ros.load_types(kind)
    package, middle, name = kind.split("/")
    fields = {field: idl_field(*how) for field, how in ros.typestore().fielddefs[kind][1]}
    described: Any = make_idl_struct(f"{name}_", f"{package}.{middle}.dds_.{name}_", fields)

    def of(cdr: bytes) -> Any:
        sample = object.__new__(described)
        sample.cdr = cdr
        return sample

    described.of, described.deserialize = staticmethod(of), staticmethod(of)
    described.serialize = lambda self, **options: self.cdr
    return described


def idl_field(node: Any, value: Any) -> Any:
    types = need("cyclonedds.idl.types", "a bridge to ROS 2")
    if node == Nodetype.NAME:
        return wire_type(value)
    if node == Nodetype.ARRAY:
        return types.array[idl_field(*value[0]), value[1]]
    if node == Nodetype.SEQUENCE:
        return types.sequence[idl_field(*value[0])]
    plain = {"string": str, "bool": bool, "octet": types.byte}
    return plain.get(value[0]) or getattr(types, value[0])
