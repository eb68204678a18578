"""Images, numbered sequences, photographs, raw frames and movies."""
