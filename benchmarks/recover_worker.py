"""Rescues one file after another: ``python -m benchmarks.recover_worker``; the campaign's other end starts it.

Each line of the standard input is a file; the answer is a line of JSON: ``ok``, ``refused`` or ``failed``, why, and the
memory that the process occupies. What :func:`polfuse_lab.session.recover` does for each file in a process of its own is
done here in one for many, since starting processes would take most of the time.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import open_session
from polfuse_lab.session.recovery import EXPECTED, copy_whole_records


def main() -> None:
    """Serve until the standard input ends."""
    for line in sys.stdin:
        damaged = Path(line.rstrip("\n"))
        out = damaged.with_name(f"{damaged.name}.rescued.h5")
        out.unlink(missing_ok=True)
        kind, why = "ok", ""
        try:
            copy_whole_records(damaged, out)
            with open_session(out) as session:
                for index in range(len(session.sweeps)):
                    session.audio(index)
        except PolfuseError as error:
            kind, why = "refused", str(error)
        except EXPECTED as error:
            # What 'recover' turns into one sentence.
            kind, why = "refused", f"{type(error).__name__}: {error}"
        except Exception as error:
            kind, why = "failed", f"{type(error).__name__}: {error}"
        left = [path.name for path in damaged.parent.glob(f"{damaged.name}*.recovering")]
        if left:
            kind, why = "failed", f"left behind: {left[0]}"
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        print(json.dumps([kind, why[:300], pages * os.sysconf("SC_PAGE_SIZE")]), flush=True)


if __name__ == "__main__":
    main()
