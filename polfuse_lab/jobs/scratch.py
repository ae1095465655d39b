"""A job's own folder: what it makes is made there and put into its place in one step, or thrown away as a whole."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import socket
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from polfuse_lab.errors import PolfuseError
from polfuse_lab.jobs.specs import JobSpec, Made

PREFIX = ".polfuse-job-"
REMOVE_S = 1.0
"""How long whatever still writes into a folder that is thrown away is waited for, s."""


class Scratch:
    """Folders beside the places where a job's results go (on their disks, so that they can be moved in one step).

    A products file that the job changes is there under its own name, as a second name of the same file: stages are
    never changed in place, so the original stays as it is until the end.

    Args:
        spec: the job.

    Raises:
        PolfuseError: a folder cannot be written.
    """

    def __init__(self, spec: JobSpec) -> None:
        self._folders: dict[Path, Path] = {}
        self._before: dict[Path, tuple[int, int, int]] = {}
        self.words: list[str] = []
        """The command with paths in these folders."""
        try:
            for word in spec.words:
                self.words.append(str(self._place(word)) if isinstance(word, Made) else word)
        except PolfuseError:
            self.discard()
            raise
        except OSError as error:
            self.discard()
            raise PolfuseError(
                f"cannot be written to ({error.strerror})",
                where=str(error.filename or "the folder"),
                advice="choose another folder, or check its permissions and the space on the disk",
            ) from error

    def _place(self, made: Made) -> Path:
        path, home = made.path, made.path.parent
        if made.how == "new" and path.exists():
            raise PolfuseError("is there already", where=str(path), advice="choose another name")
        if home not in self._folders:
            _sweep(home)
            self._folders[home] = Path(tempfile.mkdtemp(prefix=f"{_own_prefix()}{os.getpid()}-", dir=home))
        inside = self._folders[home] / path.name
        if made.how == "changed" and path.is_file() and not inside.exists():
            self._before[path] = _stamp(path)
            try:
                os.link(path, inside)
            except OSError:
                shutil.copy2(path, inside)
        return inside

    def adopt(self) -> list[Path]:
        """Put everything into its place; where it is now.

        Raises:
            PolfuseError: a file that the job changed was changed by somebody else meanwhile, or cannot be replaced.
        """
        for path, before in self._before.items():
            if not path.exists() or _stamp(path) != before:
                raise PolfuseError(
                    "was changed by another program while the job was at work",
                    where=str(path),
                    advice="run the job again: what is in the file now is the other program's",
                )
        placed = []
        for home, folder in self._folders.items():
            for item in sorted(folder.rglob("*")):
                if not item.is_file() or item.name.endswith(".lock"):
                    continue
                target = home / item.relative_to(folder)
                if target in self._before and item.samefile(target):
                    continue  # never changed
                try:
                    target.parent.mkdir(parents=True, exist_ok=True)
                    os.replace(item, target)
                except OSError as error:
                    raise PolfuseError(
                        f"cannot be put into its place ({error.strerror})",
                        where=str(target),
                        advice="close the programs that hold it and run the job again",
                    ) from error
                placed.append(target)
        self.discard()
        return placed

    def discard(self) -> None:
        """Throw everything away. Never raises."""
        end = time.monotonic() + REMOVE_S
        for folder in self._folders.values():
            while folder.exists():
                with contextlib.suppress(OSError):
                    shutil.rmtree(folder)
                if time.monotonic() > end:
                    break
                if folder.exists():
                    time.sleep(0.02)

    def told(self, value: Any) -> Any:
        """A result with the paths that things have now."""
        if isinstance(value, str):
            for home, folder in self._folders.items():
                value = value.replace(str(folder), str(home))
            return value
        if isinstance(value, Mapping):
            return {key: self.told(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.told(item) for item in value]
        return value


def _own_prefix() -> str:
    """Of this computer: a folder on the network may hold the scratch folders of others."""
    return f"{PREFIX}{hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]}-"


def _sweep(home: Path) -> None:
    """Remove what jobs left whose program was killed. Never raises."""
    if os.name != "posix":
        return
    for folder in home.glob(f"{_own_prefix()}*"):
        number = folder.name.removeprefix(_own_prefix()).partition("-")[0]
        if not number.isdigit():
            continue
        try:
            os.kill(int(number), 0)
        except ProcessLookupError:
            with contextlib.suppress(OSError):
                shutil.rmtree(folder)
        except OSError:
            continue


def _stamp(path: Path) -> tuple[int, int, int]:
    about = path.stat()
    return about.st_ino, about.st_size, about.st_mtime_ns
