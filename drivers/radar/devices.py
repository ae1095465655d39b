"""Find the sound card that a rig file names, and refuse one that would resample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceRefused

JACK = "JACK Audio Connection Kit"
ALSA = "ALSA"
NATIVE_RATE_APIS = ("Windows WASAPI", "Core Audio", JACK, "ASIO")
"""Host APIs whose default rate is the rate at which the device runs; at any other rate they resample or refuse."""
RESAMPLING_APIS = ("MME", "Windows DirectSound")
"""Host APIs that resample without a word, and do not tell the device's own rate."""


@dataclass(frozen=True)
class SoundCard:
    """A capture device: PortAudio's index, its name, and what is worth knowing about it."""

    index: int
    name: str
    detail: str
    api: str
    """PortAudio's host API."""


def find_device(sounddevice: Any, name: str, sample_rate_hz: float, where: str) -> SoundCard:
    """The one stereo capture device whose name is, or contains, ``name`` (any case); empty: the default.

    Raises:
        DeviceRefused: none or several match, it has fewer than two inputs, or it runs at another rate.
    """
    devices = list(sounddevice.query_devices())
    apis = [api["name"] for api in sounddevice.query_hostapis()]
    inputs = [d for d in devices if d["max_input_channels"] > 0]
    device = _choose(inputs, apis, name, sounddevice, where)
    api = apis[device["hostapi"]]
    if device["max_input_channels"] < 2:
        raise DeviceRefused(
            f"{device['name']} is a mono input", where=where, advice="use a stereo line input: beat and sync are two"
        )
    native = float(device["default_samplerate"])
    if api in NATIVE_RATE_APIS and abs(native - sample_rate_hz) > 0.5:
        raise resampled(str(device["name"]), native, sample_rate_hz, where)
    detail = f"{api}, {sample_rate_hz:g} Hz"
    if api in RESAMPLING_APIS:
        detail += "; this host API resamples without saying so: set the device to this rate in the system's settings"
    return SoundCard(int(device["index"]), str(device["name"]), detail, api)


def resampled(name: str, native_hz: float, sample_rate_hz: float, where: str) -> DeviceRefused:
    """The refusal of a sound card that runs at another rate than asked for."""
    return DeviceRefused(
        f"{name} runs at {native_hz:g} Hz and would be resampled to {sample_rate_hz:g} Hz",
        where=where,
        advice=f"set radar.sample_rate_hz = {native_hz:g}, or the sound card to {sample_rate_hz:g} Hz",
    )


def _choose(inputs: list[Any], apis: list[str], name: str, sounddevice: Any, where: str) -> Any:
    if not inputs:
        raise DeviceRefused(
            "this computer has no sound input", where=where, advice="plug in the sound card and try again"
        )
    if not name:
        default = sounddevice.default.device[0]
        return next((d for d in inputs if d["index"] == default), inputs[0])
    wanted = name.casefold()
    labels = {d["index"]: f"{d['name']}, {apis[d['hostapi']]}" for d in inputs}
    matches = [d for d in inputs if wanted in (d["name"].casefold(), labels[d["index"]].casefold())]
    if not matches:
        matches = [d for d in inputs if wanted in labels[d["index"]].casefold()]
    if len(matches) != 1:
        found = "; ".join(labels[d["index"]] for d in (matches or inputs))
        what = f"{len(matches)} sound inputs match {name!r}" if matches else f"no sound input is called {name!r}"
        raise DeviceRefused(what, where=where, advice=f"name one of: {found}")
    return matches[0]
