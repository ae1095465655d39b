"""Fault scripts: when a fault is active is computed here by hand from its definition."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_mocks.faults import Fault, FaultKind, FaultScript, parse_fault

S = 1_000_000_000
KIND = FaultKind.SILENCE


def begun(script: FaultScript) -> int:
    """The script's origin: the next change of a fault with after_s = 0 is the origin itself."""
    change = script.next_change_ns()
    assert change is not None
    return change


def test_a_fault_by_time_is_active_from_its_begin_to_its_end_and_never_again() -> None:
    script = FaultScript([Fault(KIND, after_s=5, for_s=2)])
    origin = begun(script) - 5 * S
    assert [script.active(KIND, origin + round(t * S)) is not None for t in (0, 4.999, 5, 6.999, 7, 5.5)] == [
        False,
        False,
        True,
        True,
        False,
        False,
    ]


def test_a_fault_by_time_ends_on_time_even_if_nobody_looked_at_its_begin() -> None:
    script = FaultScript([Fault(KIND, after_s=5, for_s=2)])
    assert script.active(KIND, begun(script) + 3 * S) is None


def test_a_fault_by_count_is_active_for_exactly_its_counts() -> None:
    script = FaultScript([Fault(KIND, after_count=10, for_count=3)])
    assert [count for count in range(30) if script.active(KIND, count=count)] == [10, 11, 12]


def test_a_fault_by_count_is_over_when_the_device_counted_past_it_in_one_step() -> None:
    script = FaultScript([Fault(KIND, after_count=10, for_count=3)])
    assert script.active(KIND, count=9) is None
    assert script.active(KIND, count=13) is None
    assert script.active(KIND, count=11) is None


def test_a_fault_from_count_0_is_over_once_its_counts_have_passed() -> None:
    script = FaultScript([Fault(KIND, after_count=0, for_count=3)])
    assert script.active(KIND, count=5) is None


def test_a_fault_by_count_waits_for_a_count() -> None:
    script = FaultScript([Fault(KIND, after_count=1)])
    assert script.active(KIND) is None
    assert script.active(KIND, count=1) is not None
    assert script.active(KIND) is not None  # begun: it lasts


def test_time_and_count_mix_either_way() -> None:
    late = FaultScript([Fault(KIND, after_s=1, for_count=2)])
    origin = begun(late) - S
    assert late.active(KIND, origin, count=100) is None
    # After one second the count stands at 200: active for counts 200 and 201.
    assert [late.active(KIND, origin + S, count=count) is not None for count in (200, 201, 202)] == [True, True, False]
    counted = FaultScript([Fault(KIND, after_count=5, for_s=1)])
    assert counted.active(KIND, origin, count=4) is None
    assert counted.active(KIND, origin + 10 * S, count=5) is not None
    assert counted.active(KIND, origin + round(10.999 * S), count=6) is not None
    assert counted.active(KIND, origin + 11 * S, count=6) is None


def test_a_fault_without_begin_and_end_is_always_active_and_others_are_not() -> None:
    script = FaultScript([Fault(KIND, amount=0.5)])
    found = script.active(KIND)
    assert found is not None
    assert found.amount == 0.5
    assert script.active(FaultKind.SLOW) is None


def test_faults_are_started_and_stopped_by_hand_and_forgotten_at_a_restart() -> None:
    script = FaultScript([Fault(KIND, for_s=0)])
    assert script.active(KIND) is None  # lasts no time
    script.start(KIND, for_s=60)
    script.start(FaultKind.SLOW, after_s=60)
    assert script.active(KIND) is not None
    assert script.active(FaultKind.SLOW) is None
    script.stop(KIND)
    assert script.active(KIND) is None
    script.restart()
    assert script.active(FaultKind.SLOW) is None
    assert script.next_change_ns() is not None  # the scripted one is back, its end not yet looked at


def test_a_clock_alone_never_wakes_a_script_without_faults_to_come() -> None:
    assert FaultScript().next_change_ns() is None
    endless = FaultScript([Fault(KIND)])
    assert endless.active(KIND) is not None
    assert endless.next_change_ns() is None
    assert FaultScript([Fault(KIND, after_count=3)]).next_change_ns() is None
    timed = FaultScript([Fault(KIND, after_s=1, for_s=1)])
    assert timed.next_change_ns(begun(timed)) is None  # the end is known once the begin has been seen


def test_a_script_may_be_asked_and_changed_from_several_threads() -> None:
    script = FaultScript()
    failures: list[BaseException] = []

    def hammer() -> None:
        try:
            for count in range(500):
                script.start(KIND, for_count=1)
                script.active(KIND, count=count)
                script.stop(KIND)
        except BaseException as error:  # reported below, in the test's own thread
            failures.append(error)

    threads = [threading.Thread(target=hammer) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert not failures
    assert script.active(KIND) is None


@pytest.mark.parametrize("name", ["after_s", "for_s", "after_count", "for_count"])
@pytest.mark.parametrize("value", [-1, float("inf"), float("nan")])
def test_times_and_counts_must_be_finite_and_not_negative(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        Fault(KIND, **{name: value})  # type: ignore[arg-type]


@given(
    after=st.one_of(st.none(), st.floats(0, 1e6)),
    length=st.one_of(st.none(), st.floats(0, 1e6)),
    times=st.lists(st.floats(0, 2e6), max_size=20),
)
def test_by_time_alone_every_answer_follows_the_definition(
    after: float | None, length: float | None, times: list[float]
) -> None:
    script = FaultScript([Fault(KIND, after_s=after, for_s=length)])
    start = begun(script)
    end = None if length is None else start + round(length * 1e9)
    origin = start - round((after or 0.0) * 1e9)
    for t in sorted(times):
        now = origin + round(t * 1e9)
        assert (script.active(KIND, now) is not None) == (now >= start and (end is None or now < end))


def test_a_fault_is_read_from_one_line_of_text() -> None:
    assert parse_fault("trolley:silence:after=5s:for=2s") == ("trolley", Fault(KIND, after_s=5, for_s=2))
    assert parse_fault("camera:drop_frames:after=20:for=3:amount=0.5") == (
        "camera",
        Fault(FaultKind.DROP_FRAMES, after_count=20, for_count=3, amount=0.5),
    )
    assert parse_fault("radar:stall") == ("radar", Fault(FaultKind.STALL))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "allowed: DEVICE:KIND"),
        ("trolley", "allowed: DEVICE:KIND"),
        ("trolley:melt", "silence, garbage"),
        ("trolley:silence:before=2s", "allowed: DEVICE:KIND"),
        ("trolley:silence:after=1e3", "a number"),  # a count is a whole number
        ("trolley:silence:after=--s", "a number"),
        ("trolley:silence:after=-2s", "at least 0"),
        ("trolley:silence:after=2s:after=3s", "twice"),
    ],
)
def test_a_wrong_line_is_answered_with_what_is_allowed(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says.replace("(", r"\(")):
        parse_fault(text)
