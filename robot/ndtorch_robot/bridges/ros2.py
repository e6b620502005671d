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
from ndtorch.navigation.mapping.map_rendering import map_cells
from ndtorch.utils.packages import need
from ndtorch.utils.toml import Strict
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.bridges.registry import Bridge, Opening, bridge, command_of
from ndtorch_robot.obstacles import seen_obstacles
from ndtorch_robot.ports import Step

QUEUE = 10
"""Messages that a reader keeps until they are taken."""

LOCAL = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface name="{}"/></Interfaces><AllowMulticast>{}</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>{}</Discovery>
</Domain></CycloneDDS>"""


class Ros2Settings(Strict):
    """`[bridges.ros2]`.

    Args:
        domain_id: as ROS_DOMAIN_ID.
        interface: of the network; the one that Cyclone DDS, or CYCLONEDDS_URI, chooses where it is empty. With `lo`
            participants are found without multicast.
        cmd_vel_in: topic of the commands from outside, where these are listened to.
        stamped_cmd_vel: commands are TwistStamped, as since ROS 2 Kilted, instead of Twist.
        map_period_s: the map is published this often.
    """

    domain_id: Annotated[int, Field(ge=0, le=232)] = 0
    interface: str = ""
    cmd_vel_in: str = "cmd_vel_smoothed"
    stamped_cmd_vel: bool = False
    map_period_s: Annotated[float, Field(gt=0)] = 5.0


class Ros2Bridge(Bridge):
    """Publishes /scan, /odom, /tf, /diagnostics, /cmd_vel and /map; takes commands and goals where they are wanted.

    Raises:
        InputError: Cyclone DDS is not installed, or does not start.
    """

    def __init__(self, settings: Ros2Settings, opening: Opening) -> None:
        self.settings, self.opening = settings, opening
        self.node = Node(settings.domain_id, settings.interface)
        twist = "geometry_msgs/msg/Twist" + "Stamped" * settings.stamped_cmd_vel
        self.scan = self.node.publisher("scan", "sensor_msgs/msg/LaserScan")
        self.odom = self.node.publisher("odom", "nav_msgs/msg/Odometry")
        self.tf = self.node.publisher("tf", "tf2_msgs/msg/TFMessage")
        self.cmd_vel = self.node.publisher("cmd_vel", twist)
        self.diagnostics = self.node.publisher("diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self.grid = opening.runner.grid
        self.map = None if self.grid is None else self.node.publisher("map", "nav_msgs/msg/OccupancyGrid", latched=True)
        self.readers: list[tuple[Callable[[], list[Any]], Callable[[Any], None]]] = []
        if opening.wish is not None:
            self.readers.append((self.node.subscriber(settings.cmd_vel_in, twist), self.on_cmd_vel))
        if opening.runner.navigator.controller.has_goals:
            self.readers.append((self.node.subscriber("goal_pose", "geometry_msgs/msg/PoseStamped"), self.on_goal))
        self.wall_clock = math.inf
        self.mapped = -math.inf

    def publish(self, step: Step) -> None:
        # The least delay so far is taken for none: steps have the times of the loop's clock, stamps those of the wall.
        self.wall_clock = min(self.wall_clock, time.time() - step.time)
        now, state = step.time + self.wall_clock, step.state
        self.cmd_vel(ros.twist_stamped(step.sent, now) if self.settings.stamped_cmd_vel else ros.twist(step.sent))
        self.diagnostics(ros.diagnostics(step.standing, step.telemetry, now))
        if state is None:
            return
        navigator = self.opening.runner.navigator
        self.scan(ros.laser_scan(seen_obstacles(state, navigator), now))
        self.odom(ros.odometry(state.pose, step.driven, now))
        self.tf(ros.transforms(state.pose, state.place, now))
        if self.map is not None and self.grid is not None and step.time - self.mapped >= self.settings.map_period_s:
            self.mapped = step.time
            assert navigator.grid_map is not None
            self.map(ros.occupancy_grid(map_cells(navigator.grid_map, state), self.grid, now))

    def poll(self) -> None:
        for take, tell in self.readers:
            for message in take():
                tell(message)

    def on_cmd_vel(self, message: Any) -> None:
        moved = getattr(message, "twist", message)
        assert self.opening.wish is not None
        self.opening.wish.put(command_of(moved.linear.x, moved.angular.z))

    def on_goal(self, message: Any) -> None:
        self.opening.runner.drive_to(message.pose.position.x, message.pose.position.y)

    def close(self) -> None:
        self.node.close()


class Node:
    """A participant of a DDS domain that reads and writes ROS 2 messages, objects of `ros_messages`.

    Topics and types have the names that ROS 2 gives them over DDS: `/scan` is `rt/scan`, and
    `sensor_msgs/msg/LaserScan` is `sensor_msgs::msg::dds_::LaserScan_`.

    Args:
        domain_id, interface: see `Ros2Settings`.
    """

    def __init__(self, domain_id: int, interface: str = "") -> None:
        need("cyclonedds", "a bridge to ROS 2")
        from cyclonedds.core import DDSException
        from cyclonedds.domain import Domain, DomainParticipant

        peers = '<Peers><Peer address="127.0.0.1"/></Peers>' if interface == "lo" else ""
        config = LOCAL.format(interface, str(not peers).lower(), peers)
        try:
            self.domain: Any = Domain(domain_id, config) if interface else None
            self.participant: Any = DomainParticipant(domain_id)
        except DDSException as error:
            raise InputError(f"Cyclone DDS does not start in domain {domain_id}: {error.msg}") from None

    def publisher(self, topic: str, kind: str, latched: bool = False) -> Callable[[Any], None]:
        """What publishes messages of a type, reliably; `latched`: who subscribes later gets the last one, too."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
        qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(1), durability)
        data_type = wire_type(kind)
        writer = DataWriter(self.participant, Topic(self.participant, f"rt/{topic}", data_type), qos=qos)

        def publish(message: Any) -> None:
            writer.write(data_type.of(ros.to_cdr(message)))

        return publish

    def subscriber(self, topic: str, kind: str) -> Callable[[], list[Any]]:
        """What takes the messages of a type that have arrived; best effort, which gets on with every publisher."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(QUEUE))
        reader = DataReader(self.participant, Topic(self.participant, f"rt/{topic}", wire_type(kind)), qos=qos)

        def take() -> list[Any]:
            return [ros.from_cdr(sample.cdr, kind) for sample in reader.take(QUEUE) if hasattr(sample, "cdr")]

        return take

    def close(self) -> None:
        """Leave the domain; what reads and writes in it is gone."""
        self.participant = self.domain = None


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
    fields = {field: idl_field(described) for field, described in ros.typestore().fielddefs[kind][1]}
    return make_idl_struct(f"{name}_", f"{package}.{middle}.dds_.{name}_", fields)


def idl_field(described: Any) -> Any:
    """The IDL type of a field."""
    types = need("cyclonedds.idl.types", "a bridge to ROS 2")
    node, value = described
    if node == Nodetype.NAME:
        return idl_type(value)
    if node == Nodetype.ARRAY:
        return types.array[idl_field(value[0]), value[1]]
    if node == Nodetype.SEQUENCE:
        return types.sequence[idl_field(value[0])]
    plain = {"string": str, "bool": bool, "byte": types.byte, "octet": types.byte}
    return plain[value[0]] if value[0] in plain else getattr(types, value[0])


@bridge("ros2", Ros2Settings)
def open_ros2(settings: Ros2Settings, opening: Opening) -> Ros2Bridge:
    return Ros2Bridge(settings, opening)
