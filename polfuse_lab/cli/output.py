"""How every command speaks: one JSON object or a few lines on stdout, everything else on stderr, errors in one line."""

from __future__ import annotations

import functools
import json
import sys
import traceback
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec

import typer

from polfuse_lab.plain import plain

if TYPE_CHECKING:
    from polfuse_lab.scale.progress import Progress

Arguments = ParamSpec("Arguments")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show a traceback when something fails.")]


Listener = Callable[[str, float | None, float | None], None]
_listener: Listener | None = None


def listen(listener: Listener | None) -> None:
    """Have every line of progress also told to a program: in words, as a fraction (0 to 1) and as seconds left."""
    global _listener
    _listener = listener


def progress(message: str, fraction: float | None = None, left_s: float | None = None) -> None:
    """One line for the user on stderr.

    Args:
        message: the line.
        fraction: how much of the whole is done, 0 to 1, where that is known.
        left_s: seconds that the rest will take, where that is known.
    """
    print(message, file=sys.stderr, flush=True)
    if _listener is not None:
        _listener(message, fraction, left_s)


def counted(told: Progress) -> None:
    """Progress of a run that counts what it has done, as a line."""
    progress(str(told), told.done / max(told.total, 1), told.remaining_s)


def result(values: Mapping[str, Any], *, as_json: bool, text: str) -> None:
    """The outcome of a command: ``values`` as one JSON object, or ``text`` for people."""
    print(json.dumps(plain(values), allow_nan=False) if as_json else text, flush=True)


def guarded(function: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """Turn the failures of a command into one line on stderr and exit status 1; Ctrl-C into 130.

    The command must take ``debug: Debug``.
    """

    @functools.wraps(function)
    def run(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        try:
            function(*args, **kwargs)
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except KeyboardInterrupt:
            progress("stopped by the user")
            raise typer.Exit(130) from None
        except BrokenPipeError:
            # The reader of stdout went away (head, a closed pager); nobody is left to be told.
            sys.stderr.close()
            raise typer.Exit(1) from None
        except Exception as error:
            if kwargs.get("debug"):
                traceback.print_exc()
            progress(f"error: {_words(error)}")
            raise typer.Exit(1) from None

    return run


def _words(error: Exception) -> str:
    from drivers.errors import DeviceError
    from polfuse_lab.errors import PolfuseError
    from processing.errors import DataError

    if isinstance(error, (PolfuseError, DeviceError, DataError)):
        return str(error)
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}; check the path, its permissions and the space on the disk"
    return f"{type(error).__name__}: {error}; this is a defect of the program: run again with --debug and report it"
