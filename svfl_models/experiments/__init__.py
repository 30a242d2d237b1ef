"""Tables of many training runs: which runs, side by side on all cores or GPUs, and the page that shows them."""
