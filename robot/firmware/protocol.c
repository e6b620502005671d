#include "protocol.h"

#include <string.h>

/* CRC-16/CCITT-FALSE: polynomial 0x1021, starts at 0xffff. */
uint16_t crc_ccitt(const uint8_t *bytes, uint8_t length) {
    uint16_t crc = 0xffff;
    for (uint8_t i = 0; i < length; i++) {
        crc ^= (uint16_t)((uint16_t)bytes[i] << 8);
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = (uint16_t)(crc & 0x8000 ? (uint16_t)(crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}

/* CRC-16/DNP: polynomial 0x3d65, reflected, inverted at the end. */
uint16_t crc_dnp(const uint8_t *bytes, uint8_t length) {
    uint16_t crc = 0;
    for (uint8_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        for (uint8_t bit = 0; bit < 8; bit++) crc = (uint16_t)(crc & 1 ? (crc >> 1) ^ 0xa6bc : crc >> 1);
    }
    return (uint16_t)~crc;
}

uint8_t body_size(uint8_t type) {
    switch (type) {
    case HELLO:
    case HEARTBEAT:
    case STOP:
    case ARM:
        return 0;
    case COMMAND:
        return 4;
    case WELCOME:
        return 10;
    case TELEMETRY:
        return 20;
    default:
        return 255;
    }
}

void parser_reset(struct parser *p) {
    p->length = 0;
    p->overlong = 0;
}

/* COBS, in place; the length of what was coded, or 0 for a coding error. */
static uint8_t uncobs(uint8_t *bytes, uint8_t length) {
    uint8_t from = 0, to = 0;
    while (from < length) {
        uint8_t code = bytes[from++];
        if (code == 0 || (uint16_t)from + code - 1 > length) return 0;
        for (uint8_t k = 1; k < code; k++) bytes[to++] = bytes[from++];
        if (code != 0xff && from < length) bytes[to++] = 0;
    }
    return to;
}

static enum result parse(uint8_t *bytes, uint8_t length, struct frame *out) {
    length = uncobs(bytes, length);
    if (length < HEADER_SIZE + CHECK_SIZE || length > MAX_PAYLOAD) return REFUSED;
    uint8_t checked = (uint8_t)(length - CHECK_SIZE);
    if (get_u16(bytes + checked) != crc_ccitt(bytes, checked)) return REFUSED;
    if (get_u16(bytes + checked + 2) != crc_dnp(bytes, checked)) return REFUSED;
    out->version = bytes[0];
    out->type = bytes[1];
    out->sequence = get_u16(bytes + 2);
    out->size = (uint8_t)(checked - HEADER_SIZE);
    memcpy(out->body, bytes + HEADER_SIZE, out->size);
    if (out->version != PROTOCOL_VERSION) return OTHER_VERSION;
    return out->size == body_size(out->type) ? FRAME : REFUSED;
}

enum result parser_feed(struct parser *p, uint8_t byte, struct frame *out) {
    if (byte != 0) {
        if (p->length < MAX_FRAME - 1)
            p->bytes[p->length++] = byte;
        else
            p->overlong = 1;
        return NOTHING;
    }
    uint8_t length = p->length, overlong = p->overlong;
    parser_reset(p);
    if (overlong) return REFUSED;
    return length ? parse(p->bytes, length, out) : NOTHING;
}

uint8_t frame_encode(const struct frame *f, uint8_t *out) {
    uint8_t raw[MAX_PAYLOAD];
    uint8_t size = f->size > MAX_BODY ? MAX_BODY : f->size;
    uint8_t checked = (uint8_t)(HEADER_SIZE + size);
    raw[0] = f->version;
    raw[1] = f->type;
    put_u16(raw + 2, f->sequence);
    memcpy(raw + HEADER_SIZE, f->body, size);
    put_u16(raw + checked, crc_ccitt(raw, checked));
    put_u16(raw + checked + 2, crc_dnp(raw, checked));
    uint8_t length = (uint8_t)(checked + CHECK_SIZE), code = 0, to = 1;
    for (uint8_t i = 0; i < length; i++) { /* never 254 bytes without a zero: one code byte suffices */
        if (raw[i]) {
            out[to++] = raw[i];
        } else {
            out[code] = (uint8_t)(to - code);
            code = to++;
        }
    }
    out[code] = (uint8_t)(to - code);
    out[to++] = 0;
    return to;
}
