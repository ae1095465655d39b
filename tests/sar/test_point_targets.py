"""Point targets over a whole scene; the full number of places: ``python -m benchmarks accuracy.focus_points``."""

from benchmarks.accuracy_focus_points import run


def test_points_are_what_theory_has_wherever_they_stand():
    # Limits of the rows: -13.26 dB within 0.1 dB, widths within 1 %, phase within 1 degree; on the rail those of the
    # exact integral in float64.
    rows = run(quick=True)
    assert {row.name.split(".")[1] for row in rows} == {"points_flight", "points_rail"}
    assert [row for row in rows if not row.ok] == []
