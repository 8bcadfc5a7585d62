// The device's side of palpate's open raw-HID protocol, version 1 (docs/raw_hid.md). No dependencies, no allocation.
//
// Hardware is a type with
//   static constexpr int axes;
//   void read(int32_t counts[6]);              counts of each axis
//   void drive(const int16_t command[6]);      set the motors; all zero releases them
//   bool homed();                              whether the counts are valid
//   void home();                               start homing; may be called again
//   uint16_t buttons();
//   void scales(float per_count[6], float per_unit[6], bool &torques);
//   uint32_t micros();
#pragma once
#include <stdint.h>
#include <string.h>

namespace palpate {

constexpr int LENGTH = 64;
enum Kind : uint8_t { COMMAND = 1, STATE = 2, INFO = 3 };
enum Flags : uint8_t { ENABLE = 1, HOME = 2, ASK_INFO = 4, HOMED = 1, TRIPPED = 2 };

inline uint16_t crc(const uint8_t *data, int count) {
  uint16_t value = 0xFFFF;
  for (int i = 0; i < count; ++i) {
    value ^= data[i];
    for (int bit = 0; bit < 8; ++bit) value = value & 1 ? (value >> 1) ^ 0x8408 : value >> 1;
  }
  return value ^ 0xFFFF;
}

inline uint16_t get16(const uint8_t *at) { return static_cast<uint16_t>(at[0] | at[1] << 8); }
inline void put16(uint8_t *at, uint16_t value) { at[0] = value & 0xFF; at[1] = value >> 8; }
inline void put32(uint8_t *at, uint32_t value) { put16(at, value & 0xFFFF); put16(at + 2, value >> 16); }
inline void putf(uint8_t *at, float value) { uint32_t bits; memcpy(&bits, &value, 4); put32(at, bits); }

template <class Hardware> class Device {
public:
  explicit Device(Hardware &hardware) : hardware_(hardware) {}

  // Handles a report; true if `answer` contains a report to send.
  bool handle(const uint8_t *report, uint8_t *answer) {
    if (report[0] != 0x50 || report[1] != COMMAND || get16(report + 62) != crc(report, 62)) return false;
    const uint8_t flags = report[4];
    received_ = get16(report + 2);
    if (flags & HOME && !hardware_.homed()) hardware_.home();
    if (flags & ENABLE && hardware_.homed()) {
      int16_t command[6];
      for (int i = 0; i < 6; ++i) command[i] = static_cast<int16_t>(get16(report + 8 + 2 * i));
      hardware_.drive(command);
      on_ = true;
      tripped_ = false;
      since_ = hardware_.micros();
      timeout_ = 1000UL * get16(report + 6);
    } else {
      release();
    }
    memset(answer, 0, LENGTH);
    answer[0] = 0x50;
    if (flags & ASK_INFO) info(answer); else state(answer);
    put16(answer + 62, crc(answer, 62));
    return true;
  }

  // Call it in every loop: switches the motors off when no command has come for the watchdog's time.
  void watch() {
    if (on_ && static_cast<uint32_t>(hardware_.micros() - since_) > timeout_) {
      release();
      tripped_ = true;
    }
  }

private:
  void release() {
    const int16_t nothing[6] = {0, 0, 0, 0, 0, 0};
    hardware_.drive(nothing);
    on_ = false;
  }

  void state(uint8_t *answer) {
    int32_t counts[6] = {0, 0, 0, 0, 0, 0};
    hardware_.read(counts);
    answer[1] = STATE;
    put16(answer + 2, ++sequence_);
    put16(answer + 4, received_);
    answer[6] = static_cast<uint8_t>((hardware_.homed() ? HOMED : 0) | (tripped_ ? TRIPPED : 0));
    answer[7] = Hardware::axes;
    put32(answer + 8, hardware_.micros());
    for (int i = 0; i < 6; ++i) put32(answer + 12 + 4 * i, static_cast<uint32_t>(counts[i]));
    put16(answer + 36, hardware_.buttons());
  }

  void info(uint8_t *answer) {
    float per_count[6] = {0}, per_unit[6] = {0};
    bool torques = false;
    hardware_.scales(per_count, per_unit, torques);
    answer[1] = INFO;
    put16(answer + 2, 1);
    answer[4] = torques;
    answer[5] = Hardware::axes;
    for (int i = 0; i < 6; ++i) {
      putf(answer + 6 + 4 * i, per_count[i]);
      putf(answer + 30 + 4 * i, per_unit[i]);
    }
  }

  Hardware &hardware_;
  uint16_t received_ = 0, sequence_ = 0;
  uint32_t since_ = 0, timeout_ = 0;
  bool on_ = false, tripped_ = false;
};

}  // namespace palpate
