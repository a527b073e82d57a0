"""Systems that are no pass of a picture: their settings against error and time, one module each."""
