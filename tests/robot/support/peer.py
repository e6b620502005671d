"""The other end of a pty, in place of a board."""

import os
import pty
import threading
import tty

from ndtorch_robot.link.messages import LinkFrame, Parser, Type, encode_frame


class Peer:
    """Answers as `answer` says, a function of a frame that yields versions, kinds and bodies."""

    def __init__(self, answer):
        self.end, slave = pty.openpty()
        tty.setraw(slave)
        self.slave, self.device, self.answer = slave, os.ttyname(slave), answer
        self.going = True
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        parser, sequence = Parser(), 0
        while self.going:
            try:
                data = os.read(self.end, 200)
            except OSError:
                return
            for frame in parser.feed(data):
                for version, kind, body in self.answer(frame):
                    sequence += 1
                    os.write(self.end, encode_frame(LinkFrame(version, kind, sequence, body)))

    def close(self):
        self.going = False
        os.write(self.slave, b"\0")
        self.thread.join(2)
        os.close(self.end)
        os.close(self.slave)


def board(frame, version=1, name=b"maxston8"):
    """Answers like a board that stands."""
    if frame.type == Type.HELLO:
        yield version, Type.WELCOME, frame.sequence.to_bytes(2, "little") + name
    elif frame.type in (Type.HEARTBEAT, Type.ARM, Type.STOP):
        yield version, Type.TELEMETRY, frame.sequence.to_bytes(2, "little") + bytes(18)
