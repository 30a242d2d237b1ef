"""Networks of latent models: the encoders PoE, VTT and concatenation, the decoder and the dynamics."""
