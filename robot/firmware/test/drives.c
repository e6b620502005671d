/* Drives by chance: what the board does with greetings, commands, damage, batteries and times, extreme ones among them.
 *
 * All that it does is summed up in one number, which must be the same on a computer and on the board: no sum and no
 * comparison may depend on the width of an int. What must hold of any drive is looked at as well. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../config.h"
#include "../drive.h"
#include "end.h"

#define DRIVES 30
#define STEPS 300

static uint32_t random_state = 1, sum = 2166136261u;
static unsigned long ticks[4], standing;

static uint32_t draw(void) { /* xorshift32 */
    random_state ^= random_state << 13;
    random_state ^= random_state >> 17;
    random_state ^= random_state << 5;
    return random_state;
}

static uint16_t below(uint16_t most) { return (uint16_t)((draw() >> 8) % most); }

static void add(uint32_t value) { sum = (sum ^ value) * 16777619u + (sum >> 16); }

static void must(int holds, const char *what) {
    if (holds) return;
    printf("%s\n", what);
    end(1);
}

/* Ends of the ranges, neighbors of zero, limits of the car and their neighbors. */
static int16_t number(void) {
    static const int16_t odd[] = {0, 1, -1, INT16_MAX, INT16_MIN, INT16_MIN + 1, MAX_SPEED_MM_S, -MAX_SPEED_MM_S,
                                  MAX_SPEED_MM_S + 1, MAX_CURVATURE_1_KM, -MAX_CURVATURE_1_KM, 300, -300};
    return below(2) ? odd[below(sizeof odd / sizeof *odd)] : (int16_t)draw();
}

static uint16_t battery(void) {
    static const uint16_t odd[] = {0, BATTERY_ABSENT_MV, BATTERY_ABSENT_MV + 1, BATTERY_EMPTY_MV, BATTERY_LOW_MV - 1, 65535};
    return below(3) ? (uint16_t)(BATTERY_LOW_MV + below(2000)) : odd[below(sizeof odd / sizeof *odd)];
}

static uint32_t pause(void) {
    static const uint32_t odd[] = {0, 1, 50, 51, COMMAND_TIMEOUT_MS, NOISE_MS, BATTERY_LASTS_MS, 32767, 32768, 65535, 65536,
                                   70000, 0x7fffffff};
    return below(120) ? 3u + below(4) : odd[below(sizeof odd / sizeof *odd)];
}

static void look(const struct drive *d, uint32_t now) {
    struct frame f;
    drive_telemetry(d, 0, now, &f);
    for (uint8_t i = 0; i < f.size; i = (uint8_t)(i + 2)) add(get_u16(f.body + i));
    add(d->gear), add(d->remainder), add((uint16_t)d->target_speed), add((uint16_t)d->target_curvature);
    const uint16_t pulses[] = {d->motor_us, d->front_us, d->rear_us};
    for (uint8_t i = 0; i < 3; i++) must(pulses[i] >= MIN_PULSE_US && pulses[i] <= MAX_PULSE_US, "a pulse beyond its limits");
    must(d->speed <= MAX_SPEED_MM_S && d->speed >= -MAX_SPEED_MM_S, "too fast");
    if (d->state != ARMED) {
        must(d->motor_us == MOTOR_NEUTRAL_US && d->speed == 0, "a car that stands, and turns its wheels");
        standing++;
        return;
    }
    ticks[d->gear]++;
    must(d->gear != BRAKING || d->motor_us == MOTOR_BRAKE_US || d->motor_us == MOTOR_TAP_US, "a brake that is none");
    must(d->gear != PAUSING || d->motor_us == MOTOR_NEUTRAL_US, "a pause that is none");
    must(d->gear != FORWARD || d->motor_us >= MOTOR_NEUTRAL_US, "backwards in the gear for forward");
    must(d->gear != REVERSE || d->motor_us <= MOTOR_NEUTRAL_US, "forward in the gear for reverse");
    must((d->curvature > 0) == (d->front_us > FRONT_NEUTRAL_US) || (d->curvature < 5 && d->curvature > -5) ||
             FRONT_US_PER_1_M <= 0, "steered the wrong way");
}

static void drive_somewhere(void) {
    static const uint8_t types[] = {HELLO, STOP, 200, WELCOME, HEARTBEAT};
    struct drive d;
    uint32_t now = draw();
    uint16_t sequence = (uint16_t)draw();
    int16_t speed = number(), curvature = number();
    drive_init(&d, (uint8_t)below(2));
    d.ticked_ms = now;
    for (uint16_t step = 0; step < STEPS; step++) {
        struct frame f = {.version = PROTOCOL_VERSION};
        uint16_t kind = step == 0 ? 0 : step == 1 ? 1 : below(240);
        f.type = kind == 0 ? HELLO : kind < 12 ? ARM : kind == 12 ? types[below(sizeof types)] : step & 1 ? HEARTBEAT : COMMAND;
        sequence = (uint16_t)(sequence + (kind == 13 ? (uint16_t)draw() : 1u));
        f.sequence = sequence;
        f.size = body_size(f.type);
        if (below(100) == 0) speed = number(), curvature = number();
        put_u16(f.body, (uint16_t)speed);
        put_u16(f.body + 2, (uint16_t)curvature);
        enum result result = kind == 14 ? REFUSED : kind == 15 ? OTHER_VERSION : FRAME;
        add(drive_receive(&d, result, &f, now));
        if (step == 0 || kind == 16) d.battery_mv = battery();
        now += step < 2 ? 0 : pause();
        drive_tick(&d, now);
        look(&d, now);
    }
}

int main(void) {
    begin_output();
    for (uint16_t i = 0; i < DRIVES; i++) drive_somewhere();
    printf("%u drives: %lu steps forward, %lu braking, %lu pausing, %lu in reverse, %lu standing; %08lx\n", DRIVES,
           ticks[FORWARD], ticks[BRAKING], ticks[PAUSING], ticks[REVERSE], standing, (unsigned long)sum);
    for (uint8_t gear = FORWARD; gear <= REVERSE; gear++) must(ticks[gear] > 100, "too few steps in one of the gears");
    end(0);
}
