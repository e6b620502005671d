"""A process that sees a car as ROS 2 does, over DDS, with message types written down here: it prints what it got.

    python ros2_peer.py DOMAIN

It sends a goal until its stdin ends, and prints when it has one message of every topic.
"""

import json
import select
import sys

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


def struct(package, kind, **fields):
    """The message type `package/msg/kind` as ROS 2 has it over DDS."""
    return make_idl_struct(f"{kind}_", f"{package}.msg.dds_.{kind}_", fields)


Time_ = struct("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header_ = struct("std_msgs", "Header", stamp=Time_, frame_id=str)
Vector3_ = struct("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
Point_ = struct("geometry_msgs", "Point", x=float64, y=float64, z=float64)
Quaternion_ = struct("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)
Pose_ = struct("geometry_msgs", "Pose", position=Point_, orientation=Quaternion_)
PoseStamped_ = struct("geometry_msgs", "PoseStamped", header=Header_, pose=Pose_)
Twist_ = struct("geometry_msgs", "Twist", linear=Vector3_, angular=Vector3_)
PoseWithCovariance_ = struct("geometry_msgs", "PoseWithCovariance", pose=Pose_, covariance=array[float64, 36])
TwistWithCovariance_ = struct("geometry_msgs", "TwistWithCovariance", twist=Twist_, covariance=array[float64, 36])
Odometry_ = struct(
    *("nav_msgs", "Odometry"), header=Header_, child_frame_id=str, pose=PoseWithCovariance_, twist=TwistWithCovariance_
)
RANGES = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
LISTS = {"ranges": sequence[float32], "intensities": sequence[float32]}
LaserScan_ = struct("sensor_msgs", "LaserScan", header=Header_, **dict.fromkeys(RANGES, float32), **LISTS)
TOPICS = {"scan": LaserScan_, "odom": Odometry_}

LO = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""


def fields(message):
    """A message as JSON."""
    if hasattr(message, "__dict__"):
        return {name: fields(value) for name, value in vars(message).items()}
    if isinstance(message, list | tuple | bytes):
        return [fields(part) for part in message]
    return message if message == message else None


def main(domain):
    kept, participant = Domain(domain, LO), DomainParticipant(domain)
    # As the defaults of ROS 2: reliable publishers, and subscribers that get on with them.
    qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))
    readers = {
        name: DataReader(participant, Topic(participant, f"rt/{name}", kind), qos=qos) for name, kind in TOPICS.items()
    }
    goal = DataWriter(participant, Topic(participant, "rt/goal_pose", PoseStamped_), qos=qos)
    got, said = {}, False
    while not select.select([sys.stdin], [], [], 0.01)[0]:
        pose = Pose_(Point_(3.0, -1.5, 0.0), Quaternion_(0.0, 0.0, 0.0, 1.0))
        goal.write(PoseStamped_(Header_(Time_(0, 0), "map"), pose))
        for name, reader in readers.items():
            for message in reader.take(1):
                got[name] = fields(message)
        if len(got) == len(TOPICS) and not said:
            said = True
            print(json.dumps(got), flush=True)
    del kept


if __name__ == "__main__":
    main(int(sys.argv[1]))
