"""Accuracy levels of one scene side by side: what is compared, the picture, and the page."""
