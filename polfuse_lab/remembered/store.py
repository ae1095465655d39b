"""Small JSON files in the user's data folder that survive a crash, and whose damage costs their content only."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from drivers.user_data import user_data_folder

lock = threading.RLock()
"""Held by whoever reads a file in order to write it."""


def read(name: str, version: int) -> tuple[dict[str, Any], str]:
    """Content of a file, and what is wrong with it.

    A file that is damaged is renamed, so that it can be looked at, and counts as empty; one of a newer version is left
    as it is.

    Args:
        name: the file's name in the user's data folder.
        version: newest version that is understood.

    Returns:
        The content (empty where there is none), and one sentence, empty when all is well.
    """
    path = user_data_folder() / name
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or not isinstance(content.get("version"), int):
            raise ValueError("it holds something else")
    except FileNotFoundError:
        return {}, ""
    except OSError as error:
        return {}, f"{path} cannot be read ({error.strerror}): nothing is remembered"
    except (ValueError, RecursionError) as error:
        aside = path.with_name(f"{path.stem}-damaged-{time.strftime('%Y%m%d-%H%M%S')}{path.suffix}")
        with contextlib.suppress(OSError):
            os.replace(path, aside)
        return {}, f"{path} was damaged ({error}): what it held is forgotten, and kept as {aside.name}"
    if content["version"] > version:
        return {}, f"{path} was written by a newer version of this program: what it holds is not used"
    return content, ""


def write(name: str, version: int, content: dict[str, Any]) -> str:
    """Replace a file in one step; why that was not possible, or an empty text. A newer version's file is left alone."""
    folder = user_data_folder()
    path = folder / name
    try:
        with contextlib.suppress(FileNotFoundError, ValueError):
            held = json.loads(path.read_text(encoding="utf-8"))
            if isinstance(held, dict) and isinstance(held.get("version"), int) and held["version"] > version:
                return f"{path} was written by a newer version of this program and is left alone"
        folder.mkdir(parents=True, exist_ok=True)
        handle, fresh = tempfile.mkstemp(prefix=f".{name}.", dir=folder)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                json.dump({"version": version, **content}, stream, indent=1)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(fresh, path)
        except BaseException:
            Path(fresh).unlink(missing_ok=True)
            raise
    except OSError as error:
        return f"{path} cannot be written ({error.strerror}): what it should hold is forgotten at the end"
    return ""
