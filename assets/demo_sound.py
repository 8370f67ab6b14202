"""The demo's sound, synthesised: a quiet pad over street air for the clip, a short jingle for the ad."""

import numpy as np
from numpy.typing import NDArray

Sound = NDArray[np.float32]  # (2, samples), -1..1

SAMPLE_RATE = 48000


def pitch(note: int) -> float:
    """Frequency in Hz of a MIDI note number."""
    return float(440.0 * 2 ** ((note - 69) / 12))


def air(samples: int, rng: np.random.Generator) -> Sound:
    """Distant-traffic noise: white noise with its spectrum tilted down, in both ears unlike."""
    spectrum = np.fft.rfft(rng.standard_normal((2, samples)), axis=1)
    hertz = np.fft.rfftfreq(samples, 1 / SAMPLE_RATE)
    spectrum *= (hertz > 40) / (1 + (hertz / 180) ** 1.5)
    sound = np.fft.irfft(spectrum, samples, axis=1)
    return np.asarray(sound / np.abs(sound).max(), np.float32)


def street_pad(seconds: float) -> Sound:
    """Four soft chords over street air, faded in and out."""
    time = np.arange(int(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    sound = 0.05 * air(len(time), np.random.default_rng(3)).astype(np.float64)
    chords = ((50, 57, 62, 66), (47, 54, 62, 66), (43, 55, 59, 66), (45, 52, 61, 64))
    length = seconds / len(chords)
    for number, chord in enumerate(chords):
        local = (time - number * length) / length
        swell = np.clip(np.sin(np.pi * np.clip((local + 0.15) / 1.3, 0, 1)), 0, 1) ** 1.5
        for voice, note in enumerate(chord):
            for ear, detune in enumerate((0.9985, 1.0015)):
                phase = 2 * np.pi * pitch(note) * detune * time + voice
                sound[ear] += 0.035 * swell * (np.sin(phase) + 0.25 * np.sin(2 * phase) + 0.08 * np.sin(3 * phase))
    fade = np.clip(np.minimum(time / 0.5, (seconds - time) / 0.8), 0, 1)
    return np.asarray(sound * fade, np.float32)


def jingle(seconds: float) -> Sound:
    """Bells and a bass that end on the key note, so that the loop closes."""
    time = np.arange(int(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    sound = np.zeros((2, len(time)))
    tune = ((0.0, 76), (0.31, 79), (0.62, 83), (0.94, 86), (1.56, 83), (1.87, 81), (2.19, 79), (2.5, 74), (2.81, 79))
    for start, note in (*tune, (3.12, 83), (3.12, 79), (3.12, 74), (0.0, 43), (1.25, 48), (2.5, 50), (3.12, 43)):
        since = np.maximum(time - start, 0)
        strike = np.minimum(since / 0.004, 1) * np.exp(-since * (2.2 if note > 60 else 1.4)) * (time >= start)
        phase = 2 * np.pi * pitch(note) * since
        bell = (
            np.sin(phase)
            + 0.4 * np.sin(2.0 * phase) * np.exp(-3 * since)
            + 0.2 * np.sin(5.4 * phase) * np.exp(-9 * since)
        )
        side = 0.5 + 0.3 * np.sin(note)
        sound += 0.14 * np.stack([bell * strike * side, bell * strike * (1 - side)])
    echo = int(0.19 * SAMPLE_RATE)
    sound[:, echo:] += 0.3 * sound[::-1, :-echo]
    return np.asarray(sound * np.clip((seconds - time) / 0.4, 0, 1), np.float32)
