"""The networks of latent models: product of experts, VTT and concatenation, with decoder and dynamics."""
