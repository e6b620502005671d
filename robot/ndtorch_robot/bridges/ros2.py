"""ROS 2 topics without a ROS installation: Cyclone DDS carries what `rosbags` encodes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

from pydantic import Field
from rosbags.interfaces import Nodetype

from ndtorch.errors import InputError
from ndtorch.utils.packages import need
from ndtorch.utils.toml import Strict
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.bridges import Bridge, Opening, bridge
from ndtorch_robot.navigator_runner import seen_obstacles
from ndtorch_robot.ports import Step

CONFIG = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface {}/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers>{}</Peers></Discovery></Domain></CycloneDDS>"""
"""Participants are looked for at named peers, without multicast."""

PUBLISHED = {
    "scan": "sensor_msgs/msg/LaserScan",
    "odom": "nav_msgs/msg/Odometry",
    "tf": "tf2_msgs/msg/TFMessage",
    "map": "nav_msgs/msg/OccupancyGrid",
}
GOAL = "geometry_msgs/msg/PoseStamped"


class Ros2Settings(Strict):
    """`[bridges.ros2]`: who is spoken to, and how often the map is published.

    Args:
        domain_id: ROS_DOMAIN_ID.
        peer: address of the other computer; this one alone by default.
        map_period_s: seconds between two maps.
    """

    domain_id: Annotated[int, Field(ge=0, le=232)] = 0
    peer: Annotated[str, Field(pattern=r"^[\w.:-]+$")] = "127.0.0.1"
    map_period_s: Annotated[float, Field(gt=0)] = 5.0


class Ros2Bridge(Bridge):
    """Publishes /scan, /odom, /tf and /map, and takes /goal_pose where there are goals.

    Topics and types have the names that ROS 2 gives them over DDS: `/scan` is `rt/scan`.

    Raises:
        InputError: Cyclone DDS is not installed, or does not start.
    """

    def __init__(self, settings: Ros2Settings, opening: Opening) -> None:
        need("cyclonedds", "a bridge to ROS 2")
        from cyclonedds.core import DDSException
        from cyclonedds.domain import Domain, DomainParticipant

        loopback = settings.peer in ("127.0.0.1", "localhost")
        interface = 'name="lo"' if loopback else 'autodetermine="true"'
        try:
            config = CONFIG.format(interface, f'<Peer address="{settings.peer}"/>')
            self.domain: Any = Domain(settings.domain_id, config)
            self.participant: Any = DomainParticipant(settings.domain_id)
        except DDSException as error:
            raise InputError(f"Cyclone DDS does not start in domain {settings.domain_id}: {error.msg}") from None
        self.settings, self.opening, self.grid = settings, opening, opening.runner.grid
        self.send = {name: self.publisher(name, kind) for name, kind in PUBLISHED.items()}
        self.take_goals = self.subscriber("goal_pose") if opening.runner.navigator.controller.has_goals else list
        self.wall_clock, self.mapped = math.inf, -math.inf

    def publish(self, step: Step) -> None:
        # The least delay so far is taken for none: steps have the times of the loop's clock, stamps those of the wall.
        self.wall_clock = min(self.wall_clock, time.time() - step.time)
        now, state, navigator = step.time + self.wall_clock, step.state, self.opening.runner.navigator
        if state is None:
            return
        self.send["scan"](ros.laser_scan(seen_obstacles(state, navigator), now))
        self.send["odom"](ros.odometry(state.pose, step.driven, now))
        self.send["tf"](ros.transforms(state.pose, state.place, now))
        if self.grid is not None and step.time - self.mapped >= self.settings.map_period_s:
            self.mapped = step.time
            assert navigator.grid_map is not None
            self.send["map"](ros.occupancy_grid(navigator.grid_map.normalised(state.map), self.grid, now))

    def poll(self) -> None:
        for message in self.take_goals():
            self.opening.runner.drive_to(message.pose.position.x, message.pose.position.y)

    def close(self) -> None:
        self.participant = self.domain = None

    def publisher(self, topic: str, kind: str) -> Callable[[Any], None]:
        """What publishes messages of a type, reliably; who subscribes to the map later gets the last one, too."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        durability = Policy.Durability.TransientLocal if topic == "map" else Policy.Durability.Volatile
        qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(1), durability)
        data_type = wire_type(kind)
        writer = DataWriter(self.participant, Topic(self.participant, f"rt/{topic}", data_type), qos=qos)

        def publish(message: Any) -> None:
            writer.write(data_type.of(ros.to_cdr(message)))

        return publish

    def subscriber(self, topic: str) -> Callable[[], list[Any]]:
        """What takes the goals that have arrived; best effort, which gets on with every publisher."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
        reader = DataReader(self.participant, Topic(self.participant, f"rt/{topic}", wire_type(GOAL)), qos=qos)
        return lambda: [ros.from_cdr(sample.cdr, GOAL) for sample in reader.take(10) if hasattr(sample, "cdr")]


@cache
def wire_type(kind: str) -> Any:
    """A message type for DDS, which is announced with all its fields, while samples are bytes that stay as they are."""
    described = idl_type(kind)

    def of(cdr: bytes) -> Any:
        sample = object.__new__(described)
        sample.cdr = cdr
        return sample

    described.of, described.deserialize = staticmethod(of), staticmethod(of)
    described.serialize = lambda self, **options: self.cdr
    return described


@cache
def idl_type(kind: str) -> Any:
    """The IDL type of Cyclone DDS for a message type, of the definitions of `rosbags`."""
    from cyclonedds.idl import make_idl_struct

    ros.load_types(kind)
    package, middle, name = kind.split("/")
    fields = {field: idl_field(*described) for field, described in ros.typestore().fielddefs[kind][1]}
    return make_idl_struct(f"{name}_", f"{package}.{middle}.dds_.{name}_", fields)


def idl_field(node: Any, value: Any) -> Any:
    types = need("cyclonedds.idl.types", "a bridge to ROS 2")
    if node == Nodetype.NAME:
        return idl_type(value)
    if node == Nodetype.ARRAY:
        return types.array[idl_field(*value[0]), value[1]]
    if node == Nodetype.SEQUENCE:
        return types.sequence[idl_field(*value[0])]
    plain = {"string": str, "bool": bool, "octet": types.byte}
    return plain.get(value[0]) or getattr(types, value[0])


@bridge("ros2")
def open_ros2(settings: Ros2Settings, opening: Opening) -> Ros2Bridge:
    return Ros2Bridge(settings, opening)
