// One axis on a Teensy 4: a quadrature encoder on pins 2 and 3, a motor driver (PWM on 4, direction on 5), a button on 6,
// an end switch on 7. Tools > USB Type > Raw HID. Libraries: Encoder. Not tried on hardware.
#include <Encoder.h>

#include "protocol.h"

struct Slider {
  static constexpr int axes = 1;
  Encoder encoder{2, 3};
  bool known = false;

  void read(int32_t counts[6]) { counts[0] = encoder.read(); }
  void drive(const int16_t command[6]) {
    const int size = constrain(abs(command[0]), 0, 5000);  // the device limits every command: 5 N
    digitalWrite(5, command[0] < 0);
    analogWrite(4, size * 255L / 5000);
  }
  bool homed() { return known; }
  void home() {  // the user pushes it to the switch
    if (digitalRead(7) == LOW) {
      encoder.write(0);
      known = true;
    }
  }
  uint16_t buttons() { return digitalRead(6) == LOW; }
  void scales(float per_count[6], float per_unit[6], bool &torques) {
    per_count[0] = 10e-6f;  // [m]
    per_unit[0] = 1e-3f;    // [N]
    torques = false;
  }
  uint32_t micros() { return ::micros(); }
};

Slider slider;
palpate::Device<Slider> device(slider);

void setup() {
  pinMode(4, OUTPUT);
  pinMode(5, OUTPUT);
  pinMode(6, INPUT_PULLUP);
  pinMode(7, INPUT_PULLUP);
}

void loop() {
  uint8_t report[64], answer[64];
  if (RawHID.recv(report, 0) == 64 && device.handle(report, answer)) RawHID.send(answer, 1);
  device.watch();
}
