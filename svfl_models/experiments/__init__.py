"""Tables of many training runs: the runs, in parallel on all cores or GPUs, and the page with their results."""
