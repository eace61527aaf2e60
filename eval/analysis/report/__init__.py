"""``vuca report``: evaluations as Markdown pages, as CSV tables and as one HTML page."""
