"""What a simple regression can read off a latent."""
