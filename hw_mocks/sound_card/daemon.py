"""A sound server of the simulator's own, which never outlives it."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from polfuse_lab.errors import PolfuseError

# The shell outlives a killed simulator just long enough to end the server: its standard input is then at its end.
SCRIPT = '"$@" </dev/null & pid=$!; echo $pid; cat >/dev/null; kill $pid; wait $pid; rm -rf -- "$POLFUSE_SOUND"'


class Daemon:
    """A server process with a directory of its own (:attr:`directory`), from :meth:`start` to :meth:`close`."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.directory = Path(tempfile.mkdtemp(prefix=f"polfuse-{name}-"))
        self._shell: subprocess.Popen[bytes] | None = None
        self.pid = 0

    def start(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        ready: Callable[[], bool],
        *,
        timeout_s: float,
        advice: str,
    ) -> None:
        """Start the server (again, if it has ended) and wait until it is ready.

        Raises:
            PolfuseError: it does not get ready in time; the last line that it said is told. It is ended.
        """
        self._end()
        own = {"HOME": str(self.directory), "POLFUSE_SOUND": str(self.directory)}
        with (self.directory / "log").open("wb") as log:
            self._shell = subprocess.Popen(
                ["sh", "-c", SCRIPT, "sh", *command],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env={**os.environ, **environment, **own},
                # Ctrl-C at the terminal is for the simulator, which then ends its server in order.
                start_new_session=True,
            )
        assert self._shell.stdout is not None
        self.pid = int(self._shell.stdout.readline())
        deadline = time.monotonic() + timeout_s
        while not ready():
            if time.monotonic() > deadline:
                said = (self.directory / "log").read_text(encoding="utf-8", errors="replace").strip()
                self.close()
                raise PolfuseError(
                    f"does not start ({said.splitlines()[-1] if said else 'it says nothing'})",
                    where=self._name,
                    advice=advice,
                )
            time.sleep(0.005)

    def kill(self) -> None:
        """Fault: end the server at once, as if the sound card had been unplugged."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def close(self) -> None:
        """End the server and remove its directory. Idempotent."""
        self._end()
        shutil.rmtree(self.directory, ignore_errors=True)

    def _end(self) -> None:
        shell, self._shell = self._shell, None
        if shell is None:
            return
        kept = self.directory.is_dir()
        assert shell.stdin is not None
        shell.stdin.close()
        try:
            shell.wait(timeout=3)
        except subprocess.TimeoutExpired:
            self.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                shell.wait(timeout=3)
        if shell.stdout is not None:
            shell.stdout.close()
        if kept:
            # The shell has removed it; a restarted server needs it again.
            self.directory.mkdir(mode=0o700, exist_ok=True)
