/* The board's own code, protocol.c and drive.c, as a library for this computer: no processor is simulated, and time is
 * what the caller says, so that hours pass in minutes. The main loop is that of main.c, once a millisecond. */
#include <stdlib.h>
#include <string.h>

#include "../config.h"
#include "../drive.h"

struct board {
    struct drive drive;
    struct parser parser;
    uint16_t sequence;
    uint32_t ms, ticked, told;
};

/* A board that was just switched on, `ms` milliseconds after the start of time. */
void *board_new(uint32_t ms) {
    struct board *b = calloc(1, sizeof *b);
    if (!b) return NULL;
    drive_init(&b->drive, 0);
    b->ms = b->ticked = b->told = ms;
    return b;
}

void board_free(void *board) { free(board); }

static unsigned answer(struct board *b, uint8_t kind, uint8_t *out, unsigned used, unsigned room) {
    struct frame f;
    if (used + MAX_FRAME > room) return 0;
    b->sequence++;
    if (kind == WELCOME) drive_welcome(&b->drive, b->sequence, &f);
    else drive_telemetry(&b->drive, b->sequence, b->ms, &f);
    b->told = b->ms;
    return frame_encode(&f, out + used);
}

/* Goes on until the time `ms`. All of `in` comes in its last millisecond. Answers go to `out`; returns how many bytes. */
unsigned board_run(void *board, uint32_t ms, const uint8_t *in, unsigned length, uint8_t *out, unsigned room) {
    struct board *b = board;
    struct frame f;
    unsigned used = 0;
    for (; b->ms < ms; b->ms++) {
        for (; length && b->ms + 1 == ms; length--) {
            uint8_t kind = drive_receive(&b->drive, parser_feed(&b->parser, *in++, &f), &f, b->ms);
            if (kind) used += answer(b, kind, out, used, room);
        }
        if (b->ms - b->ticked >= 4) {
            b->ticked = b->ms;
            drive_tick(&b->drive, b->ms);
        }
        if (b->ms - b->told >= TELEMETRY_MS && b->drive.greeted) used += answer(b, TELEMETRY, out, used, room);
    }
    return used;
}

/* Widths in microseconds: motor, front, rear. */
void board_pulses(const void *board, uint16_t widths[3]) {
    const struct drive *d = &((const struct board *)board)->drive;
    widths[0] = d->motor_us;
    widths[1] = d->front_us;
    widths[2] = d->rear_us;
}
