/* ATmega328P at 16 MHz (Arduino Uno, Nano). Pins:
 *   D9  PB1 OC1A  front steering, timer 1        A0  battery through a divider
 *   D10 PB2 OC1B  motor controller, timer 1      D0, D1  serial, through the board's USB
 *   D3  PD3       rear steering, timer 2         D4, PD4 a lamp: on while armed
 * Timer 1 makes two pulses every 20 ms in hardware. It starts timer 2, which ends the third pulse. */
#include <avr/io.h>

#include <avr/fuse.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "config.h"
#include "drive.h"

#define RING 128 /* a power of two */
#define RECEIVE_AT_ONCE 32

struct ring {
    volatile uint8_t bytes[RING], head, tail;
};

_Static_assert((RING & (RING - 1)) == 0 && RING <= 128, "the ring's places are counted in 8 bits");
_Static_assert(F_CPU % (8 * BAUD) == 0, "the serial port cannot make this rate");
_Static_assert(MAX_PULSE_US / 8 < 256, "two halves of a rear pulse, in ticks of 4 us, must fit into 8 bits each");
_Static_assert(MAX_PULSE_US < 20000, "pulses come every 20 ms");

static struct ring received, sending;
static volatile uint32_t milliseconds;
static volatile uint8_t rear_first, rear_second; /* both halves of the rear pulse, ticks of 4 us; second > 0 */
static uint8_t reset_cause __attribute__((section(".noinit")));

/* The supply must stay above 4.3 V at 16 MHz, else the board is held in reset: `make fuses` writes this. */
FUSES = {.low = 0xff, .high = 0xde, .extended = 0xfc};

/* Before anything else: the watchdog stays on, with its shortest time, after it has reset the board.
 * A boot loader runs first and clears MCUSR. Optiboot leaves what was in it in register 2. */
void early(void) __attribute__((naked, used, section(".init3")));
void early(void) {
    uint8_t from_boot_loader;
    __asm__ volatile("mov %0, r2" : "=r"(from_boot_loader));
    reset_cause = MCUSR ? MCUSR : from_boot_loader;
    MCUSR = 0;
    wdt_disable();
}

ISR(USART_RX_vect) {
    uint8_t byte = UDR0, next = (uint8_t)((received.head + 1) & (RING - 1));
    if (next == received.tail) return; /* full: the frame will be refused by its checks */
    received.bytes[received.head] = byte;
    received.head = next;
}

ISR(USART_UDRE_vect) {
    if (sending.tail == sending.head) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
        return;
    }
    UDR0 = sending.bytes[sending.tail];
    sending.tail = (uint8_t)((sending.tail + 1) & (RING - 1));
}

ISR(TIMER0_COMPA_vect) { milliseconds++; }

/* 2000 us are 500 ticks: an 8-bit timer counts them in two halves. Both are taken anew for every pulse, here and not in
 * the main loop: a main loop that is late or hangs does not shorten the pulse. */
static uint8_t rear_left;

ISR(TIMER1_OVF_vect) { /* the two hardware pulses begin here, and so does the third */
    TCNT2 = 0;
    OCR2A = rear_first;
    rear_left = rear_second;
    TIFR2 = _BV(OCF2A);
    PORTD |= _BV(PD3);
    TCCR2B = _BV(CS22); /* 250 kHz */
}

ISR(TIMER2_COMPA_vect) {
    if (rear_left) {
        OCR2A = rear_left;
        rear_left = 0;
        return;
    }
    PORTD &= (uint8_t)~_BV(PD3);
    TCCR2B = 0;
}

static void pulses(const struct drive *d) {
    uint16_t ticks = d->rear_us / 4;
    uint8_t first = (uint8_t)(ticks / 2), sreg = SREG;
    cli();
    OCR1A = (uint16_t)(d->front_us * 2 - 1);
    OCR1B = (uint16_t)(d->motor_us * 2 - 1);
    rear_first = (uint8_t)(first - 1);
    rear_second = (uint8_t)(ticks - first - 1);
    SREG = sreg;
    if (d->state == ARMED) PORTD |= _BV(PD4);
    else PORTD &= (uint8_t)~_BV(PD4);
}

static void send(const struct frame *f) {
    uint8_t bytes[MAX_FRAME], length = frame_encode(f, bytes);
    uint8_t room = (uint8_t)((sending.tail - sending.head - 1) & (RING - 1));
    if (room < length) return; /* a whole frame or none */
    for (uint8_t i = 0; i < length; i++) {
        sending.bytes[sending.head] = bytes[i];
        sending.head = (uint8_t)((sending.head + 1) & (RING - 1));
    }
    UCSR0B |= _BV(UDRIE0);
}

static uint32_t now(void) {
    uint8_t sreg = SREG;
    cli();
    uint32_t ms = milliseconds;
    SREG = sreg;
    return ms;
}

static void start_hardware(void) {
    DDRB = _BV(PB1) | _BV(PB2);
    DDRD = _BV(PD3) | _BV(PD4);
    TCCR0A = _BV(WGM01); /* 1 kHz */
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = (uint8_t)(F_CPU / 64 / 1000 - 1);
    TIMSK0 = _BV(OCIE0A);
    ICR1 = (uint16_t)(F_CPU / 8 / 50 - 1); /* 50 Hz, half a microsecond a tick */
    TCCR1A = _BV(COM1A1) | _BV(COM1B1) | _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS11);
    TIMSK1 = _BV(TOIE1);
    TCCR2A = _BV(WGM21); /* stopped; started by timer 1 */
    TIMSK2 = _BV(OCIE2A);
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = (uint16_t)(F_CPU / 8 / BAUD - 1); /* last: simavr works out the speed when this is written */
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0) | _BV(ADSC);
    SMCR = SLEEP_MODE_IDLE;
}

static void measure_battery(struct drive *d) {
    if (ADCSRA & _BV(ADSC)) return;
    d->battery_mv = (uint16_t)((uint32_t)ADC * BATTERY_FULL_SCALE_MV / 1023);
    ADCSRA |= _BV(ADSC);
}

int main(void) {
    static struct drive drive;
    static struct parser parser;
    struct frame frame;
    uint16_t sequence = 0;
    uint32_t ticked = 0, told = 0;
    drive_init(&drive, reset_cause & _BV(WDRF));
    pulses(&drive); /* before the timers run: the first pulse is a good one */
    start_hardware();
    wdt_enable(WDTO_60MS);
    sei();
    for (;;) {
        uint32_t ms = now();
        /* So many bytes at a time and no more: a line that never falls silent must not keep the rest waiting. */
        for (uint8_t n = 0; n < RECEIVE_AT_ONCE && received.tail != received.head; n++) {
            uint8_t byte = received.bytes[received.tail];
            received.tail = (uint8_t)((received.tail + 1) & (RING - 1));
            uint8_t answer = drive_receive(&drive, parser_feed(&parser, byte, &frame), &frame, ms);
            if (answer == WELCOME) drive_welcome(&drive, ++sequence, &frame);
            if (answer == TELEMETRY) drive_telemetry(&drive, ++sequence, ms, &frame);
            if (answer) {
                send(&frame);
                told = ms;
            }
        }
        if (ms - ticked >= 4) {
            ticked = ms;
            drive_tick(&drive, ms);
            pulses(&drive);
            measure_battery(&drive);
            wdt_reset(); /* only when time goes on and the watchdogs above were looked at */
        }
        if (ms - told >= TELEMETRY_MS && drive.greeted) {
            told = ms;
            drive_telemetry(&drive, ++sequence, ms, &frame);
            send(&frame);
        }
        if (received.tail == received.head) sleep_mode(); /* a byte that comes just now ends the sleep at once */
    }
}
