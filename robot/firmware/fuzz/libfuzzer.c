/* Any bytes at all, guided by coverage: parser and drive must not break, pulses stay in range. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "../config.h"
#include "../drive.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct parser parser = {0};
    struct drive drive;
    struct frame frame, again;
    uint8_t coded[MAX_FRAME];
    uint32_t now = 0;
    drive_init(&drive, 0);
    for (size_t i = 0; i < size; i++) {
        enum result result = parser_feed(&parser, data[i], &frame);
        if (result == FRAME) { /* what was taken comes out of the encoder again */
            uint8_t length = frame_encode(&frame, coded);
            struct parser other = {0};
            enum result second = NOTHING;
            for (uint8_t k = 0; k < length; k++) second = parser_feed(&other, coded[k], &again);
            if (second != FRAME || again.sequence != frame.sequence || memcmp(again.body, frame.body, frame.size)) abort();
        }
        drive_receive(&drive, result, &frame, now);
        if (result != NOTHING) drive_tick(&drive, now += 7);
        if (drive.motor_us < MIN_PULSE_US || drive.motor_us > MAX_PULSE_US) abort();
        if (drive.state == STANDING && drive.motor_us != MOTOR_NEUTRAL_US) abort();
    }
    return 0;
}
