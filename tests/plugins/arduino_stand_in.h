// The few functions of an Arduino that the encoder's sketch uses, on an ordinary computer. Pins and time are set by a test.
#include <cstdint>
#include <cstdio>

#define HIGH 1
#define CHANGE 1
#define INPUT 0
#define INPUT_PULLUP 2

static int pins[8];
static uint32_t now_us;
static void (*on_edge[8])();

static uint32_t micros() { return now_us; }
static int digitalRead(int pin) { return pins[pin]; }
static void pinMode(int, int) {}
static int digitalPinToInterrupt(int pin) { return pin; }
static void attachInterrupt(int pin, void (*work)(), int) { on_edge[pin] = work; }
static void noInterrupts() {}
static void interrupts() {}

static struct {
  void begin(long) {}
  void print(const char *text) { fputs(text, stdout); }
} Serial;
