"""A private PulseAudio server whose source is a FIFO: the simulator's samples reach PortAudio as from a sound card."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card.paths import alsa_environment
from polfuse_lab.errors import PolfuseError

DEVICE = "polfuse_radar"
BACKLOG_S = 1.0
PIPE_S = 0.02
"""Length of the FIFO: short, since its content is what a recorder gets first."""

# The shell outlives a killed simulator just long enough to end the server: its standard input is then at its end.
SCRIPT = (
    'pulseaudio "$@" </dev/null & pid=$!; echo $pid; cat >/dev/null; kill $pid; wait $pid; rm -rf -- "$POLFUSE_PULSE"'
)


class PulseSource:
    """A :class:`hw_mocks.sound_card.feeder.Sink` into a PulseAudio server of its own, on a private socket.

    ``device`` and ``environment`` are the options with which :class:`drivers.radar.sound_port.SoundPort` reaches it.

    Raises:
        PolfuseError: the server does not start.
    """

    device = DEVICE

    def __init__(self, sample_rate_hz: float, *, timeout_s: float = 10.0) -> None:
        self._rate = sample_rate_hz
        self._pending = bytearray()
        self._pipe = -1
        self.lost_frames = 0
        self._directory = Path(tempfile.mkdtemp(prefix="polfuse-pulse-"))
        conf = self._directory / "asound.conf"
        socket = self._directory / "native"
        conf.write_text(
            f'pcm.{DEVICE} {{ type pulse server "unix:{socket}" device "{DEVICE}" '
            f'hint {{ show on description "{DEVICE}" }} }}\n',
            encoding="utf-8",
        )
        private = {"XDG_RUNTIME_DIR": str(self._directory), "PULSE_COOKIE": str(self._directory / "cookie")}
        self.environment = {**alsa_environment(conf), **private}
        self._shell = self._launch(socket, sample_rate_hz)
        assert self._shell.stdout is not None
        self.pid = int(self._shell.stdout.readline())
        self._await(socket, timeout_s)
        self._pipe = os.open(self._fifo, os.O_RDWR | os.O_NONBLOCK)
        self._shorten()

    @property
    def _fifo(self) -> Path:
        return self._directory / "samples"

    def _launch(self, socket: Path, rate: float) -> subprocess.Popen[bytes]:
        source = f"source_name={DEVICE} file={self._fifo} format=s16le rate={rate:.0f} channels=2"
        arguments = [
            *("-n", "--daemonize=no", "--use-pid-file=no", "--exit-idle-time=-1", "--realtime=no"),
            *("--high-priority=no", "--disable-shm=yes", "--log-target=stderr", "--log-level=error"),
            *("-L", f"module-native-protocol-unix socket={socket} auth-anonymous=1"),
            *("-L", f"module-pipe-source {source}"),
        ]
        home = {"HOME": str(self._directory), "POLFUSE_PULSE": str(self._directory)}
        with (self._directory / "log").open("wb") as log:
            return subprocess.Popen(
                ["sh", "-c", SCRIPT, "sh", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env={**os.environ, **self.environment, **home},
                # Ctrl-C at the terminal is for the simulator, which then ends its server in order.
                start_new_session=True,
            )

    def _await(self, socket: Path, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while not (socket.exists() and self._fifo.exists()):
            if time.monotonic() > deadline:
                said = (self._directory / "log").read_text(encoding="utf-8", errors="replace").strip()
                self.close()
                raise PolfuseError(
                    f"does not start ({said.splitlines()[-1] if said else 'it says nothing'})",
                    where="pulseaudio",
                    advice="use the simulated rig with audio = 'tcp'",
                )
            time.sleep(0.005)

    def _shorten(self) -> None:
        import fcntl

        wanted = 4096
        while wanted < PIPE_S * self._rate * 4:
            wanted *= 2
        with contextlib.suppress(OSError, AttributeError):
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, wanted)

    def put(self, samples: NDArray[np.int16], first: int, t_ns: int) -> None:
        """Write a block; see :class:`hw_mocks.sound_card.feeder.Sink`."""
        self._pending += np.ascontiguousarray(samples, dtype="<i2").tobytes()
        surplus = len(self._pending) - int(BACKLOG_S * self._rate) * 4
        if surplus > 0:
            # Nobody listens, or the server stalls. The head may belong to a frame that is half in the pipe: whole
            # frames after it are dropped.
            head = (-self._written) % 4
            dropped = (surplus + 3) // 4 * 4
            del self._pending[head : head + dropped]
            self.lost_frames += dropped // 4
        self.flush()

    _written = 0

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
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def close(self) -> None:
        """End the server and remove its files. Idempotent."""
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1
        if self._shell.stdin is not None:
            self._shell.stdin.close()
        try:
            self._shell.wait(timeout=3)
        except subprocess.TimeoutExpired:
            self.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._shell.wait(timeout=3)
        if self._shell.stdout is not None:
            self._shell.stdout.close()
        shutil.rmtree(self._directory, ignore_errors=True)
