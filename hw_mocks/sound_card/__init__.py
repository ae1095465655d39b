"""The simulated sound card: beat and sync of the scene's radar, over PulseAudio, JACK, an ALSA file or loopback TCP."""

from hw_mocks.sound_card.alsa_file import AlsaFile
from hw_mocks.sound_card.card_faults import CARD_FAULTS
from hw_mocks.sound_card.feeder import Sink, SoundCard, Source
from hw_mocks.sound_card.jack_card import JackCard
from hw_mocks.sound_card.paths import available_paths
from hw_mocks.sound_card.pulse import PulseSource
from hw_mocks.sound_card.settings import AudioSettings
from hw_mocks.sound_card.stream_server import StreamServer
from hw_mocks.sound_card.synthesizer import Synthesizer

__all__ = [
    "CARD_FAULTS",
    "AlsaFile",
    "AudioSettings",
    "JackCard",
    "PulseSource",
    "Sink",
    "SoundCard",
    "Source",
    "StreamServer",
    "Synthesizer",
    "available_paths",
]
