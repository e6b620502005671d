/* The firmware on a simulated ATmega328P, in real time: its serial port is a pty, its pulses are printed.
 *
 *     avrsim FIRMWARE.elf LINK [LOG]
 *
 * LINK becomes a symbolic link to the pty. Lines on stdout and in LOG, times of CLOCK_MONOTONIC in ns:
 *     R path                          ready
 *     P motor|front|rear us cycle ns  a pulse has ended
 *     F command ns                    a command from stdin was carried out
 *     L us ns                         the simulation was late by so much and let the time go
 * Commands, lines on stdin:
 *     stall          the processor hangs with interrupts off, as after a wild jump
 *     hang           the main loop hangs, interrupts go on
 *     unplug, plug   the serial adapter
 *     battery mV     voltage at the battery
 *     up|down MODE   what the cable does to frames to or from the board: see wire.c
 *     quit
 * When stdin ends it goes on for a second: what a killed program leaves behind can be read in LOG. */
#define _GNU_SOURCE
#include <avr_adc.h>
#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_timer.h>
#include <avr_uart.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <sim_avr.h>
#include <sim_elf.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "../config.h"
#include "wire.h"

#define MHZ 16
#define TIMER1_PRESCALER 8
#define SLICE_NS 200000
#define USB_NS 1000000u
#define LATE_NS 30000000
#define AFTERLIFE_NS 1000000000u

static avr_t *avr;
static avr_irq_t *uart_in, *adc_in;
static const char *link_path;
static int master = -1, slave = -1, ready = 1;
static uint8_t queue[4096];
static unsigned first, last;
static uint64_t rises[3];
static FILE *log_file;

static uint64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static void say(const char *format, ...) {
    FILE *files[] = {stdout, log_file};
    for (int k = 0; k < 2; k++)
        if (files[k]) {
            va_list values;
            va_start(values, format);
            vfprintf(files[k], format, values);
            va_end(values);
        }
}

static void to_board(const uint8_t *bytes, unsigned length) {
    for (unsigned i = 0; i < length && last - first < sizeof queue; i++) queue[last++ % sizeof queue] = bytes[i];
}

static uint8_t outgoing[4096];
static unsigned outgoing_length;
static uint64_t outgoing_since;

static void to_program(const uint8_t *bytes, unsigned length) {
    if (!outgoing_length) outgoing_since = now_ns();
    for (unsigned i = 0; i < length && outgoing_length < sizeof outgoing; i++) outgoing[outgoing_length++] = bytes[i];
}

static void flush_to_program(uint64_t now) { /* in chunks, as a USB adapter does: whole frames, or what came in 1 ms */
    if (!outgoing_length || (outgoing[outgoing_length - 1] && now < outgoing_since + USB_NS)) return;
    if (master >= 0 && write(master, outgoing, outgoing_length) < 0 && errno != EAGAIN && errno != EIO)
        perror("avrsim: write");
    outgoing_length = 0;
}

static struct wire up = {.out = to_board, .random = 1}, down = {.out = to_program, .random = 2};

static void pump(void) { /* as fast as the line is, no faster */
    while (ready && first != last) avr_raise_irq(uart_in, queue[first++ % sizeof queue]);
}

static void on_output(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    uint8_t byte = (uint8_t)value;
    wire_feed(&down, &byte, 1);
}

static void on_ready(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    if (value) ready = param != NULL;
}

static void on_pin(avr_irq_t *irq, uint32_t value, void *param) {
    static const char *const names[] = {"front", "motor", "rear"};
    (void)irq;
    size_t k = (size_t)param;
    if (value) {
        rises[k] = avr->cycle;
    } else if (rises[k]) {
        double us = (double)(avr->cycle - rises[k]) / MHZ;
        say("P %s %.1f %llu %llu\n", names[k], us, (unsigned long long)avr->cycle, (unsigned long long)now_ns());
        rises[k] = 0;
    }
}

/* simavr 1.6 looks at OCR1A and OCR1B only when the mode of timer 1 is set; a real one takes them over at its top,
 * which is when simavr next reads comp_cycles. */
static void on_compare(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    size_t k = (size_t)param;
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (strcmp(io->kind, "timer") == 0 && ((avr_timer_t *)io)->name == '1')
            ((avr_timer_t *)io)->comp[k].comp_cycles = (value + 1) * TIMER1_PRESCALER;
}

static void no_sleep(avr_t *a, avr_cycle_count_t cycles) { (void)a, (void)cycles; }

static int plug(void) {
    char name[128];
    struct termios raw;
    if (openpty(&master, &slave, name, NULL, NULL) < 0) return perror("avrsim: openpty"), 0;
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw); /* our end of it stays open, so that the program may come and go */
    fcntl(master, F_SETFL, O_NONBLOCK);
    unlink(link_path);
    if (symlink(name, link_path) < 0) return perror("avrsim: symlink"), 0;
    return 1;
}

static void unplug(void) {
    unlink(link_path);
    if (slave >= 0) close(slave);
    if (master >= 0) close(master);
    master = slave = -1;
}

static void stall(int interrupts) {
    for (uint32_t pc = 0; pc + 1 < avr->codeend; pc += 2)
        if (avr->flash[pc] == 0xff && avr->flash[pc + 1] == 0xcf) { /* rjmp .-2, where main would return to */
            avr->pc = pc;
            avr->sreg[S_I] = (uint8_t)interrupts;
            avr->state = cpu_Running;
            return;
        }
}

static void battery(unsigned mv) {
    avr_raise_irq(adc_in, mv * 5000 / BATTERY_FULL_SCALE_MV);
}

/* 0 to end. */
static int command(char *line) {
    char word[16] = "", more[16] = "";
    sscanf(line, "%15s %15s", word, more);
    if (strcmp(word, "quit") == 0) return 0;
    if (strcmp(word, "stall") == 0) stall(0);
    else if (strcmp(word, "hang") == 0) stall(1);
    else if (strcmp(word, "unplug") == 0) unplug();
    else if (strcmp(word, "plug") == 0) plug();
    else if (strcmp(word, "battery") == 0) battery((unsigned)atoi(more));
    else if (!(strcmp(word, "up") == 0 ? wire_mode(&up, more) : strcmp(word, "down") == 0 && wire_mode(&down, more)))
        fprintf(stderr, "avrsim: cannot do %s %s\n", word, more);
    say("F %s%s%s %llu\n", word, *more ? "-" : "", more, (unsigned long long)now_ns());
    return 1;
}

static int read_commands(void) {
    static char line[64];
    static unsigned length;
    char byte;
    ssize_t n = read(STDIN_FILENO, &byte, 1);
    if (n < 0) return errno == EINTR;
    if (n == 0) return -1;
    if (byte != '\n') {
        if (length < sizeof line - 1) line[length++] = byte;
        return 1;
    }
    line[length] = 0;
    length = 0;
    return command(line);
}

static void start(const char *path) {
    elf_firmware_t firmware = {0};
    if (elf_read_firmware(path, &firmware) != 0) exit(2);
    strcpy(firmware.mmcu, "atmega328p");
    firmware.frequency = MHZ * 1000000u;
    avr = avr_make_mcu_by_name(firmware.mmcu);
    if (!avr) exit(2);
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = avr->aref = 5000;
    avr->sleep = no_sleep;
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    adc_in = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_output, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_ready, &avr);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_ready, NULL);
    static const struct {
        char port;
        int bit;
    } pins[] = {{'B', 1}, {'B', 2}, {'D', 3}};
    for (size_t k = 0; k < 3; k++)
        avr_irq_register_notify(
            avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(pins[k].port), pins[k].bit), on_pin, (void *)k);
    for (size_t k = 0; k < 2; k++)
        avr_irq_register_notify(
            avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_OUT_PWM0 + (int)k), on_compare, (void *)k);
    /* Interrupts on low levels are not used. simavr would still look for them in every cycle in which D3, the rear
     * pulse, is low, and be slower than a real board on a computer that does other things as well. */
    for (uint8_t k = 0; k < 2; k++) avr_extint_set_strict_lvl_trig(avr, k, 0);
    battery(7400);
}

int main(int argc, char **argv) {
    if (argc < 3) return fprintf(stderr, "usage: avrsim FIRMWARE.elf LINK [LOG]\n"), 2;
    setvbuf(stdout, NULL, _IOLBF, 0);
    signal(SIGPIPE, SIG_IGN);
    /* Real time is meant: without it a busy computer would slow the board down, as no board is slowed down. */
    struct sched_param priority = {.sched_priority = 5};
    if (sched_setscheduler(0, SCHED_RR, &priority) < 0) fprintf(stderr, "avrsim: no real-time priority\n");
    if (argc > 3) {
        log_file = fopen(argv[3], "w");
        if (!log_file) return perror(argv[3]), 2;
        setvbuf(log_file, NULL, _IOLBF, 0);
    }
    link_path = argv[2];
    start(argv[1]);
    if (!plug()) return 2;
    say("R %s\n", link_path);
    uint64_t base = now_ns(), end = 0;
    for (;;) {
        uint64_t now = now_ns();
        if (end && now > end) break;
        if (now - base > avr->cycle * 1000 / MHZ + LATE_NS) {
            uint64_t late = now - base - avr->cycle * 1000 / MHZ;
            say("L %llu %llu\n", (unsigned long long)late / 1000, (unsigned long long)now);
            base += late;
        }
        avr_cycle_count_t target = (now - base) * MHZ / 1000;
        while (avr->cycle < target) {
            pump();
            int state = avr_run(avr);
            if (state == cpu_Done || state == cpu_Crashed) return fprintf(stderr, "avrsim: the processor died\n"), 1;
        }
        flush_to_program(now);
        struct pollfd files[] = {{.fd = end ? -1 : STDIN_FILENO, .events = POLLIN}, {.fd = master, .events = POLLIN}};
        struct timespec wait = {.tv_nsec = SLICE_NS};
        if (ppoll(files, 2, &wait, NULL) < 0) continue;
        if (!end && files[0].revents) {
            int more = read_commands();
            if (more == 0) break;
            if (more < 0) end = now + AFTERLIFE_NS;
        }
        if (master >= 0 && files[1].revents & POLLIN) {
            uint8_t bytes[512];
            ssize_t n = read(master, bytes, sizeof bytes);
            if (n > 0) wire_feed(&up, bytes, (unsigned)n);
        }
    }
    unplug();
    return 0;
}
