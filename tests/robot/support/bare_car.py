"""The loop of a car without a board: as fast as it goes, on pictures that slide past."""

from ndtorch_robot.ports import Drive, DriveCommand, unseal
from ndtorch_robot.run import make_car
from ndtorch_robot.run_config import RunConfig, SimulationTable

FAULTS = ["no command for 0.2 s"]


class FilmCar(Drive):
    """Cameras, clock and drive: every reading gives the next of some frames, and wheels that do what they are told."""

    def __init__(self, frames):
        self.frames, self.time, self.sent = iter(frames), 0.0, DriveCommand(0.0, 0.0)

    def now(self):
        return self.time

    def wait_until(self, time):
        self.time = time

    def read(self):
        return next(self.frames)._replace(time=self.time)

    def send(self, command):
        self.sent = unseal(command)
        return self.sent

    def driven(self):
        return self.sent

    def telemetry(self):
        return {"armed": True, "faults": FAULTS, "battery_v": 7.4, "rejected": 3, "link": None}

    def stop(self):
        self.sent = DriveCommand(0.0, 0.0)

    def resume(self):
        return True


def bare_loop(car, rig, observers=None, **navigation):
    """A loop that drives off at once. What slides past does not turn as the wheels do, which is not looked at."""
    config = RunConfig(
        robot="bare", simulation=SimulationTable(), navigation=navigation, camera_monitor={"min_turns": 1000}
    )
    return make_car(config, car, rig, car, car, lambda line: None, True, observers or [], near_check=False)
