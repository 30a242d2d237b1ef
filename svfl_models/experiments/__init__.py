"""Tables of many training runs: the runs, done in parallel on all cores or GPUs, and the page that shows them."""
