/* A bad cable: what passes between the program and the board, frame by frame. */
#ifndef WIRE_H
#define WIRE_H

#include <stdint.h>

enum mode { CLEAN, GARBAGE, TRUNCATE, DUPLICATE, REORDER, VERSION, SILENCE };

struct wire {
    enum mode mode;
    uint8_t bytes[256];
    unsigned length;
    uint8_t held[256];
    unsigned held_length;
    uint32_t random;
    void (*out)(const uint8_t *bytes, unsigned length);
};

/* 0 when there is no such mode. */
int wire_mode(struct wire *w, const char *name);
void wire_feed(struct wire *w, const uint8_t *bytes, unsigned length);
#endif
