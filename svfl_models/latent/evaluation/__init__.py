"""Evaluates a pretrained latent model (``svfl-train latent-eval``) on episodes that it was not trained on.

The files are best read in this order: `episodes` chooses the episodes and `frames` computes the model's outputs on
them. One file follows for each question: `reconstruction`, `contact`, `alignment`, `following` (the next
proprioception), `probing` (linear probes), `missing` (missing modalities), `attention` and `experts` (the weight of
each expert), `symmetry`. `evaluate` runs all of them, and `pages` writes the results.
"""
