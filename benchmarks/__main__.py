"""Runs benchmarks by name, such as ``python -m benchmarks reliability.fuzz --quick``."""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import sys
from dataclasses import asdict

import benchmarks
from benchmarks.peers import PEERS, table
from benchmarks.rows import Row

GROUPS = ("speed", "accuracy", "reliability")


def names() -> list[str]:
    """Names of all benchmarks, sorted."""
    modules = [module.name for module in pkgutil.iter_modules(benchmarks.__path__)]
    return sorted(name.replace("_", ".", 1) for name in modules if name.partition("_")[0] in GROUPS)


def run(name: str, *, quick: bool) -> list[Row]:
    """Run one benchmark. Raises KeyError for an unknown name."""
    if name not in names():
        raise KeyError(name)
    module = importlib.import_module(f"benchmarks.{name.replace('.', '_', 1)}")
    rows: list[Row] = module.run(quick)
    return rows


def _line(row: Row) -> str:
    ratio = "" if row.ratio is None else f"  {row.ratio:.3g} of {row.peer or 'the limit'}"
    error = "" if row.error is None else f"  error {row.error}"
    return f"{'ok  ' if row.ok else 'FAIL'} {row.name}{ratio}{error}  ({row.target})"


def main(arguments: list[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit status: 1 when a row is not ok, 2 for wrong usage."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names())}; all if left out")
    parser.add_argument("--quick", action="store_true", help="a short version of each")
    parser.add_argument(
        "--peers", action="store_true", help="those that compare with programs of others, and one table of these"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.parse_args(arguments)
    unknown = sorted(set(given.names) - set(names()))
    if unknown:
        parser.error(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(names())}")
    if given.peers and given.names:
        parser.error("--peers chooses the benchmarks itself: leave the names out")
    rows: list[Row] = []
    for name in PEERS if given.peers else given.names or names():
        print(f"{name} ...", file=sys.stderr, flush=True)
        for row in run(name, quick=given.quick):
            rows.append(row)
            if not given.json:
                print(_line(row), flush=True)
    if given.json:
        print(json.dumps({"rows": [asdict(row) for row in rows]}))
    elif given.peers:
        print(table(rows))
    return 0 if all(row.ok for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
