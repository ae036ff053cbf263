"""Between a scene and the solver: its set-up, its run from frame to frame, the files of what it cost."""
