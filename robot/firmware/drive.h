/* What the board does with messages: arming, watchdogs, ramps and pulses. No hardware in here. */
#ifndef DRIVE_H
#define DRIVE_H

#include "config.h"
#include "protocol.h"

enum { STANDING = 0, ARMED = 1 };

/* Bits of `faults`: why the wheels stand. ARM clears all but FAULT_BATTERY and FAULT_EMPTY. */
enum {
    FAULT_COMMAND = 1,    /* no command for COMMAND_TIMEOUT_MS */
    FAULT_HEARTBEAT = 2,  /* no heartbeat for HEARTBEAT_TIMEOUT_MS */
    FAULT_VERSION = 4,    /* a frame of another version of the protocol */
    FAULT_NOISE = 8,      /* too many refused frames */
    FAULT_BATTERY = 16,   /* low: slower, but the wheels may turn */
    FAULT_WATCHDOG = 32,  /* the watchdog timer reset the board */
    FAULT_STOPPED = 64,   /* told to stop */
    FAULT_EMPTY = 128,    /* the battery is empty: the wheels stand until it is not */
};

enum gear { FORWARD, BRAKING, PAUSING, REVERSE };

struct drive {
    uint8_t state, faults, greeted;
    uint16_t sequence, echo, rejected, battery_mv;
    uint8_t noise, refusals;               /* how many were refused, and where the next one is noted */
    uint32_t refused_ms[NOISE_LIMIT - 1];  /* when, the last of them */
    uint32_t commanded_ms, beaten_ms, ticked_ms, gear_ms;
    uint32_t not_low_ms, not_empty_ms; /* when the battery was last seen so */
    int16_t target_speed, target_curvature; /* mm/s, 1/km */
    int16_t speed, curvature;               /* applied */
    enum gear gear;
    uint8_t may_reverse; /* the motor controller may take a pulse below neutral for reverse */
    uint32_t stood_ms;   /* when it last did not drive forward */
    uint16_t brake_us;
    uint16_t motor_us, front_us, rear_us;
    uint16_t remainder; /* of the ramp, in mm/s / 1000 */
};

void drive_init(struct drive *d, uint8_t watchdog_reset);

/* A result of the parser; returns the type of message to answer with now, or 0. */
uint8_t drive_receive(struct drive *d, enum result result, const struct frame *f, uint32_t now_ms);

/* Watchdogs, ramp and pulses; to be called every few milliseconds. */
void drive_tick(struct drive *d, uint32_t now_ms);

void drive_telemetry(const struct drive *d, uint16_t sequence, uint32_t now_ms, struct frame *out);
void drive_welcome(const struct drive *d, uint16_t sequence, struct frame *out);
#endif
