"""Actuators that play a vibration."""

from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.messages.vibration import Vibration
from palpate.nodes.base import Node, SettingError, Wants
from palpate.physics.extras import missing

BUFFER = 0.2  # [s] of sound in the ring buffer


class SoundCard(Node):
    """Plays a vibration on a sound card, for a loudspeaker or a voice coil at its output.

    gain    full scale per newton; the signal is limited to full scale
    rate    sampling rate of the sound card
    device  name or number of the output; "": the default output; "none": no output
    """

    sink = True

    gain: Annotated[float, "1/N", msgspec.Meta(gt=0)] = 2.0
    rate: Annotated[float, "Hz", msgspec.Meta(ge=8000, le=192000)] = 48e3
    device: Annotated[str, "1"] = ""

    def start(self) -> None:
        # position of the card's next sample in samples of the vibration; last sample of the vibration
        self.phase, self.last = 1.0, 0.0
        self.ring = np.zeros(int(BUFFER * self.rate), np.float32)
        self.written = self.played = 0  # numbers of samples; only one thread changes each
        self.stream: Any = None
        if self.device == "none":
            return
        try:
            import sounddevice
        except (ImportError, OSError) as error:  # OSError: the library PortAudio is missing
            raise SettingError(
                missing("the sound card", getattr(error, "name", None) or "sounddevice", "feel")
            ) from None
        named: Any = int(self.device) if self.device.isdigit() else self.device or None
        try:
            self.stream = sounddevice.OutputStream(
                samplerate=self.rate, device=named, channels=1, dtype="float32", latency="low", callback=self.fill
            )
            self.stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise SettingError(f"setting 'device': {self.device or 'default'}: {error}. `python -m sounddevice` lists "
                               "the outputs; device: none plays nothing") from None  # fmt: skip

    def step(self, vibration: Annotated[Vibration, Wants("lateral", "sampling")]) -> None:
        block = vibration.lateral
        if not len(block):
            return
        step = vibration.sampling / self.rate
        count = int((len(block) - self.phase) / step) + 1 if self.phase <= len(block) else 0
        at = self.phase + step * np.arange(count)
        sound = np.interp(at, np.arange(len(block) + 1), np.concatenate([[self.last], block]))
        self.phase, self.last = self.phase + step * count - len(block), float(block[-1])
        if self.written + count - self.played > len(self.ring):  # the buffer is full: the card is off or too slow
            return
        self.ring[(self.written + np.arange(count)) % len(self.ring)] = np.clip(self.gain * sound, -1.0, 1.0)
        self.written += count

    def fill(self, out: Any, frames: int, time: Any, status: Any) -> None:
        """Callback of the sound card's thread: the next samples, then silence if the buffer is empty."""
        count = min(frames, self.written - self.played)
        out[:count, 0] = self.ring[(self.played + np.arange(count)) % len(self.ring)]
        out[count:, 0] = 0.0
        self.played += count

    def stop(self) -> None:
        if getattr(self, "stream", None) is not None:
            self.stream.close()
            self.stream = None
