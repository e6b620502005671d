#include "drive.h"

#include <string.h>

#include "config.h"

_Static_assert(sizeof ROBOT_NAME == 9, "ROBOT_NAME must have eight characters");
_Static_assert(MIN_PULSE_US >= 500 && MAX_PULSE_US <= 2500 && MIN_PULSE_US < MAX_PULSE_US, "pulses that servos understand");
_Static_assert(MIN_PULSE_US <= MOTOR_BRAKE_US && MOTOR_BRAKE_US <= MOTOR_NEUTRAL_US, "the brake is a pulse below neutral");
_Static_assert(MOTOR_BRAKE_US <= MOTOR_TAP_US && MOTOR_TAP_US < MOTOR_NEUTRAL_US - MOTOR_DEAD_BAND_US, "a tap is a weak brake");
_Static_assert(MIN_PULSE_US < MOTOR_NEUTRAL_US && MOTOR_NEUTRAL_US < MAX_PULSE_US, "the motor's neutral is a pulse");
_Static_assert(MIN_PULSE_US < FRONT_NEUTRAL_US && FRONT_NEUTRAL_US < MAX_PULSE_US, "the front neutral is a pulse");
_Static_assert(MIN_PULSE_US < REAR_NEUTRAL_US && REAR_NEUTRAL_US < MAX_PULSE_US, "the rear neutral is a pulse");
_Static_assert(MAX_SPEED_MM_S > 0 && MAX_SPEED_MM_S <= 5000 && MAX_CURVATURE_1_KM > 0 && MAX_CURVATURE_1_KM <= 10000,
               "limits of a car");
_Static_assert(BATTERY_ABSENT_MV < BATTERY_LOW_MV && BATTERY_EMPTY_MV < BATTERY_LOW_MV, "empty is lower than low");
_Static_assert(BATTERY_EMPTY_MV == 0 || BATTERY_EMPTY_MV > BATTERY_ABSENT_MV, "an empty battery is not an absent one");
_Static_assert(BATTERY_ABSENT_MV >= 0 && BATTERY_LOW_MV < BATTERY_FULL_SCALE_MV && BATTERY_FULL_SCALE_MV <= 65535,
               "voltages that are measured, in 16 bits");
_Static_assert(BATTERY_LOW_SPEED_MM_S > 0 && BATTERY_LOW_SPEED_MM_S <= MAX_SPEED_MM_S, "a low battery drives slower");

_Static_assert(ACCELERATION_MM_S2 > 0 && ACCELERATION_MM_S2 <= 100000, "a step of 50 ms fits into 16 bits");
_Static_assert(MOTOR_US_PER_M_S > 0 && MOTOR_US_PER_M_S <= 10000 && MOTOR_DEAD_BAND_US >= 0, "longer pulses are forward");
_Static_assert(FRONT_US_PER_1_M >= -10000 && FRONT_US_PER_1_M <= 10000, "what the front servo may turn by");
_Static_assert(REAR_US_PER_1_M >= -10000 && REAR_US_PER_1_M <= 10000, "what the rear servo may turn by");
_Static_assert(COMMAND_TIMEOUT_MS > 0 && COMMAND_TIMEOUT_MS <= 1000, "a car that is told nothing more stands in a second");
_Static_assert(HEARTBEAT_TIMEOUT_MS > 0 && HEARTBEAT_TIMEOUT_MS <= 1000, "a car that hears nothing more stands in a second");
_Static_assert(NOISE_LIMIT >= 2 && NOISE_LIMIT <= 100 && NOISE_MS > 0, "refusals are counted in 8 bits, all but one kept");
_Static_assert(BRAKE_MS > 0 && PAUSE_MS > 0 && FORWARD_MS > 0 && BATTERY_LASTS_MS > 0, "times go forward");

static int16_t clip(int16_t value, int16_t most) { return value > most ? most : value < -most ? (int16_t)-most : value; }

static uint16_t pulse(int16_t neutral, int32_t offset) {
    int32_t us = neutral + offset;
    return (uint16_t)(us < MIN_PULSE_US ? MIN_PULSE_US : us > MAX_PULSE_US ? MAX_PULSE_US : us);
}

static void stand(struct drive *d, uint8_t fault) {
    d->state = STANDING;
    d->faults |= fault;
    d->target_speed = d->target_curvature = d->speed = d->curvature = 0;
    d->remainder = 0;
    if (d->gear != REVERSE) d->gear = FORWARD; /* a brake begun must begin again */
    d->motor_us = MOTOR_NEUTRAL_US;
    d->front_us = FRONT_NEUTRAL_US;
    d->rear_us = REAR_NEUTRAL_US;
}

void drive_init(struct drive *d, uint8_t watchdog_reset) {
    memset(d, 0, sizeof *d);
    d->may_reverse = 1; /* the motor controller may have been on for long */
    stand(d, watchdog_reset ? FAULT_WATCHDOG : 0);
}

/* So many within so long, whenever the first of them came: nothing is forgiven in between. */
static void refuse(struct drive *d, uint32_t now_ms) {
    if (d->rejected < 0xffff) d->rejected++;
    uint32_t oldest_ms = d->refused_ms[d->refusals];
    d->refused_ms[d->refusals] = now_ms;
    d->refusals = (uint8_t)((d->refusals + 1) % (NOISE_LIMIT - 1));
    if (d->noise < NOISE_LIMIT) d->noise++;
    if (d->noise >= NOISE_LIMIT && now_ms - oldest_ms < NOISE_MS && d->state == ARMED) stand(d, FAULT_NOISE);
}

uint8_t drive_receive(struct drive *d, enum result result, const struct frame *f, uint32_t now_ms) {
    if (result == NOTHING) return 0;
    if (result == OTHER_VERSION) {
        stand(d, FAULT_VERSION);
        refuse(d, now_ms);
        return WELCOME; /* whose header says which version this is */
    }
    if (result == REFUSED || f->type >= WELCOME) {
        refuse(d, now_ms);
        return 0;
    }
    if (f->type == STOP) { /* always heard */
        stand(d, FAULT_STOPPED);
        return TELEMETRY;
    }
    if (f->type == HELLO) {
        stand(d, 0);
        d->greeted = 1;
        d->sequence = f->sequence;
        d->noise = 0;
        return WELCOME;
    }
    if (!d->greeted) return 0;
    if ((uint16_t)(f->sequence - d->sequence - 1) >= 0x7fff) { /* seen already, or older */
        refuse(d, now_ms);
        return 0;
    }
    d->sequence = f->sequence;
    switch (f->type) {
    case HEARTBEAT:
        d->beaten_ms = now_ms;
        d->echo = f->sequence;
        return TELEMETRY;
    case COMMAND:
        d->commanded_ms = now_ms;
        if (d->state == ARMED) {
            d->target_speed = clip(get_i16(f->body), MAX_SPEED_MM_S);
            d->target_curvature = clip(get_i16(f->body + 2), MAX_CURVATURE_1_KM);
        }
        return 0;
    case ARM:
        d->faults &= FAULT_BATTERY | FAULT_EMPTY;
        d->noise = 0;
        if (d->faults & FAULT_EMPTY) return TELEMETRY;
        d->commanded_ms = d->beaten_ms = now_ms;
        d->state = ARMED;
        return TELEMETRY;
    default:
        return 0;
    }
}

/* Towards the target, through zero, by no more than the acceleration allows. */
static void ramp(struct drive *d, int16_t target, uint16_t elapsed_ms) {
    uint32_t most = (uint32_t)ACCELERATION_MM_S2 * elapsed_ms + d->remainder;
    int16_t step = (int16_t)(most / 1000);
    d->remainder = (uint16_t)(most % 1000);
    if (d->speed < target) d->speed = target - d->speed > step ? (int16_t)(d->speed + step) : target;
    else if (d->speed > target) d->speed = d->speed - target > step ? (int16_t)(d->speed - step) : target;
    else d->remainder = 0;
}

static int16_t fastest(const struct drive *d) {
    return d->faults & FAULT_BATTERY ? BATTERY_LOW_SPEED_MM_S : MAX_SPEED_MM_S;
}

/* A motor controller of model cars takes the first pulse below neutral for the brake, and the next one for reverse, until
 * it drives forward again. Some forget a brake that was broken off, others do not. So nothing but the first brake after
 * driving forward is strong: a weak one counts as well, and hardly moves the car where it is taken for reverse. */
static void shift(struct drive *d, uint16_t elapsed_ms, uint32_t now_ms) {
    int16_t target = clip(d->target_speed, fastest(d));
    switch (d->gear) {
    case FORWARD:
        ramp(d, target < 0 ? 0 : target, elapsed_ms);
        if (target < 0 && d->speed == 0) {
            d->gear = BRAKING;
            d->gear_ms = now_ms;
            d->brake_us = d->may_reverse ? MOTOR_TAP_US : MOTOR_BRAKE_US;
            d->may_reverse = 1;
        }
        break;
    case BRAKING:
        if (target > 0) d->gear = FORWARD;
        else if (now_ms - d->gear_ms >= BRAKE_MS) {
            d->gear = PAUSING;
            d->gear_ms = now_ms;
        }
        break;
    case PAUSING:
        if (target > 0) d->gear = FORWARD;
        else if (now_ms - d->gear_ms >= PAUSE_MS) d->gear = REVERSE;
        break;
    case REVERSE:
        ramp(d, target > 0 ? 0 : target, elapsed_ms);
        if (target > 0 && d->speed == 0) d->gear = FORWARD;
        break;
    }
}

/* Low is a limit of the speed, empty is a stop. */
static void look_at_battery(struct drive *d, uint32_t now_ms) {
    const uint16_t empty_mv = BATTERY_EMPTY_MV; /* 0 is compared as a number, not as a constant that warns */
    uint8_t absent = d->battery_mv <= BATTERY_ABSENT_MV;
    if (absent || d->battery_mv >= BATTERY_LOW_MV) {
        d->not_low_ms = d->not_empty_ms = now_ms;
        d->faults &= (uint8_t)~(FAULT_BATTERY | FAULT_EMPTY);
        return;
    }
    if (d->battery_mv >= empty_mv) d->not_empty_ms = now_ms;
    if (now_ms - d->not_low_ms >= BATTERY_LASTS_MS) d->faults |= FAULT_BATTERY;
    if (now_ms - d->not_empty_ms >= BATTERY_LASTS_MS && !(d->faults & FAULT_EMPTY)) stand(d, FAULT_EMPTY);
}

void drive_tick(struct drive *d, uint32_t now_ms) {
    uint32_t elapsed = now_ms - d->ticked_ms;
    d->ticked_ms = now_ms;
    /* Of the last refusals only those are remembered that may still count. */
    if (now_ms - d->refused_ms[(d->refusals + NOISE_LIMIT - 2) % (NOISE_LIMIT - 1)] >= NOISE_MS) d->noise = 0;
    look_at_battery(d, now_ms);
    if (d->speed <= 0) d->stood_ms = now_ms;
    else if (now_ms - d->stood_ms >= FORWARD_MS) d->may_reverse = 0;
    if (d->state != ARMED) return;
    if (now_ms - d->commanded_ms >= COMMAND_TIMEOUT_MS) stand(d, FAULT_COMMAND);
    if (now_ms - d->beaten_ms >= HEARTBEAT_TIMEOUT_MS) stand(d, FAULT_HEARTBEAT);
    if (d->state != ARMED) return;

    shift(d, (uint16_t)(elapsed > 50 ? 50 : elapsed), now_ms);
    d->curvature = d->target_curvature;
    int32_t offset = (int32_t)d->speed * MOTOR_US_PER_M_S / 1000;
    if (d->speed > 0) offset += MOTOR_DEAD_BAND_US;
    if (d->speed < 0) offset -= MOTOR_DEAD_BAND_US;
    /* An int of the board has 16 bits: without this the difference is 65501, which is full speed forward. */
    if (d->gear == BRAKING) offset = (int32_t)d->brake_us - MOTOR_NEUTRAL_US;
    d->motor_us = pulse(MOTOR_NEUTRAL_US, offset);
    d->front_us = pulse(FRONT_NEUTRAL_US, (int32_t)d->curvature * FRONT_US_PER_1_M / 1000);
    d->rear_us = pulse(REAR_NEUTRAL_US, (int32_t)d->curvature * REAR_US_PER_1_M / 1000);
}

void drive_welcome(const struct drive *d, uint16_t sequence, struct frame *out) {
    out->version = PROTOCOL_VERSION;
    out->type = WELCOME;
    out->sequence = sequence;
    out->size = body_size(WELCOME);
    put_u16(out->body, d->sequence);
    memcpy(out->body + 2, ROBOT_NAME, 8);
}

void drive_telemetry(const struct drive *d, uint16_t sequence, uint32_t now_ms, struct frame *out) {
    out->version = PROTOCOL_VERSION;
    out->type = TELEMETRY;
    out->sequence = sequence;
    out->size = body_size(TELEMETRY);
    put_u16(out->body, d->echo);
    out->body[2] = d->state;
    out->body[3] = d->faults;
    put_u16(out->body + 4, (uint16_t)d->speed);
    put_u16(out->body + 6, (uint16_t)d->curvature);
    put_u16(out->body + 8, d->battery_mv);
    put_u16(out->body + 10, d->motor_us);
    put_u16(out->body + 12, d->front_us);
    put_u16(out->body + 14, d->rear_us);
    put_u16(out->body + 16, d->rejected);
    put_u16(out->body + 18, (uint16_t)(now_ms / 1000));
}
