"""What a run leaves in its folder, `outputs/<scene>/<level>`."""
