"""Foreign recordings into session files."""

from polfuse_lab.imports.wav import WavImport, import_wav

__all__ = ["WavImport", "import_wav"]
