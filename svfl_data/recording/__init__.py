"""How an episode grows: appending, the journal, sealing, and what is saved after a crash."""
