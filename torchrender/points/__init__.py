"""Point models: files, trees, compression, drawing."""
