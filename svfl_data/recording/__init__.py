"""Recording of an episode: appending, the journal, sealing, and salvage after a crash."""
