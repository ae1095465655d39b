"""Camera frames: their exposure, and whether a polarizer turned meanwhile."""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import cast

from drivers.contracts import ExposureControl
from drivers.errors import DeviceError
from drivers.records import Frame, PolarizerFix
from polfuse_lab.plans.steps import AutoExpose, Expose
from polfuse_lab.records import Event, Exposure, FrameFlag, SourceFix
from polfuse_lab.scheduler.context import Context
from polfuse_lab.scheduler.control import Aborted
from polfuse_lab.scheduler.motion import Motion
from polfuse_lab.scheduler.watch import Seen, Watch, camera_watch

FRAME_SLACK_S = 10.0
MOVED_RAD = math.radians(0.5)
"""A polarizer that was seen so far from where it was turned to has moved: 1 % of the light at 45 degrees to it."""


class Frames:
    """Takes camera frames and counts them."""

    def __init__(self, context: Context, motion: Motion) -> None:
        self._context = context
        self._motion = motion
        self._exposure_s = context.rig.camera.exposure_s if context.rig.camera is not None else 0.0
        self._exposure_found = False
        self._exposures: Counter[tuple[float, float | None]] = Counter()
        self._watch: Watch | None = None
        self.frames = 0
        """Frames kept: the next one has this number."""
        self.frames_lost = 0

    @property
    def _polarizers(self) -> Watch:
        if self._watch is None:
            self._watch = camera_watch(self._context)
        return self._watch

    def expose(self, step: Expose) -> None:
        """Take frames at the present angles. Raises as a step."""
        context = self._context
        source = step.source_angle_rad
        key = (round(step.angle_rad, 6), None if source is None else round(source, 6))
        for _ in range(step.frames):
            for retry in range(context.plan.retries + 1):
                frame, flags = self._take(step, self._exposures[key], FrameFlag.RETRY if retry else FrameFlag.NONE)
                if not frame.incomplete and not flags & FrameFlag.MOVED:
                    break
                what = "incomplete" if frame.incomplete else "taken while a polarizer moved"
                if retry == context.plan.retries:
                    raise DeviceError(
                        f"each of {retry + 1} frames was {what}",
                        where="camera" if frame.incomplete else "polarizer",
                        advice="check its network (jumbo frames, packet delay) and its cable"
                        if frame.incomplete
                        else "look what turns it, and whether its motor holds",
                    )
                article = "an incomplete camera frame" if frame.incomplete else f"a camera frame {what}"
                context.warn(f"{article} at {math.degrees(step.angle_rad):.1f} deg was taken again")
                if flags & FrameFlag.MOVED:
                    self._turn_back()
        self._exposures[key] += 1

    def _take(self, step: Expose, attempt: int, flags: FrameFlag) -> tuple[Frame, FrameFlag]:
        """One frame, kept with what is to be known of it."""
        context = self._context
        angle, source = self._motion.angle, self._motion.source_angle
        self._polarizers.begin()
        context.devices.call("camera", context.devices.camera.trigger)
        frame = self._await_frame(self._exposure_s)
        end_ns = frame.t_host_ns + round(frame.exposure_s * 1e9)
        failure: DeviceError | Aborted | None = None
        try:
            seen = self._polarizers.complete(self.frames, end_ns)
            flags |= _moved(angle, [fix for fix in seen if isinstance(fix, PolarizerFix)])
            flags |= _moved(source, [fix.fix for fix in seen if isinstance(fix, SourceFix)])
        except (DeviceError, Aborted) as error:
            # The frame is kept, but nobody can vouch for the angles.
            failure = error
            flags |= FrameFlag.MOVED
        self.frames_lost += frame.lost_before + int(frame.incomplete)
        source_rad = step.source_angle_rad if source is None else source.angle_rad
        self.frames += 1
        context.keep(
            Exposure(
                frame,
                angle.angle_rad if angle is not None else step.angle_rad,
                angle.sd_rad if angle is not None else 0.0,
                step.dark,
                attempt,
                source_rad,
                0.0 if source is None else source.sd_rad,
                flags,
            )
        )
        if failure is not None:
            raise failure
        return frame, flags

    def _turn_back(self) -> None:
        angle, source = self._motion.angle, self._motion.source_angle
        if angle is not None:
            self._motion.turn(angle.angle_rad)
        if source is not None:
            self._motion.turn_source(source.angle_rad)

    def auto_expose(self, step: AutoExpose) -> None:
        """Find the exposure with frames that are not kept. One that suits badly is only a warning."""
        from drivers.camera.auto_exposure import ExposureGoal, Seen, search

        context, devices = self._context, self._context.devices
        section = context.rig.camera
        assert section is not None
        control = cast(ExposureControl, devices.camera)
        if self._exposure_found:
            # A series that is repeated goes on with the exposure of its first frames.
            self._exposure_s = devices.call("camera", control.set_exposure, self._exposure_s)
            return
        goal = ExposureGoal(
            devices.call("camera", control.exposure_limits), section.saturation_counts, section.black_level_counts
        )
        asking = search(goal, self._exposure_s, max(len(step.angles_rad), 1))
        at: int | None = None
        seen: Seen | None = None
        while True:
            try:
                look = next(asking) if seen is None else asking.send(seen)
            except StopIteration as end:
                found = end.value
                break
            if step.angles_rad and look.angle != at:
                self._motion.turn(step.angles_rad[look.angle])
                at = look.angle
            self._exposure_s = devices.call("camera", control.set_exposure, look.exposure_s)
            devices.call("camera", devices.camera.trigger)
            image = self._await_frame(self._exposure_s).image
            seen = Seen(self._exposure_s, goal.level(image))
            context.keep(exposure_look(goal.limits_s, self._exposure_s, int(image.max())))
        # The camera stands at the last exposure looked at, which is the one found.
        self._exposure_found = True
        if found.problem:
            context.warn(f"automatic exposure: {found.problem}")
        context.event("exposure", f"exposure {found.exposure_s:g} s after {found.looks} frames")

    def _await_frame(self, exposure_s: float) -> Frame:
        context, camera = self._context, self._context.devices.camera
        expected = context.control.now() + exposure_s
        while (frame := context.devices.call("camera", camera.poll)) is None:
            context.in_time(expected + FRAME_SLACK_S, "camera", "delivered no frame")
            self._polarizers.tick(expected - context.control.now())
            context.control.slice(0.005)
        return frame


def _moved(stood: PolarizerFix | None, fixes: list[PolarizerFix]) -> FrameFlag:
    """Whether a polarizer was seen turning, or more than :data:`MOVED_RAD` (modulo pi) from where it stood."""
    for fix in fixes:
        away = 0.0 if stood is None else math.remainder(fix.angle_rad - stood.angle_rad, math.pi)
        if fix.moving or abs(away) > MOVED_RAD:
            return FrameFlag.MOVED
    return FrameFlag.NONE


def exposure_look(limits_s: tuple[float, float], exposure_s: float, peak: int) -> Event:
    """What a look of the search for an exposure showed, to the last bit: the search can be gone through again by it."""
    low, high = limits_s
    text = f"exposure {float(exposure_s)!r} s of {float(low)!r} to {float(high)!r} s, brightest pixel {peak} counts"
    return Event("look", text, time.monotonic_ns())
