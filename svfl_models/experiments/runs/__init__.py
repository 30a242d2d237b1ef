"""Running of many trainings in parallel: which runs to do, in which process, and which were done before."""
