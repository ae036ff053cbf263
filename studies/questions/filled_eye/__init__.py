"""What a fill of oil or gas touches in every posture."""
