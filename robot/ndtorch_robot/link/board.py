"""The board of robot/firmware in Python: protocol, arming, timeouts, ramp and gears; see docs/robot/protocol.md.

It is the board of `ndtorch run sim`, and the one between the loop and the pins of a Raspberry Pi, where it is a process
of its own, without torch.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from pydantic import Field

from ndtorch.utils.toml import Strict
from ndtorch_robot.link.messages import (
    COMMAND_BODY,
    TELEMETRY_BODY,
    VERSION,
    WELCOME_BODY,
    LinkFault,
    LinkFrame,
    Parser,
    Type,
    encode_frame,
)

TICK_MS, PERIOD_MS, TELEMETRY_MS = 4, 20, 20
"""Milliseconds between two looks at the watchdogs, between two pulses of servos, and between two telemetries."""

NOISE_LIMIT, NOISE_MS = 4, 1000
"""At so many refused frames within this time the wheels stop."""

BRAKE_MS, PAUSE_MS, FORWARD_MS = 300, 120, 60
"""Times of the brake, of the pause before reverse, and of driving forward after which a pulse below neutral brakes."""

NAMES = ("motor", "front", "rear")


class BoardSettings(Strict):
    """A car as its board knows it; by default that of robot/firmware/config.h.

    Pulses are neutral plus speed or curvature times so many microseconds; of the motor also the dead band.
    """

    max_speed_mm_s: int = Field(1000, gt=0, le=5000)
    max_curvature_1_km: int = Field(2200, gt=0, le=32000)
    acceleration_mm_s2: int = Field(2000, gt=0, le=100000)
    front_neutral_us: int = Field(1500, ge=1000, le=2000)
    front_us_per_1_m: int = Field(200, ge=-10000, le=10000)
    rear_neutral_us: int = Field(1500, ge=1000, le=2000)
    rear_us_per_1_m: int = Field(-200, ge=-10000, le=10000)
    motor_neutral_us: int = Field(1500, ge=1000, le=2000)
    motor_dead_band_us: int = Field(30, ge=0, le=300)
    motor_us_per_m_s: int = Field(200, gt=0, le=10000)
    motor_brake_us: int = Field(1350, ge=1000, le=1500)
    motor_tap_us: int = Field(1465, ge=1000, le=1500)
    min_pulse_us: int = Field(1000, ge=500, le=2500)
    max_pulse_us: int = Field(2000, ge=500, le=2500)
    command_timeout_ms: int = Field(200, gt=0, le=1000)
    heartbeat_timeout_ms: int = Field(150, gt=0, le=1000)


class Pulse(NamedTuple):
    """One pulse: `"motor"`, `"front"` or `"rear"`, its width in us, and when it ended, s."""

    name: str
    width: float
    time: float


class Gear(Enum):
    """Motor controllers of model cars take a pulse below neutral for the brake, and the next one for reverse."""

    FORWARD = auto()
    BRAKING = auto()
    PAUSING = auto()
    REVERSE = auto()


class Board:
    """The board, at any time of the caller: it answers bytes by bytes, and gives the pulses of the car.

    Where `brakes_first`, the motor controller takes the first pulse below neutral for the brake. `speed` is
    that after the ramp, mm/s, and `widths` are those of the pulses of motor, front and rear, us.
    """

    def __init__(self, name: str, settings: BoardSettings | None = None, brakes_first: bool = True) -> None:
        self.name, self.settings, self.brakes_first = name, settings or BoardSettings(), brakes_first
        self.reset(0.0)

    def reset(self, now: float) -> None:
        """Switch it off and on at this time, s: it has forgotten everything."""
        self.ms = self.ticked = self.told = round(now * 1e3)
        self.parser, self.refused, self.versions = Parser(), 0, 0
        self.armed = self.greeted = False
        self.may_reverse, self.gear, self.faults = True, Gear.FORWARD, LinkFault(0)
        self.sequence = self.received = self.echo = self.rejected = 0
        self.commanded = self.beaten = self.stood = self.gear_at = 0
        self.brake_us = self.remainder = self.noise = self.refusals = 0
        self.refused_at = [0] * (NOISE_LIMIT - 1)
        self.last_tick = 0
        self.stand()

    def run(self, now: float, data: bytes = b"") -> bytes:
        """Go on until a time, s; these bytes come in its last millisecond. Returns answers."""
        until, out = round(now * 1e3), b""
        while self.ms < until:
            if data and self.ms + 1 == until:
                out += self.receive(data)
            if self.ms - self.ticked >= TICK_MS:
                self.ticked = self.ms
                self.tick()
            if self.ms - self.told >= TELEMETRY_MS and self.greeted:
                out += self.telemetry()
            self.ms += 1
        return out

    def close(self) -> None:
        """Nothing to give back."""

    def stand(self, fault: int = 0) -> None:
        s = self.settings
        self.armed, self.faults = False, self.faults | LinkFault(fault)
        self.target_speed = self.target_curvature = self.speed = self.curvature = self.remainder = 0
        self.gear = Gear.REVERSE if self.gear is Gear.REVERSE else Gear.FORWARD  # a brake begun must begin again
        self.widths = s.motor_neutral_us, s.front_neutral_us, s.rear_neutral_us

    def refuse(self) -> None:
        self.rejected = min(self.rejected + 1, 0xFFFF)
        oldest = self.refused_at[self.refusals]
        self.refused_at[self.refusals] = self.ms
        self.refusals = (self.refusals + 1) % (NOISE_LIMIT - 1)
        self.noise = min(self.noise + 1, NOISE_LIMIT)
        if self.noise >= NOISE_LIMIT and self.ms - oldest < NOISE_MS and self.armed:
            self.stand(LinkFault.NOISE)

    def receive(self, data: bytes) -> bytes:
        out = b""
        *ended, rest = data.split(b"\0")
        for piece in (*(part + b"\0" for part in ended), rest):  # in the order in which frames end
            frames = self.parser.feed(piece)
            for _ in range(self.parser.refused - self.refused):
                self.refuse()
            self.refused = self.parser.refused
            if self.parser.other_version is not None:
                self.parser.other_version = None
                self.stand(LinkFault.VERSION)
                self.refuse()
                out += self.welcome()  # whose header says which version this is
            out += b"".join(map(self.on_frame, frames))
        return out

    def on_frame(self, frame: LinkFrame) -> bytes:
        if frame.type >= Type.WELCOME:
            self.refuse()
        elif frame.type == Type.STOP:  # always heard
            self.stand(LinkFault.STOPPED)
            return self.telemetry()
        elif frame.type == Type.HELLO:
            self.stand()
            self.greeted, self.received, self.noise = True, frame.sequence, 0
            return self.welcome()
        elif not self.greeted:
            pass
        elif not 0 < (frame.sequence - self.received) & 0xFFFF < 0x8000:  # repeated, or older than the last
            self.refuse()
        else:
            self.received = frame.sequence
            return self.obey(frame)
        return b""

    def obey(self, frame: LinkFrame) -> bytes:
        s = self.settings
        if frame.type == Type.COMMAND:
            self.commanded = self.ms
            if self.armed:
                speed, curvature = COMMAND_BODY.unpack(frame.body)
                self.target_speed = min(max(speed, -s.max_speed_mm_s), s.max_speed_mm_s)
                self.target_curvature = min(max(curvature, -s.max_curvature_1_km), s.max_curvature_1_km)
            return b""
        if frame.type == Type.HEARTBEAT:
            self.beaten, self.echo = self.ms, frame.sequence
        else:
            self.faults, self.noise, self.armed = LinkFault(0), 0, True
            self.commanded = self.beaten = self.ms
        return self.telemetry()

    def tick(self) -> None:
        s, now = self.settings, self.ms
        elapsed, self.last_tick = min(now - self.last_tick, 50), now
        if now - self.refused_at[(self.refusals - 1) % (NOISE_LIMIT - 1)] >= NOISE_MS:
            self.noise = 0
        if self.speed <= 0:
            self.stood = now
        elif now - self.stood >= FORWARD_MS:
            self.may_reverse = False
        silent = LinkFault.COMMAND * (now - self.commanded >= s.command_timeout_ms)
        silent |= LinkFault.HEARTBEAT * (now - self.beaten >= s.heartbeat_timeout_ms)
        if self.armed and silent:
            self.stand(silent)
        if not self.armed:
            return
        self.shift(elapsed)
        self.curvature = self.target_curvature
        offset = int(self.speed * s.motor_us_per_m_s / 1000)
        offset += s.motor_dead_band_us * ((self.speed > 0) - (self.speed < 0))
        if self.gear is Gear.BRAKING:
            offset = self.brake_us - s.motor_neutral_us
        front, rear = (int(self.curvature * per / 1000) for per in (s.front_us_per_1_m, s.rear_us_per_1_m))
        pulses = s.motor_neutral_us + offset, s.front_neutral_us + front, s.rear_neutral_us + rear
        motor, front, rear = (min(max(us, s.min_pulse_us), s.max_pulse_us) for us in pulses)
        self.widths = motor, front, rear

    def ramp(self, target: int, elapsed: int) -> None:
        """Towards the target by no more than the acceleration allows."""
        most = self.settings.acceleration_mm_s2 * elapsed + self.remainder
        step, self.remainder = divmod(most, 1000)
        if self.speed == target:
            self.remainder = 0
        self.speed += min(max(target - self.speed, -step), step)

    def shift(self, elapsed: int) -> None:
        s, target = self.settings, self.target_speed
        if not self.brakes_first:
            self.ramp(target, elapsed)
        elif self.gear is Gear.FORWARD:
            self.ramp(max(target, 0), elapsed)
            if target < 0 and self.speed == 0:
                # Where the last brake may count still, another one is weak: it could be taken for reverse.
                self.gear, self.gear_at = Gear.BRAKING, self.ms
                self.brake_us = s.motor_tap_us if self.may_reverse else s.motor_brake_us
                self.may_reverse = True
        elif self.gear is Gear.REVERSE:
            self.ramp(min(target, 0), elapsed)
            if target > 0 and self.speed == 0:
                self.gear = Gear.FORWARD
        elif target > 0:
            self.gear = Gear.FORWARD
        elif self.gear is Gear.BRAKING and self.ms - self.gear_at >= BRAKE_MS:
            self.gear, self.gear_at = Gear.PAUSING, self.ms
        elif self.gear is Gear.PAUSING and self.ms - self.gear_at >= PAUSE_MS:
            self.gear = Gear.REVERSE

    def welcome(self) -> bytes:
        return self.answer(Type.WELCOME, WELCOME_BODY.pack(self.received, self.name.encode("ascii", "replace")))

    def telemetry(self) -> bytes:
        state = self.echo, self.armed, self.faults, self.speed, self.curvature, 0, *self.widths, self.rejected
        return self.answer(Type.TELEMETRY, TELEMETRY_BODY.pack(*state, self.ms // 1000 & 0xFFFF))

    def answer(self, kind: Type, body: bytes) -> bytes:
        self.sequence, self.told = self.sequence + 1 & 0xFFFF, self.ms
        return encode_frame(LinkFrame(VERSION, kind, self.sequence, body))
