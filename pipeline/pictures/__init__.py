"""Marks, panels and views, of which the render stage and the pages make their pictures."""
