"""Rates and delays of the bridges over loopback, at 30 steps a second: `python -m tests.robot.support.bridge_rates`.

A delay is from the time of a step, when the loop has handed it over, to its arrival in a second process.
"""

import json
import subprocess
import sys
import time

from ndtorch.navigation import Grid
from ndtorch_robot.bridges import Opening, open_bridges
from tests.robot.support import ros2_peer
from tests.robot.support.autopilot import free_port
from tests.robot.support.cars import known_step

SECONDS, RATE, DOMAIN = 15.0, 30.0, 199


def mavlink_peer(port):
    """Counts what arrives, as `ros2_peer.rates`."""
    from pymavlink import mavutil

    line = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=1, source_component=1, dialect="common")
    counts, ages, end, beaten = {"OBSTACLE_DISTANCE": 0, "ODOMETRY": 0}, [], None, 0.0
    while end is None or time.time() < end:
        if time.time() - beaten > 1.0:
            beaten = time.time()
            line.mav.heartbeat_send(10, 3, 1, 0, 4)
        message = line.recv_match(type=list(counts), blocking=True, timeout=0.1)
        if message is not None:
            end = end or time.time() + SECONDS
            counts[message.get_type()] += 1
            ages.append(1e3 * (time.time() - message.time_usec * 1e-6))
    ages.sort()
    figures = {f"{name}_hz": round(count / SECONDS, 1) for name, count in counts.items()}
    figures |= {"p50_ms": round(ages[len(ages) // 2], 2), "p99_ms": round(ages[len(ages) * 99 // 100], 2)}
    print(json.dumps(figures), flush=True)


def main():
    (step, runner), port = known_step(grid=Grid(-10, 10, -10, 10)), free_port()
    me = [sys.executable, "-m", "tests.robot.support.bridge_rates", str(port)]
    peers = [subprocess.Popen([sys.executable, ros2_peer.__file__, str(DOMAIN), str(SECONDS)]), subprocess.Popen(me)]
    tables = {"ros2": {"domain_id": DOMAIN, "interface": "lo"}, "mavlink": {"device": f"udpout:127.0.0.1:{port}"}}
    with open_bridges(tables, Opening("rates", print, runner)) as threads:
        due = time.time()
        while any(peer.poll() is None for peer in peers):
            for thread in threads:
                thread(step._replace(time=time.time()))
            due += 1 / RATE
            time.sleep(max(0.0, due - time.time()))
        print({thread.name: {"taken": thread.taken, "left out": thread.skipped} for thread in threads})


if __name__ == "__main__":
    mavlink_peer(int(sys.argv[1])) if len(sys.argv) > 1 else main()
