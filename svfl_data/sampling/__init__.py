"""Training samples from episodes: windows, batches, splits and statistics."""
