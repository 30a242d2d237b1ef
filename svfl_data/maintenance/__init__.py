"""Changes to whole datasets: repairing, merging, filtering, relabelling and packing."""
