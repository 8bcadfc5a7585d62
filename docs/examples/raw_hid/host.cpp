// The protocol on a computer: 64-byte reports from standard input, answers to standard output, a mass on a spring as the
// hardware. It runs firmware without a board:  g++ -std=c++17 -o host host.cpp
#include <poll.h>
#include <unistd.h>

#include <chrono>

#include "protocol.h"

struct Mass {
  static constexpr int axes = 3;
  double x[3] = {0, 0, 0.11}, v[3] = {0, 0, 0}, f[3] = {0, 0, 0};
  bool known = false;
  std::chrono::steady_clock::time_point begun = std::chrono::steady_clock::now(), then = begun;

  void move() {
    const auto now = std::chrono::steady_clock::now();
    const double home[3] = {0, 0, 0.11}, mass = 0.2, spring = 200, damper = 12;
    for (double left = std::chrono::duration<double>(now - then).count(); left > 0; left -= 1e-4) {
      const double h = left < 1e-4 ? left : 1e-4;
      for (int i = 0; i < 3; ++i) {
        v[i] += h / mass * (f[i] - spring * (x[i] - home[i]) - damper * v[i]);
        x[i] += h * v[i];
      }
    }
    then = now;
  }
  void read(int32_t counts[6]) {
    move();
    for (int i = 0; i < 3; ++i) counts[i] = static_cast<int32_t>(x[i] / 20e-6 + (x[i] < 0 ? -0.5 : 0.5));
  }
  void drive(const int16_t command[6]) {
    move();
    for (int i = 0; i < 3; ++i) f[i] = 1e-3 * command[i];
  }
  bool homed() { return known; }
  void home() { known = micros() > 50000; }
  uint16_t buttons() { return 0b10; }
  void scales(float per_count[6], float per_unit[6], bool &torques) {
    for (int i = 0; i < 3; ++i) {
      per_count[i] = 20e-6f;
      per_unit[i] = 1e-3f;
    }
    torques = false;
  }
  uint32_t micros() {
    const auto age = std::chrono::steady_clock::now() - begun;
    return static_cast<uint32_t>(std::chrono::duration_cast<std::chrono::microseconds>(age).count());
  }
};

int main() {
  Mass mass;
  palpate::Device<Mass> device(mass);
  uint8_t report[palpate::LENGTH], answer[palpate::LENGTH];
  int have = 0;
  for (;;) {
    pollfd input{0, POLLIN, 0};
    if (poll(&input, 1, 1) > 0) {
      const auto got = ::read(0, report + have, palpate::LENGTH - have);
      if (got <= 0) return 0;
      have += static_cast<int>(got);
    }
    if (have == palpate::LENGTH) {
      have = 0;
      if (device.handle(report, answer) && ::write(1, answer, palpate::LENGTH) != palpate::LENGTH) return 1;
    }
    device.watch();
  }
}
