"""A JACK server with a dummy driver and a client that plays the simulator's samples: the path with honest flags.

JACK's own cycle is the sound card's clock here. So the client is asked for each cycle's samples, and when the server
skips cycles (an xrun), the frames of those cycles are gone, as on a sound card whose buffer was not emptied in time.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from typing import Any

import numpy as np

from hw_mocks.faults import FaultScript
from hw_mocks.sound_card.card_faults import CardFaults
from hw_mocks.sound_card.daemon import Daemon
from hw_mocks.sound_card.feeder import Source

DEVICE = "polfuse_radar"
PERIOD_S = 0.02
RESYNC_S = 0.05


class JackCard:
    """Samples a source over JACK from construction to :meth:`close`; samples leave as float32 (int16 / 32768).

    ``device`` and ``environment`` are the options with which :class:`drivers.radar.sound_port.SoundPort` reaches it.
    Faults of content (silence, garbage) are carried out; the server itself can be stalled or killed by its ``pid``.

    Raises:
        PolfuseError: the server does not start.
    """

    device = DEVICE

    def __init__(self, source: Source, *, faults: FaultScript | None = None, timeout_s: float = 10.0) -> None:
        self._source = source
        self._rate = round(source.audio.sample_rate_hz)
        self.period_frames = round(PERIOD_S * self._rate)
        self._faults = CardFaults(faults)
        self._daemon = Daemon("jackd")
        self._server = self._daemon.directory.name
        self._timeout_s = timeout_s
        self.environment = {"JACK_DEFAULT_SERVER": self._server, "JACK_NO_START_SERVER": "1"}
        self._client: Any = None
        self.failure: BaseException | None = None
        self._origin = self._number = 0
        self._anchor_ns = 0
        self.plug_in()

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._daemon.pid

    def plug_in(self) -> None:
        """Start the server and the client: at first, and again after :meth:`kill`, at the same address.

        Raises:
            PolfuseError: the server does not start.
        """
        self._hang_up()
        dummy = ["-d", "dummy", "-r", str(self._rate), "-p", str(self.period_frames), "-C", "2", "-P", "2"]
        self._daemon.start(
            ["jackd", "-r", "-n", self._server, *dummy],
            {**self.environment, "JACK_NO_AUDIO_RESERVATION": "1"},
            self._connect,
            timeout_s=self._timeout_s,
            advice="use the simulated rig with audio = 'tcp'",
        )
        self._ports = [self._client.outports.register(f"out_{name}") for name in ("beat", "sync")]
        self._client.set_process_callback(self._cycle)
        self._number, self._anchor_ns = 0, 0
        self._client.activate()

    def _connect(self) -> bool:
        jack: Any = importlib.import_module("jack")
        jack.set_error_function(lambda _: None)
        jack.set_info_function(lambda _: None)
        try:
            self._client = jack.Client(self.device, no_start_server=True, servername=self._server)
        except jack.JackOpenError:
            return False
        return True

    def _cycle(self, frames: int) -> None:
        """Play one cycle; called by JACK's thread, which it must not delay."""
        try:
            client = self._client
            if client is None:
                return
            now_ns, number = time.monotonic_ns(), client.last_frame_time
            if not self._anchor_ns:
                self._origin, self._number, self._anchor_ns = number, number, now_ns
            # JACK's counter has 32 bits.
            self._number += (number - self._number) % 2**32
            first = self._number - self._origin
            t_ns = self._anchor_ns + round(first / self._rate * 1e9)
            if abs(now_ns - t_ns) > RESYNC_S * 1e9:
                self._anchor_ns += now_ns - t_ns
                t_ns = now_ns
            # A cycle plays what was sampled before it.
            samples = self._source.block(first, frames, t_ns - round(frames / self._rate * 1e9))
            samples = self._faults.content(samples, first, self._source.audio.sync_channel)
            volts = samples.astype(np.float32)
            if samples.dtype.kind == "i":
                volts /= np.float32(2.0 ** (8 * samples.dtype.itemsize - 1))
            for port, channel in zip(self._ports, volts.T, strict=True):
                port.get_array()[:] = channel
        except BaseException as error:
            self.failure = error
            raise

    def kill(self) -> None:
        """Fault: end the server at once, as if the sound card had been unplugged."""
        self._daemon.kill()

    def close(self) -> None:
        """End client and server. Idempotent."""
        self._hang_up()
        self._daemon.close()

    def _hang_up(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(Exception):
                client.deactivate()
            with contextlib.suppress(Exception):
                client.close()
