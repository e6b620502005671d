/* Frames of the drive link, as docs/robot/protocol.md says. No hardware in here: it runs on the host too. */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdint.h>

#define PROTOCOL_VERSION 1
#define HEADER_SIZE 4
#define CHECK_SIZE 4
#define MAX_BODY 22
#define MAX_PAYLOAD (HEADER_SIZE + MAX_BODY + CHECK_SIZE)
#define MAX_FRAME (MAX_PAYLOAD + 2) /* COBS adds one byte, the delimiter is another */

enum message { HELLO = 1, HEARTBEAT = 2, COMMAND = 3, STOP = 4, ARM = 5, WELCOME = 0x81, TELEMETRY = 0x82 };

enum result { NOTHING, FRAME, REFUSED, OTHER_VERSION };

struct frame {
    uint8_t version, type;
    uint16_t sequence;
    uint8_t size;
    uint8_t body[MAX_BODY];
};

struct parser {
    uint8_t bytes[MAX_FRAME];
    uint8_t length;
    uint8_t overlong;
};

uint16_t crc_ccitt(const uint8_t *bytes, uint8_t length);
uint16_t crc_dnp(const uint8_t *bytes, uint8_t length);

void parser_reset(struct parser *p);

/* One byte of the line. FRAME and OTHER_VERSION fill *out; REFUSED is a frame with an error in it. */
enum result parser_feed(struct parser *p, uint8_t byte, struct frame *out);

/* Bytes written to `out`, which has room for MAX_FRAME, delimiter included. */
uint8_t frame_encode(const struct frame *f, uint8_t *out);

/* Size that the body of a message has in this version, or 255. */
uint8_t body_size(uint8_t type);

static inline uint16_t get_u16(const uint8_t *b) { return (uint16_t)(b[0] | (uint16_t)b[1] << 8); }
static inline int16_t get_i16(const uint8_t *b) { return (int16_t)get_u16(b); }
static inline void put_u16(uint8_t *b, uint16_t v) {
    b[0] = (uint8_t)v;
    b[1] = (uint8_t)(v >> 8);
}
#endif
