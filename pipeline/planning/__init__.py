"""The surgeon's question: the smallest fill that covers a break of the retina, with which oil, in which posture."""
