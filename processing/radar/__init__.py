"""The radar: its beat and antennas, sync, range profiles, Doppler and tracks."""
