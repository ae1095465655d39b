"""The radar's stereo audio port on any sound card that PortAudio reaches.

Callback mode only: PortAudio's blocking read drops samples silently. The callback copies into a ring and returns;
everything else happens when the port is polled.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.radar import pace, portaudio
from drivers.radar.collecting import Collecting
from drivers.radar.devices import ALSA, JACK, SoundCard, find_device, resampled
from drivers.radar.health import SignalHealth, examine_signal, level_of
from drivers.radar.ring import SampleRing
from drivers.radar.stream_clock import StreamClock
from drivers.radar.true_rate import card_rate_hz
from drivers.records import AudioBlock, ClockFix, Identity, Level

CHANNELS = 2
SETTLE_TIMEOUT_S = 4.0


class SoundPort:
    """The audio port as a :class:`drivers.contracts.Radar`. Safe to use from several threads."""

    @dataclass(frozen=True)
    class Options:
        """Settings of the audio port."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        device: str = ""
        """Name of the sound card, or a part of it that only one has; empty for the system's default."""
        sample_rate_hz: Annotated[float, Ge(8_000), Le(384_000)] = 48_000.0
        """Sample rate, Hz."""
        sample_format: Literal["int16", "int32", "float32"] = "int16"
        """Sample type; samples are stored exactly as delivered."""
        block_frames: Annotated[int, Ge(0), Le(65_536)] = 480
        """Frames per callback; 0 leaves it to PortAudio."""
        latency_s: Annotated[float, Gt(0), Le(0.5)] = 0.1
        """Buffer asked of the sound system, s; longer survives longer pauses of the computer, and delivers later."""
        guard_s: Annotated[float, Ge(0), Le(10)] = 0.06
        """Frames sampled less than this after a record was asked for are discarded, s; above the path's least delay."""
        stall_timeout_s: Annotated[float, Gt(0), Le(60)] = 2.0
        """Time without any sample after which the port counts as stalled, s."""
        open_timeout_s: Annotated[float, Gt(0), Le(60)] = 8.0
        """Time that the sound system may take to open or close the port, s."""
        ring_s: Annotated[float, Ge(1), Le(600)] = 8.0
        """Samples kept while nobody asks for them, s."""
        check_pace: bool = True
        """Compare the frame count with the host's clock. False only for file devices, which know no time: they wait
        until their samples are asked for, and records follow each other without a gap."""
        environment: Mapping[str, str] = field(default_factory=dict)
        """Environment of the sound system: ALSA_*, PULSE_*, JACK_*, XDG_RUNTIME_DIR."""

    def __init__(self, options: Options) -> None:
        checked(options)
        portaudio.check_environment(options.environment)
        self._options = options
        self._where = f"radar audio port {options.device!r}" if options.device else "radar audio port"
        self._lock = threading.RLock()
        self._stream: Any = None
        self._stuck = False
        self._ring = SampleRing(1, CHANNELS, options.sample_format)
        self._clock = StreamClock(options.sample_rate_hz)
        self._next_arrival = 0
        self._ended, self._closing = threading.Event(), threading.Event()
        self._released, self._holding = 0, False
        self._request: Collecting | None = None
        self._longest_callback_ns = 0

    # -- opening and closing ------------------------------------------------------------------------------------------

    def open(self) -> Identity:
        """Open the stream and wait until its pace is known.

        Raises:
            DeviceError: PortAudio is missing.
            DeviceRefused: no such device, it is mono, it does not do the rate, or it runs at another rate.
            DeviceTimeout: no samples come, or the sound system hangs.
        """
        with self._lock:
            if self._stream is not None:
                raise DeviceRefused("is open already", where=self._where, advice="close it first")
            sounddevice = portaudio.acquire(self._options.environment)
            try:
                device = find_device(sounddevice, self._options.device, self._options.sample_rate_hz, self._where)
                self._start(sounddevice, device)
                self._refuse_resampling(device)
                self._settle()
            except BaseException:
                if self._stream is None:
                    portaudio.release(stuck=self._stuck)
                self.close()
                raise
            return Identity("radar", "sounddevice", device.name, device.detail)

    def _start(self, sounddevice: Any, device: SoundCard) -> None:
        options = self._options
        capacity = max(int(options.ring_s * options.sample_rate_hz), 4 * options.block_frames, 4096)
        self._ring = ring = SampleRing(capacity, CHANNELS, options.sample_format)
        # A JACK server has a block length of its own, and loses whole blocks.
        by_jack = device.api == JACK
        self._clock = StreamClock(options.sample_rate_hz, paced=options.check_pace, whole_blocks=by_jack)
        self._next_arrival = 0
        self._request = None
        self._longest_callback_ns = 0
        self._ended = ended = threading.Event()
        self._closing = closing = threading.Event()
        self._released, self._holding = 0, False

        def arrived(samples: NDArray[np.generic], frames: int, times: Any, status: Any) -> None:
            host_ns = time.monotonic_ns()
            if not options.check_pace:
                self._holding = True
                while ring.written + frames > self._released + capacity and not closing.wait(0.001):
                    pass
                self._holding = False
            age_s = times.currentTime - times.inputBufferAdcTime if times.inputBufferAdcTime > 0 else float("nan")
            ring.write(samples, host_ns, age_s, bool(status.input_overflow))
            self._longest_callback_ns = max(self._longest_callback_ns, time.monotonic_ns() - host_ns)

        def start() -> Any:
            stream = sounddevice.InputStream(
                device=device.index,
                samplerate=options.sample_rate_hz,
                channels=CHANNELS,
                dtype=options.sample_format,
                blocksize=0 if by_jack else options.block_frames,
                latency=options.latency_s,
                clip_off=True,
                dither_off=True,
                callback=arrived,
                finished_callback=ended.set,
            )
            try:
                stream.start()
            except BaseException:
                stream.close()
                raise
            return stream

        try:
            self._stream = portaudio.bounded(start, options.open_timeout_s, "opening the audio port", self._where)
        except DeviceTimeout:
            self._stuck = True
            raise
        except sounddevice.PortAudioError as error:
            raise DeviceRefused(
                f"cannot be opened at {options.sample_rate_hz:g} Hz, {CHANNELS} channels, {options.sample_format} "
                f"({error.args[0] if error.args else error})",
                where=self._where,
                advice="choose a rate and format that the sound card has, and close other programs that use it",
            ) from error

    def _refuse_resampling(self, device: SoundCard) -> None:
        """Refuse a sound card that runs at another rate, where the sound system can be asked."""
        if device.api != ALSA or not self._options.check_pace:
            return
        rate = self._options.sample_rate_hz
        native = card_rate_hz()
        if native is not None and abs(native - rate) > 0.5:
            raise resampled(device.name, native, rate, self._where)

    def _settle(self) -> None:
        """Wait until the backlog of the start is gone and the pace agrees with the host's clock."""
        rate = self._options.sample_rate_hz
        deadline = time.monotonic() + SETTLE_TIMEOUT_S
        while True:
            time.sleep(0.01)
            arrivals, following = self._ring.arrivals(0)
            used = arrivals if not self._options.check_pace else pace.settled(arrivals, rate)
            if used:
                break
            self._require_running()
            if time.monotonic() > deadline:
                self._refuse_pace(pace.rate_hz(arrivals))
        for arrival in used:
            self._clock.add(arrival)
        self._next_arrival = following

    def _refuse_pace(self, rate_hz: float | None) -> None:
        if rate_hz is None:
            raise DeviceTimeout(
                f"delivers no samples ({SETTLE_TIMEOUT_S:g} s)",
                where=self._where,
                advice="check that the sound card records: input selected, not muted, not held by another program",
            )
        raise DeviceRefused(
            f"delivers {rate_hz:.0f} samples a second, not {self._options.sample_rate_hz:.0f}",
            where=self._where,
            advice="set radar.sample_rate_hz to the rate at which the sound card really runs",
        )

    def close(self) -> None:
        """Release the sound card. Idempotent; never raises."""
        with self._lock:
            stream, self._stream, self._request = self._stream, None, None
            if stream is None:
                return
            self._closing.set()
            try:
                portaudio.bounded(
                    lambda: stream.close(ignore_errors=True), self._options.open_timeout_s, "closing", self._where
                )
            except DeviceTimeout:
                self._stuck = True
            except Exception as error:
                print(f"{self._where}: closing failed ({error})", file=sys.stderr)
            portaudio.release(stuck=self._stuck)

    def make_safe(self) -> None:
        """Forget the record asked for; a listening port has nothing else to make safe."""
        self.cancel()

    # -- records ------------------------------------------------------------------------------------------------------

    @property
    def sample_rate_hz(self) -> float:
        """Nominal sample rate of the open stream, Hz."""
        return self._options.sample_rate_hz

    @property
    def longest_callback_s(self) -> float:
        """Longest that the callback has kept the audio thread since the stream was opened, s."""
        return self._longest_callback_ns * 1e-9

    @property
    def lost_frames(self) -> int:
        """Frames known to be lost since the stream was opened."""
        with self._lock:
            with contextlib.suppress(DeviceError):
                self._take_in()
            return self._clock.lost

    def begin(self, frames: int) -> None:
        """Ask for ``frames`` contiguous frames, sampled at least ``guard_s`` after this call.

        Raises:
            DeviceRefused: ``frames`` is not positive or does not fit into memory, or a record is under way.
            DeviceLost, DeviceTimeout: the port is gone or stalled.
        """
        self._begin(frames, gapless=False)

    def begin_stream(self, frames: int) -> None:
        """Ask for records of ``frames`` frames, one after another without a gap, until :meth:`cancel`.

        Whoever asks polls at least as often as ``ring_s`` says, or frames are missing. Raises as :meth:`begin`.
        """
        self._begin(frames, gapless=True)

    def _begin(self, frames: int, *, gapless: bool) -> None:
        now_ns = time.monotonic_ns()
        with self._lock:
            if self._request is not None:
                raise DeviceRefused("a record is under way", where=self._where, advice="cancel it first")
            if frames <= 0:
                raise DeviceRefused(f"a record of {frames} frames", where=self._where, advice="ask for one or more")
            self._take_in()
            guard_ns = round(self._options.guard_s * 1e9)
            paced = self._options.check_pace
            first = self._clock.frame_surely_after(now_ns + guard_ns) if paced else self._released
            try:
                samples = np.zeros((frames, CHANNELS), dtype=self._options.sample_format)
            except (MemoryError, ValueError):
                raise DeviceRefused(
                    f"a record of {frames} frames does not fit into memory",
                    where=self._where,
                    advice="record fewer sweeps at a time",
                ) from None
            self._request = Collecting(
                self._ring,
                self._clock,
                first,
                samples,
                sample_rate_hz=self._options.sample_rate_hz,
                after_ns=now_ns + guard_ns if paced else None,
                # Half of the guard is left for the clock's own scatter, which is some milliseconds.
                margin_ns=guard_ns // 2,
                gapless=gapless,
            )

    def poll(self) -> AudioBlock | None:
        """The record asked for, once it is whole and it is known whether frames are missing in it; else None.

        Raises:
            DeviceLost: the sound card is gone.
            DeviceTimeout: no sample came for ``stall_timeout_s``.
        """
        with self._lock:
            request = self._request
            if request is None:
                return None
            self._take_in()
            block = request.take()
            self._released = max(self._released, request.following)
            if block is not None and not request.gapless:
                self._request = None
            return block

    def cancel(self) -> None:
        """Forget the record asked for, and those that would follow it."""
        with self._lock:
            self._request = None

    def _take_in(self) -> None:
        """Hand new arrivals to the clock; raise when the stream has ended or stalled."""
        if self._stream is None:
            raise DeviceLost("is not open", where=self._where, advice="open it first")
        arrivals, self._next_arrival = self._ring.arrivals(self._next_arrival)
        for arrival in arrivals:
            self._clock.add(arrival)
        self._require_running()

    def _require_running(self) -> None:
        if self._ended.is_set() or not self._stream.active:
            raise DeviceLost(
                "the sound card stopped delivering: it was unplugged or its sound server ended",
                where=self._where,
                advice="plug it in again and reopen the port",
            )
        last = self._ring.last_ns
        if last is not None and not self._holding and time.monotonic_ns() - last > self._options.stall_timeout_s * 1e9:
            raise DeviceTimeout(
                f"no sample for {self._options.stall_timeout_s:g} s",
                where=self._where,
                advice="the sound card or its server hangs: plug it in again, or restart the sound server",
            )

    # -- looking at the signal ----------------------------------------------------------------------------------------

    def level(self) -> Level:
        """Peak and rms of both channels over the last tenth of a second, as fractions of full scale."""
        recent = self._recent(0.1)
        return Level() if recent is None else level_of(recent)

    def health(self, nominal_period_s: float | None = None, ramp_up_s: float | None = None) -> SignalHealth:
        """What the last two seconds say about the signal; see :func:`drivers.radar.health.examine_signal`.

        Raises:
            DeviceTimeout: nothing has been sampled yet.
        """
        recent = self._recent(2.0)
        if recent is None:
            raise DeviceTimeout("no samples yet", where=self._where, advice="try again in a second")
        rate = self._options.sample_rate_hz
        return examine_signal(recent, rate, nominal_period_s=nominal_period_s, ramp_up_s=ramp_up_s)

    def check_signal(self, nominal_period_s: float | None = None) -> None:
        """Refuse what cannot be a radar's beat and sync, judged by the last two seconds.

        Raises:
            DeviceBadAnswer: a dead channel, identical channels, no sync, or not the sweeps' rhythm.
            DeviceTimeout: nothing has been sampled yet.
        """
        error = self.health(nominal_period_s).error
        if error is not None:
            raise DeviceBadAnswer(error.sentence, where=self._where, advice=error.advice)

    def newest(self, frames: int) -> AudioBlock | None:
        """The newest samples, see :class:`drivers.contracts.OverheardRadar`."""
        ring, rate = self._ring, self._options.sample_rate_hz
        last_ns, written = ring.last_ns, ring.written
        frames = min(frames, written, ring.capacity // 2)
        if last_ns is None or frames <= 0:
            return None
        first, samples = written - frames, ring.read(written - frames, frames)
        first_ns = last_ns - round(frames / rate * 1e9)
        return None if samples is None else AudioBlock(samples, rate, first, first / rate, first_ns)

    def _recent(self, seconds: float) -> NDArray[np.generic] | None:
        """The last samples; None before there are any."""
        return None if (block := self.newest(int(seconds * self.sample_rate_hz))) is None else block.samples

    def clock(self) -> ClockFix | None:
        """A typical arrival of the last whole second: sample clock (frames, lost ones counted, over the nominal rate)
        against the host's. The delay of that arrival lies between none and about one block, and so the middle of the
        exchange half a block before it.
        """
        with self._lock:
            self._take_in()
            arrival = self._clock.typical_arrival
            if arrival is None:
                return None
            frames, host_ns, block = arrival
            rate = self._options.sample_rate_hz
            return ClockFix("radar", frames / rate, host_ns - round(block / rate / 2 * 1e9), round(block / rate * 1e9))
