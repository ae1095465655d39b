"""Every comparison with a program of somebody else's stands in one table, and one command runs all of them again."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.__main__ import main, names
from benchmarks.peers import PEERS, PROGRAMS, peer_rows, program, table
from benchmarks.rows import Row

ROOT = Path(__file__).resolve().parents[2]


def page_table() -> list[list[str]]:
    """Rows of the page's table of peers, by cells."""
    page = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    section = page.partition("## Peers\n")[2].partition("\n## ")[0]
    lines = [line.strip("| ").split(" |") for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line] for line in lines[2:]]


def test_the_page_lists_every_benchmark_with_a_peer_and_no_other() -> None:
    told = [row[-1].strip("`") for row in page_table()]
    assert set(told) == set(PEERS)
    assert set(PEERS) <= set(names())


def test_no_other_benchmark_names_a_program_as_its_peer() -> None:
    for name in set(names()) - set(PEERS):
        source = (ROOT / "benchmarks" / f"{name.replace('.', '_', 1)}.py").read_text(encoding="utf-8")
        # Peers are string literals that begin with the program's name.
        found = [word for word in PROGRAMS if re.search(rf'"(?:textbook[^"]*)?{word}', source)]
        assert not found, f"{name} compares with {found}"


def test_every_program_of_the_page_is_known() -> None:
    page = page_table()
    for word in PROGRAMS:
        assert any(word in row[1] for row in page), word
    peers = [row[1] for row in page if row[1] != "the same"]
    assert all(any(word in peer for word in PROGRAMS) for peer in peers)


def test_the_table_holds_what_is_compared_and_with_which_version() -> None:
    rows = [
        Row("a", "SciPy's uniform filters", 1.5, True, "faster | better", 1.2, 1.8, 1e-3, "worse"),
        Row("b", "the limit", 2.0, True, ""),
        Row("c", "Aravis 0.8", None, True, "none missing", error="600 frames"),
        Row("d", "torchbp", None, True, "not compared: no such package"),
    ]
    assert [program(row) for row in rows] == ["SciPy", None, "Aravis", "torchbp"]
    assert [row.name for row in peer_rows(rows)] == ["a", "c", "d"]
    lines = table(rows).splitlines()
    assert len(lines) == 5
    assert all(line.count("|") == 7 for line in lines)
    assert re.match(
        r"\| a \| SciPy's uniform filters, scipy [\d.]+ \| 1.5 \(1.2 to 1.8\) \| 0.001 \| worse \|", lines[2]
    )
    assert "not compared" in lines[4]


def test_names_beside_peers_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--peers", "speed.mosaic"])
    assert ended.value.code == 2
    assert "leave the names out" in capsys.readouterr().err
