"""Reports about recorded data: a picture of an episode, a dataset card, and the interval of a success rate."""
