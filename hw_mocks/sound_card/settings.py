"""Settings of the simulated sound card: the ``[audio]`` table of a scene file."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from polfuse_lab.rig import FileModel


class AudioSettings(FileModel):
    """The radar's audio port as simulated: beat and sync, 16 bits."""

    sample_rate_hz: float = Field(default=48_000.0, ge=8_000, le=384_000)
    """Nominal sample rate, Hz."""
    sweep_period_samples: float = Field(default=1920.5, gt=16)
    """True sweep period (up and down) in samples; need not be whole."""
    noise_cycle: int = Field(default=2, ge=1, le=64)
    """Sweeps after which noise and sweep phase repeat; that many periods are a whole number of samples."""
    sync_amplitude: float = Field(default=0.7, gt=0, le=1)
    """Sync, fraction of full scale."""
    sync_edge_samples: float = Field(default=3.0, ge=2, le=16)
    """Length of a sync edge, samples."""
    sync_noise: float = Field(default=0.0005, ge=0, le=1)
    """Noise of the sync channel, rms, fraction of full scale."""
    sync_channel: Literal[0, 1] = 1
    """Channel that carries the sync; the other one carries the beat."""
    sync_inverted: bool = False
    """Whether the sync is low during the up-ramp."""
    clock_drift_ppm: float = Field(default=0.0, ge=-1000, le=1000)
    """How much faster the sound card's clock runs than the computer's, parts per million."""

    @model_validator(mode="after")
    def _whole_cycle(self) -> AudioSettings:
        cycle = self.sweep_period_samples * self.noise_cycle
        if abs(cycle - round(cycle)) > 1e-6:
            raise ValueError(f"noise_cycle x sweep_period_samples ({cycle:g}) is a whole number of samples")
        return self

    @property
    def cycle_samples(self) -> int:
        """Samples after which a standing rig's signal repeats."""
        return round(self.sweep_period_samples * self.noise_cycle)

    @property
    def true_rate_hz(self) -> float:
        """Samples a second by the computer's clock."""
        return self.sample_rate_hz * (1 + self.clock_drift_ppm * 1e-6)
