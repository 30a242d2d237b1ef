"""Many trainings side by side: which to do, in which process, and what has been done before."""
