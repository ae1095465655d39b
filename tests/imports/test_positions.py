import pytest
from hypothesis import given
from hypothesis import strategies as st

from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.positions import Stop, Wishes, place


def stops(lengths, *, gap=1.0, repeats=(), moved=(), gaps=None):
    """Stops with those lengths; ``repeats`` and ``moved`` count from 1 as users do."""
    made, at = [], 0.5
    for index, length in enumerate(lengths):
        made.append(
            Stop(at, at + length, repeats_previous=index + 1 in repeats, moved=index + 1 in moved, usable=length > 0.1)
        )
        at += length + (gaps or {}).get(index + 1, gap)
    return made


def positions(placed):
    return [(item.burst, item.position, item.attempt) for item in placed]


def test_plain_bursts_are_positions_in_order():
    placed, notes = place(stops([1.0, 1.2, 0.8]), Wishes(), "a.wav")
    assert positions(placed) == [(0, 0, 0), (1, 1, 0), (2, 2, 0)]
    assert notes == []


@pytest.mark.parametrize(("lengths", "kept"), [([0.2, 1, 1, 1], [1, 2, 3]), ([1, 1, 1, 0.3], [0, 1, 2])])
def test_a_fragment_at_an_end_is_left_out_and_told(lengths, kept):
    placed, notes = place(stops(lengths), Wishes(), "a.wav")
    assert [item.burst for item in placed] == kept
    assert [item.position for item in placed] == [0, 1, 2]
    assert len(notes) == 1
    assert "left out" in notes[0]
    # Unless the user says that it is one of the positions.
    placed, _ = place(stops(lengths), Wishes(positions=4), "a.wav")
    assert len(placed) == 4


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (stops([1, 1, 0.3, 1, 1]), r"burst 3 \(4.50 to 4.80 s\) is 0.30 s long, others 1.00 s"),
        (stops([1] * 5, repeats=(4,)), "burst 4 .* looks like burst 3"),
        (stops([1, 1, 2.5, 1, 1], moved=(3,)), "burst 3 .* as if the cart had moved"),
    ],
)
def test_doubt_is_reported_and_settled_by_the_user(made, words):
    with pytest.raises(PolfuseError, match=words) as caught:
        place(made, Wishes(), "hv.wav")
    assert str(caught.value).startswith("hv.wav: ")
    assert "--positions" in str(caught.value)
    # All five are positions, or four of them.
    assert len(place(made, Wishes(positions=5), "hv.wav")[0]) == 5
    placed, notes = place(made, Wishes(positions=4), "hv.wav")
    assert placed[-1].position == 3
    assert len(notes) == 1
    with pytest.raises(PolfuseError, match="6 positions expected"):
        place(made, Wishes(positions=6), "hv.wav")


def test_named_bursts_are_left_out_or_repeat():
    made = stops([1, 1, 0.3, 1, 1], repeats=(5,))
    placed, notes = place(made, Wishes(drop=frozenset({3}), repeats=frozenset({5})), "a.wav")
    assert positions(placed) == [(0, 0, 0), (1, 1, 0), (3, 2, 0), (4, 2, 1)]
    assert notes == []


def test_two_kinds_of_doubt_need_more_than_a_number():
    # Leaving the short one out and taking the repeat for one both give five positions.
    made = stops([1, 1, 0.3, 1, 1, 1], repeats=(6,))
    with pytest.raises(PolfuseError, match="not clear"):
        place(made, Wishes(positions=5), "a.wav")
    assert place(made, Wishes(positions=4), "a.wav")[0][-1].position == 3
    assert place(made, Wishes(positions=5, drop=frozenset({3})), "a.wav")[0][-1].position == 4


def test_a_long_silence_is_told():
    _, notes = place(stops([1] * 5, gaps={3: 9.0}), Wishes(), "a.wav")
    assert len(notes) == 1
    assert "before burst 4 lasts 9.0 s, others 1.0 s" in notes[0]


@pytest.mark.parametrize(
    ("made", "wishes", "words"),
    [
        (stops([10.0]), Wishes(), "1 burst .* --as wav"),
        ([], Wishes(), "0 burst"),
        (stops([1, 1]), Wishes(drop=frozenset({3})), "--drop 3, but there are 2"),
        (stops([1, 1]), Wishes(repeats=frozenset({0})), "--repeats 0"),
        (stops([1, 1]), Wishes(repeats=frozenset({1})), "repeats nothing"),
        (stops([1, 1]), Wishes(drop=frozenset({2}), repeats=frozenset({2})), "both left out and a repeat"),
        (stops([1, 1]), Wishes(drop=frozenset({2})), "1 position is left"),
        (stops([1, 1]), Wishes(drop=frozenset({1, 2})), "0 position is left"),
        (stops([1, 1, 1]), Wishes(positions=61), "holds 3 positions, 61 are expected"),
        (stops([1, 0.05, 1]), Wishes(positions=3), "burst 2 .* no whole up-ramp; leave it out with --drop 2"),
    ],
)
def test_what_cannot_be_is_refused_in_words(made, wishes, words):
    with pytest.raises(PolfuseError, match=words):
        place(made, wishes, "a.wav")


@given(
    lengths=st.lists(st.floats(0.0, 5.0), max_size=12),
    marks=st.lists(st.sampled_from(["", "repeat", "moved"]), min_size=12, max_size=12),
    expected=st.none() | st.integers(0, 13),
    drop=st.frozensets(st.integers(0, 13), max_size=3),
    repeats=st.frozensets(st.integers(0, 13), max_size=3),
)
def test_positions_are_without_holes_or_refused(lengths, marks, expected, drop, repeats):
    numbered = list(enumerate(marks, 1))
    made = stops(
        lengths,
        repeats=[number for number, mark in numbered if mark == "repeat"],
        moved=[number for number, mark in numbered if mark == "moved"],
    )
    try:
        placed, _ = place(made, Wishes(expected, drop, repeats), "a.wav")
    except PolfuseError:
        return
    seen = [item.position for item in placed]
    assert seen == sorted(seen)
    assert set(seen) == set(range(max(seen) + 1))
    assert expected is None or max(seen) + 1 == expected
    assert not drop & {item.burst + 1 for item in placed}
    assert len({(item.position, item.attempt) for item in placed}) == len(placed)
