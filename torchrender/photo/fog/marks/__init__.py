"""What a user marks in a photo, and the files that hold it."""
