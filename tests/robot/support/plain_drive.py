"""A drive that notes what it is told."""

from ndtorch_robot.ports import unseal


class PlainDrive:
    def __init__(self):
        self.sent, self.stops, self.resumes, self.why, self.ready = [], 0, 0, None, True

    def send(self, command):
        self.sent.append(unseal(command))
        return self.sent[-1]

    def stop(self):
        self.stops += 1

    def resume(self):
        self.resumes += self.ready
        return self.ready

    def trouble(self):
        return self.why


class SimulatedClock:
    """Time that passes only by waiting: a loop on it runs as fast as it can and always sees the same times."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def wait_until(self, time_: float) -> None:
        self.time = max(self.time, time_)
