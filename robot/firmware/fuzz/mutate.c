/* Streams of frames with errors in them: the parser must not break, and must take nothing for a frame that was not sent.
 *
 *     mutate INPUTS SEED
 *
 * On a simulated board, which takes no arguments, both are given when it is compiled.
 *
 * An input is one to four random good frames, one after the other, changed in one to eight places: bits turned, bytes
 * replaced, removed, inserted, doubled or swapped, pieces moved, the end cut off, zeros put in. The generator of random
 * numbers is fixed (xorshift64*), so a run can be repeated. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../drive.h"
#include "../test/end.h"

#define MOST 4
#define ROOM 512

static uint64_t random_state;

static uint32_t draw(uint32_t below) {
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return (uint32_t)((random_state * 2685821657736338717u) >> 32) % below;
}

static unsigned few(unsigned below) { return (unsigned)draw(below); } /* an int of the board has 16 bits */

static void broken(void) {
    printf("a pulse beyond its limits\n");
    end(1);
}

static unsigned long accepted, other_version, refused, forged;

static void make(struct frame *f) {
    static const uint8_t types[] = {HELLO, HEARTBEAT, COMMAND, COMMAND, COMMAND, STOP, ARM, WELCOME, TELEMETRY};
    memset(f, 0, sizeof *f);
    f->version = draw(20) ? PROTOCOL_VERSION : (uint8_t)draw(256);
    f->type = types[draw(sizeof types)];
    f->sequence = (uint16_t)draw(65536);
    f->size = body_size(f->type);
    for (unsigned i = 0; i < f->size; i++) f->body[i] = draw(4) ? (uint8_t)draw(256) : 0;
}

static unsigned mutate(uint8_t *bytes, unsigned length) {
    for (unsigned n = 1 + few(8); n && length; n--) {
        unsigned at = few(length), more;
        switch (draw(9)) {
        case 0: bytes[at] ^= (uint8_t)(1u << draw(8)); break;
        case 1: bytes[at] = (uint8_t)draw(256); break;
        case 2: bytes[at] = 0; break;
        case 3: memmove(bytes + at, bytes + at + 1, --length - at); break;
        case 4:
            if (length == ROOM) break;
            memmove(bytes + at + 1, bytes + at, length++ - at);
            bytes[at] = (uint8_t)draw(256);
            break;
        case 5: length = at; break;
        case 6: { /* a piece said twice */
            more = 1 + few(30);
            if (at + more > length || length + more > ROOM) break;
            memmove(bytes + at + more, bytes + at, length - at);
            length += more;
            break;
        }
        case 7: { /* two bytes change places */
            unsigned other = few(length);
            uint8_t kept = bytes[at];
            bytes[at] = bytes[other];
            bytes[other] = kept;
            break;
        }
        case 8: /* a burst */
            for (more = few(6); more && at < length; more--) bytes[at++] ^= (uint8_t)draw(256);
            break;
        }
    }
    return length;
}

static void input(void) {
    struct frame sent[MOST];
    uint8_t bytes[ROOM + MAX_FRAME];
    unsigned length = 0, count = 1 + few(MOST);
    for (unsigned i = 0; i < count; i++) {
        make(&sent[i]);
        length += frame_encode(&sent[i], bytes + length);
    }
    length = mutate(bytes, length);
    struct parser parser = {0};
    struct drive drive;
    drive_init(&drive, 0);
    for (unsigned i = 0; i <= length; i++) { /* and a last zero */
        struct frame got;
        memset(&got, 0, sizeof got);
        enum result result = parser_feed(&parser, i < length ? bytes[i] : 0, &got);
        if (result == NOTHING) continue;
        drive_receive(&drive, result, &got, i);
        drive_tick(&drive, i);
        if (drive.motor_us < 1000 || drive.motor_us > 2000 || drive.front_us < 1000 || drive.front_us > 2000) broken();
        refused += result == REFUSED;
        if (result == REFUSED) continue;
        accepted += result == FRAME;
        other_version += result == OTHER_VERSION;
        unsigned k = 0;
        while (k < count && (got.version != sent[k].version || got.type != sent[k].type || got.size != sent[k].size ||
                             got.sequence != sent[k].sequence || memcmp(got.body, sent[k].body, got.size)))
            k++;
        forged += k == count;
    }
}

int main(int argc, char **argv) {
#ifdef __AVR__
    (void)argc, (void)argv;
    begin_output();
    unsigned long inputs = INPUTS;
    random_state = SEED;
#else
    if (argc < 3) return fprintf(stderr, "usage: mutate INPUTS SEED\n"), 2;
    unsigned long inputs = strtoul(argv[1], NULL, 10);
    random_state = strtoull(argv[2], NULL, 10);
#endif
    random_state = random_state * 0x9e3779b97f4a7c15u + 1;
    for (unsigned long i = 0; i < inputs; i++) input();
    printf("%lu inputs: %lu frames accepted, %lu of other versions, %lu refused, %lu accepted that were not sent\n",
           inputs, accepted, other_version, refused, forged);
    end(forged != 0);
}
