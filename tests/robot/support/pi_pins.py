"""Programs beside the links of a Raspberry Pi: a bank of registers on a bus, mock pins, and a car that only drives.

`bank SOCKET LOG` is a PCA9685 at address 0x40: it writes the pulse of each channel in us, with its time, into a log.
`board SOCKET ...` is `pi_board` with `smbus2` on that socket, or with mock pins of gpiozero that write such a log.
`car KIND SOCKET` drives ahead until it is stopped, by whatever means.
"""

import socket
import sys
import time
import types

from ndtorch_robot.link import pi_board

MODE1, PRESCALE = 0x00, 0xFE


def bank(address, log):
    """Registers as in the data sheet: without auto-increment a block writes one register alone."""
    registers, server = bytearray([0x11, *[0] * 253, 30, 0]), socket.socket(socket.AF_UNIX)
    server.bind(address)
    server.listen()
    line, out = server.accept()[0].makefile("rb"), open(log, "w", buffering=1)  # noqa: PTH123, SIM115
    while head := line.read(3):
        chip, register, count = head
        assert chip == 0x40
        for value in line.read(count):
            if register != PRESCALE or registers[MODE1] & 0x10:  # the prescaler is locked while pulses come
                registers[register] = value
            register += bool(registers[MODE1] & 0x20)
        if not registers[MODE1] & 0x10:
            period = (registers[PRESCALE] + 1) / 25.0
            for channel in (0, 1):
                begin_low, begin_high, low, high = registers[6 + 4 * channel : 10 + 4 * channel]
                assert begin_low == begin_high == 0
                print(time.monotonic(), channel, round((low + 256 * high) * period, 1), file=out)


class SMBus:
    """The two methods of `smbus2.SMBus` that are used, with its signatures."""

    address = ""

    def __init__(self, bus=None, force=False):
        self.line = socket.socket(socket.AF_UNIX)
        self.line.connect(self.address)

    def write_byte_data(self, i2c_addr, register, value, force=None):
        self.write_i2c_block_data(i2c_addr, register, [value], force)

    def write_i2c_block_data(self, i2c_addr, register, data, force=None):
        self.line.sendall(bytes([i2c_addr, register, len(data), *data]))

    def close(self):
        self.line.close()


def board(address, kind, *arguments):
    if kind == "pca9685":
        SMBus.address = address
        sys.modules["smbus2"] = types.SimpleNamespace(SMBus=SMBus)
    else:
        import gpiozero
        from gpiozero.pins.mock import MockFactory, MockPWMPin

        log = open(address, "w", buffering=1)  # noqa: PTH123, SIM115

        class Pin(MockPWMPin):
            def _change_state(self, value):
                print(time.monotonic(), self.info.name, value, file=log)
                return super()._change_state(value)

        gpiozero.Device.pin_factory = MockFactory(pin_class=Pin)
    pi_board.serve(kind, *arguments)


def car(kind, address):
    from ndtorch_robot.link import Opening, check_link, pi_board
    from ndtorch_robot.ports import DriveCommand
    from ndtorch_robot.safety import SafeDrive

    pi_board.PROGRAM = (sys.executable, "-m", __spec__.name, "board", address)
    opener, settings = check_link({"kind": kind})
    drive = opener(settings, Opening("pi", lambda line: print(line, flush=True)))
    safe = SafeDrive(drive, types.SimpleNamespace(now=time.monotonic))
    safe.wait_for_start(go=True)
    try:
        while True:
            if safe.standing is not None:  # again after SIGCONT
                safe.resume()
            safe.send(DriveCommand(0.5, 1.0))
            time.sleep(0.03)
    finally:
        drive.close()


if __name__ == "__main__":
    {"bank": bank, "board": board, "car": car}[sys.argv[1]](*sys.argv[2:])
