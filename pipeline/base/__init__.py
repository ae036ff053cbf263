"""What every stage needs and knows nothing of scenes: errors, files, frames, progress, tables, pages."""
