#include "wire.h"

#include <string.h>

#include "../protocol.h"

static const char *const NAMES[] = {"clean", "garbage", "truncate", "duplicate", "reorder", "version", "silence"};

int wire_mode(struct wire *w, const char *name) {
    for (unsigned i = 0; i < sizeof NAMES / sizeof *NAMES; i++)
        if (strcmp(name, NAMES[i]) == 0) {
            w->mode = (enum mode)i;
            w->length = w->held_length = 0;
            return 1;
        }
    return 0;
}

static uint8_t noise(struct wire *w) { /* xorshift */
    w->random ^= w->random << 13;
    w->random ^= w->random >> 17;
    w->random ^= w->random << 5;
    return (uint8_t)(w->random >> 11);
}

static void other_version(struct wire *w) {
    struct parser parser = {0};
    struct frame frame;
    uint8_t coded[MAX_FRAME];
    for (unsigned i = 0; i < w->length; i++)
        if (parser_feed(&parser, w->bytes[i], &frame) == FRAME) {
            frame.version++;
            w->out(coded, frame_encode(&frame, coded));
        }
}

static void whole(struct wire *w) {
    switch (w->mode) {
    case GARBAGE:
        for (unsigned i = 0; i < w->length; i++) w->bytes[i] = noise(w);
        w->out(w->bytes, w->length);
        break;
    case TRUNCATE:
        w->bytes[w->length / 2] = 0;
        w->out(w->bytes, w->length / 2 + 1);
        break;
    case DUPLICATE:
        w->out(w->bytes, w->length);
        w->out(w->bytes, w->length);
        break;
    case REORDER: /* pairs change places */
        if (w->held_length) {
            w->out(w->bytes, w->length);
            w->out(w->held, w->held_length);
            w->held_length = 0;
        } else {
            memcpy(w->held, w->bytes, w->length);
            w->held_length = w->length;
        }
        break;
    case VERSION:
        other_version(w);
        break;
    default:
        break;
    }
}

void wire_feed(struct wire *w, const uint8_t *bytes, unsigned length) {
    if (w->mode == CLEAN) {
        w->out(bytes, length);
        return;
    }
    for (unsigned i = 0; i < length; i++) {
        if (w->length < sizeof w->bytes) w->bytes[w->length++] = bytes[i];
        if (bytes[i] == 0) {
            whole(w);
            w->length = 0;
        }
    }
}
