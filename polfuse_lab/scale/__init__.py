"""Images and collects larger than memory, by tiles; tiles and batches of sessions on many processes."""
