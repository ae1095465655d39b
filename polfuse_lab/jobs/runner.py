"""``python -m polfuse_lab.jobs.runner WORD…``: one command of ``polfuse``, whose progress is told to a program.

On standard output come JSON objects, one a line: ``{"told": words, "fraction": …, "left_s": …}`` and, at the end,
``{"result": …}``. Standard error is that of the command, and so is the exit status.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import threading

from polfuse_lab.priority import give_way

NICE = 10
"""Work in the background gives way to a collect."""


def main(words: list[str]) -> int:
    """Run the command; its exit status."""
    give_way(NICE)
    threading.Thread(target=_end_with_owner, name="owner", daemon=True).start()
    out = sys.stdout
    from polfuse_lab.cli import build
    from polfuse_lab.cli.output import listen

    def say(what: dict[str, object]) -> None:
        print(json.dumps(what), file=out, flush=True)

    listen(lambda told, fraction, left_s: say({"told": told, "fraction": fraction, "left_s": left_s}))
    written = io.StringIO()
    status = 0
    try:
        with contextlib.redirect_stdout(written):
            build()(args=[*words, "--json", "--debug"], prog_name="polfuse")
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    lines = written.getvalue().strip().splitlines()
    if lines:
        with contextlib.suppress(ValueError):
            say({"result": json.loads(lines[-1])})
    return status


def _end_with_owner() -> None:
    """A job whose window has gone would be put into its place by nobody."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    # Threads of libraries must not keep a job that is done.
    os._exit(code)
