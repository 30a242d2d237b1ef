"""From episodes to training samples: windows, batches, splits and statistics."""
