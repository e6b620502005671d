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
