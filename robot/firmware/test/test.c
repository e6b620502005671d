/* The board's logic: frames, arming, watchdogs, ramps, brake before reverse. It is run on this computer, which tells
 * undefined behaviour, and on a simulated board, whose int has 16 bits. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../config.h"
#include "../drive.h"
#include "end.h"

static uint32_t checks;

#define CHECK(what)                  \
    do {                             \
        checks++;                    \
        if (!(what)) fail(__LINE__); \
    } while (0)

static void fail(int line) {
    printf("test.c:%d does not hold\n", line);
    end(1);
}

static struct drive d;
static uint32_t now;
static uint16_t sequence;

static uint8_t say(enum message type, int16_t speed, int16_t curvature) {
    struct frame f = {.version = PROTOCOL_VERSION, .type = (uint8_t)type, .sequence = ++sequence, .size = body_size(type)};
    put_u16(f.body, (uint16_t)speed);
    put_u16(f.body + 2, (uint16_t)curvature);
    return drive_receive(&d, FRAME, &f, now);
}

/* Time passes; every 30 ms a heartbeat and a command, as the program sends them. */
static void pass(uint32_t ms, int beats, int commands, int16_t speed, int16_t curvature) {
    for (uint32_t end = now + ms; now < end;) {
        now += 5;
        if (now % 30 == 0) {
            if (beats) say(HEARTBEAT, 0, 0);
            if (commands) say(COMMAND, speed, curvature);
        }
        drive_tick(&d, now);
    }
}

static void begin(void) {
    now = 1000, sequence = 65500; /* soon to wrap */
    drive_init(&d, 0);
    drive_tick(&d, now);
    CHECK(say(HELLO, 0, 0) == WELCOME);
}

static int stands(void) { return d.state == STANDING && d.motor_us == 1500 && d.front_us == 1500 && d.rear_us == 1500; }

static void test_checksums(void) { /* the published check values */
    CHECK(crc_ccitt((const uint8_t *)"123456789", 9) == 0x29b1);
    CHECK(crc_dnp((const uint8_t *)"123456789", 9) == 0xea82);
}

static void test_frames(void) {
    struct parser p = {0};
    for (unsigned size = 0; size <= MAX_BODY; size++) {
        struct frame f = {.version = PROTOCOL_VERSION, .type = TELEMETRY, .sequence = 0x1200, .size = (uint8_t)size}, g;
        for (unsigned i = 0; i < size; i++) f.body[i] = (uint8_t)(i % 3);
        uint8_t bytes[MAX_FRAME], length = frame_encode(&f, bytes);
        CHECK(length == size + 10 && bytes[length - 1] == 0 && !memchr(bytes, 0, length - 1u));
        enum result r = NOTHING;
        for (unsigned i = 0; i < length; i++) {
            CHECK(r == NOTHING);
            r = parser_feed(&p, bytes[i], &g);
        }
        CHECK(r == (size == 20 ? FRAME : REFUSED)); /* only one size is right */
        if (r == FRAME) CHECK(g.sequence == 0x1200 && memcmp(f.body, g.body, size) == 0);
        for (unsigned i = 0; i < length - 1u; i++) /* every single wrong bit is noticed */
            for (unsigned bit = 0; bit < 8; bit++) {
                bytes[i] = (uint8_t)(bytes[i] ^ 1u << bit);
                for (unsigned k = 0; k < length; k++) CHECK(parser_feed(&p, bytes[k], &g) != FRAME);
                bytes[i] = (uint8_t)(bytes[i] ^ 1u << bit);
            }
    }
    struct frame f = {.version = 2, .type = 77, .sequence = 1, .size = 3}, g;
    uint8_t bytes[MAX_FRAME], length = frame_encode(&f, bytes);
    enum result r = NOTHING;
    for (unsigned i = 0; i < length; i++) r = parser_feed(&p, bytes[i], &g);
    CHECK(r == OTHER_VERSION && g.version == 2);
    for (unsigned i = 0; i < 1000; i++) CHECK(parser_feed(&p, 7, &g) == NOTHING);
    CHECK(parser_feed(&p, 0, &g) == REFUSED);
    CHECK(parser_feed(&p, 0, &g) == NOTHING);
}

static void test_arming(void) {
    begin();
    pass(300, 1, 1, 500, 1000);
    CHECK(stands()); /* a command alone moves nothing */
    CHECK(say(ARM, 0, 0) == TELEMETRY && d.state == ARMED && d.faults == 0);
    pass(600, 1, 1, 500, 1000);
    CHECK(d.speed == 500 && d.motor_us == 1630 && d.front_us == 1700 && d.rear_us == 1300);
    pass(90, 1, 1, 30000, -30000); /* limits of its own */
    CHECK(d.target_speed == 1000 && d.target_curvature == -2200 && d.front_us == 1060 && d.rear_us == 1940);
    CHECK(say(STOP, 0, 0) == TELEMETRY && stands() && d.faults == FAULT_STOPPED);
    pass(300, 1, 1, 500, 0);
    CHECK(stands());
    drive_init(&d, 1); /* after a reset nothing is obeyed before a hello */
    CHECK(d.faults == FAULT_WATCHDOG && say(ARM, 0, 0) == 0 && stands());
}

static void test_ramp(void) {
    begin();
    say(ARM, 0, 0);
    say(COMMAND, 1000, 0);
    int16_t before = 0;
    for (unsigned i = 0; i < 20; i++) {
        now += 5;
        drive_tick(&d, now);
        CHECK(d.speed - before == 10); /* 2 m/s2 */
        before = d.speed;
    }
    for (unsigned i = 0; i < 7; i++) { /* a step of 7 ms is no whole number of mm/s: nothing is lost */
        now += 1;
        drive_tick(&d, now);
    }
    CHECK(d.speed == 214);
}

static void test_watchdogs(void) {
    begin();
    say(ARM, 0, 0);
    pass(600, 1, 1, 500, 1000);
    uint32_t last = d.commanded_ms;
    while (!stands()) pass(5, 1, 0, 0, 0);
    CHECK(now - last == COMMAND_TIMEOUT_MS && d.faults == FAULT_COMMAND);
    say(ARM, 0, 0);
    pass(600, 1, 1, 500, 1000);
    CHECK(d.speed == 500 && d.faults == 0);
    last = d.beaten_ms;
    while (!stands()) pass(5, 0, 1, 500, 1000);
    CHECK(now - last == HEARTBEAT_TIMEOUT_MS && d.faults == FAULT_HEARTBEAT);
}

static void test_bad_lines(void) {
    struct frame f = {.version = 9, .type = COMMAND};
    begin();
    say(ARM, 0, 0);
    pass(600, 1, 1, 500, 0);
    CHECK(drive_receive(&d, OTHER_VERSION, &f, now) == WELCOME && stands() && d.faults == FAULT_VERSION);
    CHECK(d.rejected == 1); /* counted as what is damaged is */

    begin();
    say(ARM, 0, 0);
    pass(600, 1, 1, 500, 0);
    for (unsigned i = 1; i < NOISE_LIMIT; i++) drive_receive(&d, REFUSED, &f, now);
    pass(300, 1, 1, 500, 0);
    CHECK(d.state == ARMED); /* a little noise is forgiven */
    for (unsigned i = 0; i < NOISE_LIMIT; i++) drive_receive(&d, REFUSED, &f, now);
    CHECK(stands() && d.faults == FAULT_NOISE);
    say(ARM, 0, 0); /* what was before is forgotten: it takes as many again */
    for (unsigned i = 1; i < NOISE_LIMIT; i++) drive_receive(&d, REFUSED, &f, now);
    CHECK(d.state == ARMED);
    drive_receive(&d, REFUSED, &f, now);
    CHECK(stands() && d.faults == FAULT_NOISE);

    for (uint32_t apart = 325; apart <= 335; apart += 5) { /* the first and the last are 975, 990 and 1005 ms apart */
        begin();
        say(ARM, 0, 0);
        pass(600, 1, 1, 500, 0);
        for (unsigned i = 1; i < NOISE_LIMIT; i++) {
            drive_receive(&d, REFUSED, &f, now);
            CHECK(d.state == ARMED);
            pass(apart, 1, 1, 500, 0);
        }
        drive_receive(&d, REFUSED, &f, now);
        CHECK(apart * (NOISE_LIMIT - 1) < NOISE_MS ? stands() && d.faults == FAULT_NOISE : d.state == ARMED);
    }
    begin();
    say(ARM, 0, 0);
    for (unsigned i = 0; i < 20; i++) { /* a few that come slowly never add up */
        pass(505, 1, 1, 500, 0);
        drive_receive(&d, REFUSED, &f, now);
        drive_receive(&d, REFUSED, &f, now);
        pass(505, 1, 1, 500, 0);
    }
    CHECK(d.state == ARMED && d.faults == 0);
    pass(NOISE_MS, 1, 1, 500, 0); /* a clock that has gone round brings nothing back */
    drive_receive(&d, REFUSED, &f, now);
    drive_receive(&d, REFUSED, &f, now);
    drive_receive(&d, REFUSED, &f, now);
    pass(NOISE_MS, 1, 1, 500, 0);
    CHECK(d.noise == 0);
    uint32_t later = d.refused_ms[0];
    drive_receive(&d, REFUSED, &f, later); /* the same time, once around */
    CHECK(d.state == ARMED);

    begin();
    say(ARM, 0, 0);
    pass(600, 1, 1, 500, 0);
    sequence -= 2; /* a frame sent before */
    int16_t target = d.target_speed;
    CHECK(say(COMMAND, 900, 0) == 0); /* nothing is answered to it */
    CHECK(d.target_speed == target && d.rejected == 1);
    CHECK(say(HEARTBEAT, 0, 0) == 0 && d.rejected == 2);
    sequence += 2;
    CHECK(say(COMMAND, 900, 0) == 0);
    CHECK(d.target_speed == 900);
    struct frame answer = {.version = PROTOCOL_VERSION, .type = TELEMETRY};
    CHECK(drive_receive(&d, FRAME, &answer, now) == 0 && d.rejected == 3); /* what a board says, not what it hears */
    CHECK(drive_receive(&d, REFUSED, &answer, now) == 0 && d.rejected == 4 && drive_receive(&d, NOTHING, &answer, now) == 0);
    CHECK(d.state == STANDING && d.faults == FAULT_NOISE);
    sequence++;
    say(ARM, 0, 0);
    d.rejected = 1;
    say(COMMAND, 900, 0);
    uint16_t now_at = d.sequence;
    sequence = (uint16_t)(now_at + 0x7fff); /* half way around and one more: the past */
    say(COMMAND, 800, 0);
    CHECK(d.target_speed == 900 && d.rejected == 2);
    sequence = (uint16_t)(now_at + 0x7ffe);
    say(COMMAND, 800, 0);
    CHECK(d.target_speed == 800);
}

static void test_brake_then_reverse(void) {
    begin();
    say(ARM, 0, 0);
    pass(600, 1, 1, 500, 0);
    uint32_t braked = 0, paused = 0;
    int coasted = 0;
    while (d.speed >= 0) {
        pass(5, 1, 1, -300, 0);
        if (d.gear == FORWARD && d.motor_us > 1500) coasted = 1;
        if (d.gear == BRAKING) {
            braked += 5;
            CHECK(d.motor_us == MOTOR_BRAKE_US);
        }
        if (d.gear == PAUSING) {
            paused += 5;
            CHECK(d.motor_us == 1500);
        }
        CHECK(now < 4000);
    }
    CHECK(coasted && braked == BRAKE_MS && paused == PAUSE_MS);
    pass(600, 1, 1, -300, 0);
    CHECK(d.speed == -300 && d.motor_us == 1410);
    pass(50, 1, 1, 0, 0);
    CHECK(d.speed > -300 && d.speed < -150); /* backwards too it slows down no faster than it may */
    pass(550, 1, 1, 0, 0);
    CHECK(d.speed == 0);
    pass(300, 1, 1, -300, 0);
    CHECK(d.speed == -300); /* still in reverse: no brake needed */
    pass(800, 1, 1, 1, 0);
    CHECK(d.speed == 1 && d.gear == FORWARD); /* however slowly */
    pass(800, 1, 1, 200, 0);
    CHECK(d.speed == 200 && d.gear == FORWARD);
}

/* Some motor controllers forget a brake when the pulse goes back to neutral, so half a brake counts for nothing. Others
 * do not: they take the next one for reverse, so that it must be weak. */
static void test_a_brake_begun_begins_again(void) {
    for (enum gear phase = BRAKING; phase <= PAUSING; phase++) {
        begin();
        say(ARM, 0, 0);
        pass(600, 1, 1, 500, 0);
        while (d.gear != phase && now < 4000) pass(5, 1, 1, -300, 0);
        pass(20, 1, 1, -300, 0);
        say(STOP, 0, 0);
        pass(500, 1, 1, -300, 0);
        CHECK(stands());
        say(ARM, 0, 0);
        uint32_t braked = 0;
        while (d.speed >= 0 && now < 4000) {
            pass(5, 1, 1, -300, 0);
            if (d.gear == BRAKING) {
                braked += 5;
                CHECK(d.motor_us == MOTOR_TAP_US);
            }
        }
        CHECK(braked == BRAKE_MS);
        say(STOP, 0, 0);
        CHECK(d.gear == REVERSE); /* which needs no brake */
    }
}

static uint16_t next_brake(void) {
    while (d.gear != BRAKING && now < 9000) pass(5, 1, 1, -300, 0);
    CHECK(d.gear == BRAKING && d.motor_us < MOTOR_NEUTRAL_US - MOTOR_DEAD_BAND_US);
    return d.motor_us;
}

static void test_only_the_first_brake_after_driving_forward_is_strong(void) {
    begin();
    say(ARM, 0, 0);
    CHECK(next_brake() == MOTOR_TAP_US); /* nobody knows what was before */
    pass(FORWARD_MS - 5, 1, 1, 500, 0);  /* two pulses may be one */
    CHECK(d.speed > 0 && next_brake() == MOTOR_TAP_US);
    pass(FORWARD_MS + 60, 1, 1, 500, 0);
    CHECK(next_brake() == MOTOR_BRAKE_US);
    pass(BRAKE_MS - 50, 1, 1, -300, 0);
    CHECK(d.gear == BRAKING && d.motor_us == MOTOR_BRAKE_US); /* to its end */
    pass(800, 1, 1, -300, 0);
    CHECK(d.speed == -300);
    pass(160, 1, 1, 1, 0); /* out of reverse, and hardly forward */
    while (d.gear == REVERSE && now < 9000) pass(5, 1, 1, 1, 0);
    CHECK(next_brake() == MOTOR_TAP_US);
}

/* Driving goes on while the battery is so. */
static void drive_on(uint16_t mv, uint32_t ms, int16_t speed) {
    d.battery_mv = mv;
    pass(ms, 1, 1, speed, 0);
}

static void test_battery(void) {
    begin();
    say(ARM, 0, 0);
    drive_on(7400, 1000, 800);
    CHECK(d.speed == 800 && d.faults == 0);
    drive_on(BATTERY_LOW_MV - 100, BATTERY_LASTS_MS - 100, 800);
    CHECK(d.speed == 800 && d.faults == 0); /* it may be the motor that pulls the voltage down */
    drive_on(BATTERY_LOW_MV - 100, 1000, 800);
    CHECK(d.speed == BATTERY_LOW_SPEED_MM_S && d.faults == FAULT_BATTERY && d.state == ARMED);
    drive_on(BATTERY_LOW_MV - 100, 3000, -800); /* through the brake */
    CHECK(d.speed == -BATTERY_LOW_SPEED_MM_S);
    drive_on(7400, 1000, 800);
    CHECK(d.faults == 0);
    drive_on(7400, 1000, 800);
    CHECK(d.speed == 800);
    drive_on(BATTERY_EMPTY_MV, BATTERY_LASTS_MS + 1000, 800);
    CHECK(d.faults == FAULT_BATTERY); /* low, but not yet empty */
    drive_on(7400, 1000, 800);
    drive_on(BATTERY_EMPTY_MV - 100, BATTERY_LASTS_MS - 100, 800);
    CHECK(d.state == ARMED);
    drive_on(BATTERY_EMPTY_MV - 100, 200, 800);
    CHECK(stands() && d.faults == (FAULT_BATTERY | FAULT_EMPTY));
    CHECK(say(ARM, 0, 0) == TELEMETRY && d.state == STANDING); /* refused, and said */
    drive_on(BATTERY_EMPTY_MV + 100, 5000, 800);               /* the load is gone, so it recovers a little */
    say(ARM, 0, 0);
    CHECK(stands());
    drive_on(BATTERY_LOW_MV + 100, 100, 800);
    CHECK(stands() && d.faults == 0);
    say(ARM, 0, 0);
    drive_on(7400, 1000, 800);
    CHECK(d.speed == 800);
    drive_on(100, 5000, 800); /* no divider */
    CHECK(d.speed == 800 && d.faults == 0);
}

/* What the computer is told, to the byte. */
static void test_answers(void) {
    struct frame f;
    CHECK(body_size(HELLO) == 0 && body_size(HEARTBEAT) == 0 && body_size(STOP) == 0 && body_size(ARM) == 0);
    CHECK(body_size(COMMAND) == 4 && body_size(WELCOME) == 10 && body_size(TELEMETRY) == 20 && body_size(200) == 255);
    begin();
    memset(&f, 0xff, sizeof f);
    drive_welcome(&d, 0x1234, &f);
    CHECK(f.version == PROTOCOL_VERSION && f.type == WELCOME && f.sequence == 0x1234 && f.size == 10);
    CHECK(f.body[0] == (uint8_t)sequence && f.body[1] == sequence >> 8);
    CHECK(memcmp(f.body + 2, ROBOT_NAME, 8) == 0);

    d = (struct drive){.echo = 0x0102, .state = ARMED, .faults = FAULT_BATTERY, .speed = -300, .curvature = 0x0203};
    d.battery_mv = 0x0304, d.motor_us = 0x0405, d.front_us = 0x0506, d.rear_us = 0x0607, d.rejected = 0x0708;
    const uint8_t wanted[20] = {2, 1, 1, 16, 0xd4, 0xfe, 3, 2, 4, 3, 5, 4, 6, 5, 7, 6, 8, 7, 0x2c, 1};
    memset(&f, 0xff, sizeof f);
    drive_telemetry(&d, 0x1235, 300999, &f); /* 300 s */
    CHECK(f.version == PROTOCOL_VERSION && f.type == TELEMETRY && f.sequence == 0x1235 && f.size == 20);
    CHECK(memcmp(f.body, wanted, 20) == 0);
}

int main(void) {
    begin_output();
    test_checksums();
    test_answers();
    test_frames();
    test_arming();
    test_ramp();
    test_watchdogs();
    test_bad_lines();
    test_brake_then_reverse();
    test_a_brake_begun_begins_again();
    test_only_the_first_brake_after_driving_forward_is_strong();
    test_battery();
    printf("%lu checks passed, int has %d bits\n", (unsigned long)checks, (int)sizeof(int) * 8);
    end(0);
}
