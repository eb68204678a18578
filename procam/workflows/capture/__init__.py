"""Shows a plan of patterns and stores the photographs, driven by procam or by hand."""
