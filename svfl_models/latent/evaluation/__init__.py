"""What a pretrained latent model is worth: ``svfl-train latent-eval``, on episodes that it has not learned from.

The order of reading: `episodes` (which), `frames` (what the model makes of them), then one file per question:
`reconstruction`, `contact`, `alignment`, `following` (the next gripper), `probes`, `missing` (modalities), `attention`
and `experts` (the weight of each expert), `symmetry`; `evaluate` asks them all, `report` and `figures` write the
answers down.
"""
