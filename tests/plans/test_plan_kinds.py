"""Every kind of plan, its steps listed one by one for a small case (written down by hand from what each kind means)."""

from __future__ import annotations

import pytest
from plan_rig import brief_steps, plan

from polfuse_lab.plans import PLAN_KINDS, CalibrationSeriesPlan, RailSarPlan
from polfuse_lab.plans.camera import LAMP_OFF, LAMP_ON
from polfuse_lab.plans.fixed import CW_OFF, CW_ON
from polfuse_lab.plans.optics import COVER, UNCOVER
from polfuse_lab.plans.steps import Ask
from polfuse_lab.rig import FileMistake


def prompts(text: str) -> list[str]:
    return [step.prompt for step in plan(text).steps() if isinstance(step, Ask)]


def moves(text: str) -> list[str]:
    return [line for line in brief_steps(text) if line.startswith("MoveTo")]


def test_rail_sar_with_a_polarizer_series() -> None:
    text = """
        kind = "rail_sar"
        aperture_m = 0.2
        step_m = 0.1
        channels = ["HH", "VV"]
        sweeps_per_channel = 3
        [optics]
        angles_deg = [0, 60, 120]
        frames_per_angle = 2
        settle_s = 0
    """
    assert brief_steps(text) == [
        "MoveTo -0.1 0", "Settle 0.2", "SelectChannel HH", "RecordSweeps 3 0 HH", "SelectChannel VV",
        "RecordSweeps 3 0 VV", "Checkpoint 0",
        "MoveTo 0 1", "Settle 0.2", "StartTurn 0", "SelectChannel HH", "RecordSweeps 3 1 HH", "SelectChannel VV",
        "RecordSweeps 3 1 VV", "TurnPolarizer 0", "Expose 2 0 False None", "TurnPolarizer 60", "Expose 2 60 False None",
        "TurnPolarizer 120", "Expose 2 120 False None", "Checkpoint 1",
        "MoveTo 0.1 2", "Settle 0.2", "SelectChannel HH", "RecordSweeps 3 2 HH", "SelectChannel VV",
        "RecordSweeps 3 2 VV", "Checkpoint 2",
    ]  # fmt: skip


def test_a_file_without_a_kind_is_a_rail_collect() -> None:
    assert isinstance(plan("aperture_m = 1.0"), RailSarPlan)


def test_channels_alternate() -> None:
    text = 'aperture_m = 0.1\nstep_m = 0.1\nchannels = ["HH", "HV", "VV"]\nchannel_order = "alternate"'
    records = [line.split()[-2:] for line in brief_steps(text) if line.startswith("RecordSweeps")]
    assert records == [["0", "HH"], ["0", "HV"], ["0", "VV"], ["1", "VV"], ["1", "HV"], ["1", "HH"]]


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ("forward", ["-0.1 0", "0 1", "0.1 2", "-0.1 3", "0 4", "0.1 5"]),
        ("reverse", ["0.1 0", "0 1", "-0.1 2", "0.1 3", "0 4", "-0.1 5"]),
        ("serpentine", ["-0.1 0", "0 1", "0.1 2", "0.1 3", "0 4", "-0.1 5"]),
    ],
)
def test_track_orders(order: str, expected: list[str]) -> None:
    text = f'aperture_m = 0.2\nstep_m = 0.1\ntrack_order = "{order}"\npasses = 2'
    assert moves(text) == [f"MoveTo {place}" for place in expected]
    loaded = plan(text)
    assert [f"{visit.x_m:g} {visit.position}" for visit in loaded.visits()] == expected
    # The middle is place 1 in whatever order: what is read is averaged by place.
    assert [visit.place for visit in loaded.visits() if visit.x_m == 0] == [1, 1]


def test_repeats_bring_the_polarizer_series_again_and_passes_do_not() -> None:
    text = "aperture_m = 0.2\nstep_m = 0.1\npasses = 2\nrepeats = 2\n[optics]\nframes_per_angle = 1"
    exposures = [line for line in brief_steps(text) if line.startswith("Expose")]
    assert len(exposures) == 2 * 4
    assert len(moves(text)) == 2 * 2 * 3


def test_waits_for_the_operator_stand_between_positions() -> None:
    steps = brief_steps('kind = "rail_sar"\naperture_m = 0.4\nstep_m = 0.1\nchannels = ["HH"]\npause_every = 2')
    # 5 positions: after the 2nd and the 4th, and not after the last one of 6.
    places = [i for i, line in enumerate(steps) if line == "Ask"]
    assert [(steps[i - 1], steps[i + 1]) for i in places] == [
        ("Checkpoint 1", "MoveTo 0 2"),
        ("Checkpoint 3", "MoveTo 0.2 4"),
    ]
    assert brief_steps("aperture_m = 0.2\nstep_m = 0.1\npause_every = 3").count("Ask") == 0


def test_continuous_sar_at_constant_speed() -> None:
    text = """
        kind = "continuous_sar"
        aperture_m = 1.0
        run_up_m = 0.1
        speed_m_s = 0.2
        channels = ["HH", "VV"]
        move_settle_s = 0
        block_s = 0.5
        passes = 2
    """
    assert brief_steps(text) == [
        "MoveTo -0.6 0", "SelectChannel HH", "RecordPass -0.6 0.6 0.2 0 HH 0.5", "Checkpoint 0",
        "MoveTo 0.6 10000", "SelectChannel VV", "RecordPass 0.6 -0.6 0.2 10000 VV 0.5", "Checkpoint 1",
        "MoveTo -0.6 20000", "SelectChannel HH", "RecordPass -0.6 0.6 0.2 20000 HH 0.5", "Checkpoint 2",
        "MoveTo 0.6 30000", "SelectChannel VV", "RecordPass 0.6 -0.6 0.2 30000 VV 0.5", "Checkpoint 3",
    ]  # fmt: skip


def test_continuous_sar_pushed_along_an_encoder() -> None:
    text = """
        kind = "continuous_sar"
        aperture_m = 1.0
        drive = "encoder"
        channels = ["HH"]
        track_order = "reverse"
        [optics]
        angles_deg = [0, 60, 120]
        settle_s = 0
    """
    assert brief_steps(text) == [
        "MoveTo 0.5 0", "Settle 0.2", "SelectChannel HH", "RecordPass 0.5 -0.5 None 0 HH 1", "Checkpoint 0",
        "StartTurn 0", "MoveTo 0 10000", "TurnPolarizer 0", "Expose 4 0 False None", "TurnPolarizer 60",
        "Expose 4 60 False None", "TurnPolarizer 120", "Expose 4 120 False None", "Checkpoint 0",
    ]  # fmt: skip


def test_ranging() -> None:
    assert brief_steps('kind = "ranging"\nseconds = 2.5\nchannel = "VV"\nrepeats = 2\nx_m = 0.3') == [
        "MoveTo 0.3 0", "SelectChannel VV", "RecordSeconds 2.5 0 VV", "Checkpoint 0",
        "SelectChannel VV", "RecordSeconds 2.5 1 VV", "Checkpoint 1",
    ]  # fmt: skip
    # Without x_m the trolley stays where it stands.
    assert brief_steps('kind = "ranging"\nsweeps = 50') == ["SelectChannel HH", "RecordSweeps 50 0 HH", "Checkpoint 0"]


def test_doppler_is_asked_for_before_and_ended_after() -> None:
    text = 'kind = "doppler"\nseconds = 4'
    assert brief_steps(text) == ["Ask", "SelectChannel HH", "RecordSeconds 4 0 HH", "Checkpoint 0", "Ask"]
    assert prompts(text) == [CW_ON, CW_OFF]
    assert prompts(text + "\nask_cw = false") == []


def test_sky() -> None:
    assert brief_steps('kind = "sky"\nchannels = ["HV", "VH"]\nsweeps_per_channel = 9\nrepeats = 2') == [
        "SelectChannel HV", "RecordSweeps 9 0 HV", "SelectChannel VH", "RecordSweeps 9 0 VH", "Checkpoint 0",
        "SelectChannel HV", "RecordSweeps 9 1 HV", "SelectChannel VH", "RecordSweeps 9 1 VH", "Checkpoint 1",
    ]  # fmt: skip
    # Files of earlier versions could hold a rail's fields, which were of no effect.
    assert brief_steps('kind = "sky"\naperture_m = 3.0\nstep_m = 0.1\nmove_settle_s = 1.0') == brief_steps(
        'kind = "sky"'
    )


CALIBRATION = """
    kind = "calibration_series"
    channels = ["HH"]
    sweeps_per_channel = 5
    aperture_m = 0.1
    step_m = 0.1
    move_settle_s = 0
    repeats = 2
    [[targets]]
    name = "corner"
    kind = "trihedral_square"
    edge_m = 1.2
    range_m = 3.6
    [[targets]]
    name = "plate"
    kind = "plate"
    edge_m = 0.6
    range_m = 4.0
    x_m = 0.5
"""


def test_calibration_series() -> None:
    def position(x: str, number: int) -> list[str]:
        return [f"MoveTo {x} {number}", "SelectChannel HH", f"RecordSweeps 5 {number} HH", f"Checkpoint {number}"]

    assert brief_steps(CALIBRATION) == [
        "Ask", "Mark target corner, repeat 1 of 2", *position("-0.05", 0), *position("0.05", 1),
        "Mark target corner, repeat 2 of 2", *position("-0.05", 2), *position("0.05", 3),
        "Ask", "Mark target plate, repeat 1 of 2", *position("-0.05", 4), *position("0.05", 5),
        "Mark target plate, repeat 2 of 2", *position("-0.05", 6), *position("0.05", 7),
    ]  # fmt: skip
    first, second = prompts(CALIBRATION)
    assert "corner (trihedral with square faces, edge 1.2 m) at a ground range of 3.6 m" in first
    assert "plate (plate, edge 0.6 m) at a ground range of 4 m, x = 0.5 m" in second
    assert len(prompts(CALIBRATION.replace("repeats = 2", "repeats = 2\nplace_again = true"))) == 4


def test_visits_tell_which_records_are_averaged() -> None:
    loaded = plan(CALIBRATION)
    assert isinstance(loaded, CalibrationSeriesPlan)
    assert [(v.position, v.target, v.repeat, v.place) for v in loaded.visits()] == [
        (0, "corner", 0, 0), (1, "corner", 0, 1), (2, "corner", 1, 0), (3, "corner", 1, 1),
        (4, "plate", 0, 0), (5, "plate", 0, 1), (6, "plate", 1, 0), (7, "plate", 1, 1),
    ]  # fmt: skip


def test_polarizer_series_with_dark_frames() -> None:
    text = 'kind = "polarizer_series"\nangles_deg = [0, 60, 120]\nframes_per_angle = 2\ndark_frames = 3\nsettle_s = 0.1'
    assert brief_steps(text) == [
        "TurnPolarizer 0", "Ask", "Expose 3 0 True None", "Ask",
        "TurnPolarizer 0", "Settle 0.1", "Expose 2 0 False None", "TurnPolarizer 60", "Settle 0.1",
        "Expose 2 60 False None", "TurnPolarizer 120", "Settle 0.1", "Expose 2 120 False None", "Checkpoint 0",
    ]  # fmt: skip
    assert prompts(text) == [COVER, UNCOVER]
    # The dark frames are taken with the exposure that is found.
    found = brief_steps(text + "\nauto_exposure = true")
    assert found[0].startswith("AutoExpose")
    assert found[1] == "TurnPolarizer 0"
    # A camera with a mosaic has nothing to turn.
    assert brief_steps(text, mosaic=True) == [
        "Ask",
        "Expose 3 0 True None",
        "Ask",
        "Expose 2 0 False None",
        "Checkpoint 0",
    ]


def test_active_optical() -> None:
    text = 'kind = "active_optical"\nframes_per_pair = 2\nsettle_s = 0\ndark_frames = 1\nambient_frames = 3'
    assert brief_steps(text) == [
        "TurnPolarizer 0", "Ask", "Expose 1 0 True None", "Ask",
        "Ask", "TurnPolarizer 0", "Expose 3 0 False None", "TurnPolarizer 90", "Expose 3 90 False None", "Ask",
        "TurnSource 0", "TurnPolarizer 0", "Expose 2 0 False 0", "TurnPolarizer 90", "Expose 2 90 False 0",
        "TurnSource 90", "TurnPolarizer 90", "Expose 2 90 False 90", "TurnPolarizer 0", "Expose 2 0 False 90",
        "Checkpoint 0",
    ]  # fmt: skip
    assert prompts(text) == [COVER, UNCOVER, LAMP_OFF, LAMP_ON]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            'kind = "rail_sr"',
            "line 1, kind: found 'rail_sr' (did you mean 'rail_sar'?), allowed: rail_sar, continuous_sar",
        ),
        ("kind = 3", "line 1, kind: found 3, allowed"),
        ('kind = "ranging"\nseconds = 1\nsteps_m = 0.1', "line 3, steps_m: found a key that is not known"),
        ('kind = "ranging"', "either seconds or sweeps"),
        ('kind = "ranging"\nseconds = 1\nsweeps = 2', "either seconds or sweeps"),
        ('kind = "continuous_sar"', 'speed_m_s is needed with drive = "constant_speed"'),
        ('kind = "continuous_sar"\ndrive = "encoder"\nspeed_m_s = 1', "speed_m_s is left out"),
        ('kind = "continuous_sar"\nspeed_m_s = 1\nchannels = ["HH", "HH"]', "each named once"),
        ('kind = "continuous_sar"\nspeed_ms = 1', "did you mean 'speed_m_s'"),
        ('kind = "calibration_series"', "targets: found nothing"),
        ('kind = "calibration_series"\ntargets = []', "targets"),
        (
            CALIBRATION.replace("edge_m = 0.6", 'edge_m = "2 ft"'),
            "line 17, targets.1.edge_m: found '2 ft', allowed: a valid number",
        ),
        (CALIBRATION.replace('name = "plate"', 'name = "corner"'), "different names"),
        (CALIBRATION.replace('"trihedral_square"', '"sphere"'), "'trihedral', 'trihedral_square', 'dihedral'"),
        ('kind = "doppler"\nsweeps = 3', "sweeps: found a key that is not known"),
        ('kind = "sky"\nstep = 3', "line 2, step: found a key that is not known"),
    ],
)
def test_mistakes_are_answered_with_line_found_and_allowed(text: str, expected: str) -> None:
    with pytest.raises(FileMistake) as caught:
        plan(text)
    assert expected in str(caught.value)
    assert str(caught.value).startswith("plan.toml: ")


def test_a_list_of_wrong_items_is_one_mistake() -> None:
    with pytest.raises(FileMistake) as caught:
        plan('kind = "calibration_series"\n[[targets]]\nname = "a"\nkind = "plate"\nedge_m = 0\nrange_m = 3')
    assert len(caught.value.mistakes) == 1


def test_every_kind_says_its_own_name() -> None:
    assert set(PLAN_KINDS) == {
        "rail_sar", "continuous_sar", "ranging", "doppler", "sky", "calibration_series", "polarizer_series",
        "active_optical", "custom",
    }  # fmt: skip
    for kind, model in PLAN_KINDS.items():
        assert model.model_fields["kind"].default == kind
        assert all(field.description for field in model.model_fields.values()), kind
