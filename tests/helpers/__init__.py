"""What several test modules share: builders, stand-ins, and ways to run programs."""
