"""The radar's stereo audio port: beat on one channel, sync on the other."""
