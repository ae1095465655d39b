"""The simulated sound card: beat and sync of the scene's radar, over PulseAudio, an ALSA file or loopback TCP."""

from hw_mocks.sound_card.alsa_file import AlsaFile
from hw_mocks.sound_card.feeder import Sink, SoundCard
from hw_mocks.sound_card.paths import available_paths
from hw_mocks.sound_card.pulse import PulseSource
from hw_mocks.sound_card.settings import AudioSettings
from hw_mocks.sound_card.stream_server import StreamServer
from hw_mocks.sound_card.synthesizer import Synthesizer

__all__ = [
    "AlsaFile",
    "AudioSettings",
    "PulseSource",
    "Sink",
    "SoundCard",
    "StreamServer",
    "Synthesizer",
    "available_paths",
]
