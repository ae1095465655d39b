"""A private PulseAudio server whose source is a FIFO: the simulator's samples reach PortAudio as from a sound card."""

from __future__ import annotations

import contextlib
import errno
import os

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card.daemon import Daemon
from hw_mocks.sound_card.paths import alsa_environment
from hw_mocks.sound_card.sample_formats import PULSE_NAMES, SampleFormat, encode, frame_bytes

DEVICE = "polfuse_radar"
BACKLOG_S = 1.0
PIPE_S = 0.02
"""Length of the FIFO: short, since its content is what a recorder gets first."""


class PulseSource:
    """A :class:`hw_mocks.sound_card.feeder.Sink` into a PulseAudio server of its own, on a private socket.

    ``device`` and ``environment`` are the options with which :class:`drivers.radar.sound_port.SoundPort` reaches it.

    Args:
        sample_rate_hz: rate at which the server runs its source, Hz; a recorder at another rate gets resampled samples.
        sample_format: the source's own sample format.
        timeout_s: time for the server to start, s.

    Raises:
        PolfuseError: the server does not start.
    """

    device = DEVICE

    def __init__(
        self, sample_rate_hz: float, *, sample_format: SampleFormat = "int16", timeout_s: float = 10.0
    ) -> None:
        self._rate = sample_rate_hz
        self._format: SampleFormat = sample_format
        self._frame = frame_bytes(sample_format)
        self._timeout_s = timeout_s
        self._pending = bytearray()
        self._pipe = -1
        self._written = 0
        self.lost_frames = 0
        self._daemon = Daemon("pulseaudio")
        self._socket = self._daemon.directory / "native"
        self._fifo = self._daemon.directory / "samples"
        conf = self._daemon.directory / "asound.conf"
        private = {
            "XDG_RUNTIME_DIR": str(self._daemon.directory),
            "PULSE_COOKIE": str(self._daemon.directory / "cookie"),
            "PULSE_SERVER": f"unix:{self._socket}",
        }
        self._conf = conf
        self.environment = {**alsa_environment(conf), **private}
        self.plug_in()

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._daemon.pid

    def plug_in(self) -> None:
        """Start the server: at first, and again after :meth:`kill`, at the same address.

        Raises:
            PolfuseError: it does not start.
        """
        self._hang_up()
        for stale in (self._socket, self._fifo):
            stale.unlink(missing_ok=True)
        self._daemon.start(
            self._command(),
            self.environment,
            lambda: self._socket.exists() and self._fifo.exists(),
            timeout_s=self._timeout_s,
            advice="use the simulated rig with audio = 'tcp'",
        )
        self._conf.write_text(
            f'pcm.{DEVICE} {{ type pulse server "unix:{self._socket}" device "{DEVICE}" '
            f'hint {{ show on description "{DEVICE}" }} }}\n',
            encoding="utf-8",
        )
        self._pending.clear()
        self._written = 0
        self._pipe = os.open(self._fifo, os.O_RDWR | os.O_NONBLOCK)
        self._shorten()

    def _command(self) -> list[str]:
        rate = f"rate={self._rate:.0f} channels=2 format={PULSE_NAMES[self._format]}"
        return [
            "pulseaudio",
            *("-n", "--daemonize=no", "--use-pid-file=no", "--exit-idle-time=-1", "--realtime=no"),
            *("--high-priority=no", "--disable-shm=yes", "--log-target=stderr", "--log-level=error"),
            *("-L", f"module-native-protocol-unix socket={self._socket} auth-anonymous=1"),
            *("-L", f"module-pipe-source source_name={DEVICE} file={self._fifo} {rate}"),
        ]

    def _shorten(self) -> None:
        import fcntl

        wanted = 4096
        while wanted < PIPE_S * self._rate * self._frame:
            wanted *= 2
        with contextlib.suppress(OSError, AttributeError):
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, wanted)

    def put(self, samples: NDArray[np.generic], first: int, t_ns: int) -> None:
        """Write a block; see :class:`hw_mocks.sound_card.feeder.Sink`."""
        self._pending += encode(samples, self._format)
        surplus = len(self._pending) - int(BACKLOG_S * self._rate) * self._frame
        if surplus > 0:
            # Nobody listens, or the server stalls. The head may belong to a frame that is half in the pipe: whole
            # frames after it are dropped.
            head = (-self._written) % self._frame
            dropped = (surplus + self._frame - 1) // self._frame * self._frame
            del self._pending[head : head + dropped]
            self.lost_frames += dropped // self._frame
        self.flush()

    def flush(self) -> bool:
        """Write what fits into the FIFO; whether anything still waits."""
        while self._pending and self._pipe >= 0:
            try:
                count = os.write(self._pipe, self._pending)
            except OSError as error:
                if error.errno in (errno.EAGAIN, errno.EINTR):
                    break
                raise
            self._written += count
            del self._pending[:count]
        return bool(self._pending)

    def kill(self) -> None:
        """Fault: end the server at once, as if the sound card had been unplugged."""
        self._daemon.kill()

    def unplug(self) -> None:
        """Fault: the same; see :class:`hw_mocks.sound_card.feeder.Sink`."""
        self._daemon.kill()
        self._hang_up()

    def close(self) -> None:
        """End the server and remove its files. Idempotent."""
        self._hang_up()
        self._daemon.close()

    def _hang_up(self) -> None:
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1
